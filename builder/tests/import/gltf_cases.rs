//! glTF files as programs write them: skins, morph targets, instances, hidden nodes, opacity of vertices, emission, images in
//! every format, and what is done about extensions that are not supported.
//!
//! The documents show unit squares: a red one at x = 0 to 1, and where two are needed, a blue one at x = 2 to 3. The root
//! cube then has an edge of 3, and each square has 6 x 6 voxels per layer at level 4.

use std::collections::BTreeMap;

use esvo_builder::{Mesh, Wrap};
use serde_json::{Value, json};

use crate::leaves::{colors, leaves, lines};
use crate::support::{Files, data_uri, png};

const RED: [u8; 3] = [255, 0, 0];
const BLUE: [u8; 3] = [0, 0, 255];
/// Layers of voxels that a flat sheet has.
const LAYERS: usize = 1;

/// A document under construction.
struct Document {
    /// Its `buffers` are those after the first, which has `bytes`.
    json: Value,
    bytes: Vec<u8>,
}

impl Document {
    /// Nothing but the lists.
    fn new() -> Self {
        let json = json!({
            "asset": {"version": "2.0"}, "buffers": [], "bufferViews": [], "accessors": [], "meshes": [], "materials": [],
            "nodes": [], "scene": 0, "scenes": [{"nodes": []}],
        });
        Self { json, bytes: Vec::new() }
    }

    /// A red square at x = 0 to 1 (mesh 0, node 0) and a blue one at x = 2 to 3 (mesh 1, node 1).
    fn two_squares() -> Self {
        let mut document = Self::new();
        document.square(0.0, [1.0, 0.0, 0.0, 1.0]);
        document.square(2.0, [0.0, 0.0, 1.0, 1.0]);
        document
    }

    /// A red square with texture coordinates from 0, 0 at the top left to 1, 1.
    fn textured_square() -> Self {
        let mut document = Self::new();
        document.square(0.0, [1.0; 4]);
        let uvs = document.floats("VEC2", &[0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0]);
        document.attributes(0)["TEXCOORD_0"] = uvs.into();
        document
    }

    fn list(&mut self, name: &str) -> &mut Vec<Value> {
        let root = self.json.as_object_mut().unwrap();
        root.entry(name).or_insert_with(|| json!([])).as_array_mut().unwrap()
    }

    fn push(&mut self, list: &str, value: Value) -> usize {
        let list = self.list(list);
        list.push(value);
        list.len() - 1
    }

    fn view(&mut self, bytes: &[u8]) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let at = self.bytes.len();
        self.bytes.extend(bytes);
        self.push("bufferViews", json!({"buffer": 0, "byteOffset": at, "byteLength": bytes.len()}))
    }

    /// An accessor of floating-point numbers.
    fn floats(&mut self, kind: &str, values: &[f32]) -> usize {
        let width = match kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => 16,
        };
        let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        let view = self.view(&bytes);
        let count = values.len() / width;
        self.push("accessors", json!({"bufferView": view, "componentType": 5126, "count": count, "type": kind}))
    }

    /// An accessor of four bytes per vertex.
    fn bytes(&mut self, values: &[[u8; 4]], normalized: bool) -> usize {
        let view = self.view(values.as_flattened());
        let count = values.len();
        self.push(
            "accessors",
            json!({"bufferView": view, "componentType": 5121, "count": count, "type": "VEC4", "normalized": normalized}),
        )
    }

    /// A unit square from `x` on, in a mesh, a material and a node of its own.
    fn square(&mut self, x: f32, color: [f32; 4]) {
        let positions = self.floats("VEC3", &[x, 0.0, 0.0, x + 1.0, 0.0, 0.0, x + 1.0, 1.0, 0.0, x, 1.0, 0.0]);
        let view = self.view(&[0, 1, 2, 0, 2, 3]);
        let indices =
            self.push("accessors", json!({"bufferView": view, "componentType": 5121, "count": 6, "type": "SCALAR"}));
        let material = self.push("materials", json!({"pbrMetallicRoughness": {"baseColorFactor": color}}));
        let primitive = json!({"attributes": {"POSITION": positions}, "indices": indices, "material": material});
        let mesh = self.push("meshes", json!({"primitives": [primitive]}));
        let node = self.push("nodes", json!({"mesh": mesh}));
        self.json["scenes"][0]["nodes"].as_array_mut().unwrap().push(node.into());
    }

    fn primitive(&mut self, mesh: usize) -> &mut Value {
        &mut self.json["meshes"][mesh]["primitives"][0]
    }

    fn attributes(&mut self, mesh: usize) -> &mut Value {
        &mut self.primitive(mesh)["attributes"]
    }

    fn material(&mut self, index: usize) -> &mut Value {
        &mut self.json["materials"][index]
    }

    fn node(&mut self, index: usize) -> &mut Value {
        &mut self.json["nodes"][index]
    }

    /// An embedded image.
    fn image(&mut self, bytes: &[u8]) -> usize {
        self.push("images", json!({"uri": data_uri(bytes)}))
    }

    /// A texture of an embedded image.
    fn texture(&mut self, bytes: &[u8]) -> usize {
        let image = self.image(bytes);
        self.push("textures", json!({"source": image}))
    }

    fn text(&self) -> String {
        let mut json = self.json.clone();
        let own = json!({"byteLength": self.bytes.len(), "uri": data_uri(&self.bytes)});
        json["buffers"].as_array_mut().unwrap().insert(0, own);
        json.to_string()
    }

    fn mesh(&self) -> Mesh {
        Files::new().accept("a.gltf", self.text())
    }

    fn error(&self) -> String {
        Files::new().refuse("a.gltf", self.text())
    }

    /// The document as a GLB container whose chunks are not padded.
    fn unpadded_glb(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"] = json!([{"byteLength": self.bytes.len()}]);
        let mut text = json.to_string().into_bytes();
        while text.len() % 4 != 1 {
            text.push(b' ');
        }
        let mut bytes = b"glTF\x02\0\0\0".to_vec();
        bytes.extend((28 + text.len() as u32 + self.bytes.len() as u32).to_le_bytes());
        for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &self.bytes)] {
            bytes.extend((chunk.len() as u32).to_le_bytes());
            bytes.extend(kind);
            bytes.extend(chunk);
        }
        bytes
    }
}

fn counts<const N: usize>(expected: [([u8; 3], usize); N]) -> BTreeMap<[u8; 3], usize> {
    expected.into_iter().collect()
}

fn square_of(color: [u8; 3]) -> BTreeMap<[u8; 3], usize> {
    counts([(color, 36 * LAYERS)])
}

fn both_squares() -> BTreeMap<[u8; 3], usize> {
    counts([(RED, 36 * LAYERS), (BLUE, 36 * LAYERS)])
}

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
    assert_eq!(leaves(&document.mesh(), 4).len(), 6 * 16 * LAYERS);
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
    let red: Vec<[u32; 3]> = leaves(&document.mesh(), 6).iter().filter(|l| l.color == RED).map(|l| l.at).collect();
    // In 64ths of 3: the square ends at 21.3.
    let (first, last) = (red.iter().map(|at| at[0]).min(), red.iter().map(|at| at[0]).max());
    assert_eq!((first, last), (Some(10), Some(21)));
    // With another cutoff, and the opacity of the material.
    document.material(0)["alphaCutoff"] = json!(0.2);
    document.material(0)["pbrMetallicRoughness"]["baseColorFactor"] = json!([1, 0, 0, 0.8]);
    let red = leaves(&document.mesh(), 6).iter().filter(|l| l.color == RED).map(|l| l.at[0]).min();
    assert_eq!(red, Some(5));
}

#[test]
fn the_opacity_of_vertices_and_of_texels_multiply() {
    let mut document = Document::textured_square();
    // The left half of the image has an opacity of 0.6.
    let texture = document.texture(&png(2, 1, &[[255, 0, 0, 153], [255, 0, 0, 255]]));
    document.material(0)["pbrMetallicRoughness"] = json!({"baseColorTexture": {"index": texture}});
    document.material(0)["alphaMode"] = "MASK".into();
    let full = leaves(&document.mesh(), 4).len();
    let alphas = document.bytes(&[[255, 255, 255, 178]; 4], true);
    document.attributes(0)["COLOR_0"] = alphas.into();
    let mesh = document.mesh();
    assert_eq!(mesh.warnings, [""; 0]);
    let half = leaves(&mesh, 4).len();
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
fn emission_is_the_colour_where_the_base_colour_is_black() {
    const GREEN: [u8; 4] = [0, 200, 0, 255];
    let sheet = || counts([([0, 200, 0], 256 * LAYERS)]);
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
    assert_eq!(colors(&document.mesh(), 4), counts([(BLUE, 256 * LAYERS)]));
    // Over another colour, or without emission, the base colour counts.
    document.material(0)["pbrMetallicRoughness"] = json!({"baseColorTexture": {"index": green}});
    assert_eq!(colors(&document.mesh(), 4), sheet());
    *document.material(0) = json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": black}}});
    assert_eq!(colors(&document.mesh(), 4), counts([([0; 3], 256 * LAYERS)]));
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

fn red_sheet() -> BTreeMap<[u8; 3], usize> {
    counts([(RED, 256 * LAYERS)])
}

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
            assert_eq!((colors(&mesh, 4), mesh.warnings), (counts([(expected, 256 * LAYERS)]), vec![]));
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
            assert_eq!(colors(&mesh, 3), counts([(RED, 64 * LAYERS)]));
            let expected = lost
                .map(|lost| format!("material material 0: the image 0 (embedded) cannot be decoded: {why}; {lost}"));
            assert_eq!(mesh.warnings, Vec::from_iter(expected), "{kind}");
        }
    }
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
