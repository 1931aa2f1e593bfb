//! Rays of any origin, direction, span and size.

use bytemuck::{Pod, Zeroable};
use esvo_format::Octree;
use glam::Vec3;

/// Largest absolute value of a direction component. Rays with a larger one miss.
pub const MAX_COMPONENT: f32 = (1u32 << 20) as f32;

/// Largest absolute value of an origin's component. Rays with a larger one miss: `t` of planes and contours would overflow. Single precision
/// tells no voxels apart from farther than 2^24.
pub const MAX_ORIGIN: f32 = (1u64 << 40) as f32;

/// One ray in cast space, the cube `[1, 2]³` of the casters, 40 bytes, as the kernels read it. A test compares it with the
/// kernel's struct `RayRecord`.
///
/// [`Object::ray`](crate::Object::ray) makes one from mesh space.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Debug, Pod, Zeroable)]
pub struct Ray {
    /// Where `t` is 0.
    pub origin: Vec3,
    /// Displacement over `t` = 1, of any length above 0. Casters replace a component below 2^-23
    /// ([`EPSILON`](crate::reference::EPSILON)) by that number with its sign, so a length around 1 is best.
    pub direction: Vec3,
    /// Start of the ray, in lengths of `direction`. A ray that starts in a voxel hits that voxel.
    pub t_min: f32,
    /// End of the ray, in lengths of `direction`. [`f32::INFINITY`] for a ray without end.
    pub t_max: f32,
    /// Voxels that are small where the ray leaves them, at `t`, end it: those whose edge is at most
    /// `size_at_origin + t * size_per_t`, the edge of the root cube being 1. Both 0: only leaves end it.
    pub size_at_origin: f32,
    /// See [`size_at_origin`](Self::size_at_origin).
    pub size_per_t: f32,
}

impl Ray {
    /// A ray from `origin` on without end, which only leaves end. Both are in cast space: from mesh space use
    /// [`Object::ray`](crate::Object::ray).
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, t_min: 0.0, t_max: f32::INFINITY, size_at_origin: 0.0, size_per_t: 0.0 }
    }

    /// Whether origin and direction are finite.
    pub fn is_finite(&self) -> bool {
        self.origin.is_finite() && self.direction.is_finite()
    }

    /// Whether a caster follows the ray: no component of the direction exceeds 2^20 ([`MAX_COMPONENT`]), none of the origin 2^40
    /// ([`MAX_ORIGIN`]), and no number is NaN. All other rays miss.
    #[inline(always)]
    pub fn is_cast(&self) -> bool {
        let spans = self.t_min.is_nan() || self.t_max.is_nan();
        let sizes = self.size_at_origin.is_nan() || self.size_per_t.is_nan();
        // False for NaN, which the greatest component may hide.
        let within = |vector: Vec3, most: f32| vector.to_array().iter().all(|x| x.abs() <= most);
        within(self.direction, MAX_COMPONENT) && within(self.origin, MAX_ORIGIN) && !spans && !sizes
    }

    /// Whether small voxels can end the ray.
    #[inline(always)]
    pub fn has_size(&self) -> bool {
        self.size_at_origin != 0.0 || self.size_per_t != 0.0
    }
}

/// Rays to cast against one object of an octree.
#[derive(Clone, Copy, Debug)]
pub struct Rays<'a> {
    /// Slot of the root's child descriptor: the root slot of one of the octree's objects.
    pub root: u32,
    /// Clip voxels by their contours; otherwise they are cubes.
    pub contours: bool,
    /// The rays, in any order. A ray that [is not cast](Ray::is_cast) misses.
    pub rays: &'a [Ray],
}

impl<'a> Rays<'a> {
    /// Rays against an object, with contours.
    ///
    /// # Panics
    /// The octree has no such object.
    pub fn new(octree: &Octree, object: usize, rays: &'a [Ray]) -> Self {
        Self { root: octree.objects()[object].root_slot as u32, contours: true, rays }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_with_nan_or_without_end_are_told_apart() {
        let ray = Ray::new(Vec3::splat(1.5), Vec3::X);
        assert!(ray.is_cast() && !ray.has_size());
        assert!(Ray { t_min: f32::INFINITY, size_per_t: f32::INFINITY, ..ray }.is_cast());
        for bad in [
            Ray { origin: Vec3::new(f32::NAN, 1.0, 1.0), ..ray },
            Ray { origin: Vec3::new(1.0, f32::INFINITY, 1.0), ..ray },
            Ray { direction: Vec3::new(0.0, 0.0, f32::NAN), ..ray },
            Ray { direction: Vec3::splat(MAX_COMPONENT.next_up()), ..ray },
            Ray { origin: Vec3::new(1.0, -MAX_ORIGIN.next_up(), 1.0), ..ray },
            Ray { t_min: f32::NAN, ..ray },
            Ray { t_max: f32::NAN, ..ray },
            Ray { size_at_origin: f32::NAN, ..ray },
            Ray { size_per_t: f32::NAN, ..ray },
        ] {
            assert!(!bad.is_cast(), "{bad:?}");
        }
        assert!(Ray { size_at_origin: 0.1, ..ray }.has_size() && Ray { size_per_t: 0.1, ..ray }.has_size());
    }
}
