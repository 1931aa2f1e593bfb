//! Whether something is in the way of a ray.

use glam::Vec3;

use super::frame::Frame;
use super::screen;
use super::start::Offset;
use crate::grid::Grid;
use crate::trace::{Fidelity, Hit, Ray, Steps, batch};
use crate::volume::Occupancy;

/// A ray that is asked about. Lengths are in the world's unit.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Query {
    /// Where it begins: on a surface, if there is a normal.
    pub from: Vec3,
    /// Normal of the surface, of length 1; zero for a ray that begins in the air.
    pub normal: Vec3,
    /// Of length 1.
    pub direction: Vec3,
    /// Where it ends.
    pub length: f32,
}

/// What may be in the way of rays.
pub trait Obstacles: Sync {
    /// Whether something is in the way, for each query.
    fn blocked(&self, queries: &[Query]) -> Vec<bool>;

    /// How far the first thing is, for each query; `None` if nothing is in the way.
    fn first(&self, queries: &[Query]) -> Vec<Option<f32>>;
}

/// How a volume is traced.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum How {
    /// Every voxel that the ray touches.
    Walk(Fidelity),
    /// Samples this many voxels apart.
    Steps {
        /// From sample to sample, in voxels; above 0, at most 64.
        length: f64,
        /// Mips and more.
        fidelity: Fidelity,
    },
}

/// Rays that are traced together.
const TOGETHER: usize = 2048;

/// Obstacles as a volume has them.
#[derive(Clone, Copy, Debug)]
pub struct Through<'a, O: ?Sized> {
    /// The volume.
    pub volume: &'a O,
    /// Where its voxels lie.
    pub grid: Grid,
    /// How it is traced.
    pub how: How,
    /// What is skipped at a surface.
    pub offset: Offset,
    /// The picture that is looked at for as far as the volume is not.
    pub screen: Option<&'a Frame>,
}

impl<O: Occupancy + Sync + ?Sized> Through<'_, O> {
    /// The ray of a query through the volume, without what the picture may have in its way. `None` if the query ends before it, or is too far away.
    pub fn ray(&self, query: &Query) -> Option<Ray> {
        match (Self { screen: None, ..*self }).begin(query) {
            Begun::Goes(ray, _) => Some(ray),
            Begun::Met(_) | Begun::Free => None,
        }
    }

    /// Distance to what the picture has in the way, or else the ray through the volume and where on the query it begins.
    fn begin(&self, query: &Query) -> Begun {
        let voxel = self.grid.voxel as f32;
        let (along, above) = self.offset.of(query.normal, query.direction);
        let (along, above) = (along * voxel, above * voxel);
        if let Some(frame) = self.screen
            && query.normal != Vec3::ZERO
        {
            // What is lifted off the surface is not skipped along the ray, but the ray passes as much lower.
            let skipped = (along + above).min(query.length);
            if let Some(at) = screen::first(frame, query.from, query.direction, skipped, 2.0 * voxel) {
                return Begun::Met(at);
            }
        }
        if along >= query.length {
            return Begun::Free;
        }
        let start = query.from + query.direction * along + query.normal * above;
        let start = self.grid.to_voxels(start.as_dvec3());
        let length = f64::from(query.length - along) / self.grid.voxel;
        match Ray::new(start, query.direction.as_dvec3(), length) {
            Ok(ray) => Begun::Goes(ray, along),
            // Nothing is that far away, and nothing lies in no direction.
            Err(_) => Begun::Free,
        }
    }
}

enum Begun {
    Met(f32),
    Free,
    Goes(Ray, f32),
}

impl<O: Occupancy + Sync + ?Sized> Through<'_, O> {
    /// The answer to each query: what a query is answered with whose ray has met something, or nothing; and what to `trace`, rays and where on their queries they
    /// begin, in the place of which `trace` puts answers in the same order.
    fn answer<A: Clone>(
        &self,
        queries: &[Query],
        met: impl Fn(f32) -> A,
        free: A,
        trace: impl Fn(&[Ray], &[f32]) -> Vec<A>,
    ) -> Vec<A> {
        let mut answers = vec![free; queries.len()];
        let (mut places, mut rays, mut along) = (Vec::new(), Vec::new(), Vec::new());
        for part in (0..queries.len()).step_by(TOGETHER) {
            for (place, query) in (part..).zip(&queries[part..queries.len().min(part + TOGETHER)]) {
                match self.begin(query) {
                    Begun::Met(at) => answers[place] = met(at),
                    Begun::Free => {}
                    Begun::Goes(ray, skipped) => {
                        places.push(place);
                        rays.push(ray);
                        along.push(skipped);
                    }
                }
            }
            for (place, answer) in places.drain(..).zip(trace(&rays, &along)) {
                answers[place] = answer;
            }
            rays.clear();
            along.clear();
        }
        answers
    }
}

impl<O: Occupancy + Sync + ?Sized> Obstacles for Through<'_, O> {
    fn blocked(&self, queries: &[Query]) -> Vec<bool> {
        let trace = |rays: &[Ray], _: &[f32]| match self.how {
            How::Walk(fidelity) => batch::blocked(self.volume, rays, fidelity),
            How::Steps { length, fidelity } => rays
                .iter()
                .map(|ray| {
                    Steps::new(ray, length).is_ok_and(|steps| steps.first_hit(self.volume, ray, fidelity).hit.is_some())
                })
                .collect(),
        };
        self.answer(queries, |_| true, false, trace)
    }

    fn first(&self, queries: &[Query]) -> Vec<Option<f32>> {
        let trace = |rays: &[Ray], along: &[f32]| {
            let hits = match self.how {
                How::Walk(fidelity) => batch::first_hits(self.volume, rays, fidelity),
                How::Steps { length, fidelity } => rays
                    .iter()
                    .map(|ray| Steps::new(ray, length).ok()?.first_hit(self.volume, ray, fidelity).hit)
                    .collect(),
            };
            let far = |(hit, along): (Option<Hit>, &f32)| hit.map(|hit| along + hit.distance * self.grid.voxel as f32);
            hits.into_iter().zip(along).map(far).collect()
        };
        self.answer(queries, Some, None, trace)
    }
}
