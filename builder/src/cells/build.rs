//! From cells to an octree.

use std::ops::Range;
use std::path::Path;
use std::time::{Duration, Instant};

use esvo_format::{BlockStore, RawNormal, Tree, Voxel, pack};
use glam::{DMat4, Vec3A};
use rayon::prelude::*;

use super::Cells;
use crate::build::block_nodes;
use crate::surface::Sample;
use crate::surface::attributes::Mean;
use crate::surface::srgb::decode_srgb;
use crate::{BuildError, BuildSettings, BuildStats, Built, BuiltFile, FileOptions};

/// Cubes with fewer cells than this are not divided among threads.
const PARALLEL_CELLS: usize = 1 << 14;

/// Builds an octree whose leaves are these cells, without contours, on all threads of the current rayon pool. The result does
/// not depend on their number.
///
/// Colours and normals are averaged on every level; each leaf has the same weight. Of the settings, only `colors`, `normals`,
/// `plain_attributes` and `assemble` apply. `octree_to_mesh` is the transform from octree space (root cube `[0, 1]³`) to the
/// space of the octree's user, as [`PreparedMesh::octree_to_mesh`](super::PreparedMesh::octree_to_mesh). The statistics have
/// no triangles.
///
/// # Errors
/// Those of [`Cells::check`]; a transform or an octree that the format cannot hold.
pub fn build_cells(cells: &Cells, octree_to_mesh: DMat4, settings: &BuildSettings) -> Result<Built, BuildError> {
    let start = Instant::now();
    cells.check()?;
    cells_in_memory(cells, octree_to_mesh, settings, &metadata(cells), start.elapsed())
}

/// As [`build_cells`], directly into a file. Either the complete file appears or none. Of the options, only `write` and `meta`
/// apply.
///
/// # Errors
/// Those of [`build_cells`]; an error of writing files.
pub fn build_cells_file(
    cells: &Cells,
    octree_to_mesh: DMat4,
    settings: &BuildSettings,
    path: &Path,
    options: &FileOptions,
) -> Result<BuiltFile, BuildError> {
    let start = Instant::now();
    cells.check()?;
    cells_in_file(cells, octree_to_mesh, settings, path, options, &metadata(cells), start.elapsed())
}

fn metadata(cells: &Cells) -> String {
    let meta = serde_json::json!({
        "generator": concat!("esvo-builder ", env!("CARGO_PKG_VERSION")),
        "cells": cells.codes.len(),
    });
    meta.to_string()
}

/// As [`build_cells`], for cells that were checked, with this metadata. `prepare` is how long it took to make the cells.
pub(crate) fn cells_in_memory(
    cells: &Cells,
    octree_to_mesh: DMat4,
    settings: &BuildSettings,
    meta: &str,
    prepare: Duration,
) -> Result<Built, BuildError> {
    let store = BlockStore::in_memory();
    let start = Instant::now();
    let root = fill(cells, settings, &store)?;
    let voxelize = start.elapsed();
    let mut octree = store.octree(root, octree_to_mesh)?;
    octree.set_meta(meta.to_owned());
    Ok(Built { octree, stats: stats(prepare, voxelize, start.elapsed()) })
}

/// As [`build_cells_file`], for cells that were checked. `own` is the metadata if the options have none, and `prepare` how
/// long it took to make the cells.
pub(crate) fn cells_in_file(
    cells: &Cells,
    octree_to_mesh: DMat4,
    settings: &BuildSettings,
    path: &Path,
    options: &FileOptions,
    own: &str,
    prepare: Duration,
) -> Result<BuiltFile, BuildError> {
    let start = Instant::now();
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let file = tempfile::tempfile_in(folder).map_err(|e| BuildError::io(folder, e))?;
    let store = BlockStore::in_file(file, Vec::new());
    let root = fill(cells, settings, &store)?;
    let voxelize = start.elapsed();
    let meta = if options.meta.is_empty() { own } else { &options.meta };
    let object = store.write(root, octree_to_mesh, meta, path, &options.write)?;
    Ok(BuiltFile { object, stats: stats(prepare, voxelize, start.elapsed()), resumed: false, resumed_voxels: 0 })
}

/// `both` is the time of voxelizing and assembling together.
fn stats(prepare: Duration, voxelize: Duration, both: Duration) -> BuildStats {
    BuildStats { triangles: 0, dropped_triangles: 0, prepare, voxelize, assemble: both.saturating_sub(voxelize) }
}

/// Fills the store with the blocks of the cells. Returns the number of the root block.
fn fill(cells: &Cells, settings: &BuildSettings, store: &BlockStore) -> Result<u32, BuildError> {
    let filler = Filler {
        cells,
        settings,
        colors: settings.colors && !cells.colors.is_empty(),
        normals: settings.normals && !cells.normals.is_empty(),
        block_nodes: block_nodes(&settings.assemble),
        store,
    };
    let (tree, _) = filler.divide(0..cells.codes.len(), 0)?;
    Ok(store.put(pack(&tree, None, &settings.assemble)?)?)
}

struct Filler<'a> {
    cells: &'a Cells,
    settings: &'a BuildSettings,
    /// Whether voxels get colours.
    colors: bool,
    /// Whether voxels get normals.
    normals: bool,
    /// Subtrees with more nodes than this become blocks.
    block_nodes: usize,
    store: &'a BlockStore,
}

impl Filler<'_> {
    fn empty_tree(&self) -> Tree {
        let mut tree = Tree::default();
        tree.plain = self.settings.plain_attributes;
        tree
    }

    /// The tree of a cube on `level` with the cells `range` in it, at least one; its children in parallel. Also the mean of
    /// its attributes.
    fn divide(&self, range: Range<usize>, level: u32) -> Result<(Tree, Mean), BuildError> {
        let mut tree = self.empty_tree();
        // The children of a cube that is divided are not leaves: on the deepest level there are at most eight cells.
        if range.len() < PARALLEL_CELLS {
            let mean = self.descend(&mut tree, range, level)?;
            return Ok((tree, mean));
        }
        let starts = self.starts(&range, level);
        let subtrees: Vec<Option<(Tree, Mean)>> = (0..8usize)
            .into_par_iter()
            .map(|slot| {
                let range = starts[slot]..starts[slot + 1];
                if range.is_empty() { Ok(None) } else { self.divide(range, level + 1).map(Some) }
            })
            .collect::<Result<_, BuildError>>()?;
        let children = std::array::from_fn(|slot| {
            let (_, mean) = subtrees[slot].as_ref()?;
            let (color, normal) = mean.encode();
            Some(self.wanted(color, normal))
        });
        let node = tree.open(&children);
        for (subtree, _) in subtrees.iter().flatten() {
            tree.append(subtree);
        }
        self.close(&mut tree, node, self.cells.codes[range.start], level)?;
        Ok((tree, Mean::of_parts(subtrees.iter().flatten().map(|(_, mean)| mean))))
    }

    /// Pushes the node of a cube on `level` with the cells `range` in it, at least one, and its subtree.
    fn descend(&self, tree: &mut Tree, range: Range<usize>, level: u32) -> Result<Mean, BuildError> {
        let starts = self.starts(&range, level);
        let is_leaf = level + 1 == self.cells.levels;
        let mut means: [Option<Mean>; 8] = [None; 8];
        let children = std::array::from_fn(|slot| {
            let first = starts[slot];
            if first == starts[slot + 1] {
                return None;
            }
            if !is_leaf {
                return Some(self.wanted([0; 3], RawNormal::default()));
            }
            let mean = self.mean_of(first);
            means[slot] = Some(mean);
            // Not the colour of the mean: that went through linear light and back.
            let color = self.cells.colors.get(first).copied().unwrap_or_default();
            Some(Voxel { leaf: true, ..self.wanted(color, mean.encode().1) })
        });
        let node = tree.open(&children);
        if !is_leaf {
            for slot in (0..8).filter(|&slot| starts[slot] < starts[slot + 1]) {
                let mean = self.descend(tree, starts[slot]..starts[slot + 1], level + 1)?;
                let (color, normal) = mean.encode();
                let Voxel { color, normal, .. } = self.wanted(color, normal);
                tree.set_attributes(node, slot, color, normal);
                means[slot] = Some(mean);
            }
        }
        self.close(tree, node, self.cells.codes[range.start], level)?;
        Ok(Mean::of_parts(means.iter().flatten()))
    }

    /// Ends the node of a cube on `level` with this cell in it. Turns its subtree into a block if it is large enough.
    fn close(&self, tree: &mut Tree, node: usize, code: u64, level: u32) -> Result<(), BuildError> {
        tree.close(node);
        if level > 0 && tree.nodes.len() - node > self.block_nodes {
            let detached = tree.detach(node);
            let block = pack(&detached, Some(self.address(code, level)), &self.settings.assemble)?;
            tree.attach(self.store.put(block)?);
        }
        Ok(())
    }

    /// Where the cells of each child of a cube on `level` begin, and the end of the last. `range` are the cube's cells.
    fn starts(&self, range: &Range<usize>, level: u32) -> [usize; 9] {
        let shift = 3 * (self.cells.levels - level - 1);
        let codes = &self.cells.codes[range.clone()];
        let slot_of = |code: u64| (code >> shift & 7) as usize;
        std::array::from_fn(|slot| range.start + codes.partition_point(|&code| slot_of(code) < slot))
    }

    /// A voxel with the attributes that the cells have and the settings ask for.
    fn wanted(&self, color: [u8; 3], normal: RawNormal) -> Voxel {
        Voxel { color: self.colors.then_some(color), normal: self.normals.then_some(normal), ..Voxel::default() }
    }

    fn mean_of(&self, index: usize) -> Mean {
        let Cells { colors, normals, .. } = self.cells;
        let color = colors.get(index).map_or(Vec3A::ZERO, |color| decode_srgb(*color).into());
        let normal = normals.get(index).map_or(Vec3A::Z, |normal| Vec3A::from_array(*normal));
        Mean::new(1.0, &Sample { color, normal })
    }

    /// The cube on `level` that contains a cell: lower corner in units of 2^-23 of the root, and scale.
    fn address(&self, code: u64, level: u32) -> ([u32; 3], u32) {
        let corner = super::morton_place(code >> (3 * (self.cells.levels - level)));
        (corner.map(|x| x << (23 - level)), 23 - level)
    }
}
