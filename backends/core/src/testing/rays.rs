//! Rays for tests of [`Caster::cast_rays`], and their run by one caster against the reference.

use std::sync::Arc;

use esvo_format::Octree;
use glam::Vec3;

use crate::reference::{self, MAX_COMPONENT};
use crate::testing::compare::Comparison;
use crate::testing::sample::Noise;
use crate::{CastError, Caster, Hit, Ray, Rays};

/// Incoherent rays: each starts somewhere in or around the root cube and goes somewhere else, with a span and sizes of its
/// own. Some have no end, some no size, some an empty span. The same numbers give the same rays.
pub fn incoherent(count: usize, seed: u64) -> Vec<Ray> {
    let mut noise = Noise(seed);
    let mut number = |low: f32, high: f32| low + (high - low) * noise.number() as f32;
    let mut rays = Vec::with_capacity(count);
    for index in 0..count {
        let mut vector = |low, high| Vec3::new(number(low, high), number(low, high), number(low, high));
        let (origin, towards, around) = (vector(0.6, 2.4), vector(1.1, 1.9), vector(-1.0, 1.0));
        let length = [1.0, 0.3, 7.0][index % 3];
        // Two of three towards the octree.
        let direction = if index % 3 == 2 { around } else { towards - origin } * length;
        let (t_min, t_max) = match index % 5 {
            0 => (0.0, f32::INFINITY),
            1 => (0.0, number(0.0, 2.0)),
            2 => (number(-1.0, 1.0), f32::MAX),
            3 => (number(0.0, 0.5), number(0.3, 1.5)),
            _ => (0.0, 1e6),
        };
        let (size_at_origin, size_per_t) = match index % 7 {
            0 | 1 => (0.0, 0.0),
            2 | 3 => (number(0.0, 0.1), 0.0),
            4 | 5 => (0.0, number(0.0, 0.1)),
            _ => (number(-0.05, 0.05), number(0.0, 0.1)),
        };
        rays.push(Ray { origin, direction, t_min, t_max, size_at_origin, size_per_t });
    }
    rays
}

/// Rays that a program makes by mistake or by chance: without length, too long, not finite, NaN, along axes and faces and
/// through corners of voxels, from far away, with spans that are empty, reversed or infinite, with sizes below 0 or infinite.
pub fn strange() -> Vec<Ray> {
    let plain = Ray::new(Vec3::new(0.25, 1.5, 1.47), Vec3::new(1.0, 0.03, 0.02));
    let mut rays = vec![plain];
    let numbers =
        [0.0, -0.0, 1e-42, -1e-30, 1e-7, 1.0, 1.5, 2.0, 1e6, 1e30, f32::MAX, f32::MIN, f32::INFINITY, f32::NAN];
    for number in numbers.into_iter().chain(numbers.map(|number| -number)) {
        for axis in 0..3 {
            let with = |mut vector: Vec3| {
                vector[axis] = number;
                vector
            };
            rays.push(Ray { origin: with(plain.origin), ..plain });
            rays.push(Ray { direction: with(plain.direction), ..plain });
            rays.push(Ray { direction: with(Vec3::ZERO), ..plain });
            rays.push(Ray { origin: with(Vec3::splat(1.5)), direction: -plain.direction, ..plain });
        }
        rays.push(Ray { t_min: number, ..plain });
        rays.push(Ray { t_max: number, ..plain });
        rays.push(Ray { size_at_origin: number, ..plain });
        rays.push(Ray { size_per_t: number, ..plain });
        rays.push(Ray { size_at_origin: 0.01, size_per_t: number, ..plain });
    }
    for length in [0.0, 1e-20, MAX_COMPONENT, MAX_COMPONENT.next_up(), f32::MAX] {
        rays.push(Ray { direction: Vec3::X * length, ..plain });
        rays.push(Ray { direction: Vec3::splat(-length), origin: Vec3::splat(3.0), ..plain });
    }
    for origin in [Vec3::ZERO, Vec3::splat(3.0), Vec3::splat(1.5), Vec3::splat(1.25), Vec3::new(1.0, 1.25, 1.75)] {
        for direction in
            [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Z, Vec3::ONE, Vec3::NEG_ONE, Vec3::new(1.0, 1.0, 0.0)]
        {
            rays.push(Ray::new(origin, direction));
        }
    }
    rays
}

/// Casts rays by `caster` and by the reference: both hits of each. The octree need not be loaded.
///
/// # Errors
/// What the caster said.
pub fn both(
    caster: &mut dyn Caster,
    octree: &Arc<Octree>,
    rays: &[Ray],
    contours: bool,
) -> Result<(Vec<Hit>, Vec<Hit>), CastError> {
    caster.load(octree)?;
    let rays = Rays { contours, ..Rays::new(octree, 0, rays) };
    // Left over from other rays.
    let mut ours = vec![Hit::miss(7); 3];
    caster.cast_rays(&rays, &mut ours)?;
    let theirs = rays.rays.iter().map(|ray| reference::cast_ray(octree, rays.root, ray, contours)).collect();
    Ok((ours, theirs))
}

/// Casts rays with and without contours by `caster` and by the reference, and compares.
///
/// # Errors
/// What the caster said.
pub fn against_reference(caster: &mut dyn Caster, octree: &Arc<Octree>, rays: &[Ray]) -> Result<Comparison, CastError> {
    let mut all = Comparison::default();
    for contours in [false, true] {
        let (ours, theirs) = both(caster, octree, rays, contours)?;
        all = all.and(Comparison::of(&ours, &theirs));
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::sample::Sample;

    #[test]
    fn the_rays_are_of_every_kind() {
        let octree = Sample::plain(6, true).octree().expect("assembles");
        let rays = incoherent(2100, 1);
        assert_eq!(rays, incoherent(2100, 1));
        assert_ne!(rays, incoherent(2100, 2));
        let hits: Vec<Hit> = rays.iter().map(|ray| reference::cast_ray(&octree, 2, ray, true)).collect();
        let found = hits.iter().filter(|hit| !hit.is_miss()).count();
        assert!((600..1800).contains(&found), "{found}");
        let ended = hits.iter().filter(|hit| !hit.is_miss() && hit.scale() > 23 - 6 + 1).count();
        assert!(ended > 100, "{ended} end at large voxels");
        assert!(hits.iter().any(|hit| !hit.is_miss() && hit.raw_t < 0.0));
        let cast = strange().iter().filter(|ray| ray.is_cast()).count();
        assert!(cast > 100 && strange().len() - cast > 50, "{cast}");
    }
}
