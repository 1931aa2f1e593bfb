//! Subtrees of a build without contours. Only the deepest level ends a voxel there, so that no shape is compared with anything and no
//! block of attributes is tested: a node is its mask of children, and on the deepest level the mask needs no pieces of surface.
//!
//! The voxels are those of `recursion.rs`, bit for bit.

use esvo_format::{RawNormal, Voxel as TreeVoxel};

use super::pair::{Bounds, Found, Parent};
use super::recursion::{Recursion, Source, Split, Worker, set_components};
use crate::surface::attributes::Mean;

/// The bits of a mask of child slots, in order.
fn bits(mask: u8) -> impl Iterator<Item = usize> + Clone {
    (0..8).filter(move |slot| mask >> slot & 1 != 0)
}

impl Recursion<'_> {
    /// Builds the subtree of a cube, which is a node of its parent, and pushes it to the worker's tree. Returns the mean of its
    /// attributes; `None`, and pushes nothing, if there is no surface in it.
    #[inline(never)]
    pub(super) fn push_cubes(&self, worker: &mut Worker, split: &Split) -> Option<Mean> {
        let (arena_mark, pieces_mark) = (worker.arena.mark(), worker.pieces.len());
        let through = self.through(worker, split);
        let split = Split { surface: through.as_ref().map_or(split.surface, Source::Through), ..*split };
        let deepest = split.cube.level + 1 == self.settings.levels;
        let stores = self.surface.stores(self.settings);
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
        let stores = self.surface.stores(self.settings);
        worker.voxels += u64::from(mask.count_ones());
        let (color, normal) = self.settings.wanted([0; 3], RawNormal::default());
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
                let (color, normal) = self.settings.wanted(found.color, found.normal);
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
                    let (color, normal) = self.settings.wanted(color, normal);
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
        if !worker.tree.columns.is_empty() {
            bits(mask).for_each(|slot| set_components(&mut worker.tree, node, slot, &means[slot]));
        }
        worker.tree.close(node);
        self.cut(&mut worker.tree, node, &split.cube);
        Some(if stores { Mean::of_parts(bits(mask).map(|slot| &means[slot])) } else { Mean::default() })
    }
}

#[cfg(test)]
mod tests {
    use esvo_format::{BlockStore, WriteOptions};
    use proptest::prelude::*;

    use super::*;
    use crate::surface::Surface;
    use crate::{BuildSettings, Material, Mesh};

    /// The file of a build that takes the short way or not.
    fn file(mesh: &Mesh, settings: &BuildSettings, short: bool) -> Vec<u8> {
        let surface = Surface::new(mesh, settings).expect("a mesh with surface");
        let store = BlockStore::in_memory();
        let mut recursion = Recursion::new(&surface, settings, &store, None, &|_| {});
        assert!(recursion.cubes_only);
        recursion.cubes_only = short;
        let root = recursion.run().expect("memory").expect("surface");
        let octree = store.octree(root, surface.octree_to_mesh).expect("a tree");
        let mut bytes = Vec::new();
        octree.write_to_with(&mut bytes, &WriteOptions::default()).expect("memory");
        bytes
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn the_short_way_gives_the_same_bytes(
            corners in prop::collection::vec(prop::array::uniform3(prop::array::uniform3(0.0f32..1.0)), 1..6),
            colors in prop::collection::vec(prop::array::uniform3(0.0f32..1.0), 18),
            (stores_colors, stores_normals) in any::<(bool, bool)>(), levels in 6u32..9,
        ) {
            let positions: Vec<[f64; 3]> = corners.iter().flatten().map(|p| p.map(f64::from)).collect();
            let mesh = Mesh {
                colors: colors[..positions.len()].to_vec(),
                triangles: (0..corners.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
                triangle_materials: vec![0; corners.len()],
                materials: vec![Material::default()],
                positions,
                ..Mesh::default()
            };
            let settings =
                BuildSettings { levels, contours: false, colors: stores_colors, normals: stores_normals, ..BuildSettings::default() };
            let (short, long) = (file(&mesh, &settings, true), file(&mesh, &settings, false));
            prop_assert!(short == long, "{} and {} bytes", short.len(), long.len());
        }
    }
}
