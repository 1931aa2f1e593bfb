//! Lamps and their shadows, hard or soft.

use glam::{Vec2, Vec3};

use super::frame::Frame;
use super::obstacles::{Obstacles, Query};
use super::{Rays, each_surface, random};

/// A ball that shines.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Lamp {
    /// Where its middle is.
    pub position: Vec3,
    /// Its radius, in the world's unit; 0 makes hard shadows.
    pub radius: f32,
    /// Its light: what a surface at distance 1 that faces the lamp gets, linear red, green and blue.
    pub color: Vec3,
    /// The cone that it shines in; `None`: in all directions.
    pub cone: Option<Cone>,
}

/// The cone of a spotlight.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Cone {
    /// Its axis, of length 1.
    pub axis: Vec3,
    /// Cosine of the angle between the axis and where the light begins to fade.
    pub inner: f32,
    /// Cosine of the angle where it ends; below `inner`.
    pub outer: f32,
}

impl Lamp {
    /// The light that comes from the lamp's middle to a place if nothing is in the way, before the surface's slope counts. Within the lamp it is as at its
    /// radius.
    pub fn light(&self, place: Vec3) -> Vec3 {
        let way = place - self.position;
        let distance = way.length_squared().max(self.radius * self.radius).max(1e-12);
        let share = self.cone.map_or(1.0, |cone| {
            let cosine = way.dot(cone.axis) / distance.sqrt();
            let share = ((cosine - cone.outer) / (cone.inner - cone.outer)).clamp(0.0, 1.0);
            share * share * (3.0 - 2.0 * share)
        });
        self.color * (share / distance)
    }

    /// A point of the lamp as it is seen from a place.
    pub(super) fn point(&self, seen_from: Vec3, at: Vec2) -> Vec3 {
        let way = (self.position - seen_from).try_normalize().unwrap_or(Vec3::Z);
        let (x, y) = way.any_orthonormal_pair();
        let on_disk = random::disk(at) * self.radius;
        self.position + x * on_disk.x + y * on_disk.y
    }
}

/// The share of a lamp that each pixel's surface sees, from 0 to 1; 0 where the surface faces away from it or no light of it comes.
pub fn shadow(frame: &Frame, obstacles: &impl Obstacles, lamp: &Lamp, rays: Rays) -> Vec<f32> {
    // All rays to a lamp without a radius are one.
    let count = if lamp.radius == 0.0 { 1 } else { rays.count };
    each_surface(
        frame,
        0.0,
        |pixel, surface, queries| {
            if lamp.light(surface.position) == Vec3::ZERO {
                return;
            }
            for i in 0..count {
                let way = lamp.point(surface.position, random::square(pixel, i, rays.seed)) - surface.position;
                let length = way.length();
                let direction = way / length;
                if direction.dot(surface.normal) > 0.0 {
                    queries.push(Query { from: surface.position, normal: surface.normal, direction, length });
                }
            }
        },
        |queries| obstacles.blocked(queries),
        |_, _, _, blocked| blocked.iter().filter(|&&blocked| !blocked).count() as f32 / count as f32,
    )
}

/// The light that each pixel's surface gets from a lamp, of which it sees a share.
pub fn lit(frame: &Frame, lamp: &Lamp, seen: &[f32]) -> Vec<Vec3> {
    let light = |(surface, seen): (&Option<super::Surface>, &f32)| {
        surface.as_ref().map_or(Vec3::ZERO, |surface| {
            let way = (lamp.position - surface.position).normalize_or_zero();
            lamp.light(surface.position) * (way.dot(surface.normal).max(0.0) * seen)
        })
    };
    frame.surfaces.iter().zip(seen).map(light).collect()
}
