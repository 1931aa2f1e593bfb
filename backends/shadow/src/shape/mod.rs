//! What objects are made of, and which voxels they fill in a pose.

mod cubes;
mod mesh;
mod solid;
mod stamp;
mod surface;

pub use cubes::{Cubes, Rule};
pub use mesh::Mesh;
pub use stamp::Stamp;

use crate::error::ShadowError;
use crate::grid::{Grid, Pose};

/// What an object is made of.
#[derive(Clone, Debug)]
pub enum Shape {
    /// A mesh, as its surface or solid.
    Mesh(Mesh),
    /// Cubes of one size: a voxel model, or the voxels of an octree at a level.
    Cubes(Cubes),
}

/// The most base cells of the box around one object: 1 GiB of bytes.
const LARGEST: f64 = (1u64 << 30) as f64;

impl Shape {
    /// The voxels that the shape fills in a pose.
    ///
    /// # Errors
    /// A pose that is not finite, or turns by a quaternion whose length is not 1; one that moves the shape more than 2^21 voxels away; a shape whose
    /// box has more than 2^30 base cells.
    pub fn voxels(&self, pose: &Pose, grid: &Grid) -> Result<Stamp, ShadowError> {
        pose.check()?;
        match self {
            Self::Mesh(mesh) => mesh.voxels(pose, grid),
            Self::Cubes(cubes) => cubes.voxels(pose, grid),
        }
    }
}

/// Refuses boxes, in voxels, that are too far away or too large for a stamp.
fn check_box(low: glam::DVec3, high: glam::DVec3) -> Result<(), ShadowError> {
    let farthest = f64::from(1 << 21);
    if !(low.abs().max_element() <= farthest && high.abs().max_element() <= farthest) {
        return Err(ShadowError::Pose(format!(
            "an object reaches from {low} to {high}, in voxels; objects are within {farthest} voxels of the grid's origin"
        )));
    }
    let cells = (high - low) / 2.0 + 2.0;
    if cells.element_product() > LARGEST {
        return Err(ShadowError::Shape(format!(
            "an object is {} voxels large; the box around an object has at most 2^33 voxels. Put it into the world in parts, or as \
             something that does not move",
            high - low
        )));
    }
    Ok(())
}
