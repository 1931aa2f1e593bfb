//! The rays of a picture in mesh space and double precision, and what they find among triangles.
//!
//! These are the rays of a [`View`] before it rounds them to single precision: the same pixels, the same order, and the
//! same `t` (depth over far depth), so that a [`TriangleHit`] can be compared with a [`Hit`](crate::Hit).

use glam::{DMat4, DVec3};

use crate::frame::check_size;
use crate::{Camera, CastError, View};

/// One ray in double precision. Its space is that of whoever makes it.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct ExactRay {
    /// Where `t` is 0.
    pub origin: DVec3,
    /// Displacement over `t` = 1.
    pub direction: DVec3,
    /// Start of the ray, at least 0.
    pub t_min: f64,
    /// End of the ray.
    pub t_max: f64,
}

/// The rays of one picture in mesh units.
///
/// The ray of pixel `(x, y)`, `(0, 0)` on the top left, starts at `origin` and has the direction
/// `base + (x + 0.5) dx + (y + 0.5) dy`; `t = 1` is the far plane.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct CameraRays {
    /// The eye.
    pub origin: DVec3,
    /// Direction to the top-left corner of the picture.
    pub base: DVec3,
    /// Direction per pixel to the right.
    pub dx: DVec3,
    /// Direction per pixel downwards.
    pub dy: DVec3,
    /// `t` at the near plane.
    pub t_near: f64,
    /// Width of the picture in pixels.
    pub width: u32,
    /// Height of the picture in pixels.
    pub height: u32,
}

impl CameraRays {
    /// The rays of a camera, in mesh space.
    ///
    /// # Errors
    /// Those of [`View::new`].
    pub fn new(camera: &Camera, size: (u32, u32)) -> Result<Self, CastError> {
        let (width, height) = size;
        check_size(width, height)?;
        let [right, up, forward] = camera.axes()?;
        let half = (camera.fov_degrees.to_radians() / 2.0).tan() * camera.far;
        let pixel = 2.0 * half / f64::from(width.min(height));
        let (dx, dy) = (right * pixel, -up * pixel);
        Ok(Self {
            origin: camera.eye.into(),
            base: forward * camera.far - dx * (f64::from(width) / 2.0) - dy * (f64::from(height) / 2.0),
            dx,
            dy,
            t_near: camera.near / camera.far,
            width,
            height,
        })
    }

    /// The rays of `view` with its rounded numbers, in mesh space. Where hits of these differ from hits of the rays of
    /// [`new`](Self::new), the cause is the rounding of the camera and not the caster.
    pub fn of_view(view: &View, octree_to_mesh: DMat4) -> Self {
        let vector = |v: [f32; 3]| octree_to_mesh.transform_vector3(DVec3::from(v.map(f64::from)));
        Self {
            origin: octree_to_mesh.transform_point3(DVec3::from(view.origin.map(f64::from)) - DVec3::ONE),
            base: vector(view.base),
            dx: vector(view.dx),
            dy: vector(view.dy),
            t_near: f64::from(view.t_near),
            width: view.width,
            height: view.height,
        }
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Direction through a point of the picture in pixels.
    pub fn direction(&self, x: f64, y: f64) -> DVec3 {
        self.base + self.dx * x + self.dy * y
    }

    /// The ray of a pixel, from the near to the far plane.
    pub fn ray(&self, x: u32, y: u32) -> ExactRay {
        ExactRay {
            origin: self.origin,
            direction: self.direction(f64::from(x) + 0.5, f64::from(y) + 0.5),
            t_min: self.t_near,
            t_max: 1.0,
        }
    }

    /// The ray of the pixel at `index` of a picture stored row by row.
    pub fn ray_at(&self, index: usize) -> ExactRay {
        let width = self.width as usize;
        self.ray((index % width) as u32, (index / width) as u32)
    }

    /// Edge of a pixel on the far plane; at `t` it is `t` times as long.
    pub fn pixel_size(&self) -> f64 {
        self.dx.cross(self.dy).length().sqrt()
    }
}

/// What a ray finds among triangles.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct TriangleHit {
    /// Where the ray meets the triangle, or [`TriangleHit::MISS_T`].
    pub t: f64,
    /// Index of the triangle, or [`TriangleHit::NONE`].
    pub triangle: u32,
}

impl TriangleHit {
    /// `t` of a ray that hits nothing; the same as [`Hit::MISS_T`](crate::Hit::MISS_T).
    pub const MISS_T: f64 = 2.0;
    /// `triangle` of a ray that hits nothing.
    pub const NONE: u32 = u32::MAX;
    /// A ray that hit nothing.
    pub const MISS: Self = Self { t: Self::MISS_T, triangle: Self::NONE };

    /// Whether nothing was hit.
    pub fn is_miss(&self) -> bool {
        self.triangle == Self::NONE
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CastOptions;

    fn camera() -> Camera {
        Camera {
            eye: [3.0, -2.0, 8.0],
            forward: [0.2, 0.5, -2.0],
            up: [0.1, 1.0, 0.0],
            fov_degrees: 50.0,
            near: 0.1,
            far: 40.0,
        }
    }

    #[test]
    fn the_rays_are_those_of_the_view() {
        let (size, object) = ((37, 21), DMat4::from_translation(DVec3::new(-5.0, 3.0, 1.0)));
        let octree_to_mesh = object * DMat4::from_rotation_y(0.3) * DMat4::from_scale(DVec3::splat(16.0));
        let exact = CameraRays::new(&camera(), size).unwrap();
        let view = View::new(&camera(), octree_to_mesh, 0, size, &CastOptions::default()).unwrap();
        let rounded = CameraRays::of_view(&view, octree_to_mesh);
        for index in 0..exact.pixels() {
            let (a, b) = (exact.ray_at(index), rounded.ray_at(index));
            assert!((a.origin - b.origin).length() < 1e-5, "{a:?} {b:?}");
            assert!((a.direction - b.direction).length() < 1e-4, "{a:?} {b:?}");
            assert!((a.t_min - b.t_min).abs() < 1e-8);
            // The rays as the kernels compute them.
            let ray = view.ray(index as u32 % 37, index as u32 / 37);
            let direction = octree_to_mesh.transform_vector3(ray.direction.as_dvec3());
            assert!((a.direction - direction).length() < 1e-4, "{a:?} {direction}");
        }
        assert!((exact.pixel_size() / 16.0 - f64::from(view.pixel_size)).abs() < 1e-6);
    }

    #[test]
    fn t_is_depth_over_far_depth() {
        let rays = CameraRays::new(&camera(), (64, 64)).unwrap();
        let forward = DVec3::from(camera().forward).normalize();
        for index in [0, 63, 64 * 40 + 9, 64 * 64 - 1] {
            assert!((rays.ray_at(index).direction.dot(forward) - 40.0).abs() < 1e-9);
        }
        // The first row is on top, the first column on the left.
        let up = rays.ray(32, 0).direction - rays.ray(32, 63).direction;
        let right = rays.ray(63, 32).direction - rays.ray(0, 32).direction;
        assert!(up.dot(camera().up.into()) > 0.0);
        assert!(right.cross(up).dot(forward) < 0.0);
    }

    #[test]
    fn cameras_without_a_picture_are_refused() {
        assert!(CameraRays::new(&Camera { forward: [0.0; 3], ..camera() }, (4, 4)).is_err());
        assert!(CameraRays::new(&camera(), (0, 4)).is_err());
    }
}
