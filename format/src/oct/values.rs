//! Colours and normals that are not in blocks: one for every voxel (a palette), or for every corner of one.

use glam::Vec3;

use super::kind;
use super::layers::{Layers, Node};
use crate::{Octree, RawNormal, Tree};

/// A colour, sRGB-encoded, and a normal.
pub(super) type Value = ([u8; 3], RawNormal);

/// As stored: alpha, blue, green and red from the top; a raw normal.
type Words = [u32; 2];

/// What a voxel has, of its own or from the nearest ancestor that does.
#[derive(Clone, Copy)]
pub(super) enum Attributes {
    /// Nothing.
    None,
    /// A value.
    One(Words),
    /// Values at the corners of a cube; the voxel is the part of it from `low` with edge `size`, the cube's being 1.
    Corners { values: [Words; 8], low: Vec3, size: f32 },
}

impl Attributes {
    /// Those of child `slot` of a node that has these.
    pub(super) fn child(self, layers: &Layers, node: &Node, slot: u32) -> Self {
        let word = |mask: u32| {
            let at = node.first_value as usize + 2 * (node.mask & (mask - 1)).count_ones() as usize;
            [layers.values[at], layers.values[at + 1]]
        };
        if layers.kind == Some(kind::CORNERS) {
            // The corners of the eight children are a lattice of 3 x 3 x 3, x fastest.
            let corner =
                |k: u32| 1 << (0..3).map(|axis| ((slot >> axis & 1) + (k >> axis & 1)) * [1, 3, 9][axis]).sum::<u32>();
            if (0..8).all(|k| node.mask & corner(k) != 0) {
                let values = std::array::from_fn(|k| word(corner(k as u32)));
                return Self::Corners { values, low: Vec3::ZERO, size: 1.0 };
            }
        } else if node.mask >> slot & 1 != 0 {
            return Self::One(word(1 << slot));
        }
        match self {
            Self::Corners { values, low, size } => {
                let offset = Vec3::from([0, 1, 2].map(|axis| (slot >> axis & 1) as f32));
                Self::Corners { values, low: low + offset * (size * 0.5), size: size * 0.5 }
            }
            other => other,
        }
    }

    /// The value in the middle of the voxel.
    pub(super) fn value(&self) -> Option<Value> {
        match self {
            Self::None => None,
            Self::One([color, normal]) => Some((channels(*color), RawNormal(*normal))),
            Self::Corners { values, low, size } => {
                let at = *low + *size * 0.5;
                let (mut color, mut normal, mut sum) = (Vec3::ZERO, Vec3::ZERO, 0.0);
                for (k, [c, n]) in values.iter().enumerate() {
                    let along = |axis: usize| if k >> axis & 1 != 0 { at[axis] } else { 1.0 - at[axis] };
                    // Corners that no surface comes near have no value, which their alpha of 0 tells.
                    let weight = if *c >> 24 == 0 { 0.0 } else { along(0) * along(1) * along(2) };
                    color += weight * Vec3::from(channels(*c).map(f32::from));
                    normal += weight * RawNormal(*n).decode();
                    sum += weight;
                }
                if sum == 0.0 {
                    return None;
                }
                let color = color / sum;
                Some((color.to_array().map(|c| c.round() as u8), RawNormal::encode(normal)))
            }
        }
    }
}

fn channels(color: u32) -> [u8; 3] {
    let [r, g, b, _] = color.to_le_bytes();
    [r, g, b]
}

/// How far the blocks of an octree are from the values in the tree that it was made from: the largest difference of a
/// colour channel in steps of 1/255, the largest angle between normals in degrees, and the mean of these angles.
pub(super) fn block_error(tree: &Tree, octree: &Octree) -> (f32, f32, f64) {
    let mut worst = (0.0f32, 0.0f32);
    let mut sum = 0.0;
    let mut stack = vec![(0, octree.objects()[0].root_slot as u32)];
    while let Some((index, slot)) = stack.pop() {
        let node = &tree.nodes[index];
        let valid = (0..8u8).filter(|child| node.valid >> child & 1 != 0);
        for (voxel, child) in (node.first_voxel as usize..).zip(valid) {
            if let (Some(exact), Some(found)) = (tree.colors.get(voxel), octree.color(slot, child)) {
                for (exact, found) in exact.iter().zip(found) {
                    worst.0 = worst.0.max((f32::from(*exact) - found * 255.0).abs());
                }
            }
            if let (Some(exact), Some(found)) = (tree.normals.get(voxel), octree.normal(slot, child)) {
                let angle = exact.decode().angle_between(found).to_degrees();
                worst.1 = worst.1.max(angle);
                sum += f64::from(angle);
            }
        }
        stack.extend(tree.children(index).filter_map(|(child, index)| Some((index, octree.child(slot, child)?))));
    }
    (worst.0, worst.1, sum / tree.voxels() as f64)
}
