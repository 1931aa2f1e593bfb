//! Lists of rays and fans, sixteen rays at a time while they stay together.
//!
//! A visit of a voxel costs a packet the same for one ray as for sixteen. Where few rays of a packet go on together, they are
//! faster in lockstep, each with a stack of its own. Whether they do is seen when a packet has been cast; what follows it in the
//! list is expected to be alike.

use esvo_core::{Fan, Fans, Hit, Ray};
use fearless_simd::prelude::*;

use super::super::counters::{What, count};
use super::super::scene::Scene;
use super::super::task::{LANES, Task};
use super::super::{lockstep, single};
use super::packet::{Floats, Packet, Results, finest_scale_at};
use super::walk::{Stack, cast_alone};

/// Rays that must enter a node together in the mean, in halves of a ray, for packets to be faster than rays apart: with cubes
/// and with contours. Measured with AVX2: results/amd-epyc-2-threads/casting-approaches.md.
const LEAST_TOGETHER: [u32; 2] = [10, 5];

/// Packets whose rays are cast apart after a packet of rays that do not stay together: the first time, and at most.
/// Between them, twice as many and one more each time.
const APART: (usize, usize) = (7, 63);

/// Rays of the shortest list that is cast as a packet.
const LEAST_RAYS: usize = 4;

/// Casts the rays of fans, one fan after the other.
#[inline(always)]
pub(super) fn fans<S: Simd>(simd: S, scene: &Scene, all: &Fans, some: &[Fan], hits: &mut [Hit]) {
    let mut packets = Packets::new(simd, scene, all.contours);
    let mut rays = Vec::with_capacity(all.directions.len());
    for (fan, hits) in some.iter().zip(hits.chunks_exact_mut(all.directions.len())) {
        rays.clear();
        rays.extend(all.directions.iter().map(|direction| Fans::ray(fan, *direction)));
        packets.cast_all(&rays, hits);
    }
}

/// Casts a list of rays.
#[inline(always)]
pub(super) fn list<S: Simd>(simd: S, scene: &Scene, rays: &[Ray], contours: bool, hits: &mut [Hit]) {
    if rays.len() < LEAST_RAYS {
        return single::run(scene, Task::Rays { rays, contours, hits });
    }
    Packets::new(simd, scene, contours).cast_all(rays, hits);
}

/// Casts packets one after the other.
struct Packets<'a, S: Simd> {
    simd: S,
    scene: &'a Scene<'a>,
    contours: bool,
    stack: Stack<S>,
    /// Packets whose rays are cast apart before the next is tried.
    wait: usize,
    /// The same after the next packet of rays that do not stay together.
    next_wait: usize,
}

impl<'a, S: Simd> Packets<'a, S> {
    #[inline(always)]
    fn new(simd: S, scene: &'a Scene<'a>, contours: bool) -> Self {
        Self { simd, scene, contours, stack: Stack::new(simd), wait: 0, next_wait: APART.0 }
    }

    /// Casts rays.
    #[inline(always)]
    fn cast_all(&mut self, mut rays: &[Ray], mut hits: &mut [Hit]) {
        while !rays.is_empty() {
            let together = self.wait == 0;
            let packets = if together { 1 } else { self.wait.min(rays.len().div_ceil(LANES)) };
            let (some, other_rays) = rays.split_at(rays.len().min(packets * LANES));
            let (found, other_hits) = hits.split_at_mut(some.len());
            (rays, hits) = (other_rays, other_hits);
            if together {
                self.cast(some, found);
            } else {
                self.wait -= packets;
                lockstep::cast(self.simd, self.scene, some, self.contours, found);
            }
        }
    }

    /// Casts at most sixteen rays together.
    #[inline(always)]
    fn cast(&mut self, rays: &[Ray], hits: &mut [Hit]) {
        let Self { simd, scene, contours, .. } = *self;
        let mut origin = [[0.0; LANES]; 3];
        let mut direction = [[0.0; LANES]; 3];
        let [mut t_min, mut t_max] = [[0.0; LANES]; 2];
        let size_per_t = rays.first().map_or(0.0, |ray| ray.size_per_t);
        let (mut lanes, mut again, mut finest_scale) = (0, 0, 0);
        for (lane, ray) in rays.iter().enumerate().take(LANES) {
            for axis in 0..3 {
                origin[axis][lane] = ray.origin[axis];
                direction[axis][lane] = ray.direction[axis];
            }
            (t_min[lane], t_max[lane]) = (ray.t_min, ray.t_max);
            if ray.is_cast() {
                // All rays of a packet have the same size, at the origin none: few lists have others.
                match finest_scale_at((ray.origin - 1.5).abs().max_element()) {
                    Some(scale) if ray.size_at_origin == 0.0 && ray.size_per_t == size_per_t => {
                        finest_scale = scale.max(finest_scale);
                        lanes |= 1 << lane;
                    }
                    _ => again |= 1 << lane,
                }
            }
        }
        let vector = |numbers| Floats::simd_from(simd, numbers);
        let mut results = Results::new(simd, lanes | again);
        results.give_up(again);
        if lanes != 0 {
            let [x, y, z] = origin;
            let origin = [vector(x), vector(y), vector(z)];
            let [x, y, z] = direction;
            let mut packet = Packet::new(simd, origin, [vector(x), vector(y), vector(z)], finest_scale);
            packet.size_per_t = size_per_t;
            packet.contours = if scene.clips(contours) { 0xff } else { 0 };
            let span = [vector(t_min), vector(t_max)];
            cast_alone(simd, scene, &packet, span, lanes, &mut self.stack, &mut results);
        }
        if 2 * results.rays_pushed < LEAST_TOGETHER[usize::from(scene.clips(contours))] * results.pushes {
            self.wait = self.next_wait;
            self.next_wait = (2 * self.next_wait + 1).min(APART.1);
        } else {
            self.next_wait = APART.0;
        }
        count(What::CastAgain, results.again.count_ones());
        for (lane, (ray, hit)) in rays.iter().zip(hits).enumerate() {
            *hit = match results.again >> lane & 1 {
                0 => results.found.get(lane),
                _ => single::cast_one(simd, scene, ray, contours),
            };
        }
    }
}
