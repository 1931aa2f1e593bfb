//! Writes the voxels of a level of an octree for other programs: points ([`write_points`]), a voxel model of MagicaVoxel
//! ([`write_model`]), and grids of NanoVDB ([`write_grids`]).
//!
//! Voxels of a level are its voxels and the leaves above it. Models and grids have cubes of the level instead: a leaf above it fills all
//! cubes in it, but for those that its contour, or one above it, leaves out.
//!
//! The octree must be [sound](Octree::sound).

mod cubes;
mod nanovdb;
mod palette;
mod ply;
mod vox;

use std::io::{self, Write};

use esvo_format::Octree;

pub use cubes::{Cube, Cubes};
pub use vox::Up;

/// The deepest level whose voxels can be written.
pub const MAX_LEVEL: u32 = 21;

/// Most cubes that [`Cubes::new`] is meant for: a list of 2 GB.
pub const MAX_CUBES: u64 = 1 << 27;

/// Number of the voxels of a level of an object: points that [`write_points`] writes.
///
/// # Panics
/// If there is no such object.
#[must_use]
pub fn voxel_count(octree: &Octree, object: usize, level: u32) -> u64 {
    let mut points = 0;
    // Nothing here fails.
    let _ = cubes::visit(octree, object, level, &mut |_, _| {
        points += 1;
        Ok(())
    });
    points
}

/// Writes the voxels of a level of an object, 1 to [`MAX_LEVEL`], as binary `.ply`: a point for each at its centre in mesh space, with
/// its normal and its colour (sRGB, 8 bits) if the octree has them, and with the length of its edge as `size`.
///
/// # Errors
/// The writer's.
///
/// # Panics
/// If there is no such object.
pub fn write_points(out: &mut dyn Write, octree: &Octree, object: usize, level: u32) -> io::Result<()> {
    ply::write(out, octree, object, level, voxel_count(octree, object, level))
}

/// Writes cubes as a `.vox` file: models of up to 256 x 256 x 256 that its scene places side by side, with at most 255 colours. If there
/// are more, each is replaced by one that stands for several (median cut).
///
/// # Errors
/// The writer's.
pub fn write_model(mut out: &mut dyn Write, cubes: &Cubes, up: Up) -> io::Result<()> {
    vox::model(cubes, up).write_vox(&mut out)
}

/// Writes cubes as a `.nvdb` file of version 32.4.2: a fog volume `density` of floats that are 1 in each cube, and, if the octree has
/// colours, a voxel volume `color` of Rgba8. The map of the grids places them in mesh space. Without cubes, the grids have no nodes.
///
/// # Errors
/// The writer's.
pub fn write_grids(out: &mut dyn Write, cubes: &Cubes) -> io::Result<()> {
    nanovdb::write(out, cubes)
}
