//! What one bit a voxel is good for: ambient occlusion, shadows, reflections, fog and indirect light, each a pass over a picture's surfaces.
//!
//! A pass takes a [`Frame`], the first surfaces of a picture from whatever caster, and asks [`Obstacles`] whether something is in the way of its rays.
//! [`Through`] answers by a volume, with the shortcuts that a volume allows. Other obstacles, such as the exact octree or triangles, answer the same
//! questions of the same rays: the difference is what the shortcuts cost.
//!
//! # Where rays start
//! A surface fills the voxels that it meets, so a ray from a surface would end in the surface's own voxels. [`start`] derives how far away from the
//! surface they end, and [`Offset`] says how far a ray goes before it looks at the volume. For that distance a ray may look at the picture instead
//! ([`screen`]), where fine details are that the offset skips.
//!
//! # What is where
//! - [`frame`]: [`Frame`], [`Surface`] and [`Eye`]. [`obstacles`]: [`Obstacles`], [`Query`] and [`Through`].
//! - [`start`], [`screen`]: the beginning of rays.
//! - [`occlusion`], [`lamps`], [`reflections`], [`fog`], [`bounce`]: the passes.
//! - [`mod@compose`]: a picture with several of them.
//! - [`denoise`]: filters of their results, in a picture and over pictures.

pub mod bounce;
pub mod compose;
pub mod denoise;
pub mod fog;
pub mod frame;
pub mod lamps;
pub mod obstacles;
pub mod occlusion;
mod random;
pub mod reflections;
pub mod screen;
pub mod start;

pub use compose::{Composed, Counts, Pass, Settings, Wanted, compose, compose_with};
pub use frame::{Eye, Frame, Surface};
pub use lamps::{Cone, Lamp};
pub use obstacles::{How, Obstacles, Query, Through};
pub use start::Offset;

use rayon::prelude::*;

/// Rays of a pass: how many for each pixel, and the number that they are chosen by.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Rays {
    /// Rays for each pixel, from 1 on.
    pub count: u32,
    /// Chooses directions. Pictures of a film have one seed each, so that their noise averages out.
    pub seed: u32,
}

/// Pixels that a thread does one after the other.
const PART: usize = 1024;
/// Queries that are cast together, but for those of the last pixel: many enough for [`trace::batch`](crate::trace::batch), and few enough to stay in a cache.
const QUERIES: usize = 2048;
/// Pixels whose samples of fog are in memory together.
const TOGETHER: usize = 256;

/// Adds a surface's rays to all around, as often in a direction as its cosine is large.
fn ask_around(pixel: u32, surface: &Surface, reach: f32, rays: Rays, queries: &mut Vec<Query>) {
    queries.extend((0..rays.count).map(|i| Query {
        from: surface.position,
        normal: surface.normal,
        direction: random::hemisphere(surface.normal, random::square(pixel, i, rays.seed)),
        length: reach,
    }));
}

/// Makes a value of each pixel from the answers to its queries. Pixels are done in parts, on all cores, so that queries need little memory.
///
/// `ask` adds a pixel's queries, each with a weight; `answer` turns the weights and answers into the pixel's value. Pixels without a surface get `none`.
fn each_surface<T: Send + Clone + Sync, A>(
    frame: &Frame,
    none: T,
    ask: impl Fn(u32, &Surface, &mut Vec<Query>) + Sync,
    cast: impl Fn(&[Query]) -> Vec<A> + Sync,
    answer: impl Fn(u32, &Surface, &[Query], &[A]) -> T + Sync,
) -> Vec<T> {
    let parts = frame.surfaces.par_chunks(PART).enumerate().flat_map_iter(|(part, surfaces)| {
        let pixel = |i: usize| (part * PART + i) as u32;
        let mut queries = Vec::new();
        // Of the pixels since the last answers, one past the last of each one's queries.
        let mut ends = Vec::new();
        let mut values = Vec::with_capacity(surfaces.len());
        for (i, surface) in surfaces.iter().enumerate() {
            if let Some(surface) = surface {
                ask(pixel(i), surface, &mut queries);
            }
            ends.push(queries.len());
            if queries.len() < QUERIES && i + 1 < surfaces.len() {
                continue;
            }
            let answers = cast(&queries);
            let mut from = 0;
            for end in ends.drain(..) {
                let i = values.len();
                values.push(surfaces[i].as_ref().map_or_else(
                    || none.clone(),
                    |surface| answer(pixel(i), surface, &queries[from..end], &answers[from..end]),
                ));
                from = end;
            }
            queries.clear();
        }
        values
    });
    parts.collect()
}
