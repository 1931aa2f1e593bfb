//! Rays that are hard for a caster.

use esvo_format::Octree;
use glam::Vec3;

use super::{noise, one_of};
use crate::Ray;
use crate::testing::sample::Noise;

/// What is hard about a ray.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Kind {
    /// Nothing: from somewhere to a voxel.
    Plain,
    /// Along an axis, often in a face or an edge.
    Axes,
    /// In the plane of a face.
    Faces,
    /// Through a corner or an edge of a voxel, exactly.
    Corners,
    /// Components of the direction 0, -0, denormal, tiny, huge.
    Components,
    /// From within a voxel.
    Inside,
    /// From a face, an edge or a corner, or the number next to it.
    Boundaries,
    /// From 10^-6 to 10^9 voxels away.
    Far,
    /// Spans that are empty, reversed, infinite, or begin and end at faces.
    Spans,
    /// Sizes that end it at once, never, or exactly at a voxel.
    Sizes,
    /// Hard rays in bundles of sixty-four that hardly differ, for casters that cast rays together.
    Bundles,
    /// Any bits in every number.
    Bits,
}

impl Kind {
    /// All of them.
    pub const ALL: [Self; 12] = [
        Self::Plain,
        Self::Axes,
        Self::Faces,
        Self::Corners,
        Self::Components,
        Self::Inside,
        Self::Boundaries,
        Self::Far,
        Self::Spans,
        Self::Sizes,
        Self::Bundles,
        Self::Bits,
    ];

    /// Its name, one word.
    pub fn name(self) -> &'static str {
        match self {
            Self::Plain => "plain",
            Self::Axes => "axes",
            Self::Faces => "faces",
            Self::Corners => "corners",
            Self::Components => "components",
            Self::Inside => "inside",
            Self::Boundaries => "boundaries",
            Self::Far => "far",
            Self::Spans => "spans",
            Self::Sizes => "sizes",
            Self::Bundles => "bundles",
            Self::Bits => "bits",
        }
    }
}

/// Voxels that rays are aimed at: lower corner and edge of each.
#[derive(Clone, Debug)]
pub struct Target(Vec<(Vec3, f32)>);

impl Target {
    /// Up to `most` voxels of the first object of an octree, evenly over its depth-first order.
    pub fn of(octree: &Octree, most: usize) -> Self {
        let mut voxels = Vec::new();
        let mut waiting = vec![(octree.objects()[0].root_slot as u32, Vec3::ONE, 1.0f32)];
        while let Some((node, corner, edge)) = waiting.pop() {
            let descriptor = octree.descriptor(node);
            let half = edge * 0.5;
            for slot in (0..8u8).filter(|slot| descriptor.valid_mask() >> slot & 1 != 0) {
                let at = corner + half * Vec3::from(std::array::from_fn(|axis| f32::from(slot >> axis & 1)));
                voxels.push((at, half));
                if descriptor.leaf_mask() >> slot & 1 == 0 {
                    waiting.push((octree.first_child(node) + descriptor.child_rank(slot), at, half));
                }
            }
        }
        let step = voxels.len().div_ceil(most.max(1)).max(1);
        Self(voxels.into_iter().step_by(step).collect())
    }
}

fn between(noise: &mut Noise, low: f32, high: f32) -> f32 {
    low + (high - low) * noise.number() as f32
}

fn vector(noise: &mut Noise, low: f32, high: f32) -> Vec3 {
    Vec3::new(between(noise, low, high), between(noise, low, high), between(noise, low, high))
}

/// A point of a cube: within, or with some components on its faces.
fn point(noise: &mut Noise, (corner, edge): (Vec3, f32), on_faces: f64) -> Vec3 {
    let part = |noise: &mut Noise| {
        if noise.number() < on_faces { one_of(noise, &[0.0, 1.0, 0.5]) } else { noise.number() as f32 }
    };
    corner + edge * Vec3::new(part(noise), part(noise), part(noise))
}

/// The number itself or one next to it.
fn near(noise: &mut Noise, x: f32) -> f32 {
    match (noise.number() * 4.0) as u32 {
        0 => x.next_up(),
        1 => x.next_down(),
        _ => x,
    }
}

/// Any of the lengths that directions have in practice.
fn length(noise: &mut Noise) -> f32 {
    one_of(noise, &[1.0, 1.0, 1.0, 0.1, 10.0, 1000.0, 0.001])
}

/// The ray of this kind and number. The same each time.
pub fn ray(kind: Kind, target: &Target, seed: u64) -> Ray {
    let noise = &mut noise(seed.wrapping_mul(31).wrapping_add(kind as u64 + 1));
    let voxel = one_of(noise, &target.0);
    let from = vector(noise, 0.0, 3.0);
    let to = point(noise, voxel, 0.1);
    let plain = Ray::new(from, (to - from) * length(noise));
    match kind {
        Kind::Plain => plain,
        Kind::Axes => {
            let axis = (noise.number() * 3.0) as usize % 3;
            let to = point(noise, voxel, 0.6);
            let mut direction = Vec3::from(std::array::from_fn(|_| one_of(noise, &[0.0, -0.0])));
            direction[axis] = one_of(noise, &[1.0, -1.0]) * length(noise);
            let mut origin = to;
            origin[axis] -= direction[axis].signum() * between(noise, 0.0, 2.0);
            Ray::new(origin, direction)
        }
        Kind::Faces => {
            let axis = (noise.number() * 3.0) as usize % 3;
            let mut ray = plain;
            ray.origin[axis] = voxel.0[axis] + voxel.1 * one_of(noise, &[0.0, 1.0]);
            ray.direction[axis] = one_of(noise, &[0.0, -0.0]);
            ray
        }
        Kind::Corners => {
            let to = point(noise, voxel, 1.0);
            let part =
                |noise: &mut Noise| one_of(noise, &[-4.0, -3.0, -2.0, -1.0, 0.0, 0.0, 1.0, 2.0, 3.0, 4.0]) * 0.25;
            let direction = Vec3::new(part(noise), part(noise), part(noise));
            let steps = one_of(noise, &[0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 4.0, 7.5]);
            Ray::new(to - direction * steps, direction)
        }
        Kind::Components => {
            let numbers = [
                0.0,
                -0.0,
                1e-45,
                -1e-45,
                1e-38,
                1e-20,
                -1e-9,
                f32::EPSILON * 0.5,
                f32::EPSILON,
                -f32::EPSILON,
                f32::EPSILON * 1.5,
                1.0,
                -1.0,
                1e3,
                (1 << 20) as f32,
                -((1 << 20) as f32),
                ((1 << 20) as f32).next_up(),
                f32::MAX,
                f32::INFINITY,
                f32::NAN,
            ];
            // Mostly numbers that are cast.
            let few = if noise.number() < 0.8 { 16 } else { numbers.len() };
            let mut ray = plain;
            for axis in 0..3 {
                if noise.number() < 0.6 {
                    ray.direction[axis] = one_of(noise, &numbers[..few]);
                }
            }
            // Along the direction through the voxel.
            ray.origin = to - ray.direction.clamp(Vec3::splat(-1e6), Vec3::splat(1e6)) * between(noise, 0.0, 1.0);
            if !ray.origin.is_finite() {
                ray.origin = from;
            }
            ray
        }
        Kind::Inside => Ray::new(to, vector(noise, -1.0, 1.0) * length(noise)),
        Kind::Boundaries => {
            let origin = point(noise, voxel, 0.8);
            let origin = Vec3::new(near(noise, origin.x), near(noise, origin.y), near(noise, origin.z));
            let mut direction = vector(noise, -1.0, 1.0);
            for axis in 0..3 {
                if noise.number() < 0.2 {
                    direction[axis] = 0.0;
                }
            }
            Ray::new(origin, direction)
        }
        Kind::Far => {
            let distance = voxel.1 * 10f32.powf(between(noise, -6.0, 9.0));
            let way = vector(noise, -1.0, 1.0).normalize_or(Vec3::X);
            let direction = if noise.number() < 0.5 { -way } else { -way * distance.clamp(1e-3, 1e5) };
            Ray::new(to + way * distance, direction)
        }
        Kind::Spans => {
            // Where planes of the voxel are crossed.
            let planes = (point(noise, voxel, 1.0) - plain.origin) / plain.direction;
            let mut end = || {
                let plane = planes[(noise.number() * 3.0) as usize % 3];
                let number =
                    one_of(noise, &[0.0, 0.5, 1.0, 1.0, -1.0, 2.0, 1e9, f32::INFINITY, f32::NEG_INFINITY, 1e-40]);
                if noise.number() < 0.5 { near(noise, plane) } else { number }
            };
            let (t_min, t_max) = (end(), end());
            Ray { t_min, t_max, ..plain }
        }
        Kind::Sizes => {
            let edge = voxel.1;
            let at_origin =
                [0.0, 0.0, edge, edge.next_up(), edge.next_down(), 0.5, 1.0, 2.0, -1.0, f32::INFINITY, 1e-40];
            let per_t = [0.0, 0.0, edge, 1e-3, 0.1, -1e-3, 1e6, -1e30, f32::INFINITY];
            Ray { size_at_origin: one_of(noise, &at_origin), size_per_t: one_of(noise, &per_t), ..plain }
        }
        Kind::Bundles => {
            let (bundle, number) = (seed / 64, seed % 64);
            let kinds =
                [Kind::Plain, Kind::Faces, Kind::Corners, Kind::Inside, Kind::Boundaries, Kind::Far, Kind::Sizes];
            let mut ray = self::ray(kinds[(bundle % 7) as usize], target, bundle);
            let by = [0.0, f32::EPSILON, 1e-4, 1e-2][(bundle / 7 % 4) as usize];
            let across = Vec3::new((number % 8) as f32 - 3.5, (number / 8) as f32 - 3.5, (number % 3) as f32 - 1.0);
            ray.direction += across * by * ray.direction.abs().max_element();
            ray
        }
        Kind::Bits => {
            let mut any = || f32::from_bits((noise.number() * 2f64.powi(32)) as u32);
            let mut all: [f32; 10] = std::array::from_fn(|_| any());
            let keep = (noise.number() * 1024.0) as u32;
            let of_plain: [f32; 10] = bytemuck::cast(plain);
            for (k, number) in all.iter_mut().enumerate() {
                // Two of three stay as they are, so that some rays hit.
                if keep >> k & 1 != 0 || noise.number() < 0.33 {
                    *number = of_plain[k];
                }
            }
            bytemuck::cast(all)
        }
    }
}

/// A ray from within the [sphere](super::sphere) to a corner, an edge or a face of one of its voxels, without end: it must hit.
pub fn leaks(target: &Target, seed: u64) -> Ray {
    let noise = &mut noise(seed ^ 0x5eed);
    let voxel = one_of(noise, &target.0);
    let origin = Vec3::splat(1.5) + vector(noise, -0.15, 0.15);
    let origin = if noise.number() < 0.5 { (origin * 64.0).round() / 64.0 } else { origin };
    let to = point(noise, voxel, 0.9);
    let mut direction = (to - origin) * length(noise);
    if noise.number() < 0.2 {
        direction = Vec3::from(std::array::from_fn(|_| one_of(noise, &[0.0, 1.0, -1.0, 0.5, -0.25])));
    }
    if direction == Vec3::ZERO {
        direction = Vec3::X;
    }
    Ray::new(origin, direction)
}
