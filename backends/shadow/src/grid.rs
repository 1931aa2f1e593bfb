//! Where voxels lie in the world, and objects in it.

use glam::{DQuat, DVec3};

use crate::error::ShadowError;

/// The place and size of voxels.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Grid {
    /// Least corner of voxel (0, 0, 0), in the world's unit.
    pub origin: DVec3,
    /// Edge of a voxel, in the world's unit; above 0.
    pub voxel: f64,
}

impl Grid {
    /// A place in voxels.
    pub fn to_voxels(&self, place: DVec3) -> DVec3 {
        (place - self.origin) / self.voxel
    }

    /// A place in the world's unit.
    pub fn to_world(&self, voxels: DVec3) -> DVec3 {
        self.origin + voxels * self.voxel
    }
}

/// Where an object is, and how it is turned: first turned, then moved.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Pose {
    /// How it is turned. A unit quaternion.
    pub rotation: DQuat,
    /// Where its own origin lies, in the world's unit.
    pub position: DVec3,
}

impl Pose {
    /// As the object is.
    pub const IDENTITY: Self = Self { rotation: DQuat::IDENTITY, position: DVec3::ZERO };

    /// A place of the object in the world.
    pub fn apply(&self, place: DVec3) -> DVec3 {
        self.rotation * place + self.position
    }

    /// A place in the world, as the object has it.
    pub fn undo(&self, place: DVec3) -> DVec3 {
        self.rotation.conjugate() * (place - self.position)
    }

    pub(crate) fn check(&self) -> Result<(), ShadowError> {
        if !self.position.is_finite() || !self.rotation.is_finite() || !self.rotation.is_normalized() {
            return Err(ShadowError::Pose(format!(
                "a pose at {} with rotation {} was given; the position must be finite, the rotation a unit quaternion",
                self.position, self.rotation
            )));
        }
        Ok(())
    }
}
