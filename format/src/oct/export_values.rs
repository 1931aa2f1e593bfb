//! Colours and normals written as one value per voxel (palette) or per corner of a voxel.

use std::collections::HashMap;

use crate::file::attachment;
use crate::values::plain::{OWN_CUBE, plain_entry, slots};
use crate::{CornerCell, CornerValue, NodeCorners, Octree, RawNormal};

/// Which attributes of an object are missing or inexact in the file.
#[derive(Default)]
pub(super) struct Gaps {
    pub(super) colors: bool,
    pub(super) normals: bool,
    /// Largest error of constant colours in blocks, in units of 1/255; `None` if there are no constant colours.
    pub(super) constant: Option<f32>,
    pub(super) ambient: bool,
    /// Some colours or normals are not plain values, so their palette entries are rounded.
    pub(super) rounded: bool,
    /// Number of descriptors whose corners are stored differently in the file.
    pub(super) lattice: u64,
}

/// Values of the voxels of an object that depend on those of their ancestors.
#[derive(Default)]
pub(super) struct Inherited {
    /// For each slot of the image with a descriptor, the mask of its voxels that get a value in the palette: those
    /// whose value is stored separately, and those whose value differs from their parent's. All others inherit that of
    /// their parent.
    own: Vec<u8>,
    /// By slot of the descriptor: corners to write instead of those of the octree, which would decode differently in
    /// the file.
    corners: HashMap<u32, (u32, Vec<CornerValue>)>,
}

impl Inherited {
    /// For a palette.
    pub(super) fn palette(octree: &Octree, root: u32, gaps: &mut Gaps) -> Self {
        let mut own = vec![0; octree.slots().len()];
        let mut stack = vec![(root, None)];
        while let Some((slot, above)) = stack.pop() {
            let valid = octree.descriptor(slot).valid_mask();
            let mut mask = plain_mask(octree, slot) & valid;
            for child in slots(valid) {
                let value = value(octree, slot, child, gaps);
                if Some(value) != above {
                    mask |= 1 << child;
                }
                stack.extend(octree.child(slot, child).map(|below| (below, Some(value))));
            }
            own[slot as usize] = mask;
        }
        Self { own, ..Self::default() }
    }

    /// For corners.
    pub(super) fn corners(octree: &Octree, root: u32, gaps: &mut Gaps) -> Self {
        let mut corners: HashMap<u32, (u32, Vec<CornerValue>)> = HashMap::new();
        let mut stack: Vec<(u32, Option<CornerCell>)> = vec![(root, None)];
        while let Some((slot, above)) = stack.pop() {
            let valid = octree.descriptor(slot).valid_mask();
            let (node, values) = node_corners(octree, slot);
            // In the file, a voxel without corners inherits those of the nearest ancestor that has some.
            let lacking = slots(valid).any(|child| !node.has_child(child));
            let own = (node.mask & OWN_CUBE != 0).then(|| values.get(node.rank(OWN_CUBE)..node.count())).flatten();
            let expected = above.map(|cell| cell.of_voxel());
            // The corners of this descriptor in the file, which its voxels inherit.
            let mut said = (node, values);
            if lacking && own != expected.as_ref().map(|corners| &corners[..]) {
                gaps.lattice += 1;
                let (mask, values) = corners.entry(slot).or_insert_with(|| lattice(node, values));
                said = (NodeCorners { mask: *mask, first: 0 }, &values[..]);
            }
            for child in slots(valid) {
                let below = octree.child(slot, child);
                stack.extend(below.map(|below| (below, said.0.cell(child, said.1))));
            }
        }
        Self { corners, ..Self::default() }
    }

    /// A word with mask and pointer for each node, then the values.
    pub(super) fn palette_words(&self, octree: &Octree, nodes: &[u32], gaps: &mut Gaps) -> Vec<u32> {
        let mut words = vec![0; nodes.len()];
        for (index, slot) in nodes.iter().enumerate() {
            let mask = self.own[*slot as usize];
            words[index] = (words.len() as u32) << 8 | u32::from(mask);
            for child in slots(mask) {
                words.extend_from_slice(bytemuck::cast_slice(&[value(octree, *slot, child, gaps)]));
            }
        }
        words
    }

    /// Two words with mask and pointer for each node, then the values.
    pub(super) fn corner_words(&self, octree: &Octree, nodes: &[u32]) -> Vec<u32> {
        let mut words = vec![0; nodes.len() * 2];
        for (index, slot) in nodes.iter().enumerate() {
            let (node, values) = node_corners(octree, *slot);
            let (mask, values) = match self.corners.get(slot) {
                Some((mask, values)) => (*mask, &values[..]),
                None => (node.mask & (OWN_CUBE - 1), values.get(..node.rank(OWN_CUBE)).unwrap_or_default()),
            };
            words[2 * index] = mask;
            words[2 * index + 1] = words.len() as u32;
            words.extend_from_slice(bytemuck::cast_slice(values));
        }
        words
    }
}

/// Values for all points of the lattice: existing values, values interpolated between the corners of the voxel, or
/// none.
fn lattice(node: NodeCorners, values: &[CornerValue]) -> (u32, Vec<CornerValue>) {
    let point = |index: u32| {
        if node.mask >> index & 1 != 0 {
            return values.get(node.rank(1 << index)).copied().unwrap_or_default();
        }
        // An octant of which the point is a corner, and the number of that corner.
        let place = [index % 3, index / 3 % 3, index / 9];
        let bits = |bit: fn(u32) -> u32| (0..3).fold(0, |all, axis| all | bit(place[axis]) << axis);
        let (child, corner) = (bits(|at| at / 2) as u8, bits(|at| at - at / 2));
        let own = NodeCorners { mask: node.mask & OWN_CUBE, first: 0 };
        let first = node.rank(OWN_CUBE).min(values.len());
        own.cell(child, &values[first..]).map_or_else(CornerValue::default, |cell| cell.of_voxel()[corner as usize])
    };
    (OWN_CUBE - 1, (0..27).map(point).collect())
}

/// The mask of the voxels of a descriptor whose colours or normals are stored separately.
fn plain_mask(octree: &Octree, slot: u32) -> u8 {
    let parts = &octree.parts()[octree.block_of(slot) as usize];
    let masks = parts.attachments.iter().map(|(kind, ..)| match *kind {
        kind @ (attachment::COLORS_PLAIN | attachment::NORMALS_PLAIN) => {
            let words = octree.attachment_words(parts, kind);
            words.and_then(|words| words.get((slot - parts.start) as usize)).map_or(0, |word| plain_entry(*word).0)
        }
        _ => 0,
    });
    masks.fold(0, |all, mask| all | mask)
}

/// Colour and normal of a voxel for a palette.
fn value(octree: &Octree, slot: u32, child: u8, gaps: &mut Gaps) -> CornerValue {
    let color = octree.plain_color(slot, child).unwrap_or_else(|| match octree.color(slot, child) {
        Some(color) => {
            gaps.rounded = true;
            let [r, g, b] = color.map(|c| (c * 255.0).round() as u8);
            [r, g, b, u8::MAX]
        }
        None => {
            gaps.colors = true;
            [u8::MAX; 4]
        }
    });
    let normal = octree.plain_normal(slot, child).unwrap_or_else(|| {
        let normal = octree.normal(slot, child);
        *(if normal.is_some() { &mut gaps.rounded } else { &mut gaps.normals }) = true;
        RawNormal::encode(normal.unwrap_or(glam::Vec3::Z))
    });
    CornerValue { color, normal }
}

fn node_corners(octree: &Octree, slot: u32) -> (NodeCorners, &[CornerValue]) {
    let parts = &octree.parts()[octree.block_of(slot) as usize];
    octree.corner_values(parts, slot).unwrap_or_default()
}
