//! From a voxel model to an octree.

use std::path::Path;
use std::time::Instant;

use glam::{DMat4, DVec3};
use rayon::prelude::*;

use super::normal::normals;
use super::{Place, VoxelModel};
use crate::cells::{Cells, cells_in_file, cells_in_memory, morton};
use crate::{BuildError, BuildSettings, Built, BuiltFile, FileOptions};

/// Builds an octree from a voxel model.
///
/// Of the settings, only `colors`, `normals`, `plain_attributes` and `assemble` apply. There are no contours, and the level
/// follows from the model: see [`VoxelModel::levels`].
///
/// # Errors
/// Those of [`VoxelModel::levels`], and an octree that the format cannot hold.
pub fn build_voxels(model: &VoxelModel, settings: &BuildSettings) -> Result<Built, BuildError> {
    let start = Instant::now();
    let (cells, octree_to_mesh) = cells_of(model, settings)?;
    cells_in_memory(&cells, octree_to_mesh, settings, &metadata(model), start.elapsed())
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
    let (cells, octree_to_mesh) = cells_of(model, settings)?;
    cells_in_file(&cells, octree_to_mesh, settings, path, options, &metadata(model), start.elapsed())
}

fn metadata(model: &VoxelModel) -> String {
    let meta = serde_json::json!({
        "generator": concat!("esvo-builder ", env!("CARGO_PKG_VERSION")),
        "model_voxels": model.voxels.len(),
    });
    meta.to_string()
}

/// The cells of a model, and the transform of the octree.
fn cells_of(model: &VoxelModel, settings: &BuildSettings) -> Result<(Cells, DMat4), BuildError> {
    let Place { lowest, levels } = model.place()?;
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
    let octree_to_mesh = DMat4::from_translation(DVec3::from(lowest.map(f64::from)))
        * DMat4::from_scale(DVec3::splat(f64::from(levels).exp2()));
    Ok((Cells { levels, codes, colors, normals }, octree_to_mesh))
}
