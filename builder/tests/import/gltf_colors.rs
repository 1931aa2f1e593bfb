//! Colours of glTF files as programs write them: opacity of materials and vertices, emission, wrap modes, and images in every
//! format.

use esvo_builder::{Mesh, Wrap};
use serde_json::{Value, json};

use crate::gltf_document::{BLUE, Document, RED, both_squares, colors, counts, red_sheet, square_of};
use crate::support::{lines, png, voxels};

#[test]
fn opacity_0_is_invisible() {
    let mut document = Document::two_squares();
    document.material(0)["alphaMode"] = "BLEND".into();
    assert_eq!(colors(&document.mesh(), 4), both_squares());
    document.material(0)["pbrMetallicRoughness"]["baseColorFactor"] = json!([1, 0, 0, 0]);
    let mesh = document.mesh();
    assert_eq!(colors(&mesh, 4), square_of(BLUE));
    assert_eq!(mesh.warnings, ["material material 0 blends and its opacity is 0; it is left out"]);
    // In the texture.
    let mut document = Document::two_squares();
    let uvs = document.floats("VEC2", &[0.0; 8]);
    document.attributes(0)["TEXCOORD_0"] = uvs.into();
    let texture = document.texture(&png(1, 1, &[[255, 0, 0, 0]]));
    document.material(0)["pbrMetallicRoughness"] = json!({"baseColorTexture": {"index": texture}});
    document.material(0)["alphaMode"] = "BLEND".into();
    assert_eq!(colors(&document.mesh(), 4), square_of(BLUE));
    document.material(0)["alphaMode"] = "OPAQUE".into();
    assert_eq!(colors(&document.mesh(), 4), both_squares());
}

#[test]
fn the_opacity_of_vertices_cuts_masked_and_blended_materials() {
    let with = |mode: &str, alphas: [u8; 4]| {
        let mut document = Document::two_squares();
        let colors = document.bytes(&alphas.map(|a| [255, 255, 255, a]), true);
        document.attributes(0)["COLOR_0"] = colors.into();
        document.material(0)["alphaMode"] = mode.into();
        document
    };
    assert_eq!(colors(&with("MASK", [0; 4]).mesh(), 4), square_of(BLUE));
    assert_eq!(colors(&with("BLEND", [0; 4]).mesh(), 4), square_of(BLUE));
    for (mode, alphas) in [("OPAQUE", [0; 4]), ("MASK", [128; 4]), ("BLEND", [1; 4])] {
        assert_eq!(colors(&with(mode, alphas).mesh(), 4), both_squares(), "{mode} {alphas:?}");
    }
    // Without colours of vertices, the opacity of the material decides alone.
    let mut document = Document::two_squares();
    document.material(0)["alphaMode"] = "MASK".into();
    document.material(0)["pbrMetallicRoughness"]["baseColorFactor"] = json!([1, 0, 0, 0.2]);
    assert_eq!(colors(&document.mesh(), 4), square_of(BLUE));
    // The right half: the opacity grows from left to right.
    let mut document = with("MASK", [0, 255, 255, 0]);
    let red: Vec<[u32; 3]> = voxels(&document.mesh(), 6).iter().filter(|l| l.1 == RED).map(|l| l.0).collect();
    // In 64ths of 3: the square ends at 21.3.
    let (first, last) = (red.iter().map(|at| at[0]).min(), red.iter().map(|at| at[0]).max());
    assert_eq!((first, last), (Some(10), Some(21)));
    // With another cutoff, and the opacity of the material.
    document.material(0)["alphaCutoff"] = json!(0.2);
    document.material(0)["pbrMetallicRoughness"]["baseColorFactor"] = json!([1, 0, 0, 0.8]);
    let red = voxels(&document.mesh(), 6).iter().filter(|l| l.1 == RED).map(|l| l.0[0]).min();
    assert_eq!(red, Some(5));
}

#[test]
fn the_opacity_of_vertices_and_of_texels_multiply() {
    let mut document = Document::textured_square();
    // The left half of the image has an opacity of 0.6.
    let texture = document.texture(&png(2, 1, &[[255, 0, 0, 153], [255, 0, 0, 255]]));
    document.material(0)["pbrMetallicRoughness"] = json!({"baseColorTexture": {"index": texture}});
    document.material(0)["alphaMode"] = "MASK".into();
    let full = voxels(&document.mesh(), 4).len();
    let alphas = document.bytes(&[[255, 255, 255, 178]; 4], true);
    document.attributes(0)["COLOR_0"] = alphas.into();
    let mesh = document.mesh();
    assert_eq!(mesh.warnings, [""; 0]);
    let half = voxels(&mesh, 4).len();
    assert!(half * 10 > full * 3 && half * 10 < full * 8, "{half} of {full}");
    let varying = document.bytes(&[255, 255, 178, 178].map(|a| [255, 255, 255, a]), true);
    document.attributes(0)["COLOR_0"] = varying.into();
    let warnings = document.mesh().warnings;
    assert_eq!(
        warnings,
        [
            "mesh 0, primitive 0: the opacity of its vertices varies over a texture with holes (cutoff 0.5); the mean of each \
          triangle is used"
        ]
    );
}

#[test]
fn each_opacity_of_vertices_over_holes_keeps_only_its_own_vertices() {
    let mut document = Document::textured_square();
    let texture = document.texture(&png(2, 1, &[[255, 0, 0, 0], [255, 0, 0, 255]]));
    document.material(0)["pbrMetallicRoughness"] = json!({"baseColorTexture": {"index": texture}});
    document.material(0)["alphaMode"] = "MASK".into();
    // A strip of 100 separate triangles, each with an opacity of its own.
    let (mut positions, mut uvs, mut colors) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..100u8 {
        let x = f32::from(i);
        positions.extend([x, 0.0, 0.0, x + 1.0, 0.0, 0.0, x, 1.0, 0.0]);
        uvs.extend([0.0, x, 1.0, x, 0.0, x + 1.0]);
        colors.extend([[255, 255, 255, 150 + i]; 3]);
    }
    let attributes = json!({
        "POSITION": document.floats("VEC3", &positions), "NORMAL": document.floats("VEC3", &[0.0, 0.0, 1.0].repeat(300)),
        "TEXCOORD_0": document.floats("VEC2", &uvs), "COLOR_0": document.bytes(&colors, true),
    });
    *document.primitive(0) = json!({"attributes": attributes, "material": 0});
    let mesh = document.mesh();
    assert_eq!((mesh.triangle_count(), mesh.positions.len(), mesh.uvs.len(), mesh.normals.len()), (100, 300, 300, 300));
    for (i, triangle) in mesh.triangles.iter().enumerate() {
        let x = i as f32;
        let corners = triangle.map(|v| (mesh.positions[v as usize], mesh.uvs[v as usize]));
        let place = |right: f32, up: f32| ([f64::from(x + right), f64::from(up), 0.0], [right, x + up]);
        assert_eq!(corners, [place(0.0, 0.0), place(1.0, 0.0), place(0.0, 1.0)]);
        let opacity = mesh.materials[mesh.triangle_materials[i] as usize].base_color[3];
        assert_eq!((opacity * 255.0).round(), 150.0 + x);
    }
}

#[test]
fn a_black_texture_over_an_emitted_colour_still_cuts_holes() {
    let mut document = Document::textured_square();
    let black = document.texture(&png(2, 1, &[[0, 0, 0, 0], [0, 0, 0, 255]]));
    *document.material(0) = json!({
        "pbrMetallicRoughness": {"baseColorTexture": {"index": black}}, "emissiveFactor": [0, 0, 1], "alphaMode": "MASK",
    });
    let mesh = document.mesh();
    let found = colors(&mesh, 4);
    assert!(found.keys().eq([&BLUE]) && (112..=144).contains(&found[&BLUE]) && mesh.warnings.is_empty(), "{found:?}");
    document.material(0)["alphaMode"] = "OPAQUE".into();
    assert_eq!(colors(&document.mesh(), 4), counts([(BLUE, 256)]));
    // Without coordinates for the texture, it cuts nothing.
    document.material(0)["alphaMode"] = "MASK".into();
    document.attributes(0).as_object_mut().unwrap().remove("TEXCOORD_0");
    let mesh = document.mesh();
    assert_eq!(colors(&mesh, 4), counts([(BLUE, 256)]));
    assert_eq!(mesh.warnings, ["mesh 0, primitive 0 has no TEXCOORD_0 for its texture; it gets its plain colour"]);
}

#[test]
fn emission_is_the_colour_where_the_base_colour_is_black() {
    const GREEN: [u8; 4] = [0, 200, 0, 255];
    let sheet = || counts([([0, 200, 0], 256)]);
    let mut document = Document::textured_square();
    let green = document.texture(&png(2, 2, &[GREEN; 4]));
    let black = document.texture(&png(2, 2, &[[0, 0, 0, 255]; 4]));
    let emission = json!({"index": green});
    *document.material(0) = json!({
        "pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]}, "emissiveFactor": [1, 1, 1], "emissiveTexture": emission,
    });
    let mesh = document.mesh();
    assert_eq!((colors(&mesh, 4), mesh.warnings), (sheet(), vec![]));
    // The colours of vertices multiply the base colour only.
    let dark = document.bytes(&[[9, 9, 9, 255]; 4], true);
    document.attributes(0)["COLOR_0"] = dark.into();
    assert_eq!(colors(&document.mesh(), 4), sheet());
    document.attributes(0).as_object_mut().unwrap().remove("COLOR_0");
    document.material(0)["pbrMetallicRoughness"] = json!({"baseColorTexture": {"index": black}});
    assert_eq!(colors(&document.mesh(), 4), sheet());
    // A factor alone, without a texture, over a black texture.
    document.material(0).as_object_mut().unwrap().remove("emissiveTexture");
    document.material(0)["emissiveFactor"] = json!([0, 0, 1]);
    assert_eq!(colors(&document.mesh(), 4), counts([(BLUE, 256)]));
    // Over another colour, or without emission, the base colour counts.
    document.material(0)["pbrMetallicRoughness"] = json!({"baseColorTexture": {"index": green}});
    assert_eq!(colors(&document.mesh(), 4), sheet());
    *document.material(0) = json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": black}}});
    assert_eq!(colors(&document.mesh(), 4), counts([([0; 3], 256)]));
}

/// A square with coordinates from -1, -1 at the top left to 2, 2, and a texture whose top left quarter is red and the rest
/// white, wrapped as the sampler says. With a normal map of the same texture.
fn wrapped(sampler: Value) -> Mesh {
    let mut document = Document::textured_square();
    let uvs = document.floats("VEC2", &[-1.0, 2.0, 2.0, 2.0, 2.0, -1.0, -1.0, -1.0]);
    document.attributes(0)["TEXCOORD_0"] = uvs.into();
    let texel = |i: usize| if i % 64 < 32 && i < 32 * 64 { [255, 0, 0, 255] } else { [255; 4] };
    let texture = document.texture(&png(64, 64, &(0..64 * 64).map(texel).collect::<Vec<_>>()));
    document.push("samplers", sampler);
    document.json["textures"][texture]["sampler"] = 0.into();
    *document.material(0) = json!({
        "pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}, "normalTexture": {"index": texture},
    });
    let mesh = document.mesh();
    assert_eq!(mesh.warnings, [""; 0]);
    mesh
}

#[test]
fn samplers_repeat_mirror_or_clamp() {
    // The coordinate of voxel i is -1 + 3 (i + 0.5) / 16; red where the texture is read below 0.5.
    const MODES: [(u32, Wrap, &str); 3] = [
        (10497, Wrap::Repeat, "rrrwwrrrwwwrrwww"),
        (33648, Wrap::Mirror, "wwwrrrrrwwwwwrrr"),
        (33071, Wrap::Clamp, "rrrrrrrrwwwwwwww"),
    ];
    for (s, wrap_u, row) in MODES {
        for (t, wrap_v, column) in MODES {
            let mesh = wrapped(json!({"wrapS": s, "wrapT": t}));
            let wrap = [wrap_u, wrap_v];
            assert_eq!(mesh.materials[0].texture.as_ref().unwrap().wrap, wrap);
            assert_eq!(mesh.materials[0].normal_map.as_ref().unwrap().texture.wrap, wrap);
            assert_eq!(lines(&mesh), (row.to_owned(), column.to_owned()), "{wrap:?}");
        }
    }
    // The default is to repeat.
    assert_eq!(lines(&wrapped(json!({}))), (MODES[0].2.to_owned(), MODES[0].2.to_owned()));
    // One image with two samplers.
    let mut document = Document::two_squares();
    let first = document.texture(&png(2, 2, &[[255, 0, 0, 255]; 4]));
    let second = document.push("textures", json!({"source": 0, "sampler": 1}));
    document.json["samplers"] = json!([{}, {"wrapS": 33071}]);
    for (mesh, texture) in [(0, first), (1, second)] {
        let uvs = document.floats("VEC2", &[0.5; 8]);
        document.attributes(mesh)["TEXCOORD_0"] = uvs.into();
        document.material(mesh)["pbrMetallicRoughness"]["baseColorTexture"] = json!({"index": texture});
    }
    let wraps = document.mesh().materials.iter().map(|m| m.texture.as_ref().unwrap().wrap).collect::<Vec<_>>();
    assert_eq!(wraps, [[Wrap::Repeat; 2], [Wrap::Clamp, Wrap::Repeat]]);
}

/// An image of 4 x 4 texels of one colour in the format of `extension`.
fn encoded(format: image::ImageFormat) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image::RgbImage::from_pixel(4, 4, image::Rgb(RED)).write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

/// A DDS file of one red DXT1 block.
fn dds() -> Vec<u8> {
    let mut words = [0u32; 31];
    // Size, flags (size and format given), height, width, bytes.
    words[..5].copy_from_slice(&[124, 0x0008_1007, 4, 4, 8]);
    words[18..21].copy_from_slice(&[32, 4, u32::from_le_bytes(*b"DXT1")]);
    words[26] = 0x1000;
    let mut bytes = b"DDS ".to_vec();
    bytes.extend(words.iter().flat_map(|w| w.to_le_bytes()));
    bytes.extend([0x00, 0xf8, 0x00, 0xf8, 0, 0, 0, 0]);
    bytes
}

const KTX2: [u8; 80] = {
    let mut bytes = [0; 80];
    let start = *b"\xabKTX 20\xbb\r\n\x1a\n";
    let mut i = 0;
    while i < start.len() {
        bytes[i] = start[i];
        i += 1;
    }
    bytes
};

#[test]
fn images_in_every_format_are_read() {
    use image::ImageFormat::{Bmp, Jpeg, Png, WebP};
    for (name, bytes) in
        [("PNG", encoded(Png)), ("WebP", encoded(WebP)), ("BMP", encoded(Bmp)), ("DDS", dds()), ("JPEG", encoded(Jpeg))]
    {
        let mut document = Document::textured_square();
        let texture = document.texture(&bytes);
        document.material(0)["pbrMetallicRoughness"] = json!({"baseColorTexture": {"index": texture}});
        let mesh = document.mesh();
        assert_eq!(mesh.warnings, [""; 0], "{name}");
        let texel = mesh.materials[0].texture.as_ref().unwrap().mips[0].texels[5];
        assert!(texel[0] >= 253 && texel[1] <= 1 && texel[2] <= 1, "{name}: {texel:?}");
    }
}

#[test]
fn images_of_extensions_are_preferred_and_the_others_replace_them() {
    const WEBP: &str = "EXT_texture_webp";
    let with = |extension: &str, image: &[u8], plain: Option<&[u8]>| {
        let mut document = Document::textured_square();
        let image = document.image(image);
        let texture = document.push("textures", json!({"extensions": {extension: {"source": image}}}));
        if let Some(plain) = plain {
            let plain = document.image(plain);
            document.json["textures"][texture]["source"] = plain.into();
        }
        document.material(0)["pbrMetallicRoughness"] = json!({"baseColorTexture": {"index": texture}});
        document.json["extensionsUsed"] = json!([extension]);
        document
    };
    let webp = encoded(image::ImageFormat::WebP);
    let blue = png(1, 1, &[[0, 0, 255, 255]]);
    for (mut document, expected) in [
        (with(WEBP, &webp, None), RED),
        (with(WEBP, &webp, Some(&blue)), RED),
        (with(WEBP, &KTX2, Some(&blue)), BLUE),
        (with("MSFT_texture_dds", &dds(), None), RED),
        (with("MSFT_texture_dds", &dds(), Some(&blue)), BLUE),
        (with("KHR_texture_basisu", &KTX2, Some(&blue)), BLUE),
    ] {
        for required in [false, true] {
            if required {
                document.json["extensionsRequired"] = document.json["extensionsUsed"].clone();
            }
            let mesh = document.mesh();
            assert_eq!((colors(&mesh, 4), mesh.warnings), (counts([(expected, 256)]), vec![]));
        }
    }
    // Geometry in its plain colour, and what was lost.
    let mut document = with("KHR_texture_basisu", &KTX2, None);
    document.json["extensionsRequired"] = json!(["KHR_texture_basisu"]);
    document.material(0)["pbrMetallicRoughness"]["baseColorFactor"] = json!([1, 0, 0, 1]);
    let mesh = document.mesh();
    assert_eq!(colors(&mesh, 4), red_sheet());
    assert_eq!(
        mesh.warnings,
        [
            "material material 0: texture 0 has only an image of the glTF extension KHR_texture_basisu, which is not supported; \
          using a plain colour"
        ]
    );
}

#[test]
fn an_image_that_cannot_be_decoded_is_like_one_that_is_missing() {
    for (kind, lost) in [
        ("normalTexture", Some("its normal map is left out")),
        ("baseColorTexture", Some("using a plain colour")),
        ("occlusionTexture", None),
    ] {
        for (bytes, why) in [
            (&KTX2[..], "it is a KTX2 image, which is not supported; convert it to PNG, JPEG or WebP"),
            (b"nonsense", "it is none of PNG, JPEG, WebP, TGA, BMP and DDS; convert it to PNG, JPEG or WebP"),
        ] {
            let mut document = Document::textured_square();
            let texture = document.texture(bytes);
            *document.material(0) = json!({"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}});
            let parent = if kind == "baseColorTexture" {
                &mut document.material(0)["pbrMetallicRoughness"]
            } else {
                document.material(0)
            };
            parent[kind] = json!({"index": texture});
            let mesh = document.mesh();
            assert_eq!(colors(&mesh, 3), counts([(RED, 64)]));
            let expected = lost
                .map(|lost| format!("material material 0: the image 0 (embedded) cannot be decoded: {why}; {lost}"));
            assert_eq!(mesh.warnings, Vec::from_iter(expected), "{kind}");
        }
    }
}
