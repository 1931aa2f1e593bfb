//! Situations that people met with files of other programs: the right voxels and their colours.

use crate::support::{Files, colors, png, voxels};

const RED: [u8; 3] = [255, 0, 0];
const GREEN: [u8; 3] = [0, 255, 0];
const BLUE: [u8; 3] = [0, 0, 255];
const RED_TEXEL: [u8; 4] = [255, 0, 0, 255];
const BLUE_TEXEL: [u8; 4] = [0, 0, 255, 255];

/// A unit square that shows the whole of its texture. The library is `a.mtl`, the material `a`.
const SQUARE: &str =
    "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3 4/4\n";

/// The colours in a row of voxels through the middle of the square of 8 x 8 voxels, given a texture with a red left half and
/// a blue right half.
fn row(files: &Files, statement: &str) -> String {
    files.write("halves.png", png(64, 1, &[[RED_TEXEL; 32], [BLUE_TEXEL; 32]].concat()));
    let mut bmp = std::io::Cursor::new(Vec::new());
    let texel = |x, _| image::Rgb(if x < 32 { RED } else { BLUE });
    image::RgbImage::from_fn(64, 1, texel).write_to(&mut bmp, image::ImageFormat::Bmp).unwrap();
    files.write("other.bmp", bmp.into_inner());
    files.write("a.mtl", format!("newmtl a\nKd 1 1 1\n{statement}\n"));
    let mesh = files.accept("a.obj", format!("mtllib a.mtl\n{SQUARE}"));
    assert_eq!(mesh.warnings, [""; 0], "{statement}");
    let mut found = voxels(&mesh, 3);
    assert_eq!(found.len(), 64);
    found.retain(|(at, _)| at[1] == 4);
    found.sort_unstable();
    found.iter().map(|(_, [r, _, b])| if r > b { 'r' } else { 'b' }).collect()
}

#[test]
fn concave_polygons_leave_their_notches_open() {
    // A comb of 4 x 4 units with two gaps of 1 x 3 units; also with the first corner elsewhere, and in the other direction.
    let comb = ["0 0", "5 0", "5 5", "4 5", "4 1", "3 1", "3 5", "2 5", "2 1", "1 1", "1 5", "0 5"];
    let files = Files::new();
    for turned in 0..comb.len() {
        for backwards in [false, true] {
            let mut corners: Vec<String> = comb.iter().map(|xy| format!("v {xy} 0.5\n")).collect();
            corners.rotate_left(turned);
            if backwards {
                corners.reverse();
            }
            let mesh = files.accept("a.obj", corners.concat() + "f 1 2 3 4 5 6 7 8 9 10 11 12\n");
            let area: f64 = (mesh.triangles.iter())
                .map(|t| {
                    let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
                    0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
                })
                .sum();
            assert_eq!(area.abs(), 17.0);
            // In the middle of a gap there is nothing.
            let found = voxels(&mesh, 5);
            assert!(found.iter().all(|(at, _)| at[1] < 16 || !(at[0] == 9 || at[0] == 22)));
        }
    }
}

#[test]
fn texture_statements_scale_move_and_clamp() {
    let files = Files::new();
    for (statement, colors) in [
        ("map_Kd halves.png", "rrrrbbbb"),
        ("map_Kd .\\other.bmp", "rrrrbbbb"),
        ("map_Kd -s 2 1 1 halves.png", "rrbbrrbb"),
        ("map_Kd halves.png -s 2", "rrbbrrbb"),
        ("MAP_KD -O 0.5 \"halves.png\"", "bbbbrrrr"),
        ("map_Kd -s 0.5 -o 0.25 0 0 halves.png", "rrrrbbbb"),
        ("map_Kd -s -1 1 1 halves.png", "bbbbrrrr"),
        ("map_Kd -s 2 -o -0.5 -clamp on HALVES.PNG", "rrrrbbbb"),
        ("map_Kd -s 2 -o -0.5 -clamp off x\\halves.png", "bbrrbbrr"),
        ("map_kd -s 4 -o -2 -clamp on -texres 64 halves.png # all", "rrrrrbbb"),
    ] {
        assert_eq!(row(&files, statement), colors, "{statement}");
    }
}

#[test]
fn masks_cut_holes_whatever_their_size_and_without_a_texture() {
    let files = Files::new();
    files.write("mask.png", png(8, 8, &[[[0, 0, 0, 255]; 32], [[255; 4]; 32]].concat()));
    files.write("red.png", png(2, 1, &[RED_TEXEL; 2]));
    for statements in
        ["map_Kd red.png\nmap_D mask.png", "Kd 1 0 0\nmap_d -imfchan r mask.png", "Kd 1 0 0\nmap_d mask.png"]
    {
        files.write("a.mtl", format!("newmtl a\n{statements}\n"));
        let mesh = files.accept("a.obj", format!("mtllib a.mtl\n{SQUARE}"));
        let found = voxels(&mesh, 3);
        // At the border of the mask, a corner of a solid triangle may touch a voxel.
        let lower = found.iter().filter(|(at, _)| at[1] < 4).count();
        assert!(lower == 32 && found.iter().all(|(at, color)| at[1] <= 4 && *color == RED), "{statements}: {found:?}");
        assert_eq!(mesh.warnings, [""; 0]);
    }
}

#[test]
fn materials_are_found_by_any_spelling() {
    let files = Files::new();
    files.write(
        "my lib#1.mtl",
        "newmtl Material #25\nKd 1 0 0\nnewmtl Material #26\nKd 0 0 1\nnewmtl \"quoted\"\nKd 0 1 0\n",
    );
    let two = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nv 3 0 0\nv 2 1 0\n";
    for library in ["my lib#1.mtl", "\"my lib#1.mtl\"", "none.mtl my\\ lib#1.mtl", "MY LIB#1.mtl # all"] {
        for (names, expected) in
            [(["Material #25", "Material #26"], [BLUE, RED]), (["MATERIAL #25", "quoted # green"], [GREEN, RED])]
        {
            let text = format!("{two}mtllib {library}\nusemtl {}\nf 1 2 3\nusemtl {}\nf 4 5 6\n", names[0], names[1]);
            let mesh = files.accept("a.obj", text);
            let found: Vec<[u8; 3]> = colors(&voxels(&mesh, 3)).into_iter().map(|(color, _)| color).collect();
            assert_eq!(found, expected, "{library} {names:?}: {:?}", mesh.warnings);
        }
    }
    let ambiguous = format!("{two}mtllib my lib#1.mtl\nusemtl Material\nf 1 2 3\n");
    assert_eq!(
        files.accept("a.obj", ambiguous).warnings,
        ["no material library defines Material; using a plain colour"]
    );
}

#[test]
fn lines_end_and_continue_in_every_way() {
    let files = Files::new();
    let obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 \\\n 2 3\n";
    let mtl = "newmtl a\nKd 1 \\\n 0 0";
    for ends in ["\n", "\r", "\r\n"] {
        for mark in ["", "\u{feff}"] {
            files.write("a.mtl", format!("{mark}{}", mtl.replace('\n', ends)));
            let mesh = files.accept("a.obj", format!("{mark}{}", obj.replace('\n', ends)));
            assert_eq!((colors(&voxels(&mesh, 3)), mesh.warnings), (vec![(RED, 43)], vec![]), "{ends:?} {mark:?}");
        }
    }
}

#[test]
fn what_is_invisible_leaves_no_voxels() {
    let files = Files::new();
    let text =
        "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nv 3 0 0\nv 2 1 0\nusemtl a\nf 1 2 3\nusemtl b\nf 4 5 6\n";
    files.write("a.mtl", "newmtl a\nKd 1 0 0\nd 0\nnewmtl b\nKd 0 0 1\n");
    let mesh = files.accept("a.obj", text);
    assert_eq!(colors(&voxels(&mesh, 3)), [(BLUE, 9)]);
    assert_eq!(mesh.warnings, ["material a: d is 0; its faces are invisible and leave no voxels"]);
    files.write("a.mtl", "newmtl a\nKd 1 0 0\nd 0\nnewmtl b\nKd 0 0 1\nd 0\n");
    let mesh = files.mesh("a.obj");
    assert_eq!(colors(&voxels(&mesh, 3)), [(BLUE, 9), (RED, 9)]);
    assert_eq!(mesh.warnings, ["d is 0 in the materials of all faces; they are drawn as if they were opaque"]);
}

/// Two triangles side by side as PLY, with further comments, properties of the faces, and values for each face.
fn ply(comments: &str, properties: &str, values: [&str; 2]) -> String {
    format!(
        "ply\nformat ascii 1.0\n{comments}element vertex 6\nproperty float x\nproperty float y\nproperty float z\n\
         element face 2\nproperty list uchar int vertex_indices\n{properties}end_header\n\
         0 0 0\n1 0 0\n0 1 0\n2 0 0\n3 0 0\n2 1 0\n3 0 1 2 {}\n3 3 4 5 {}\n",
        values[0], values[1]
    )
}

#[test]
fn ply_faces_have_colours_textures_and_coordinates_of_their_own() {
    let files = Files::new();
    files.write("red.png", png(1, 1, &[RED_TEXEL]));
    files.write("blue.png", png(1, 1, &[BLUE_TEXEL]));
    files.write("halves.png", png(64, 1, &[[RED_TEXEL; 32], [BLUE_TEXEL; 32]].concat()));
    let bytes = "property uchar red\nproperty uchar green\nproperty uchar blue\n";
    let floats = "property float r\nproperty float g\nproperty float b\n";
    let uvs = "property list uchar float texcoord\n";
    let (left, right) = ("6 .1 .5 .1 .5 .1 .5", "6 .9 .5 .9 .5 .9 .5");
    let numbered = [format!("{left} 0"), format!("{right} 1")];
    for (comments, properties, values) in [
        ("", bytes, ["255 0 0", "0 0 255"]),
        ("", floats, ["1 0 0", "0 0 1."]),
        ("comment TextureFile halves.png\n", uvs, [left, right]),
        ("comment texturefile \"Halves.png\"\n", uvs, [left, right]),
        (
            "comment TextureFile red.png\ncomment TextureFile blue.png\n",
            &format!("{uvs}property int texnumber\n"),
            [&*numbered[0], &*numbered[1]],
        ),
    ] {
        let mesh = files.accept("a.ply", ply(comments, properties, values));
        assert_eq!((&*mesh.warnings, colors(&voxels(&mesh, 3))), (&[][..], vec![(BLUE, 9), (RED, 9)]), "{properties}");
    }
    // A face whose coordinates cannot be used, and a texture that does not exist.
    let mesh = files.accept("a.ply", ply("comment TextureFile red.png\n", uvs, [left, "4 0 0 1 1"]));
    assert_eq!(
        mesh.warnings,
        [
            "face 1: 4 numbers for 3 corners: 1 face without a finite texture coordinate for each corner; they get the plain \
          colour"
        ]
    );
    assert_eq!(mesh.materials.iter().filter(|m| m.texture.is_some()).count(), 1);
    let comments = "comment TextureFile red.png\ncomment TextureFile blue.png\n";
    let properties = format!("{uvs}property int texnumber\n");
    let mesh = files.accept("a.ply", ply(comments, &properties, [&format!("{left} 0"), &format!("{right} 2")]));
    assert_eq!(
        mesh.warnings,
        ["face 1: texture 2 of 2: 1 face with a texture that the file does not name; they get the plain colour"]
    );
    let mesh = files.accept("a.ply", ply("comment TextureFile none.png\n", uvs, [left, right]));
    assert_eq!(mesh.warnings, ["the texture none.png is missing; using a plain colour"]);
    files.write("bad.png", "no image");
    let mesh = files.accept("a.ply", ply("comment TextureFile bad.png\n", uvs, [left, right]));
    let why = "it is none of PNG, JPEG, WebP, TGA, BMP and DDS; convert it to PNG, JPEG or WebP";
    assert_eq!(mesh.warnings, [format!("the texture bad.png cannot be decoded: {why}; using a plain colour")]);
}

#[test]
fn ply_colours_that_are_bad_or_incomplete_are_named() {
    let files = Files::new();
    let floats = "property float red\nproperty float green\nproperty float blue\n";
    let mesh = files.accept("a.ply", ply("", floats, ["1 nan 0", "0 0 1"]));
    assert_eq!(colors(&voxels(&mesh, 3)), [(BLUE, 9), ([255; 3], 9)]);
    assert_eq!(mesh.warnings, ["face 0: 1 colour that cannot be read or is not finite; white is used instead"]);
    let mesh = files.accept("a.ply", ply("", "property float red\nproperty float blue\n", ["1 0", "0 1"]));
    assert_eq!(mesh.warnings, ["the element 'face' has red, blue but not green; its colours are left out"]);
    let vertices = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                    property uchar red\nproperty uchar green\nproperty uchar blue\nproperty float nx\nelement face 1\n\
                    property list uchar int vertex_indices\nend_header\n";
    let mesh = files.accept("a.ply", format!("{vertices}0 0 0 255 0 0 1\n1 0 0 x 0 0 1\n0 1 0 255 0 0 1\n3 0 1 2\n"));
    assert_eq!(
        mesh.warnings,
        [
            "the element 'vertex' has nx but not ny, nz; its normals are left out",
            "vertex 1: 1 colour that cannot be read or is not finite; white is used instead",
        ]
    );
    assert_eq!(mesh.colors, [[1.0, 0.0, 0.0], [1.0; 3], [1.0, 0.0, 0.0]]);
}

#[test]
fn ply_values_that_are_not_finite_are_dropped_where_nothing_needs_them() {
    let files = Files::new();
    let text = |vertex: &str, faces: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
             property float nx\nproperty float ny\nproperty float nz\nelement face {}\n\
             property list uchar int vertex_indices\nend_header\n\n.0 0. -0 -nan -nan(ind) 1.#IND\n\n1 0 0 0 0 1\n0 1 0 0 0 1\n\
             {vertex} 0 0 1\n{faces}\n\n",
            faces.lines().count()
        )
    };
    let mesh = files.accept("a.ply", text("nan nan nan", "3 0 1 2"));
    assert_eq!(mesh.bounds(), Some(([0.0; 3], [1.0, 1.0, 0.0])));
    assert_eq!(mesh.normals[0], [0.0, 0.0, 1.0]);
    assert_eq!(
        mesh.warnings,
        ["vertex 0: 1 normal that cannot be read or is not finite; normals of the faces are used instead"]
    );
    assert_eq!(voxels(&mesh, 3).len(), 43);
    let used = text("nan nan nan", "3 0 1 2\n3 0 1 3");
    assert_eq!(files.refuse("a.ply", used), "a.ply: vertex 3 is not finite; repair or remove it");
    for ends in ["\r", "\r\n"] {
        assert_eq!(files.accept("a.ply", text("1 1 0", "3 0 1 2").replace('\n', ends)).triangle_count(), 1);
    }
}

/// Two facets side by side as binary STL.
fn stl(header: &[u8], count: u32, colors: [u16; 2]) -> Vec<u8> {
    let mut bytes = header.to_vec();
    bytes.resize(80, b' ');
    bytes.extend(count.to_le_bytes());
    for (x, color) in [0.0f32, 2.0].into_iter().zip(colors) {
        let facet = [0.0, 0.0, 1.0, x, 0.0, 0.0, x + 1.0, 0.0, 0.0, x, 1.0, 0.0f32];
        bytes.extend(facet.iter().flat_map(|x| x.to_le_bytes()));
        bytes.extend(color.to_le_bytes());
    }
    bytes
}

#[test]
fn stl_colours_follow_both_conventions() {
    let files = Files::new();
    let found = |bytes: Vec<u8>| colors(&voxels(&files.accept("a.stl", bytes), 3));
    assert_eq!(found(stl(b"x", 2, [0xfc00, 0x801f])), [(BLUE, 9), (RED, 9)]);
    assert_eq!(found(stl(b"by COLOR=\xff\0\0\xff,MATERIAL=", 2, [0x8000, 0x7c00])), [(BLUE, 9), (RED, 9)]);
    // Without the flag there is no colour: the plain grey.
    assert_eq!(found(stl(b"x", 2, [0x7c00, 0x83e0])), [(GREEN, 9), ([231; 3], 9)]);
    assert_eq!(found(stl(b"x", 2, [0, 0])), [([231; 3], 18)]);
}

#[test]
fn stl_counts_that_were_never_written_follow_from_the_length() {
    let files = Files::new();
    for (count, text) in [(0, "0"), (0x2020_2020, "538976288"), (u32::MAX, "4294967295")] {
        let mesh = files.accept("a.stl", stl(b"x", count, [0, 0]));
        assert_eq!(mesh.triangle_count(), 2);
        let line = "triangles, which stands for an unknown number; the file holds 2, which are read";
        assert_eq!(mesh.warnings, [format!("the header declares {text} {line}")]);
    }
    let wrong = files.refuse("a.stl", stl(b"x", 3, [0, 0]));
    assert_eq!(wrong, "a.stl: the header declares 3 triangles, but the file ends after 2");
}

#[test]
fn stl_text_may_be_broken_into_lines_anyhow() {
    let files = Files::new();
    let lines = "solid the facet of b\nfacet normal 0 0 -nan(ind)\nouter loop\nvertex 0 0 0\nvertex 1. 0 0\nvertex 0 .1D1 0\n\
                 endloop\nendfacet\nendsolid the facet of b\n";
    let utf16: Vec<u8> = "\u{feff}".encode_utf16().chain(lines.encode_utf16()).flat_map(u16::to_le_bytes).collect();
    for bytes in [
        lines.to_owned(),
        lines.replace('\n', "\r"),
        lines.replace('\n', "\r\n"),
        lines.replace('\n', " "),
        lines.replace("end", "end "),
        format!("\u{feff}{lines}"),
        lines.replace("solid the", "solidthe"),
        lines["solid the facet of b\n".len()..].to_owned(),
        lines.to_uppercase(),
    ] {
        let mesh = files.accept("a.stl", &bytes);
        assert_eq!((mesh.triangle_count(), voxels(&mesh, 3).len(), &*mesh.warnings), (1, 43, &[][..]), "{bytes:?}");
    }
    assert_eq!(files.accept("a.stl", utf16).triangle_count(), 1);
    let colored = files.accept("a.stl", lines.replace("outer", "color 1 0 0 outer"));
    assert_eq!(colored.warnings, ["line 3: 1 colour in an STL text; colours are read from binary files only"]);
}
