//! The leaves of the octree that a mesh becomes: how many there are, and their colours.

use std::collections::BTreeMap;

use esvo_builder::{BuildSettings, Mesh, build};
use esvo_format::Octree;

/// A leaf voxel on the deepest level.
pub(crate) struct Leaf {
    /// Lower corner in voxels of that level.
    pub(crate) at: [u32; 3],
    /// Decoded colour, 0..=255.
    pub(crate) color: [u8; 3],
}

/// The leaves of a mesh built with `levels` levels and plain attributes. All must be on the deepest level.
pub(crate) fn leaves(mesh: &Mesh, levels: u32) -> Vec<Leaf> {
    let settings =
        BuildSettings { levels, contours: false, plain_attributes: true, color_error: 0.0, ..BuildSettings::default() };
    let octree = build(mesh, &settings, &|_| ()).unwrap().octree;
    let mut found = Vec::new();
    visit(&octree, octree.objects()[0].root_slot as u32, levels, [0; 3], &mut found);
    found
}

pub(crate) fn visit(octree: &Octree, slot: u32, levels: u32, at: [u32; 3], found: &mut Vec<Leaf>) {
    let descriptor = octree.descriptor(slot);
    for child in (0..8u8).filter(|c| descriptor.valid_mask() >> c & 1 != 0) {
        let at = std::array::from_fn(|axis| 2 * at[axis] + u32::from(child >> axis & 1));
        match octree.child(slot, child) {
            Some(next) => visit(octree, next, levels - 1, at, found),
            None => {
                assert_eq!(levels, 1, "a leaf above the deepest level");
                let color = octree.color(slot, child).unwrap().map(|c| (c * 255.0).round() as u8);
                found.push(Leaf { at, color });
            }
        }
    }
}

/// How many leaves have each colour.
pub(crate) fn colors(mesh: &Mesh, levels: u32) -> BTreeMap<[u8; 3], usize> {
    let mut counts = BTreeMap::new();
    for leaf in leaves(mesh, levels) {
        *counts.entry(leaf.color).or_default() += 1;
    }
    counts
}

/// For a square of 16 x 16 voxels with a texture of red and white: the row of voxels through the upper half of its middle
/// third, from left to right, and the column through the left half of its middle third, from top to bottom.
pub(crate) fn lines(mesh: &Mesh) -> (String, String) {
    let leaves = leaves(mesh, 4);
    assert_eq!(leaves.len(), 256);
    // At least half of the light is red, in linear values.
    let letter = |leaf: &Leaf| if leaf.color[1] < 188 { 'r' } else { 'w' };
    let line = |along: usize, across: usize, place: u32| {
        let mut line: Vec<&Leaf> = leaves.iter().filter(|leaf| leaf.at[across] == place).collect();
        line.sort_by_key(|leaf| leaf.at[along]);
        line
    };
    (line(0, 1, 9).into_iter().map(letter).collect(), line(1, 0, 6).into_iter().rev().map(letter).collect())
}
