//! Geometry of glTF files as programs write it: skins, morph targets, instances, hidden nodes, bad attributes, compression,
//! and what is done about extensions that are not supported.

use serde_json::json;

use crate::gltf_document::{BLUE, Document, both_squares, colors, red_sheet, square_of};
use crate::support::{Files, png, voxels};

#[test]
fn two_squares_are_two_squares() {
    let mesh = Document::two_squares().mesh();
    assert_eq!((colors(&mesh, 4), mesh.warnings), (both_squares(), vec![]));
}

/// The red square follows one joint, node 2, in its bind pose.
fn skinned(inverse: [f32; 16]) -> Document {
    let mut document = Document::two_squares();
    let joints = document.bytes(&[[0; 4]; 4], false);
    let weights = document.floats("VEC4", &[1.0, 0.0, 0.0, 0.0].repeat(4));
    document.attributes(0)["JOINTS_0"] = joints.into();
    document.attributes(0)["WEIGHTS_0"] = weights.into();
    let inverse = document.floats("MAT4", &inverse);
    document.push("nodes", json!({}));
    document.push("skins", json!({"joints": [2], "inverseBindMatrices": inverse}));
    document.node(0)["skin"] = 0.into();
    document.json["scenes"][0]["nodes"] = json!([0, 1, 2]);
    document
}

const IDENTITY: [f32; 16] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];

#[test]
fn the_joints_place_a_skinned_mesh_and_its_node_does_not() {
    let mut document = skinned(IDENTITY);
    document.node(0)["scale"] = json!([10, 10, 10]);
    let mesh = document.mesh();
    assert_eq!((colors(&mesh, 4), mesh.warnings), (both_squares(), vec![]));
    // Joint and inverse bind matrix cancel out.
    let mut halves = IDENTITY.map(|x| 2.0 * x);
    halves[15] = 1.0;
    let mut document = skinned(halves);
    document.node(2)["scale"] = json!([0.5, 0.5, 0.5]);
    document.node(0)["translation"] = json!([7, 7, 7]);
    assert_eq!(colors(&document.mesh(), 4), both_squares());
    // A joint below another node, outside of the scene: the mesh is where its joint is.
    let mut document = skinned(IDENTITY);
    document.push("nodes", json!({"translation": [10, 20, 30], "children": [2]}));
    document.json["scenes"][0]["nodes"] = json!([0, 1]);
    let mesh = document.mesh();
    assert_eq!(mesh.positions[..2], [[10.0, 20.0, 30.0], [11.0, 20.0, 30.0]]);
    // A joint that mirrors keeps the outside out.
    let mut document = skinned(IDENTITY);
    document.node(2)["scale"] = json!([-1, 1, 1]);
    assert_eq!(document.mesh().triangles[..2], [[0, 2, 1], [0, 3, 2]]);
}

#[test]
fn joints_are_blended_by_their_weights() {
    let mut document = skinned(IDENTITY);
    document.push("nodes", json!({"translation": [0, 0, 4]}));
    document.json["skins"][0] = json!({"joints": [2, 3]});
    let joints = document.bytes(&[[0, 1, 0, 0]; 4], false);
    // Weights need not add up to one; without any, a vertex follows its first joint.
    let weights = document
        .floats("VEC4", &[[1.0, 0.0], [0.25, 0.75], [2.0, 2.0], [0.0, 0.0]].map(|[a, b]| [a, b, 0.0, 0.0]).concat());
    document.attributes(0)["JOINTS_0"] = joints.into();
    document.attributes(0)["WEIGHTS_0"] = weights.into();
    let heights: Vec<f64> = document.mesh().positions[..4].iter().map(|p| p[2]).collect();
    assert_eq!(heights, [0.0, 3.0, 2.0, 0.0]);
    // The second set of four joints.
    let (joints, weights) =
        (document.bytes(&[[1, 0, 0, 0]; 4], false), document.floats("VEC4", &[3.0, 0.0, 0.0, 0.0].repeat(4)));
    document.attributes(0)["JOINTS_1"] = joints.into();
    document.attributes(0)["WEIGHTS_1"] = weights.into();
    let heights: Vec<f64> = document.mesh().positions[..4].iter().map(|p| p[2]).collect();
    let near = heights.iter().zip([3.0, 3.75, 20.0 / 7.0, 4.0]).all(|(x, expected)| (x - expected).abs() < 1e-12);
    assert!(near, "{heights:?}");
}

#[test]
fn bad_skins_leave_the_mesh_where_its_node_is() {
    let warning = |document: &Document| {
        let mesh = document.mesh();
        assert_eq!(colors(&mesh, 4), both_squares());
        assert_eq!(mesh.warnings.len(), 1, "{:?}", mesh.warnings);
        mesh.warnings[0].clone()
    };
    let mut document = skinned(IDENTITY);
    document.json["skins"] = json!([]);
    assert_eq!(
        warning(&document),
        "node 0: skin 0 cannot be read or does not exist; its mesh stays as the node places it"
    );
    let mut document = skinned(IDENTITY);
    document.json["skins"][0]["joints"] = json!([2, 2]);
    assert_eq!(
        warning(&document),
        "node 0: skin 0 has 1 inverse bind matrices for 2 joints; its mesh stays as the node places it"
    );
    let mut document = skinned(IDENTITY);
    document.node(0)["name"] = "arm".into();
    document.json["skins"][0]["joints"] = json!([17]);
    assert_eq!(
        warning(&document),
        "node 0 (arm): joint 0 of skin 0 is not a node of the scene graph; its mesh stays as the node places it"
    );
    let mut document = skinned(IDENTITY);
    let joints = document.bytes(&[[0, 0, 0, 0], [9, 0, 0, 0], [0; 4], [0; 4]], false);
    document.attributes(0)["JOINTS_0"] = joints.into();
    assert_eq!(
        warning(&document),
        "mesh 0, primitive 0: vertex 1 refers to a joint that the skin does not have; it has 1; in node 0 it stays as the \
         node places it, without its skin"
    );
    let mut document = skinned(IDENTITY);
    document.attributes(0).as_object_mut().unwrap().remove("WEIGHTS_0");
    assert_eq!(
        warning(&document),
        "mesh 0, primitive 0: it has no JOINTS_0 and WEIGHTS_0 for the skin; in node 0 it stays as the node places it, \
         without its skin"
    );
}

#[test]
fn morph_targets_have_their_default_weights() {
    let mut document = Document::new();
    document.square(0.0, [1.0, 0.0, 0.0, 1.0]);
    // The upper edge moves up by 2.
    let target = document.floats("VEC3", &[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 2.0, 0.0]);
    document.primitive(0)["targets"] = json!([{"POSITION": target}]);
    let height = |document: &Document| {
        let mesh = document.mesh();
        assert_eq!(mesh.warnings, [""; 0]);
        mesh.bounds().unwrap().1[1]
    };
    assert_eq!(height(&document), 1.0);
    document.json["meshes"][0]["weights"] = json!([1.0]);
    assert_eq!(height(&document), 3.0);
    assert_eq!(voxels(&document.mesh(), 4).len(), 6 * 16);
    // Those of the node take precedence.
    document.node(0)["weights"] = json!([0.5]);
    assert_eq!(height(&document), 2.0);
    document.node(0)["weights"] = json!([0.0]);
    assert_eq!(height(&document), 1.0);
    // Normals turn with their own offsets.
    let normals = document.floats("VEC3", &[0.0, 0.0, 1.0].repeat(4));
    let turned = document.floats("VEC3", &[1.0, 0.0, -1.0].repeat(4));
    document.attributes(0)["NORMAL"] = normals.into();
    document.primitive(0)["targets"][0]["NORMAL"] = turned.into();
    document.node(0)["weights"] = json!([1.0]);
    assert_eq!(document.mesh().normals, [[1.0, 0.0, 0.0]; 4]);
    // A target that cannot be read is left out.
    let short = document.floats("VEC3", &[0.0; 6]);
    document.primitive(0)["targets"][0]["POSITION"] = short.into();
    let mesh = document.mesh();
    assert_eq!(mesh.bounds().unwrap().1[1], 1.0);
    assert_eq!(
        mesh.warnings,
        ["mesh 0, primitive 0: POSITION of morph target 0 is left out: it has 2 values for 4 vertices"]
    );
}

#[test]
fn instances_of_a_node_are_all_drawn() {
    let mut document = Document::new();
    document.square(0.0, [1.0, 0.0, 0.0, 1.0]);
    let places = document.floats("VEC3", &[0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 4.0, 0.0, 0.0]);
    document.node(0)["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": places}}});
    for name in ["extensionsUsed", "extensionsRequired"] {
        document.json[name] = json!(["EXT_mesh_gpu_instancing"]);
        let mesh = document.mesh();
        assert_eq!((mesh.triangle_count(), &mesh.warnings[..]), (6, &[][..]));
        let starts: Vec<f64> = mesh.positions.iter().step_by(4).map(|p| p[0]).collect();
        assert_eq!(starts, [0.0, 2.0, 4.0]);
    }
    // Below the transform of the node; with rotations and sizes, which may be normalized integers.
    document.node(0)["translation"] = json!([100, 0, 0]);
    let half = 0.5f32.sqrt();
    let turns = document.floats("VEC4", &[[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, half, half], [0.0, 0.0, 0.0, 7.0]].concat());
    let sizes = document.floats("VEC3", &[1.0, 1.0, 1.0, 3.0, 3.0, 3.0, 1.0, 2.0, 1.0]);
    let attributes = json!({"TRANSLATION": places, "ROTATION": turns, "SCALE": sizes});
    document.node(0)["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = attributes;
    let mesh = document.mesh();
    let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(x, y)| (x - y).abs() < 1e-5);
    assert!(near(mesh.positions[5], [102.0, 3.0, 0.0]), "{:?}", mesh.positions);
    assert!(near(mesh.positions[10], [105.0, 2.0, 0.0]), "{:?}", mesh.positions);
    document.json["accessors"][sizes]["count"] = 2.into();
    assert!(document.error().contains("EXT_mesh_gpu_instancing has "), "{}", document.error());
}

#[test]
fn only_attributes_that_place_instances_make_copies() {
    let mut document = Document::new();
    document.square(0.0, [1.0, 0.0, 0.0, 1.0]);
    // An accessor without bytes.
    let count = 5000;
    let numbers = document.push("accessors", json!({"componentType": 5126, "count": count, "type": "SCALAR"}));
    let with = |document: &mut Document, attributes: serde_json::Value| {
        document.node(0)["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": attributes}});
    };
    with(&mut document, json!({"_ID": numbers}));
    assert_eq!(document.mesh().triangle_count(), 2);
    let places = document.floats("VEC3", &[0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 4.0, 0.0, 0.0]);
    with(&mut document, json!({"_ID": numbers, "TRANSLATION": places}));
    assert_eq!(document.mesh().triangle_count(), 6);
    // One that places copies must have the bytes for them.
    document.json["accessors"][places]["count"] = 20_000_000.into();
    assert!(document.error().contains("reaches past the end of buffer view"), "{}", document.error());
    with(&mut document, json!({"TRANSLATION": numbers}));
    assert!(document.error().ends_with("(TRANSLATION of node 0) must be of type VEC3"), "{}", document.error());
}

#[test]
fn hidden_nodes_are_left_out_but_keep_their_place() {
    let mut document = Document::two_squares();
    document.json["extensionsUsed"] = json!(["KHR_node_visibility"]);
    document.node(0)["extensions"] = json!({"KHR_node_visibility": {"visible": false}});
    let mesh = document.mesh();
    assert_eq!(colors(&mesh, 4), square_of(BLUE));
    assert_eq!(mesh.warnings, ["node 0 is hidden by KHR_node_visibility; its mesh is left out"]);
    document.node(0)["extensions"]["KHR_node_visibility"]["visible"] = true.into();
    assert_eq!(colors(&document.mesh(), 4), both_squares());
    // With its descendants.
    document.push("nodes", json!({"children": [0], "extensions": {"KHR_node_visibility": {"visible": false}}}));
    document.json["scenes"][0]["nodes"] = json!([2, 1]);
    assert_eq!(colors(&document.mesh(), 4), square_of(BLUE));
    document.json["scenes"][0]["nodes"] = json!([2]);
    assert_eq!(document.error(), "a.gltf: KHR_node_visibility hides every node that has a mesh; make one visible");
}

#[test]
fn bad_attributes_are_left_out_and_not_the_file() {
    for (name, kind, lost) in [("NORMAL", "VEC2", "VEC3"), ("COLOR_0", "SCALAR", "VEC3 or VEC4")] {
        let mut document = Document::two_squares();
        let bad = document.floats(kind, &[0.0; 12]);
        document.attributes(0)[name] = bad.into();
        let mesh = document.mesh();
        assert_eq!(colors(&mesh, 4), both_squares());
        assert_eq!(
            mesh.warnings,
            [format!(
                "mesh 0, primitive 0: {name} is left out: accessor {bad} ({name} of mesh 0, primitive 0) must be of type {lost}"
            )]
        );
    }
    let mut document = Document::two_squares();
    let short = document.floats("VEC3", &[0.0; 6]);
    document.attributes(0)["NORMAL"] = short.into();
    assert_eq!(document.mesh().warnings, ["mesh 0, primitive 0: NORMAL is left out: it has 2 values for 4 vertices"]);
    let mut document = Document::textured_square();
    let bad = document.floats("VEC2", &[0.0, 1.0, f32::NAN, 0.0, f32::INFINITY, 1.0, 0.0, 0.0]);
    document.attributes(0)["TEXCOORD_0"] = bad.into();
    let texture = document.texture(&png(1, 1, &[[255, 0, 0, 255]]));
    document.material(0)["pbrMetallicRoughness"] = json!({"baseColorTexture": {"index": texture}});
    let mesh = document.mesh();
    assert_eq!(colors(&mesh, 4), red_sheet());
    assert_eq!(
        mesh.warnings,
        [
            "mesh 0, primitive 0: the texture coordinates of 2 of its vertices (the first is vertex 1) are not finite; 0, 0 is \
          used"
        ]
    );
}

#[test]
fn compressed_geometry_is_refused_by_name_unless_there_is_a_copy() {
    let mut document = Document::two_squares();
    document.json["extensionsUsed"] = json!(["KHR_draco_mesh_compression"]);
    document.json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    document.primitive(0)["extensions"] =
        json!({"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}});
    let mesh = document.mesh();
    assert_eq!((colors(&mesh, 4), mesh.warnings), (both_squares(), vec![]));
    let positions = document.attributes(0)["POSITION"].as_u64().unwrap() as usize;
    document.json["accessors"][positions].as_object_mut().unwrap().remove("bufferView");
    let refused = "mesh 0, primitive 0 is compressed with the glTF extension KHR_draco_mesh_compression, which is not \
                   supported, and has no uncompressed copy; export it without compression";
    assert_eq!(document.error(), format!("a.gltf: {refused}"));
    // Also if the extension is not required: the accessors would be all zero.
    document.json.as_object_mut().unwrap().remove("extensionsRequired");
    assert_eq!(document.error(), format!("a.gltf: {refused}"));
    // Meshopt: the views that accessors refer to lie in a buffer without bytes.
    let mut document = Document::two_squares();
    document.json["extensionsUsed"] = json!(["EXT_meshopt_compression"]);
    document.json["extensionsRequired"] = json!(["EXT_meshopt_compression"]);
    assert_eq!(colors(&document.mesh(), 4), both_squares());
    document.json["buffers"] =
        json!([{"byteLength": 48, "extensions": {"EXT_meshopt_compression": {"fallback": true}}}]);
    document.json["bufferViews"][0] = json!({
        "buffer": 1, "byteLength": 48, "byteStride": 12, "extensions": {"EXT_meshopt_compression":
            {"buffer": 0, "byteLength": 48, "byteStride": 12, "count": 4, "mode": "ATTRIBUTES"}},
    });
    let refused = "buffer 1 is compressed with the glTF extension EXT_meshopt_compression, which is not supported, and has no \
                   uncompressed copy; export it without compression";
    assert_eq!(document.error(), format!("a.gltf: {refused}"));
}

#[test]
fn extensions_that_are_ignored_are_named_with_their_place() {
    let mut document = Document::two_squares();
    document.json["extensionsUsed"] = json!(["ADOBE_a", "ADOBE_b", "ADOBE_unused"]);
    document.json["nodes"][1]["name"] = "lamp".into();
    document.json["nodes"][1]["extensions"] = json!({"ADOBE_a": {}});
    document.material(0)["normalTexture"] = json!({"index": 0, "extensions": {"ADOBE_b": {}}});
    document.texture(&png(1, 1, &[[128, 128, 255, 255]]));
    let warnings = document.mesh().warnings;
    assert_eq!(warnings[0], "node 1 (lamp): the glTF extension ADOBE_a is not supported; it is ignored");
    assert_eq!(warnings[1], "material 0, normalTexture: the glTF extension ADOBE_b is not supported; it is ignored");
    assert!(!warnings.iter().any(|line| line.contains("unused")), "{warnings:?}");
}

#[test]
fn chunks_of_a_glb_may_be_unpadded() {
    let mesh = Files::new().accept("a.glb", Document::two_squares().unpadded_glb());
    assert_eq!((colors(&mesh, 4), mesh.warnings), (both_squares(), vec![]));
}
