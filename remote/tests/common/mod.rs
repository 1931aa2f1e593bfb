//! A file to serve, and a client that loses patience soon.

use std::fs::File;
use std::io::Write;
use std::time::Duration;

use esvo_format::{AssembleOptions, Octree, Tree, Voxel, WriteOptions, assemble};
use esvo_remote::RemoteOptions;

/// An octree of many blocks.
pub(crate) fn octree() -> Octree {
    fn grow(tree: &mut Tree, state: &mut u64, level: u32) {
        let mut bits = || {
            *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            *state >> 33
        };
        let children: [Option<Voxel>; 8] = std::array::from_fn(|child| {
            let color = Some([bits() as u8, bits() as u8, bits() as u8]);
            let voxel = Voxel { leaf: level == 7 || bits() % 100 < 10, color, ..Voxel::default() };
            (child == 0 || bits() % 100 < 55).then_some(voxel)
        });
        let node = tree.open(&children);
        for _ in children.iter().flatten().filter(|voxel| !voxel.leaf) {
            grow(tree, state, level + 1);
        }
        tree.close(node);
    }
    let mut tree = Tree::default();
    grow(&mut tree, &mut 17, 1);
    assemble(&tree, glam::DMat4::IDENTITY, &AssembleOptions { block_slots: 256, ..AssembleOptions::default() }).unwrap()
}

/// The bytes of its file.
pub(crate) fn bytes(octree: &Octree, parts: bool) -> Vec<u8> {
    let mut bytes = Vec::new();
    octree.write_to_with(&mut bytes, &WriteOptions { parts, ..WriteOptions::default() }).unwrap();
    bytes
}

/// A temporary file with these bytes.
#[allow(dead_code, reason = "the test of object stores serves nothing itself")]
pub(crate) fn stored(bytes: &[u8]) -> File {
    let mut file = tempfile::tempfile().unwrap();
    file.write_all(bytes).unwrap();
    file
}

pub(crate) fn options() -> RemoteOptions {
    RemoteOptions {
        tries: 2,
        patience: Duration::from_millis(400),
        max_download: 10_000_000,
        ..RemoteOptions::default()
    }
}
