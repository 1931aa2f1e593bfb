//! Cameras, and viewpoints from which an octree is seen.

pub mod viewpoint;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::CastError;

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

impl Camera {
    /// Checks the ranges of all fields and gives unit vectors to the right, upwards and forwards, at right angles.
    ///
    /// # Errors
    /// [`CastError::Camera`]: a component that is NaN or infinite, planes or an angle out of range, a `forward` of length 0,
    /// or an `up` that is parallel to it.
    pub fn axes(&self) -> Result<[DVec3; 3], CastError> {
        let bad = |what: String| Err(CastError::Camera(what));
        for (name, vector) in [("eye", self.eye), ("forward", self.forward), ("up", self.up)] {
            if vector.iter().any(|x| !x.is_finite()) {
                return bad(format!("{name} is {vector:?}; every component must be a finite number"));
            }
        }
        let Self { near, far, fov_degrees, .. } = *self;
        if !(near > 0.0 && far > near && far.is_finite()) {
            return bad(format!("near is {near} and far is {far}; near must be above 0 and below far"));
        }
        if !(fov_degrees > 0.0 && fov_degrees < 180.0) {
            return bad(format!(
                "fov_degrees is {fov_degrees}; the field of view must be above 0 and below 180 degrees"
            ));
        }
        let Some(forward) = DVec3::from(self.forward).try_normalize() else {
            return bad(format!("forward is {:?}; it must have a length above 0", self.forward));
        };
        let Some(right) = forward.cross(DVec3::from(self.up)).try_normalize() else {
            return bad(format!("up is {:?}; it must not be parallel to forward", self.up));
        };
        Ok([right, right.cross(forward), forward])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_out_of_range_are_refused_by_name() {
        let good = Camera {
            eye: [0.0; 3],
            forward: [0.0, 0.0, -2.0],
            up: [0.3, 1.0, 0.0],
            fov_degrees: 60.0,
            near: 0.1,
            far: 10.0,
        };
        let [right, up, forward] = good.axes().expect("is in range");
        assert!(right.cross(up).dot(-forward) > 0.999 && up.y > 0.9 && forward == DVec3::NEG_Z);
        let infinite = f64::INFINITY;
        for (what, bad) in [
            ("eye is", Camera { eye: [0.0, f64::NAN, 0.0], ..good }),
            ("forward is", Camera { forward: [infinite, 0.0, 0.0], ..good }),
            ("forward is", Camera { forward: [0.0; 3], ..good }),
            ("up is", Camera { up: [0.0, 0.0, 7.0], ..good }),
            ("up is", Camera { up: [f64::NAN; 3], ..good }),
            ("near is 0 and far is 10; near must be above 0 and below far", Camera { near: 0.0, ..good }),
            ("near is 10 and far is 10", Camera { near: 10.0, ..good }),
            ("far is inf", Camera { far: infinite, ..good }),
            ("fov_degrees is 180", Camera { fov_degrees: 180.0, ..good }),
            ("fov_degrees is NaN", Camera { fov_degrees: f64::NAN, ..good }),
        ] {
            let error = bad.axes().expect_err(what).to_string();
            assert!(error.starts_with("camera: ") && error.contains(what), "{error}");
        }
    }
}
