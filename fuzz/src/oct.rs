//! Files of the paper's authors: an imported octree is valid, and exporting and importing it again keeps its counts.

use esvo_format::{oct, validate};

use super::survive::visit;

/// Runs the target on one input.
pub fn run(data: &[u8]) {
    let Ok(imported) = oct::from_bytes(data) else { return };
    let octree = imported.octree;
    octree.sound().expect("what is imported is sound");
    let report = validate(&octree);
    assert!(report.is_ok(), "{report}");
    visit(&octree);
    let mut bytes = Vec::new();
    if oct::write_to(&octree, &mut bytes).is_ok() {
        let again = oct::from_bytes(&bytes).expect("what was exported is imported").octree;
        let counts = |octree: &esvo_format::Octree| -> Vec<_> {
            octree.objects().iter().map(|o| (o.levels, o.descriptors, o.leaf_voxels, o.contours)).collect()
        };
        assert_eq!(counts(&again), counts(&octree));
    }
}
