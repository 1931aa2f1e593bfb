//! What a ray hit, in mesh space, and the rays that go on from there.

use glam::{DMat3, DVec3};

use crate::attributes::{facing_normal, voxel_ambient, voxel_color};
use crate::hit::Hit;
use crate::object::Object;
use crate::ray::Ray;
use crate::shape::{Margins, Shape};

/// A point at which a ray hit an object: position, normal, colour and voxel, in mesh space.
pub struct HitPoint<'a> {
    object: &'a Object<'a>,
    ray: Ray,
    hit: Hit,
    shape: Shape,
}

/// The cube of a voxel.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct VoxelCube {
    /// Slot of the parent's child descriptor.
    pub slot: u32,
    /// Child slot: bit 0 for x, bit 1 for y, bit 2 for z.
    pub child: u8,
    /// Level, the root cube being level 0.
    pub level: u32,
    /// Lower corner in octree space, where the root cube is `[0, 1]³`.
    pub octree_corner: DVec3,
    /// Edge in octree space: `2^-level`.
    pub octree_edge: f64,
    /// The corner in mesh space.
    pub corner: DVec3,
    /// The three edges from that corner in mesh space, as columns.
    pub edges: DMat3,
}

impl<'a> HitPoint<'a> {
    /// What `ray` hit. `None` for a miss, and for a hit that is not of this ray and object.
    ///
    /// Walks from the root to the voxel.
    pub fn new(object: &'a Object<'a>, ray: &Ray, hit: &Hit) -> Option<Self> {
        if hit.is_miss() {
            return None;
        }
        let shape = Shape::find(object.octree(), object.root(), object.contours(), ray, hit)?;
        Some(Self { object, ray: *ray, hit: *hit, shape })
    }

    /// Distance from the ray's origin in mesh units.
    pub fn distance(&self) -> f64 {
        (self.position() - self.object.from_cast(self.ray.origin.as_dvec3())).length()
    }

    /// Where the ray entered the voxel, or its contour: in the voxel's cube, without the caster's rounding.
    pub fn position(&self) -> DVec3 {
        self.object.from_cast(self.shape.point)
    }

    /// Unit normal, on the side of the ray: of the voxel's attachment, else of its contour, else of the face of its cube.
    pub fn normal(&self) -> DVec3 {
        facing_normal(self.object, &self.ray, &self.hit)
    }

    /// Unit normal, outward, of the plane by which the ray came into the voxel: of a face of its cube, or of a contour. `None`
    /// for a ray that started in the voxel.
    pub fn side(&self) -> Option<DVec3> {
        let plane = self.shape.entry?;
        let to_mesh = DMat3::from_mat4(*self.object.octree_to_mesh());
        Some((to_mesh.inverse().transpose() * plane.normal).normalize_or_zero())
    }

    /// Colour, sRGB-encoded, channels in `0.0..=1.0`: [`PLAIN_COLOR`](crate::shading::PLAIN_COLOR) if the octree has none.
    pub fn color(&self) -> [f32; 3] {
        voxel_color(self.object.octree(), &self.ray, &self.hit)
    }

    /// Share of the light from all directions that reaches the voxel; 1 if the octree has no ambient occlusion.
    pub fn ambient(&self) -> f32 {
        voxel_ambient(self.object.octree(), &self.hit)
    }

    /// The voxel.
    pub fn voxel(&self) -> VoxelCube {
        let (corner, edge) = (self.shape.corner, self.shape.size);
        VoxelCube {
            slot: self.hit.slot,
            child: self.hit.child(),
            level: self.hit.level(),
            octree_corner: corner - DVec3::ONE,
            octree_edge: edge,
            corner: self.object.from_cast(corner),
            edges: DMat3::from_mat4(*self.object.octree_to_mesh()) * edge,
        }
    }

    /// A ray from here on, e.g. to a light: `direction` in mesh space, of any length above 0, and the distance in mesh units at
    /// which it ends, [`f64::INFINITY`] for none. Cast it against the same object. `t` counts edges of the root cube, as for
    /// [`Object::ray`].
    ///
    /// It never meets the voxel that was hit, at grazing angles neither. A ray that goes away from the [`side`](Self::side) by
    /// which the voxel was entered starts a few units in the last place in front of it; any other ray goes through the voxel
    /// and starts where it leaves it: so a ray from the upper side of a thin sheet downwards is not stopped by the sheet. Other
    /// voxels are not skipped, and contours of neighbours do not meet exactly: their normals are stored with errors of about a
    /// degree, so that even a flat surface has steps of a few hundredths of a voxel, which about 1 ray in 100 meets. Rays
    /// to lights do without them: [`shadow_ray`](Self::shadow_ray).
    ///
    /// The ray's origin is moved off the surface, along the [`side`](Self::side). Distances of its hits count from there.
    pub fn next_ray(&self, direction: DVec3, distance: f64) -> Ray {
        self.next_ray_with(direction, distance, &Margins::DERIVED)
    }

    /// A ray to a light in `direction` at `distance`, as for [`next_ray`](Self::next_ray). `None` if the surface faces away from
    /// the light, by its [`normal`](Self::normal): the point is dark then without a ray.
    ///
    /// It starts one edge of the voxel later than [`next_ray`](Self::next_ray), beyond the steps between neighbouring voxels
    /// of one surface. What is closer than that casts no shadow.
    pub fn shadow_ray(&self, direction: DVec3, distance: f64) -> Option<Ray> {
        (self.normal().dot(direction) > 0.0).then(|| self.ray_to_light(direction, distance))
    }

    /// [`shadow_ray`](Self::shadow_ray) whatever way the surface faces.
    pub(crate) fn ray_to_light(&self, direction: DVec3, distance: f64) -> Ray {
        let mut ray = self.next_ray(direction, distance);
        // The direction has length 1 in cast space, as that of every ray of an object.
        ray.t_min += self.shape.size as f32;
        ray
    }

    fn next_ray_with(&self, direction: DVec3, distance: f64, margins: &Margins) -> Ray {
        let asked = self.object.ray(self.position(), direction, 0.0..distance);
        Ray { t_max: asked.t_max, ..self.shape.leave(asked.direction, margins) }
    }
}

#[cfg(test)]
mod tests;
