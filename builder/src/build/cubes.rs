//! Subtrees of a build without contours. Only the deepest level ends a voxel there, so that no shape is compared with anything and no
//! block of attributes is tested: a node is its mask of children, and on the deepest level the mask needs no pieces of surface.
//!
//! The voxels are those of `recursion.rs`, bit for bit.

use esvo_format::{RawNormal, Voxel as TreeVoxel};

use super::pair::{Bounds, Found, Parent};
use super::recursion::{Recursion, Source, Split, Worker};
use crate::surface::attributes::Mean;

/// The bits of a mask of child slots, in order.
fn bits(mask: u8) -> impl Iterator<Item = usize> + Clone {
    (0..8).filter(move |slot| mask >> slot & 1 != 0)
}

impl Recursion<'_> {
    /// Whether the subtrees of this build are cubes without holes.
    pub(super) fn has_cubes_only(&self) -> bool {
        !self.settings.contours && !self.surface.has_holes
    }

    /// Builds the subtree of a cube, which is a node of its parent, and pushes it to the worker's tree. Returns the mean of its
    /// attributes; `None`, and pushes nothing, if there is no surface in it.
    #[inline(never)]
    pub(super) fn push_cubes(&self, worker: &mut Worker, split: &Split) -> Option<Mean> {
        let (arena_mark, pieces_mark) = (worker.arena.mark(), worker.pieces.len());
        let through = self.through(worker, split);
        let split = Split { surface: through.as_ref().map_or(split.surface, Source::Through), ..*split };
        let deepest = split.cube.level + 1 == self.settings.levels;
        let stores = self.decider.stores_attributes();
        let mut ends = [0; 9];
        let mask = match split.surface {
            Source::Through(through) => through.children(split.cube.centre, split.cube.size),
            Source::Pieces(first, end) if deepest && !stores => {
                let Worker { arena, pieces, .. } = worker;
                let slots = |piece| arena.slots(piece, &self.surface.corners, split.cube.centre);
                pieces[first..end].iter().map(slots).fold(0, |mask, slots| mask | slots)
            }
            Source::Pieces(first, end) => {
                ends = self.distribute(worker, split.cube, first..end);
                (0..8).fold(0, |mask, slot| mask | u8::from(ends[slot] < ends[slot + 1]) << slot)
            }
        };
        let mean = (mask != 0).then(|| self.push_children(worker, &split, mask, &ends, deepest)).flatten();
        worker.pieces.truncate(pieces_mark);
        worker.arena.truncate(arena_mark);
        mean
    }

    /// Pushes the node of a cube with these children, and what is below it.
    fn push_children(
        &self,
        worker: &mut Worker,
        split: &Split,
        mut mask: u8,
        ends: &[usize; 9],
        deepest: bool,
    ) -> Option<Mean> {
        let stores = self.decider.stores_attributes();
        worker.voxels += u64::from(mask.count_ones());
        let (color, normal) = self.decider.wanted([0; 3], RawNormal::default());
        let mut voxels = [None; 8];
        bits(mask).for_each(|slot| voxels[slot] = Some(TreeVoxel { color, normal, contour: None, leaf: deepest }));
        let mut means = [Mean::default(); 8];
        if deepest && stores {
            let Worker { arena, pieces, .. } = worker;
            let found = match split.surface {
                Source::Pieces(..) => Found::Pieces { arena, pieces, ends: *ends },
                Source::Through(through) => Found::Through(through),
            };
            let parent = Parent { cube: split.cube, found, bounds: &Bounds::default() };
            for slot in bits(mask) {
                let found = self.decider.attributes(&parent, slot);
                let (color, normal) = self.decider.wanted(found.color, found.normal);
                voxels[slot] = Some(TreeVoxel { color, normal, contour: None, leaf: true });
                means[slot] = found.mean;
            }
        }
        let node = worker.tree.open(&voxels);
        for slot in bits(if deepest { 0 } else { mask }) {
            let surface = match split.surface {
                Source::Pieces(..) => Source::Pieces(ends[slot], ends[slot + 1]),
                through => through,
            };
            let child = Split { cube: split.cube.child(slot), surface, ..*split };
            match self.push_cubes(worker, &child) {
                Some(mean) if stores => {
                    let (color, normal) = mean.encode();
                    let (color, normal) = self.decider.wanted(color, normal);
                    worker.tree.set_attributes(node, slot, color, normal);
                    means[slot] = mean;
                }
                Some(_) => {}
                // The surface passes the cubes in the child within the margin.
                None => {
                    worker.tree.remove_voxel(node, slot);
                    mask &= !(1 << slot);
                }
            }
        }
        if mask == 0 {
            worker.tree.cancel(node);
            return None;
        }
        worker.tree.close(node);
        self.cut(&mut worker.tree, node, &split.cube);
        Some(if stores { Mean::of_parts(bits(mask).map(|slot| &means[slot])) } else { Mean::default() })
    }
}
