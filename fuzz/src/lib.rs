//! What the fuzz targets share with the tests of the format.

#[allow(dead_code, reason = "the tests take more of it")]
#[path = "../../format/tests/common/patch.rs"]
mod patch;
#[path = "../../format/tests/common/survive.rs"]
mod survive;

use esvo_format::Octree;

/// Does everything with the bytes that a program might do before it trusts them.
pub fn survive(bytes: &[u8]) {
    survive::survive(bytes);
}

/// The bytes with every checksum put right that can be found, so that what is behind the checksums is reached.
pub fn sealed(bytes: &[u8]) -> Vec<u8> {
    let mut file = patch::File(bytes.to_vec());
    file.seal_whatever_is_there();
    file.0
}

/// Looks at every voxel of a sound octree.
pub fn visit(octree: &Octree) {
    survive::visit(octree);
}
