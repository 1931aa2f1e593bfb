//! A part of an octree, as a streaming reader makes it, shows the whole octree coarsely, and leaves nothing out.

use std::collections::HashMap;

use esvo_core::testing::sample::{Sample, cameras};
use esvo_core::{CastOptions, Hit, View, reference};
use esvo_format::{AssembleOptions, Octree, Region, StreamReader, validate};
use glam::DVec3;

/// Slots of the part with their slots in the whole, and parent and child slot of each descriptor of the whole.
struct Places {
    of_part: HashMap<u32, u32>,
    parent: HashMap<u32, (u32, u8)>,
}

impl Places {
    fn new(part: &Octree, whole: &Octree) -> Self {
        let mut places = Self { of_part: HashMap::new(), parent: HashMap::new() };
        let root = |octree: &Octree| octree.objects()[0].root_slot as u32;
        let mut stack = vec![(Some(root(part)), root(whole))];
        while let Some((ours, theirs)) = stack.pop() {
            if let Some(ours) = ours {
                places.of_part.insert(ours, theirs);
            }
            for child in 0..8 {
                if let Some(slot) = whole.child(theirs, child) {
                    places.parent.insert(slot, (theirs, child));
                    stack.push((ours.and_then(|ours| part.child(ours, child)), slot));
                }
            }
        }
        places
    }

    /// Whether the voxel that the part shows is that of the whole, or an ancestor of it.
    fn is_ancestor_or_equal(&self, part: &Hit, whole: &Hit) -> bool {
        let shown = (self.of_part[&part.slot], part.child());
        let mut voxel = Some((whole.slot, whole.child()));
        while let Some(at) = voxel {
            if at == shown {
                return true;
            }
            voxel = self.parent.get(&at.0).copied();
        }
        false
    }
}

fn cast(octree: &Octree, contours: bool) -> Vec<Hit> {
    let root = octree.objects()[0].root_slot as u32;
    let options = CastOptions { contours, beam: false, max_voxel_pixels: 0.0 };
    let mut hits = Vec::new();
    for camera in cameras() {
        let view = View::new(&camera, octree.octree_to_mesh(0), root, (64, 48), &options).unwrap();
        for y in 0..48 {
            hits.extend((0..64).map(|x| reference::cast_ray(octree, root, &view.ray(x, y), contours)));
        }
    }
    hits
}

#[test]
fn coarse_blocks_show_ancestors_and_all_blocks_the_same() {
    for contours in [false, true] {
        // Small blocks, of two or three levels each.
        let layout = AssembleOptions { block_slots: 64, near_limit: 40 };
        let whole = Sample { levels: 7, contours, layout }.octree().unwrap();
        let mut file = Vec::new();
        whole.write_to(&mut file).unwrap();
        let reader = StreamReader::open(&file).unwrap();
        let theirs = cast(&whole, contours);

        let all: Vec<u32> = (0..whole.blocks().len() as u32).collect();
        assert!(cast(&reader.partial(&all).unwrap(), contours) == theirs);

        let half = Region { low: DVec3::ZERO, high: DVec3::new(0.5, 1.0, 1.0) };
        for (region, level) in [(Region::ALL, 3), (Region::ALL, 5), (half, 7)] {
            let blocks = reader.blocks_for(0, &region, level);
            assert!(blocks.len() < all.len(), "{} blocks for level {level}", blocks.len());
            let part = reader.partial(&blocks).unwrap();
            assert!(validate(&part).findings.is_empty(), "{}", validate(&part));
            let places = Places::new(&part, &whole);
            let (mut coarser, mut same) = (0, 0);
            for (ours, theirs) in cast(&part, contours).iter().zip(&theirs) {
                if ours.is_miss() {
                    assert!(theirs.is_miss(), "nothing is seen through what is coarser: {theirs:?}");
                    continue;
                }
                let slot = places.of_part[&ours.slot];
                if whole.descriptor(slot).leaf_mask() >> ours.child() & 1 != 0 {
                    // A leaf of the whole, with nothing finer in front of it: both give the same hit.
                    assert_eq!((theirs.slot, theirs.child(), theirs.raw_t), (slot, ours.child(), ours.raw_t));
                    same += 1;
                } else if theirs.is_miss() || !places.is_ancestor_or_equal(ours, theirs) {
                    // The ray passes between the finer voxels of the coarse one and hits something beyond it.
                    assert!(ours.raw_t <= theirs.raw_t, "{ours:?} {theirs:?}");
                } else {
                    // Both enter by the same face, or the whole by one further along the ray; `t` is rounded.
                    assert!(ours.raw_t <= theirs.raw_t * (1.0 + 1e-5), "{ours:?} {theirs:?}");
                    coarser += 1;
                }
            }
            assert!(coarser > 1000, "{coarser} coarser, {same} the same");
            assert!(level != 7 || same > 1000, "{coarser} coarser, {same} the same");
        }
    }
}
