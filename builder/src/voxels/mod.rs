//! Voxel models: cubes of one size on a grid, each with a colour, and the octrees that they become.
//!
//! A model does not go through triangles: each of its voxels, inner ones included, becomes one leaf on the deepest level of
//! the octree, with its own colour and without a contour. The level follows from the size of the model: the smallest root
//! cube with a power of two of voxels along each edge that contains it. A unit of the mesh space of the octree is the edge of
//! a voxel, and its axes are those of the model.

mod build;
mod normal;

pub use build::{build_voxels, build_voxels_file};

use crate::{BuildError, cells};

/// Most levels that the octree of a model may have: 2^21 voxels along each edge.
pub const MAX_LEVELS: u32 = cells::MAX_LEVELS;

/// A voxel: the unit cube whose lower corner is at `at`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ModelVoxel {
    /// The lower corner.
    pub at: [i32; 3],
    /// The colour, sRGB-encoded.
    pub color: [u8; 3],
}

/// A voxel model. Two voxels at the same place are allowed; the later one counts.
#[derive(Clone, Debug, Default)]
pub struct VoxelModel {
    /// The voxels, in any order.
    pub voxels: Vec<ModelVoxel>,
    /// Problems that the importer found and could work around, one line each.
    pub warnings: Vec<String>,
}

/// The place of a model in its root cube.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Place {
    /// The lower corner of the root cube.
    lowest: [i32; 3],
    /// The level of the voxels.
    levels: u32,
}

impl VoxelModel {
    /// The level of the octree on which the voxels are, at least 1.
    ///
    /// # Errors
    /// No voxels, or a model of more than 2^21 voxels along an axis.
    pub fn levels(&self) -> Result<u32, BuildError> {
        Ok(self.place()?.levels)
    }

    /// Lower and upper corner of all voxels in mesh space, whose unit is the edge of a voxel. `None` without voxels.
    #[must_use]
    pub fn bounds(&self) -> Option<([f64; 3], [f64; 3])> {
        let first = self.voxels.first()?.at.map(f64::from);
        let (mut low, mut high) = (first, first);
        for voxel in &self.voxels {
            for (axis, at) in voxel.at.into_iter().map(f64::from).enumerate() {
                low[axis] = low[axis].min(at);
                high[axis] = high[axis].max(at);
            }
        }
        Some((low, high.map(|at| at + 1.0)))
    }

    fn place(&self) -> Result<Place, BuildError> {
        let Some(first) = self.voxels.first() else {
            return Err(BuildError::Mesh("the model has no voxels".into()));
        };
        let (mut lowest, mut highest) = (first.at, first.at);
        for voxel in &self.voxels {
            for axis in 0..3 {
                lowest[axis] = lowest[axis].min(voxel.at[axis]);
                highest[axis] = highest[axis].max(voxel.at[axis]);
            }
        }
        let extent = (0..3).map(|axis| i64::from(highest[axis]) - i64::from(lowest[axis]) + 1).max().unwrap_or(1);
        let levels = (extent as u64).next_power_of_two().trailing_zeros().max(1);
        if levels > MAX_LEVELS {
            return Err(BuildError::Mesh(format!(
                "the model is {extent} voxels long; the limit is {} along each axis",
                1u64 << MAX_LEVELS
            )));
        }
        Ok(Place { lowest, levels })
    }
}
