//! Colours and normals read as one value per voxel (palette) or per corner of a voxel.

use super::kind;
use super::layers::{Layers, Node};
use crate::{CornerCell, CornerValue, NodeCorners};

/// Colours and normals of a voxel, either its own or inherited from the nearest ancestor that has some.
#[derive(Clone, Copy)]
pub(super) enum Attributes {
    /// None.
    None,
    /// A value.
    One(CornerValue),
    /// Values at the corners of the voxel's cube or of an ancestor's.
    Corners(CornerCell),
}

impl Attributes {
    /// The attributes of child `slot` of a node with these attributes.
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

/// The values of a node: a word with alpha, blue, green and red from the top, and a raw normal.
pub(super) fn own_values(layers: &Layers, node: &Node) -> Vec<CornerValue> {
    let words = &layers.values[node.first_value as usize..][..2 * node.mask.count_ones() as usize];
    bytemuck::cast_slice(words).to_vec()
}
