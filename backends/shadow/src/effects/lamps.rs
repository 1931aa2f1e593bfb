//! Lamps and their shadows, hard or soft.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::frame::{Frame, Surface};
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
    /// Where its light ends, in the world's unit: it fades towards there, and no ray is needed beyond. Infinite: nowhere.
    pub reach: f32,
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
        let left = (1.0 - (distance / (self.reach * self.reach)).powi(2)).max(0.0);
        let share = self.cone.map_or(1.0, |cone| {
            let cosine = way.dot(cone.axis) / distance.sqrt();
            let share = ((cosine - cone.outer) / (cone.inner - cone.outer)).clamp(0.0, 1.0);
            share * share * (3.0 - 2.0 * share)
        });
        self.color * (share * left * left / distance)
    }

    /// How many rays go to it from a surface: none if no light comes; all that go to a lamp without a radius are one.
    fn count(&self, surface: &Surface, rays: Rays) -> u32 {
        match self.light(surface.position) {
            Vec3::ZERO => 0,
            _ if self.radius == 0.0 => 1,
            _ => rays.count,
        }
    }

    /// A point of the lamp as it is seen from a place.
    pub(super) fn point(&self, seen_from: Vec3, at: Vec2) -> Vec3 {
        let way = (self.position - seen_from).try_normalize().unwrap_or(Vec3::Z);
        let (x, y) = way.any_orthonormal_pair();
        let on_disk = random::disk(at) * self.radius;
        self.position + x * on_disk.x + y * on_disk.y
    }
}

/// Adds the rays from a surface to a lamp, none if no light of it comes there. Rays that begin below the surface have no length.
fn ask_lamp(lamp: &Lamp, pixel: u32, surface: &Surface, rays: Rays, queries: &mut Vec<Query>) {
    queries.extend((0..lamp.count(surface, rays)).map(|i| {
        let way = lamp.point(surface.position, random::square(pixel, i, rays.seed)) - surface.position;
        let length = way.length();
        let direction = way / length;
        let length = if direction.dot(surface.normal) > 0.0 { length } else { 0.0 };
        Query { from: surface.position, normal: surface.normal, direction, length }
    }));
}

/// The share of a lamp's rays that reach it.
fn free(queries: &[Query], blocked: &[bool]) -> f32 {
    let reaches = |(query, blocked): &(&Query, &bool)| !**blocked && query.length > 0.0;
    queries.iter().zip(blocked).filter(reaches).count() as f32 / queries.len().max(1) as f32
}

/// The share of a lamp that each pixel's surface sees, from 0 to 1; 0 where the surface faces away from it or no light of it comes.
pub fn shadow(frame: &Frame, obstacles: &impl Obstacles, lamp: &Lamp, rays: Rays) -> Vec<f32> {
    each_surface(
        frame,
        0.0,
        |pixel, surface, queries| ask_lamp(lamp, pixel, surface, rays, queries),
        |queries| obstacles.blocked(queries),
        |_, _, queries, blocked| free(queries, blocked),
    )
}

/// The share of all lamps' light that reaches each pixel's surface, for red, green and blue; 0 where there is none to reach it. With one lamp it is [`shadow`].
/// Together they need one filter against noise, and not one each.
pub fn shadows(frame: &Frame, obstacles: &impl Obstacles, lamps: &[Lamp], rays: Rays) -> Vec<Vec3> {
    // Shadows of lamps at one place need not have the same noise.
    let each = || (0..).zip(lamps).map(|(number, lamp)| (lamp, Rays { seed: rays.seed.wrapping_add(number), ..rays }));
    each_surface(
        frame,
        Vec3::ZERO,
        |pixel, surface, queries| each().for_each(|(lamp, rays)| ask_lamp(lamp, pixel, surface, rays, queries)),
        |queries| obstacles.blocked(queries),
        |_, surface, mut queries, mut blocked| {
            let (mut sum, mut all) = (Vec3::ZERO, Vec3::ZERO);
            for (lamp, rays) in each() {
                let (of_lamp, others) = queries.split_at(lamp.count(surface, rays) as usize);
                let (answers, rest) = blocked.split_at(of_lamp.len());
                let light = unblocked(surface, lamp);
                all += light;
                sum += light * free(of_lamp, answers);
                (queries, blocked) = (others, rest);
            }
            Vec3::select(all.cmpgt(Vec3::ZERO), sum / all, Vec3::ZERO)
        },
    )
}

/// The light that a surface gets from a lamp if nothing is in the way.
pub fn unblocked(surface: &Surface, lamp: &Lamp) -> Vec3 {
    let way = (lamp.position - surface.position).normalize_or_zero();
    lamp.light(surface.position) * way.dot(surface.normal).max(0.0)
}

/// The light that each pixel's surface gets from lamps, of all of which a share reaches it.
pub fn lit(frame: &Frame, lamps: &[Lamp], shares: &[Vec3]) -> Vec<Vec3> {
    let light = |(surface, share): (&Option<Surface>, &Vec3)| {
        let all = |surface: &Surface| lamps.iter().map(|lamp| unblocked(surface, lamp)).sum::<Vec3>();
        surface.as_ref().map_or(Vec3::ZERO, |surface| all(surface) * *share)
    };
    frame.surfaces.par_iter().zip(shares).map(light).collect()
}
