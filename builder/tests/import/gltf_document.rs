//! glTF documents under construction: unit squares, a red one at x = 0 to 1, and where two are needed, a blue one at x = 2 to 3.
//! The root cube then has an edge of 3, and each square has 6 x 6 voxels at level 4.

use std::collections::BTreeMap;

use esvo_builder::Mesh;
use serde_json::{Value, json};

use crate::support::{self, Files, data_uri, voxels};

pub(crate) const RED: [u8; 3] = [255, 0, 0];
pub(crate) const BLUE: [u8; 3] = [0, 0, 255];

/// A document under construction.
pub(crate) struct Document {
    /// Its `buffers` are those after the first, which has `bytes`.
    pub(crate) json: Value,
    bytes: Vec<u8>,
}

impl Document {
    /// Nothing but the lists.
    pub(crate) fn new() -> Self {
        let json = json!({
            "asset": {"version": "2.0"}, "buffers": [], "bufferViews": [], "accessors": [], "meshes": [], "materials": [],
            "nodes": [], "scene": 0, "scenes": [{"nodes": []}],
        });
        Self { json, bytes: Vec::new() }
    }

    /// A red square at x = 0 to 1 (mesh 0, node 0) and a blue one at x = 2 to 3 (mesh 1, node 1).
    pub(crate) fn two_squares() -> Self {
        let mut document = Self::new();
        document.square(0.0, [1.0, 0.0, 0.0, 1.0]);
        document.square(2.0, [0.0, 0.0, 1.0, 1.0]);
        document
    }

    /// A red square with texture coordinates from 0, 0 at the top left to 1, 1.
    pub(crate) fn textured_square() -> Self {
        let mut document = Self::new();
        document.square(0.0, [1.0; 4]);
        let uvs = document.floats("VEC2", &[0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0]);
        document.attributes(0)["TEXCOORD_0"] = uvs.into();
        document
    }

    pub(crate) fn list(&mut self, name: &str) -> &mut Vec<Value> {
        let root = self.json.as_object_mut().unwrap();
        root.entry(name).or_insert_with(|| json!([])).as_array_mut().unwrap()
    }

    pub(crate) fn push(&mut self, list: &str, value: Value) -> usize {
        let list = self.list(list);
        list.push(value);
        list.len() - 1
    }

    pub(crate) fn view(&mut self, bytes: &[u8]) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let at = self.bytes.len();
        self.bytes.extend(bytes);
        self.push("bufferViews", json!({"buffer": 0, "byteOffset": at, "byteLength": bytes.len()}))
    }

    /// An accessor of floating-point numbers.
    pub(crate) fn floats(&mut self, kind: &str, values: &[f32]) -> usize {
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
    pub(crate) fn bytes(&mut self, values: &[[u8; 4]], normalized: bool) -> usize {
        let view = self.view(values.as_flattened());
        let count = values.len();
        self.push(
            "accessors",
            json!({"bufferView": view, "componentType": 5121, "count": count, "type": "VEC4", "normalized": normalized}),
        )
    }

    /// A unit square from `x` on, in a mesh, a material and a node of its own.
    pub(crate) fn square(&mut self, x: f32, color: [f32; 4]) {
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

    pub(crate) fn primitive(&mut self, mesh: usize) -> &mut Value {
        &mut self.json["meshes"][mesh]["primitives"][0]
    }

    pub(crate) fn attributes(&mut self, mesh: usize) -> &mut Value {
        &mut self.primitive(mesh)["attributes"]
    }

    pub(crate) fn material(&mut self, index: usize) -> &mut Value {
        &mut self.json["materials"][index]
    }

    pub(crate) fn node(&mut self, index: usize) -> &mut Value {
        &mut self.json["nodes"][index]
    }

    /// An embedded image.
    pub(crate) fn image(&mut self, bytes: &[u8]) -> usize {
        self.push("images", json!({"uri": data_uri(bytes)}))
    }

    /// A texture of an embedded image.
    pub(crate) fn texture(&mut self, bytes: &[u8]) -> usize {
        let image = self.image(bytes);
        self.push("textures", json!({"source": image}))
    }

    pub(crate) fn text(&self) -> String {
        let mut json = self.json.clone();
        let own = json!({"byteLength": self.bytes.len(), "uri": data_uri(&self.bytes)});
        json["buffers"].as_array_mut().unwrap().insert(0, own);
        json.to_string()
    }

    pub(crate) fn mesh(&self) -> Mesh {
        Files::new().accept("a.gltf", self.text())
    }

    pub(crate) fn error(&self) -> String {
        Files::new().refuse("a.gltf", self.text())
    }

    /// The document as a GLB container whose chunks are not padded.
    pub(crate) fn unpadded_glb(&self) -> Vec<u8> {
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

pub(crate) fn counts<const N: usize>(expected: [([u8; 3], usize); N]) -> BTreeMap<[u8; 3], usize> {
    expected.into_iter().collect()
}

pub(crate) fn square_of(color: [u8; 3]) -> BTreeMap<[u8; 3], usize> {
    counts([(color, 36)])
}

pub(crate) fn both_squares() -> BTreeMap<[u8; 3], usize> {
    counts([(RED, 36), (BLUE, 36)])
}

pub(crate) fn red_sheet() -> BTreeMap<[u8; 3], usize> {
    counts([(RED, 256)])
}

/// How many voxels of the deepest level have each colour.
pub(crate) fn colors(mesh: &Mesh, levels: u32) -> BTreeMap<[u8; 3], usize> {
    support::colors(&voxels(mesh, levels)).into_iter().collect()
}
