//! The first surfaces of a picture.

use esvo_core::shading::decode_srgb;
use esvo_core::{Camera, CastError, HitPoint, Nearest, Object, View};
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

use crate::grid::Grid;
use crate::trace::{Fidelity, Ray, first_hit};
use crate::volume::Occupancy;

/// Where a picture is seen from. Lengths are in the world's unit.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Eye {
    /// Where it is.
    pub position: Vec3,
    /// To the right of the picture; of length 1, as are the two others, at right angles to them.
    pub right: Vec3,
    /// Upwards in the picture.
    pub up: Vec3,
    /// Into the picture.
    pub forward: Vec3,
    /// Half the width and half the height of the picture at depth 1.
    pub half: Vec2,
    /// Pixels along a row, and rows.
    pub size: (u32, u32),
}

impl Eye {
    /// The eye of a camera, for pictures of so many pixels along a row, and rows.
    ///
    /// # Errors
    /// Those of [`Camera::axes`].
    pub fn of(camera: &Camera, size: (u32, u32)) -> Result<Self, CastError> {
        let [right, up, forward] = camera.axes()?.map(|axis| axis.as_vec3());
        let shorter = size.0.min(size.1).max(1) as f32;
        let half = (camera.fov_degrees.to_radians() * 0.5).tan() as f32;
        let half = half * Vec2::new(size.0 as f32, size.1 as f32) / shorter;
        Ok(Self { position: DVec3::from(camera.eye).as_vec3(), right, up, forward, half, size })
    }

    /// Where a place is in the picture: column and row, with the middle of the first pixel at (0.5, 0.5), and its depth along
    /// `forward`. `None` if it lies behind the eye.
    pub fn project(&self, place: Vec3) -> Option<(Vec2, f32)> {
        let to = place - self.position;
        let depth = to.dot(self.forward);
        if depth <= 0.0 {
            return None;
        }
        let at = Vec2::new(to.dot(self.right), -to.dot(self.up)) / (depth * self.half);
        let size = Vec2::new(self.size.0 as f32, self.size.1 as f32);
        Some(((at * 0.5 + 0.5) * size, depth))
    }

    /// From the eye through a point of the picture, of depth 1.
    pub fn direction(&self, at: Vec2) -> Vec3 {
        let size = Vec2::new(self.size.0 as f32, self.size.1 as f32);
        let at = (at / size * 2.0 - 1.0) * self.half;
        self.forward + self.right * at.x - self.up * at.y
    }

    /// Height of a pixel at depth 1.
    pub fn pixel(&self) -> f32 {
        2.0 * self.half.y / self.size.1.max(1) as f32
    }
}

/// What is seen in a pixel.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Surface {
    /// Where it is, in the world's unit.
    pub position: Vec3,
    /// Its normal, of length 1, on the side of the eye.
    pub normal: Vec3,
    /// The share of light that it reflects, linear red, green and blue.
    pub color: Vec3,
    /// Depth along the eye's `forward`.
    pub depth: f32,
    /// How far the object has moved since the picture before.
    pub moved: Vec3,
}

/// The first surface of each pixel, row by row from the top; `None` where the sky is seen.
#[derive(Clone, PartialEq, Debug)]
pub struct Frame {
    /// Where the picture is seen from.
    pub eye: Eye,
    /// As many as the picture has pixels.
    pub surfaces: Vec<Option<Surface>>,
}

impl Frame {
    /// A frame of what `see` finds in each pixel, by its column and row.
    pub fn from_fn(eye: Eye, mut see: impl FnMut(u32, u32) -> Option<Surface>) -> Self {
        let (width, height) = eye.size;
        let surfaces = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| see(x, y)).collect();
        Self { eye, surfaces }
    }

    /// What a caster of octrees found: the nearest hits of objects, one view for each. Colours and normals are those of the voxels.
    ///
    /// # Panics
    /// `nearest` are not the hits of these objects and views, or the picture of the eye has another size.
    pub fn of_hits(eye: Eye, objects: &[Object], views: &[View], nearest: &Nearest) -> Self {
        let (width, height) = eye.size;
        assert_eq!(nearest.hits.len(), width as usize * height as usize, "the hits are of another size");
        Self::from_fn(eye, |x, y| {
            let at = (y * width + x) as usize;
            let whose = nearest.views[at] as usize;
            let point = HitPoint::new(&objects[whose], &views[whose].ray(x, y), &nearest.hits[at])?;
            let position = point.position().as_vec3();
            Some(Surface {
                position,
                normal: point.normal().as_vec3(),
                color: Vec3::from(point.color().map(decode_srgb)),
                depth: (position - eye.position).dot(eye.forward),
                moved: Vec3::ZERO,
            })
        })
    }

    /// What a ray meets through the middle of each pixel. `meet` gets where it begins and its direction, of length 1, on all cores. It tells how far away
    /// the first surface is, its normal, of length 1, and its colour as in [`Surface::color`]. So frames come from triangles, or from anything else that
    /// rays meet.
    pub fn of_rays(eye: Eye, meet: &(impl Fn(Vec3, Vec3) -> Option<(f32, Vec3, Vec3)> + Sync)) -> Self {
        let width = eye.size.0.max(1);
        let see = |pixel: u32| {
            let way = eye.direction(Vec2::new((pixel % width) as f32, (pixel / width) as f32) + 0.5);
            let direction = way.normalize();
            let (distance, normal, color) = meet(eye.position, direction)?;
            let normal = if normal.dot(direction) > 0.0 { -normal } else { normal };
            let position = eye.position + direction * distance;
            Some(Surface { position, normal, color, depth: distance / way.length(), moved: Vec3::ZERO })
        };
        let surfaces = (0..eye.size.0 * eye.size.1).into_par_iter().map(see).collect();
        Self { eye, surfaces }
    }

    /// What a volume shows within `reach`: faces of its voxels, as a world of voxel models has them. `color`: that of a place with a normal.
    pub fn of_volume<O: Occupancy + Sync + ?Sized>(
        eye: Eye,
        volume: &O,
        grid: &Grid,
        reach: f32,
        color: &(impl Fn(Vec3, Vec3) -> Vec3 + Sync),
    ) -> Self {
        let length = f64::from(reach) / grid.voxel;
        Self::of_rays(eye, &|from, direction| {
            let ray = Ray::new(grid.to_voxels(from.as_dvec3()), direction.as_dvec3(), length).ok()?;
            let hit = first_hit(volume, &ray, Fidelity::EXACT).hit?;
            let way = ray.direction().normalize();
            let low = DVec3::from(hit.cell.map(|c| f64::from(c << hit.level)));
            // The ray enters through the face, of those that it sees, that is nearest to where it meets the voxel.
            let face = DVec3::select(way.cmpgt(DVec3::ZERO), low, low + f64::from(1 << hit.level));
            let off = (ray.origin() + way * f64::from(hit.distance) - face).abs();
            let axis = DVec3::select(way.cmpeq(DVec3::ZERO), DVec3::INFINITY, off).min_position();
            let mut normal = Vec3::ZERO;
            normal[axis] = -way[axis].signum() as f32;
            let distance = hit.distance * grid.voxel as f32;
            Some((distance, normal, color(from + direction * distance, normal)))
        })
    }

    /// The number and surface of the pixel that has a point of the picture.
    pub fn at(&self, at: Vec2) -> Option<(usize, &Surface)> {
        let (width, height) = self.eye.size;
        if !(at.x >= 0.0 && at.y >= 0.0 && at.x < width as f32 && at.y < height as f32) {
            return None;
        }
        let pixel = at.y as usize * width as usize + at.x as usize;
        Some((pixel, self.surfaces.get(pixel)?.as_ref()?))
    }
}
