//! Viewpoints as plain data.

use serde::Deserialize;

/// A pinhole camera in the units of its mesh, as plain data; `esvo-core` makes rays from it.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(try_from = "RawCamera")]
pub struct CameraSpec {
    /// Unique within its list.
    pub name: String,
    /// Position of the eye.
    pub eye: [f64; 3],
    /// Viewing direction, of unit length.
    pub forward: [f64; 3],
    /// The direction that is up in the picture. Not parallel to `forward`; need not be perpendicular to it.
    pub up: [f64; 3],
    /// Full angle of view over the shorter side of the picture, in degrees: more than 0, less than 180.
    pub fov_degrees: f64,
    /// Distance of the near plane: more than 0.
    pub near: f64,
    /// Distance of the far plane: more than `near`.
    pub far: f64,
}

/// A camera in a manifest: either `forward` or `target` is given.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawCamera {
    name: String,
    eye: [f64; 3],
    forward: Option<[f64; 3]>,
    target: Option<[f64; 3]>,
    up: [f64; 3],
    fov: f64,
    near: f64,
    far: f64,
}

impl TryFrom<RawCamera> for CameraSpec {
    type Error = String;

    fn try_from(raw: RawCamera) -> Result<Self, String> {
        let RawCamera { name, eye, up, fov, near, far, .. } = raw;
        let fail = |what: &str| Err(format!("camera \"{name}\": {what}"));
        let forward = match (raw.forward, raw.target) {
            (Some(forward), None) => forward,
            (None, Some(target)) => std::array::from_fn(|i| target[i] - eye[i]),
            _ => return fail("expected either `forward` or `target`, and only one of them"),
        };
        if name.is_empty() {
            return fail("the name is empty");
        }
        if !eye.iter().chain(&forward).chain(&up).chain(&[fov, near, far]).all(|x| x.is_finite()) {
            return fail("all numbers must be finite");
        }
        let forward = glam::DVec3::from_array(forward);
        let up_vector = glam::DVec3::from_array(up);
        let Some(forward) = forward.try_normalize() else {
            return fail("the viewing direction has no length (eye and target are equal, or `forward` is zero)");
        };
        if forward.cross(up_vector.normalize_or_zero()).length() < 1e-6 {
            return fail("`up` is zero or parallel to the viewing direction");
        }
        if !(fov > 0.0 && fov < 180.0) {
            return fail("`fov` must be between 0 and 180 degrees");
        }
        if !(near > 0.0 && far > near) {
            return fail("`near` must be above 0 and below `far`");
        }
        Ok(Self { name, eye, forward: forward.to_array(), up, fov_degrees: fov, near, far })
    }
}
