//! The same with right checksums: open, validate, count, walk, dump, write anew.

use esvo_format::{Octree, OpenOptions, diff::diff, dump};

use super::right_checksums;
use super::survive::survive;

/// Runs the target on one input.
pub fn run(data: &[u8]) {
    let bytes = right_checksums(data);
    survive(&bytes);
    let options = OpenOptions { memory_limit: 16 << 20 };
    let Ok(octree) = Octree::from_bytes_with(&bytes, &options) else { return };
    // Broken or not, a block can be shown.
    assert!(!dump::block(&octree, 0).expect("there is a block").to_string().is_empty());
    if octree.sound().is_ok() {
        let mut again = Vec::new();
        octree.write_to(&mut again).expect("writing to memory does not fail");
        let again = Octree::from_bytes_with(&again, &options).expect("what was written opens");
        assert!(again.slots() == octree.slots());
        // A normal that is not a number would differ from itself: there is none.
        assert!(diff(&octree, &again, 1).expect("both are sound").is_empty());
    }
}
