//! glTF: scenes, accessors, materials, and errors.

use crate::support::{Files, data_uri, png};

/// A buffer of 60 bytes: positions of a triangle, then its texture coordinates.
fn triangle_bytes() -> Vec<u8> {
    let values = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.25, 0.25, 0.75, 0.25, 0.25, 0.75];
    values.iter().flat_map(|x| x.to_le_bytes()).collect()
}

/// A document with that triangle as mesh 0. Each part can be replaced.
struct Template {
    buffers: String,
    views: &'static str,
    accessors: &'static str,
    primitive: &'static str,
    nodes: &'static str,
    rest: String,
}

impl Default for Template {
    fn default() -> Self {
        Self {
            buffers: format!(r#"{{"byteLength":60,"uri":"{}"}}"#, data_uri(&triangle_bytes())),
            views: r#"{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":24}"#,
            accessors: r#"{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"},
                {"bufferView":1,"componentType":5126,"count":3,"type":"VEC2"}"#,
            primitive: r#""attributes":{"POSITION":0}"#,
            nodes: r#"{"mesh":0}"#,
            rest: r#""scene":0,"scenes":[{"nodes":[0]}]"#.into(),
        }
    }
}

impl Template {
    fn json(&self) -> String {
        let Self { buffers, views, accessors, primitive, nodes, rest } = self;
        format!(
            r#"{{"asset":{{"version":"2.0"}},"buffers":[{buffers}],"bufferViews":[{views}],"accessors":[{accessors}],
            "meshes":[{{"primitives":[{{{primitive}}}]}}],"nodes":[{nodes}],{rest}}}"#
        )
    }

    fn mesh(&self) -> esvo_builder::Mesh {
        Files::new().accept("a.gltf", self.json())
    }

    /// The error without the name of the file.
    fn error(&self) -> String {
        let error = Files::new().refuse("a.gltf", self.json());
        error.strip_prefix("a.gltf: ").unwrap().to_owned()
    }
}

fn with_accessors(accessors: &'static str) -> Template {
    Template { accessors, ..Template::default() }
}

fn glb(json: &str, binary: &[u8]) -> Vec<u8> {
    let mut text = json.as_bytes().to_vec();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend((28 + text.len() as u32 + binary.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &text[..]), (b"BIN\0", binary)] {
        bytes.extend((chunk.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(chunk);
    }
    bytes
}

#[test]
fn a_plain_triangle() {
    let mesh = Template::default().mesh();
    assert_eq!(mesh.positions, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
    assert_eq!(mesh.materials[0].base_color, [1.0; 4]);
    assert_eq!(mesh.warnings, [""; 0]);
}

#[test]
fn buffers_in_files_and_binary_chunks() {
    let files = Files::new();
    files.write("my data.bin", triangle_bytes());
    let beside = Template { buffers: r#"{"byteLength":60,"uri":"my%20data.bin"}"#.into(), ..Template::default() };
    assert_eq!(files.accept("a.gltf", beside.json()).triangle_count(), 1);
    let inside = Template { buffers: r#"{"byteLength":60}"#.into(), ..Template::default() };
    assert_eq!(files.accept("a.glb", glb(&inside.json(), &triangle_bytes())).triangle_count(), 1);
    // The binary container with the extension of the text format.
    assert_eq!(files.accept("b.gltf", glb(&inside.json(), &triangle_bytes())).triangle_count(), 1);
    assert_eq!(
        files.refuse("c.glb", glb(&inside.json(), &triangle_bytes()[..56])),
        "c.glb: buffer 0 has 56 bytes, but 60 are declared"
    );
}

#[test]
fn nodes_place_instances() {
    let document = Template {
        nodes: r#"{"children":[1,2],"translation":[10,0,0]},
            {"mesh":0,"rotation":[0,0,0.70710678,0.70710678],"scale":[2,2,2]},
            {"mesh":0,"matrix":[-1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,5,1]},
            {"mesh":0}"#,
        ..Template::default()
    };
    let mesh = document.mesh();
    // Node 3 is not in the scene.
    assert_eq!(mesh.triangle_count(), 2);
    let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(x, y)| (x - y).abs() < 1e-6);
    assert!(near(mesh.positions[1], [10.0, 2.0, 0.0]), "{:?}", mesh.positions);
    assert!(near(mesh.positions[4], [9.0, 0.0, 5.0]), "{:?}", mesh.positions);
    // The mirrored instance keeps its outside.
    assert_eq!(mesh.triangles, [[0, 1, 2], [3, 5, 4]]);
}

#[test]
fn without_a_default_scene_all_scenes_are_read() {
    let two = r#"{"mesh":0},{"mesh":0},{"children":[4]},{"mesh":0},{"mesh":0}"#;
    let count = |rest: &str| Template { nodes: two, rest: rest.into(), ..Template::default() }.mesh().triangle_count();
    assert_eq!(count(r#""scenes":[{"nodes":[0]},{"nodes":[2,0]},{}]"#), 2);
    assert_eq!(count(r#""scenes":[]"#), 4);
    let bare = Template { nodes: "", rest: r#""scenes":[]"#.into(), ..Template::default() }.mesh();
    assert_eq!((bare.triangle_count(), bare.warnings.len()), (1, 1));
}

#[test]
fn bad_graphs_end() {
    let error = |nodes: &'static str| Template { nodes, ..Template::default() }.error();
    let twice = "has more than one parent, or is its own ancestor";
    assert_eq!(error(r#"{"children":[0]}"#), format!("node 0 {twice}"));
    assert_eq!(error(r#"{"children":[1]},{"children":[2]},{"children":[1]}"#), format!("node 1 {twice}"));
    // Each level would double the number of instances.
    assert_eq!(error(r#"{"children":[1,1]},{"children":[2,2]},{"mesh":0}"#), format!("node 2 {twice}"));
    assert_eq!(error(r#"{"children":[7]}"#), "node 7 does not exist: there are only 1");
    assert_eq!(error(r#"{"mesh":3}"#), "mesh 3 does not exist: there are only 1");
    assert_eq!(error(r#"{"name":"nothing here"}"#), "the mesh has no triangles");
    assert_eq!(
        Template { rest: r#""scene":2,"scenes":[]"#.into(), ..Template::default() }.error(),
        "scene 2 does not exist: there are only 0"
    );
}

#[test]
fn accessors_are_kept_within_their_bytes() {
    let position = "accessor 0 (POSITION of mesh 0, primitive 0)";
    let error = |accessor: &'static str| with_accessors(accessor).error();
    assert_eq!(
        error(r#"{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3"}"#),
        format!("{position} with 4 values reaches past the end of buffer view 0")
    );
    assert_eq!(
        error(r#"{"bufferView":0,"componentType":5126,"count":18446744073709551615,"type":"VEC3"}"#),
        format!("{position} with 18446744073709551615 values reaches past the end of buffer view 0")
    );
    assert_eq!(
        error(r#"{"bufferView":0,"byteOffset":18446744073709551615,"componentType":5126,"count":3,"type":"VEC3"}"#),
        format!("{position} with 3 values reaches past the end of buffer view 0")
    );
    assert_eq!(
        error(r#"{"bufferView":9,"componentType":5126,"count":3,"type":"VEC3"}"#),
        "buffer view 9 does not exist: there are only 2"
    );
    assert_eq!(
        error(r#"{"bufferView":0,"componentType":1,"count":3,"type":"VEC3"}"#),
        format!("{position} has an unknown component type")
    );
    assert_eq!(
        error(r#"{"bufferView":0,"componentType":5126,"count":3,"type":"MAT4"}"#),
        format!("{position} must be of type VEC3")
    );
    assert_eq!(
        error(r#"{"componentType":5126,"count":4000000000,"type":"VEC3"}"#),
        format!("{position} has 4000000000 values and no buffer view; the limit is 1048576")
    );
    assert_eq!(error(""), "accessor 0 does not exist: there are only 0");
    let view = |views: &'static str| Template { views, ..Template::default() }.error();
    assert_eq!(
        view(r#"{"buffer":0,"byteOffset":40,"byteLength":36}"#),
        "buffer view 0 reaches past the end of buffer 0"
    );
    assert_eq!(view(r#"{"buffer":4,"byteLength":36}"#), "buffer 4 does not exist: there are only 1");
    assert_eq!(
        view(r#"{"buffer":0,"byteLength":36,"byteStride":0}"#),
        format!("{position} has values of 12 bytes in a buffer view of stride 0")
    );
}

#[test]
fn buffers_must_be_there() {
    let error = |buffers: &str| Template { buffers: buffers.into(), ..Template::default() }.error();
    assert_eq!(error(r#"{"byteLength":60}"#), "buffer 0 has no data: no uri and no binary chunk");
    assert_eq!(error(r#"{"byteLength":1e3}"#).split(':').next(), Some("not a glTF document"));
    assert_eq!(error(r#"{"byteLength":99,"uri":"data:,abc%20"}"#), "buffer 0 has 4 bytes, but 99 are declared");
    assert!(
        error(r#"{"byteLength":60,"uri":"data:x;base64,@@@@"}"#)
            .starts_with("buffer 0: its data URI is not valid base64: ")
    );
    assert_eq!(
        error(r#"{"byteLength":60,"uri":"data:nothing"}"#),
        "buffer 0: its data URI has no comma before the data"
    );
    assert_eq!(
        error(r#"{"byteLength":60,"uri":"https://example.com/a.bin"}"#),
        "buffer 0: the URI https://example.com/a.bin is not a relative path; put the file next to the document"
    );
    assert_eq!(error(r#"{"byteLength":60,"uri":"a%ff.bin"}"#), "buffer 0: the URI a%ff.bin is not UTF-8 once decoded");
    let files = Files::new();
    let missing = Template { buffers: r#"{"byteLength":60,"uri":"none.bin"}"#.into(), ..Template::default() };
    assert!(files.refuse("a.gltf", missing.json()).starts_with("a.gltf: buffer 0: "));
    assert!(files.error("a.gltf").contains("none.bin: cannot be read: "));
    let directory = Template { buffers: r#"{"byteLength":60,"uri":"."}"#.into(), ..Template::default() };
    assert!(files.refuse("a.gltf", directory.json()).contains("is not a regular file"));
}

#[test]
fn sparse_accessors_replace_values() {
    // The index 2 is in the last byte of the buffer. The new value is the second vertex.
    let mut bytes = triangle_bytes();
    bytes.extend([2, 0, 0, 0]);
    let buffers = format!(r#"{{"byteLength":64,"uri":"{}"}}"#, data_uri(&bytes));
    let views = r#"{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":12,"byteLength":12},{"buffer":0,"byteOffset":60,"byteLength":4}"#;
    let document = |accessors| Template { buffers: buffers.clone(), views, accessors, ..Template::default() };
    let mesh = document(
        r#"{"componentType":5126,"count":3,"type":"VEC3","sparse":{"count":1,
            "indices":{"bufferView":2,"componentType":5121},"values":{"bufferView":1}}}"#,
    )
    .mesh();
    assert_eq!(mesh.positions, [[0.0; 3], [0.0; 3], [1.0, 0.0, 0.0]]);
    let position = "accessor 0 (POSITION of mesh 0, primitive 0)";
    assert_eq!(
        document(
            r#"{"bufferView":0,"componentType":5126,"count":2,"type":"VEC3","sparse":{"count":1,
            "indices":{"bufferView":2,"componentType":5121},"values":{"bufferView":1}}}"#
        )
        .error(),
        format!("{position} replaces value 2, but has only 2")
    );
    assert_eq!(
        document(
            r#"{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","sparse":{"count":4000000000000,
            "indices":{"bufferView":2,"componentType":5121},"values":{"bufferView":1}}}"#
        )
        .error(),
        format!("{position} has sparse indices that reach past the end of buffer view 2")
    );
    assert_eq!(
        document(
            r#"{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","sparse":{"count":2,
            "indices":{"bufferView":2,"componentType":5121},"values":{"bufferView":0}}}"#
        )
        .error(),
        format!("{position} has sparse indices that do not ascend")
    );
}

#[test]
fn indices_are_checked() {
    let mut bytes = triangle_bytes();
    bytes.extend([0, 1, 2, 2]);
    let buffers = format!(r#"{{"byteLength":64,"uri":"{}"}}"#, data_uri(&bytes));
    let document = |accessors, primitive| Template {
        buffers: buffers.clone(),
        views: r#"{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":60,"byteLength":4}"#,
        accessors,
        primitive,
        ..Template::default()
    };
    let vertices = r#"{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"},
        {"bufferView":1,"componentType":5121,"count":4,"type":"SCALAR"}"#;
    let indexed = r#""attributes":{"POSITION":0},"indices":1"#;
    let mesh = document(vertices, indexed).mesh();
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
    assert_eq!(mesh.warnings, ["mesh 0, primitive 0 has 1 corners left over after its last triangle"]);
    // Repeated vertices: triangles without area that only join strips.
    let strip = document(vertices, r#""attributes":{"POSITION":0},"indices":1,"mode":5"#).mesh();
    assert_eq!((strip.triangles.as_slice(), strip.warnings.len()), (&[[0, 1, 2]][..], 0));
    assert_eq!(
        document(
            r#"{"bufferView":0,"componentType":5126,"count":2,"type":"VEC3"},
                {"bufferView":1,"componentType":5121,"count":4,"type":"SCALAR"}"#,
            indexed
        )
        .error(),
        "mesh 0, primitive 0: index 2 refers to vertex 2 of 2"
    );
    assert_eq!(
        document(
            r#"{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"},
                {"bufferView":1,"componentType":5126,"count":1,"type":"SCALAR"}"#,
            indexed
        )
        .error(),
        "the indices of mesh 0, primitive 0 are not integers"
    );
}

#[test]
fn primitives_without_triangles_are_skipped() {
    let mesh = |primitive| Template { primitive, ..Template::default() };
    let points = mesh(r#""attributes":{"POSITION":0}},{"attributes":{"POSITION":0},"mode":0},{"attributes":{}"#).mesh();
    assert_eq!(points.triangle_count(), 1);
    assert_eq!(
        points.warnings,
        [
            "mesh 0, primitive 1 is made of points or lines; it is skipped",
            "mesh 0, primitive 2 has no positions; it is skipped"
        ]
    );
    assert_eq!(mesh(r#""attributes":{"POSITION":0},"mode":1"#).error(), "the mesh has no triangles");
    assert_eq!(mesh(r#""attributes":{"POSITION":0},"mode":99"#).error(), "mesh 0, primitive 0 has an unknown mode");
    let morphed = mesh(r#""attributes":{"POSITION":0},"targets":[{"POSITION":0}]"#).mesh();
    assert_eq!(morphed.warnings, [""; 0]);
}

#[test]
fn vertices_must_be_finite() {
    let mut bytes = triangle_bytes();
    bytes[16..20].copy_from_slice(&f32::NAN.to_le_bytes());
    let buffers = format!(r#"{{"byteLength":60,"uri":"{}"}}"#, data_uri(&bytes));
    let error = Template { buffers, ..Template::default() }.error();
    assert_eq!(error, "mesh 0, primitive 0: vertex 1 is not finite; repair or remove it");
    let nodes = r#"{"scale":[3e38,1,1],"children":[1]},{"scale":[3e38,1,1],"children":[2]},
        {"scale":[3e38,1,1],"children":[3]},{"scale":[3e38,1,1],"children":[4]},{"scale":[3e38,1,1],"children":[5]},
        {"scale":[3e38,1,1],"children":[6]},{"scale":[3e38,1,1],"children":[7]},{"scale":[3e38,1,1],"children":[8]},
        {"scale":[3e38,1,1],"mesh":0}"#;
    assert!(Template { nodes, ..Template::default() }.error().starts_with("vertex "));
}

#[test]
fn extensions_that_matter_are_refused_if_required() {
    let rest = |extensions: &str| Template {
        rest: format!(r#""scene":0,"scenes":[{{"nodes":[0]}}],{extensions}"#),
        ..Template::default()
    };
    assert_eq!(
        rest(r#""extensionsUsed":["ADOBE_a"],"extensionsRequired":["ADOBE_a"]"#).error(),
        "the file requires the glTF extension ADOBE_a, which is not supported; export it without"
    );
    // In use nowhere: nothing is lost.
    assert_eq!(rest(r#""extensionsUsed":["ADOBE_a"]"#).mesh().warnings, [""; 0]);
    assert!(rest(r#""extensionsRequired":["KHR_materials_unlit","KHR_lights_punctual"]"#).mesh().warnings.is_empty());
}

#[test]
fn other_versions_and_other_json_are_refused() {
    let refuse = |text: &str| Files::new().refuse("a.gltf", text);
    assert_eq!(refuse(r#"{"asset":{"version":"1.0"}}"#), "a.gltf: glTF version 1.0; only version 2 can be read");
    assert_eq!(refuse(r#"{"asset":{"version":1}}"#), "a.gltf: glTF version 1; only version 2 can be read");
    assert_eq!(
        refuse(r#"{"asset":{"version":"2.9","minVersion":"2.1"}}"#),
        "a.gltf: glTF version 2.1; only version 2 can be read"
    );
    assert_eq!(refuse("{}"), "a.gltf: not a glTF document: missing field `asset` at line 1 column 2");
    assert!(refuse(&"[".repeat(100_000)).starts_with("a.gltf: not a glTF document: "));
    assert!(refuse(&Template::default().json()[..200]).starts_with("a.gltf: not a glTF document: EOF while parsing"));
}

/// A textured document: the material's JSON, and an image of two texels side by side.
fn textured(material: &str, texels: &[[u8; 4]; 2]) -> Template {
    let image = data_uri(&png(2, 1, texels));
    Template {
        primitive: r#""attributes":{"POSITION":0,"TEXCOORD_0":1},"material":0"#,
        rest: format!(
            r#""scene":0,"scenes":[{{"nodes":[0]}}],"materials":[{{{material}}}],"textures":[{{"source":0}}],
            "images":[{{"uri":"{image}"}}]"#
        ),
        ..Template::default()
    }
}

const RED: [u8; 4] = [255, 0, 0, 255];
const HOLE: [u8; 4] = [0, 0, 0, 0];
const COLOR: &str = r#""pbrMetallicRoughness":{"baseColorFactor":[0.5,0.25,0.125,1],"baseColorTexture":{"index":0}}"#;

#[test]
fn factors_are_linear_and_textures_are_found() {
    let mesh = textured(&format!(r#"{COLOR},"name":"paint""#), &[RED, RED]).mesh();
    let material = &mesh.materials[mesh.triangle_materials[0] as usize];
    assert_eq!((&*material.name, material.base_color), ("paint", [0.5, 0.25, 0.125, 1.0]));
    assert_eq!(material.texture.as_ref().unwrap().sample(mesh.uvs[0], 1.0), [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(mesh.uvs, [[0.25, 0.25], [0.75, 0.25], [0.25, 0.75]]);
    assert_eq!(material.alpha_cutoff, None);
}

#[test]
fn alpha_modes_decide_on_holes() {
    let material = |mode: &str, texels| textured(&format!("{COLOR},{mode}"), texels).mesh();
    let cutoff = |mode, texels| material(mode, texels).materials[0].alpha_cutoff;
    assert_eq!(cutoff(r#""alphaMode":"OPAQUE""#, &[RED, HOLE]), None);
    assert_eq!(cutoff(r#""alphaMode":"MASK""#, &[RED, HOLE]), Some(0.5));
    assert_eq!(cutoff(r#""alphaMode":"MASK","alphaCutoff":0.25"#, &[RED, RED]), Some(0.25));
    let blend = material(r#""alphaMode":"BLEND","name":"leaf""#, &[RED, HOLE]);
    assert_eq!(blend.materials[0].alpha_cutoff, Some(0.5));
    assert_eq!(blend.warnings, ["material leaf blends; texels of less than half opacity become holes"]);
    assert_eq!(cutoff(r#""alphaMode":"BLEND""#, &[RED, RED]), None);
    assert_eq!(textured(r#""alphaMode":"WRONG""#, &[RED, RED]).error(), "material 0 has an unknown alphaMode");
}

#[test]
fn a_lamp_has_the_colour_of_its_light() {
    let lamp = r#""pbrMetallicRoughness":{"baseColorFactor":[0,0,0,1]},"emissiveFactor":[1,0.5,0.25]"#;
    assert_eq!(textured(lamp, &[RED, RED]).mesh().materials[0].base_color, [1.0, 0.5, 0.25, 1.0]);
}

#[test]
fn bad_images_are_warnings_and_bad_references_errors() {
    let with = |rest: &str| Template {
        primitive: r#""attributes":{"POSITION":0,"TEXCOORD_0":1},"material":0"#,
        rest: format!(r#""scene":0,"scenes":[{{"nodes":[0]}}],"materials":[{{{COLOR}}}],{rest}"#),
        ..Template::default()
    };
    let texture = r#""textures":[{"source":0}]"#;
    for (images, why) in [
        (
            r#"{"uri":"data:image/png;base64,AAAA"}"#,
            "the image 0 (embedded) cannot be decoded: it is none of PNG, JPEG, WebP, TGA, BMP and DDS; convert it to PNG, \
             JPEG or WebP",
        ),
        ("{}", "image 0 has neither uri nor bufferView"),
    ] {
        let mesh = with(&format!(r#"{texture},"images":[{images}]"#)).mesh();
        assert!(mesh.materials[0].texture.is_none());
        assert_eq!(mesh.warnings, [format!("material material 0: {why}; using a plain colour")]);
    }
    assert_eq!(with(texture).error(), "image 0 does not exist: there are only 0");
    assert_eq!(with(r#""images":[]"#).error(), "texture 0 does not exist: there are only 0");
    let missing = with(&format!(r#"{texture},"images":[{{"uri":"none.png"}}]"#)).mesh();
    assert!(missing.materials[0].texture.is_none());
    assert!(missing.warnings[0].ends_with("none.png is missing; using a plain colour"), "{:?}", missing.warnings);
    let extension = with(r#""textures":[{}]"#).mesh();
    assert_eq!(extension.warnings, ["material material 0: texture 0 has no image; using a plain colour"]);
}

#[test]
fn textures_need_coordinates() {
    let mut document = textured(COLOR, &[RED, RED]);
    document.primitive = r#""attributes":{"POSITION":0},"material":0"#;
    let mesh = document.mesh();
    assert!(mesh.materials[0].texture.is_none());
    assert_eq!(mesh.warnings, ["mesh 0, primitive 0 has no TEXCOORD_0 for its texture; it gets its plain colour"]);
}

#[test]
fn only_the_vertices_in_use_are_kept() {
    let mesh = Template {
        accessors: r#"{"bufferView":0,"componentType":5126,"count":5,"type":"VEC3"}"#,
        views: r#"{"buffer":0,"byteLength":60}"#,
        ..Template::default()
    };
    // Five vertices without indices: one triangle, and two corners left over.
    let mesh = mesh.mesh();
    assert_eq!((mesh.positions.len(), mesh.triangle_count(), mesh.warnings.len()), (3, 1, 1));
}

#[test]
fn instances_without_end_are_refused_before_they_are_made() {
    // Two hundred instances of a strip of a million vertices that take no bytes in the file.
    let nodes: Vec<String> = (0..200).map(|_| r#"{"mesh":0}"#.to_owned()).collect();
    let starts: Vec<String> = (0..200).map(|i| i.to_string()).collect();
    let mut bytes = triangle_bytes();
    bytes.extend([0, 0, 0, 0]);
    let document = Template {
        buffers: format!(r#"{{"byteLength":64,"uri":"{}"}}"#, data_uri(&bytes)),
        accessors: r#"{"componentType":5126,"count":1000000,"type":"VEC3","sparse":{"count":1,
            "indices":{"bufferView":1,"componentType":5121},"values":{"bufferView":0}}}"#,
        primitive: r#""attributes":{"POSITION":0},"mode":5"#,
        nodes: nodes.join(",").leak(),
        rest: format!(r#""scene":0,"scenes":[{{"nodes":[{}]}}]"#, starts.join(",")),
        ..Template::default()
    };
    assert_eq!(
        document.error(),
        "the mesh has at least 199999600 triangles with all instances; the limit is 134217728"
    );
}

/// A document with this normal map in its material, next to the colour texture; the normals lean to the right.
fn normal_mapped(material: &str) -> esvo_builder::Mesh {
    const LEANING: [u8; 4] = [204, 128, 230, 255];
    textured(material, &[LEANING, LEANING]).mesh()
}

#[test]
fn normal_maps_are_read_with_their_scale_and_transform() {
    let mesh = normal_mapped(r#""normalTexture":{"index":0,"scale":0.5}"#);
    let map = mesh.materials[0].normal_map.as_ref().unwrap();
    let [x, _, z] = map.sample([0.5, 0.5], 1.0);
    assert!((x - 0.3).abs() < 1e-6 && (z - 0.8).abs() < 5e-3, "{x} {z}");
    assert_eq!(map.uv_transform, esvo_builder::UvTransform::IDENTITY);
    assert!(mesh.materials[0].texture.is_none());
    // Without a colour texture, its transform is applied to the coordinates of the mesh.
    let transform = r#""extensions":{"KHR_texture_transform":{"scale":[2,4],"offset":[0.5,0]}}"#;
    let mesh = normal_mapped(&format!(r#""normalTexture":{{"index":0,{transform}}}"#));
    assert_eq!(mesh.uvs, [[1.0, 1.0], [2.0, 1.0], [1.0, 3.0]]);
    // With a colour texture, its transform is in the map.
    let mesh = normal_mapped(&format!(r#"{COLOR},"normalTexture":{{"index":0,{transform}}}"#));
    assert_eq!(mesh.uvs[0], [0.25, 0.25]);
    let map = mesh.materials[0].normal_map.as_ref().unwrap();
    assert_eq!(map.uv_transform.apply(mesh.uvs[0]), [1.0, 1.0]);
    // Another set of coordinates than the colour's.
    let mesh = normal_mapped(&format!(r#"{COLOR},"normalTexture":{{"index":0,"texCoord":1}}"#));
    assert!(mesh.materials[0].normal_map.is_none() && mesh.materials[0].texture.is_some());
    assert_eq!(
        mesh.warnings,
        ["material 0: its normal map needs other texture coordinates than its colour; it is left out"]
    );
    let bad =
        textured(r#""normalTexture":{"index":0,"extensions":{"KHR_texture_transform":{"scale":7}}}"#, &[RED, RED]);
    assert!(bad.error().starts_with("material 0: the transform of its normal map: "), "{}", bad.error());
    let missing = textured(r#""normalTexture":{"index":9}"#, &[RED, RED]);
    assert_eq!(missing.error(), "texture 9 does not exist: there are only 1");
}

#[test]
fn tangents_are_read_where_they_are_of_use_and_move_with_the_nodes() {
    // Positions (also used as normals), texture coordinates, then tangents along y of either handedness.
    let mut bytes = triangle_bytes();
    for w in [1.0f32, -1.0, 1.0] {
        bytes.extend([0.0, 2.0, 0.0, w].iter().flat_map(|x| x.to_le_bytes()));
    }
    let mut document = textured(r#""normalTexture":{"index":0}"#, &[RED, RED]);
    document.buffers = format!(r#"{{"byteLength":108,"uri":"{}"}}"#, data_uri(&bytes));
    document.views = r#"{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":24},
        {"buffer":0,"byteOffset":60,"byteLength":48}"#;
    document.accessors = r#"{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"},
        {"bufferView":1,"componentType":5126,"count":3,"type":"VEC2"},
        {"bufferView":2,"componentType":5126,"count":3,"type":"VEC4"}"#;
    document.primitive = r#""attributes":{"POSITION":0,"NORMAL":0,"TEXCOORD_0":1,"TANGENT":2},"material":0"#;
    document.nodes = r#"{"mesh":0,"scale":[1,-3,1]}"#;
    let mesh = document.mesh();
    assert_eq!(mesh.tangents, [[0.0, -1.0, 0.0, -1.0], [0.0, -1.0, 0.0, 1.0], [0.0, -1.0, 0.0, -1.0]]);
    // Without normals, tangents are ignored.
    document.primitive = r#""attributes":{"POSITION":0,"TEXCOORD_0":1,"TANGENT":2},"material":0"#;
    assert!(document.mesh().tangents.is_empty());
}
