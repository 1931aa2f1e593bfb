//! Fog in the light of lamps: shafts of light where something stands before a lamp.

use glam::Vec3;
use rayon::prelude::*;

use super::frame::Frame;
use super::lamps::Lamp;
use super::obstacles::{Obstacles, Query};
use super::{Rays, random};

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
    let width = frame.eye.size.0 as usize;
    let row = |(row, surfaces): (usize, &[Option<super::Surface>])| {
        let mut queries = Vec::new();
        // Of each query: the pixel of the row, and what its light adds to it.
        let mut shares = Vec::new();
        let mut veils = Vec::with_capacity(surfaces.len());
        for (x, surface) in surfaces.iter().enumerate() {
            let way = frame.eye.direction(glam::Vec2::new(x as f32 + 0.5, row as f32 + 0.5));
            let direction = way.normalize();
            let length = match surface {
                Some(surface) => surface.position.distance(frame.eye.position).min(fog.reach),
                None => fog.reach,
            };
            veils.push(Veil { color: Vec3::ZERO, clear: (-fog.density * length).exp() });
            let part = length / rays.count as f32;
            let pixel = (row * width + x) as u32;
            for i in 0..rays.count {
                let jitter = random::square(pixel, i, rays.seed);
                let distance = (i as f32 + jitter.x) * part;
                let place = frame.eye.position + direction * distance;
                let scattered = fog.density * (-fog.density * distance).exp() * part / (4.0 * std::f32::consts::PI);
                for lamp in lamps {
                    let light = lamp.light(place);
                    if light == Vec3::ZERO {
                        continue;
                    }
                    let to = lamp.point(place, jitter) - place;
                    let far = to.length();
                    queries.push(Query { from: place, normal: Vec3::ZERO, direction: to / far, length: far });
                    shares.push((x, light * ((-fog.density * far).exp() * scattered)));
                }
            }
        }
        for ((x, share), blocked) in shares.iter().zip(obstacles.blocked(&queries)) {
            if !blocked {
                veils[*x].color += *share;
            }
        }
        veils
    };
    frame.surfaces.par_chunks(width.max(1)).enumerate().flat_map_iter(row).collect()
}
