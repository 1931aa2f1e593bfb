//! Arbitrary bytes with corrected checksums: open, validate, count, walk, dump, write again.

use esvo_format::{Octree, OpenOptions, diff::diff, dump};

use super::right_checksums;
use super::survive::survive;

/// Runs the target on one input.
pub fn run(data: &[u8]) {
    let bytes = right_checksums(data);
    survive(&bytes);
    let options = OpenOptions { memory_limit: 16 << 20, ..OpenOptions::default() };
    let Ok(octree) = Octree::from_bytes_with(&bytes, &options) else { return };
    // Blocks can be dumped even if they are broken.
    assert!(!dump::block(&octree, 0).expect("there is a block").to_string().is_empty());
    let mut again = Vec::new();
    if octree.verified().is_err() {
        assert!(octree.write_to(&mut again).is_err(), "a broken octree was written");
    } else {
        octree.write_to(&mut again).expect("writing to memory does not fail");
        let again = Octree::from_bytes_with(&again, &options).expect("what was written opens");
        assert!(again.slots() == octree.slots());
        // Decoded normals are never NaN, which would differ from itself.
        assert!(diff(&octree, &again, 1).expect("both are verified").is_empty());
    }
}
