//! Nodes and voxels as packets meet them: what walks of single packets and tiles of packets have in common.

use esvo_core::reference::MAX_SCALE;
use esvo_format::ChildDescriptor;
use fearless_simd::prelude::*;

use super::super::counters::{What, count};
use super::super::scene::Scene;
use super::packet::{Contour, Floats, Lanes, Packet, Results, axes, bits};

/// `[mirror][mask]`: the bits of a mask of children in the order of mirrored space.
static MIRRORED: [[u8; 256]; 8] = {
    let mut table = [[0; 256]; 8];
    let mut mirror = 0;
    while mirror < 8 {
        let mut mask = 0;
        while mask < 256 {
            let mut child = 0;
            while child < 8 {
                table[mirror][mask] |= ((mask >> (child ^ mirror) & 1) << child) as u8;
                child += 1;
            }
            mask += 1;
        }
        mirror += 1;
    }
    table
};

/// What a scene is for rays of one octant.
pub(super) struct Tree<'a> {
    slots: &'a [u64],
    words: &'a [u32],
    order: &'static [u8; 256],
    /// The axes that are mirrored.
    pub(super) mirror: usize,
    pub(super) root: u32,
}

impl<'a> Tree<'a> {
    #[inline(always)]
    pub(super) fn new(scene: &Scene<'a>, mirror: usize) -> Self {
        let order = &MIRRORED[mirror & 7];
        Self { slots: scene.slots(), words: scene.words(), order, mirror, root: scene.root() }
    }

    /// The word of a child's contour.
    #[inline(always)]
    pub(super) fn contour(&self, node: &Node, child: &Child) -> Contour {
        count(What::Bytes, 4);
        let descriptor = node.descriptor;
        let at = 2 * node.slot + descriptor.contour_ptr() + descriptor.contour_rank(child.number as u8);
        Contour(self.words[at as usize])
    }

    /// The node of this slot.
    #[inline(always)]
    pub(super) fn node(&self, slot: u32, pos: [f32; 3]) -> Node {
        count(What::Bytes, 8);
        let descriptor = ChildDescriptor(self.slots[slot as usize]);
        let mut first = slot + descriptor.child_ptr();
        if descriptor.far() {
            count(What::Bytes, 8);
            first = slot.wrapping_add(self.slots[first as usize] as u32);
        }
        Node { pos, slot, descriptor, first, todo: u32::from(self.order[descriptor.valid_mask() as usize]) }
    }
}

/// A node and the children that were not visited yet.
#[derive(Clone, Copy)]
pub(super) struct Node {
    /// Lower corner, in mirrored space.
    pub(super) pos: [f32; 3],
    pub(super) slot: u32,
    pub(super) descriptor: ChildDescriptor,
    /// Slot of the first child's descriptor.
    pub(super) first: u32,
    /// Children in mirrored space.
    pub(super) todo: u32,
}

impl Node {
    /// For frames that nothing was written to.
    pub(super) const NONE: Self = Self { pos: [0.0; 3], slot: 0, descriptor: ChildDescriptor(0), first: 0, todo: 0 };

    /// Takes the next child: upper halves come first.
    #[inline(always)]
    pub(super) fn next(&mut self, mirror: usize) -> Child {
        let idx = 31 - self.todo.leading_zeros();
        self.todo ^= 1 << idx;
        let half = axes(
            #[inline(always)]
            |axis: usize| (idx >> axis & 1) as usize,
        );
        Child { half, idx, number: idx as usize ^ mirror }
    }

    /// The child's lower corner; `size` is its edge.
    #[inline(always)]
    pub(super) fn corner_of(&self, child: &Child, size: f32) -> [f32; 3] {
        axes(
            #[inline(always)]
            |axis: usize| self.pos[axis] + if child.half[axis] != 0 { size } else { 0.0 },
        )
    }

    /// Slot of the descriptor of a child that is no leaf.
    #[inline(always)]
    pub(super) fn slot_of(&self, child: &Child) -> u32 {
        self.first + self.descriptor.child_rank(child.number as u8)
    }

    #[inline(always)]
    pub(super) fn is_leaf(&self, child: &Child) -> bool {
        self.descriptor.leaf_mask() >> child.number & 1 != 0
    }

    #[inline(always)]
    pub(super) fn has_contour(&self, child: &Child, contours: u8) -> bool {
        self.descriptor.contour_mask() & contours & 1 << child.number != 0
    }
}

/// Where a walk is.
#[derive(Clone, Copy)]
pub(super) struct Place {
    /// Nodes between the walk's first node and this one.
    pub(super) depth: usize,
    /// Edge of the node's children, 2 to the power of `scale` - 23.
    pub(super) size: f32,
    pub(super) scale: u32,
}

impl Place {
    /// In the root.
    pub(super) const ROOT: Self = Self { depth: 0, size: 0.5, scale: MAX_SCALE - 1 };

    /// Goes to a child's node.
    #[inline(always)]
    pub(super) fn down(&mut self) {
        self.depth += 1;
        self.scale -= 1;
        self.size *= 0.5;
    }

    /// Goes to the parent, unless this is the walk's first node.
    #[inline(always)]
    pub(super) fn up(&mut self) -> bool {
        let can = self.depth != 0;
        if can {
            self.depth -= 1;
            self.scale += 1;
            self.size *= 2.0;
        }
        can
    }
}

/// A child of a node.
pub(super) struct Child {
    /// 1 on the axes on which it is the upper half, in mirrored space.
    pub(super) half: [usize; 3],
    /// These bits as a number.
    pub(super) idx: u32,
    /// Its number in the octree.
    pub(super) number: usize,
}

/// Where rays meet a voxel.
pub(super) struct Meeting<S: Simd> {
    /// Where they cross the planes at the lower corner.
    pub(super) corner: [Floats<S>; 3],
    pub(super) entry: Floats<S>,
    pub(super) exit: Floats<S>,
    /// Where they end in the node.
    pub(super) t_max: Floats<S>,
    pub(super) lanes: Lanes,
}

/// The rays that go on into a voxel.
pub(super) struct Visit<S: Simd> {
    /// None is left if all end.
    pub(super) lanes: Lanes,
    pub(super) t_min: Floats<S>,
    pub(super) t_max: Floats<S>,
    /// Where they cross the planes through its centre, as the reference computes it.
    pub(super) centre: [Floats<S>; 3],
}

/// Rays look into a voxel: those for which it is small end, the others are clipped against its contour, and end in it if it
/// is a leaf. `place` is that of its parent.
#[inline(always)]
pub(super) fn visit<S: Simd>(
    simd: S,
    tree: &Tree,
    packet: &Packet<S>,
    (node, child): (&Node, &Child),
    place: Place,
    meeting: Meeting<S>,
    results: &mut Results<S>,
) -> Visit<S> {
    let Meeting { corner, entry, exit, t_max, lanes } = meeting;
    let Place { size, scale, .. } = place;
    let voxel = child.number as u32 | scale << 8;
    let centre = packet.centre(simd, corner, size);
    let mut inside = Visit { lanes, t_min: entry, t_max: t_max.min(exit), centre };
    let small = lanes & bits((exit * packet.size_per_t).simd_ge(Floats::splat(simd, size)));
    if small != 0 {
        results.hit(small, entry, node.slot, voxel);
        inside.lanes &= !small;
        if inside.lanes == 0 {
            return inside;
        }
    }
    if node.has_contour(child, packet.contours) {
        count(What::ContourTests, 1);
        let (start, end) = packet.slab(tree.contour(node, child), size, centre);
        inside.t_min = inside.t_min.max(start);
        inside.t_max = inside.t_max.min(end);
        inside.lanes &= bits(inside.t_min.simd_le(inside.t_max));
        if inside.lanes == 0 {
            return inside;
        }
    }
    if node.is_leaf(child) {
        results.hit(inside.lanes, inside.t_min, node.slot, voxel);
        inside.lanes = 0;
    }
    inside
}
