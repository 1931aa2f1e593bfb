//! From a voxel model to an octree.

use std::ops::Range;
use std::path::Path;
use std::time::{Duration, Instant};

use esvo_format::{BlockStore, RawNormal, Tree, Voxel, pack};
use glam::{DMat4, DVec3, Vec3A};
use rayon::prelude::*;

use super::normal::{morton, normals};
use super::{Place, VoxelModel};
use crate::build::block_nodes;
use crate::surface::Sample;
use crate::surface::attributes::Mean;
use crate::surface::srgb::decode_srgb;
use crate::{BuildError, BuildSettings, BuildStats, Built, BuiltFile, FileOptions};

/// Builds an octree from a voxel model.
///
/// Of the settings, only `colors`, `normals`, `plain_attributes` and `assemble` apply. There are no contours, and the level
/// follows from the model: see [`VoxelModel::levels`].
///
/// # Errors
/// Those of [`VoxelModel::levels`], and an octree that the format cannot hold.
pub fn build_voxels(model: &VoxelModel, settings: &BuildSettings) -> Result<Built, BuildError> {
    let store = BlockStore::in_memory();
    let start = Instant::now();
    let (root, octree_to_mesh, mut stats) = fill(model, settings, &store)?;
    let mut octree = store.octree(root, octree_to_mesh)?;
    octree.set_meta(metadata(model));
    stats.assemble = start.elapsed().saturating_sub(stats.prepare + stats.voxelize);
    Ok(Built { octree, stats })
}

/// Builds an octree from a voxel model directly into a file. Either the complete file appears or none. Of the options, only
/// `write` and `meta` apply.
///
/// # Errors
/// Those of [`build_voxels`]; an error of writing files.
pub fn build_voxels_file(
    model: &VoxelModel,
    settings: &BuildSettings,
    path: &Path,
    options: &FileOptions,
) -> Result<BuiltFile, BuildError> {
    let start = Instant::now();
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let file = tempfile::tempfile_in(folder).map_err(|e| BuildError::io(folder, e))?;
    let store = BlockStore::in_file(file, Vec::new());
    let (root, octree_to_mesh, mut stats) = fill(model, settings, &store)?;
    let own = metadata(model);
    let meta = if options.meta.is_empty() { &own } else { &options.meta };
    let object = store.write(root, octree_to_mesh, meta, path, &options.write)?;
    stats.assemble = start.elapsed().saturating_sub(stats.prepare + stats.voxelize);
    Ok(BuiltFile { object, stats, resumed: false, resumed_voxels: 0 })
}

fn metadata(model: &VoxelModel) -> String {
    let meta = serde_json::json!({
        "generator": concat!("esvo-builder ", env!("CARGO_PKG_VERSION")),
        "model_voxels": model.voxels.len(),
    });
    meta.to_string()
}

/// Fills the store with the blocks of a model. Returns the number of the root block, the transform of the octree, and times.
fn fill(
    model: &VoxelModel,
    settings: &BuildSettings,
    store: &BlockStore,
) -> Result<(u32, DMat4, BuildStats), BuildError> {
    let start = Instant::now();
    let place = model.place()?;
    let Place { lowest, levels } = place;
    let mut cells: Vec<(u64, [u8; 3])> = (model.voxels.par_iter())
        .map(|voxel| {
            let at = std::array::from_fn(|k| (i64::from(voxel.at[k]) - i64::from(lowest[k])) as u32);
            (morton(at), voxel.color)
        })
        .collect();
    // Stable, so that the later of two voxels at a place stays the later.
    cells.par_sort_by_key(|cell| cell.0);
    cells.dedup_by(|later, earlier| {
        let same = later.0 == earlier.0;
        if same {
            earlier.1 = later.1;
        }
        same
    });
    let (codes, colors): (Vec<u64>, Vec<[u8; 3]>) = cells.into_iter().unzip();
    let normals = if settings.normals { normals(&codes, levels) } else { Vec::new() };
    let prepare = start.elapsed();
    let block_nodes = block_nodes(&settings.assemble);
    let filler = Filler { codes, colors, normals, settings, levels, block_nodes, store };
    let mut tree = Tree::default();
    tree.plain = settings.plain_attributes;
    filler.descend(&mut tree, 0..filler.codes.len(), 0)?;
    let root = store.put(pack(&tree, None, &settings.assemble)?)?;
    let octree_to_mesh = DMat4::from_translation(DVec3::from(lowest.map(f64::from)))
        * DMat4::from_scale(DVec3::splat(f64::from(levels).exp2()));
    let voxelize = start.elapsed() - prepare;
    Ok((
        root,
        octree_to_mesh,
        BuildStats { triangles: 0, dropped_triangles: 0, prepare, voxelize, assemble: Duration::ZERO },
    ))
}

struct Filler<'a> {
    /// The Morton codes of the voxels, ascending.
    codes: Vec<u64>,
    colors: Vec<[u8; 3]>,
    /// Empty if normals are not wanted.
    normals: Vec<Vec3A>,
    settings: &'a BuildSettings,
    levels: u32,
    /// Subtrees with more nodes than this become blocks.
    block_nodes: usize,
    store: &'a BlockStore,
}

impl Filler<'_> {
    /// Pushes the node of a cube on `level` with the voxels `range` in it, at least one, and its subtree.
    fn descend(&self, tree: &mut Tree, range: Range<usize>, level: u32) -> Result<Mean, BuildError> {
        let shift = 3 * (self.levels - level - 1);
        let codes = &self.codes[range.clone()];
        let slot_of = |code: u64| (code >> shift & 7) as usize;
        let start = |slot: usize| range.start + codes.partition_point(|&code| slot_of(code) < slot);
        let starts: [usize; 9] = std::array::from_fn(start);
        let is_leaf = level + 1 == self.levels;
        let mut means: [Option<Mean>; 8] = [None; 8];
        let children = std::array::from_fn(|slot| {
            if starts[slot] == starts[slot + 1] {
                return None;
            }
            let mut voxel = Voxel { leaf: is_leaf, ..self.wanted([0; 3], RawNormal::default()) };
            if is_leaf {
                let mean = self.mean_of(starts[slot]);
                voxel = Voxel { leaf: true, ..self.wanted(self.colors[starts[slot]], mean.encode().1) };
                means[slot] = Some(mean);
            }
            Some(voxel)
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
        tree.close(node);
        if level > 0 && tree.nodes.len() - node > self.block_nodes {
            let detached = tree.detach(node);
            let block = pack(&detached, Some(self.address(codes[0], level)), &self.settings.assemble)?;
            tree.attach(self.store.put(block)?);
        }
        Ok(Mean::of_parts(means.iter().flatten()))
    }

    /// A voxel with the attributes that the settings ask for.
    fn wanted(&self, color: [u8; 3], normal: RawNormal) -> Voxel {
        Voxel {
            color: self.settings.colors.then_some(color),
            normal: self.settings.normals.then_some(normal),
            ..Voxel::default()
        }
    }

    fn mean_of(&self, index: usize) -> Mean {
        let color = decode_srgb(self.colors[index]).into();
        Mean::new(1.0, &Sample { color, normal: self.normals.get(index).copied().unwrap_or(Vec3A::Z) })
    }

    /// The cube on `level` that contains a voxel: lower corner in units of 2^-23 of the root, and scale.
    fn address(&self, code: u64, level: u32) -> ([u32; 3], u32) {
        let mut corner = [0u32; 3];
        for bit in 0..level {
            let slot = code >> (3 * (self.levels - level + bit)) & 7;
            for (axis, x) in corner.iter_mut().enumerate() {
                *x |= ((slot >> axis & 1) as u32) << bit;
            }
        }
        (corner.map(|x| x << (23 - level)), 23 - level)
    }
}
