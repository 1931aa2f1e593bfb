//! Fog in the light of lamps: shafts of light where something stands before a lamp.

use glam::Vec3;
use rayon::prelude::*;

use super::frame::Frame;
use super::lamps::Lamp;
use super::obstacles::{Obstacles, Query};
use super::{Rays, TOGETHER, random};

/// Fog that is equally thick everywhere and scatters in all directions alike.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Fog {
    /// What part of light is scattered on a way of 1: after `d`, `exp(-density d)` is left.
    pub density: f32,
    /// Where the fog ends before the sky.
    pub reach: f32,
}

/// What fog does to a pixel: its light is multiplied by `clear`, and `color` is added.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Veil {
    /// Light that the fog scatters to the eye.
    pub color: Vec3,
    /// The share of light that gets through.
    pub clear: f32,
}

/// Fog between the eye and each pixel's surface. Each of [`Rays::count`] samples lies in an equal part of the way, anywhere in it, and asks once for each lamp.
pub fn fog(frame: &Frame, obstacles: &impl Obstacles, fog: Fog, lamps: &[Lamp], rays: Rays) -> Vec<Veil> {
    let width = frame.eye.size.0.max(1);
    let part = |(part, surfaces): (usize, &[Option<super::Surface>])| {
        let mut queries = Vec::new();
        // Of each query: the pixel of the part, and what its light adds to it.
        let mut shares = Vec::new();
        let mut veils = Vec::with_capacity(surfaces.len());
        for (i, surface) in surfaces.iter().enumerate() {
            let pixel = (part * TOGETHER + i) as u32;
            let at = glam::Vec2::new((pixel % width) as f32, (pixel / width) as f32);
            let way = frame.eye.direction(at + 0.5);
            let direction = way.normalize();
            let length = match surface {
                Some(surface) => surface.position.distance(frame.eye.position).min(fog.reach),
                None => fog.reach,
            };
            veils.push(Veil { color: Vec3::ZERO, clear: (-fog.density * length).exp() });
            let step = length / rays.count as f32;
            for ray in 0..rays.count {
                let jitter = random::square(pixel, ray, rays.seed);
                let distance = (ray as f32 + jitter.x) * step;
                let place = frame.eye.position + direction * distance;
                let scattered = fog.density * (-fog.density * distance).exp() * step / (4.0 * std::f32::consts::PI);
                for lamp in lamps {
                    let light = lamp.light(place);
                    if light == Vec3::ZERO {
                        continue;
                    }
                    let to = lamp.point(place, jitter) - place;
                    let far = to.length();
                    queries.push(Query { from: place, normal: Vec3::ZERO, direction: to / far, length: far });
                    shares.push((i, light * ((-fog.density * far).exp() * scattered)));
                }
            }
        }
        for ((i, share), blocked) in shares.iter().zip(obstacles.blocked(&queries)) {
            if !blocked {
                veils[*i].color += *share;
            }
        }
        veils
    };
    frame.surfaces.par_chunks(TOGETHER).enumerate().flat_map_iter(part).collect()
}
