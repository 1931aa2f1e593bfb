//! Cameras, and viewpoints from which an octree is seen.

pub mod viewpoint;

use serde::{Deserialize, Serialize};

/// A pinhole camera in mesh units.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Position of the eye.
    pub eye: [f64; 3],
    /// Viewing direction, any length above zero.
    pub forward: [f64; 3],
    /// Points up in the picture; not parallel to `forward`.
    pub up: [f64; 3],
    /// Field of view over the shorter side of the picture, in degrees, above 0 and below 180.
    pub fov_degrees: f64,
    /// Depth of the near plane, above 0: rays start there.
    pub near: f64,
    /// Depth of the far plane, above `near`: rays end there.
    pub far: f64,
}
