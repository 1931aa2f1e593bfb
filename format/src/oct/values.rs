//! Colours and normals that are not in blocks: one for every voxel (a palette), or for every corner of one.

use super::kind;
use super::layers::{Layers, Node};
use crate::{CornerCell, CornerValue, NodeCorners};

/// What a voxel has, of its own or from the nearest ancestor that does.
#[derive(Clone, Copy)]
pub(super) enum Attributes {
    /// Nothing.
    None,
    /// A value.
    One(CornerValue),
    /// Values at the corners of a cube that the voxel is or is a part of.
    Corners(CornerCell),
}

impl Attributes {
    /// Those of child `slot` of a node that has these.
    pub(super) fn child(self, layers: &Layers, node: &Node, slot: u8) -> Self {
        let corners = NodeCorners { mask: node.mask, first: 0 };
        if layers.kind == Some(kind::CORNERS) {
            if let Some(cell) = corners.cell(slot, &own_values(layers, node)) {
                return Self::Corners(cell);
            }
        } else if node.mask >> slot & 1 != 0 {
            return Self::One(own_values(layers, node)[corners.rank(1 << slot)]);
        }
        match self {
            Self::Corners(cell) => Self::Corners(cell.child(slot)),
            other => other,
        }
    }
}

/// The values of a node: alpha, blue, green and red from the top; a raw normal.
pub(super) fn own_values(layers: &Layers, node: &Node) -> Vec<CornerValue> {
    let words = &layers.values[node.first_value as usize..][..2 * node.mask.count_ones() as usize];
    bytemuck::cast_slice(words).to_vec()
}
