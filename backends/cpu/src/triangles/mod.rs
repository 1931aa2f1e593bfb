//! Casters of triangles, with which octrees are compared in error and in time.
//!
//! There are two for the same triangles. [`TriangleScene::cast`] is fast: single precision, packets of 16 rays.
//! [`TriangleScene::cast_exact`] is exact: double precision, watertight. Both take the same rays, and both give `t` as depth
//! over far depth, as octree casters do.
//!
//! The example `triangles` of this crate measures both on a mesh, and `obvhs` alone for comparison. One thread of a busy 2-core EPYC
//! (Zen 5, AVX-512), 1024x768, four interior cameras, the mean of the best of seven rounds, in millions of rays per second:
//!
//! | caster | SIBENIK | CONFERENCE |
//! |---|---|---|
//! | fast | 16.1 | 17.8 |
//! | exact | 2.2 | 2.5 |
//! | `obvhs` 0.4, BVH2, its own traversal, single rays | 6.6 | 7.7 |
//!
//! The fast caster was another then, whose loops over arrays the compiler turned into vectors. The rates of the present one are
//! in results/amd-epyc-2-threads/embree.md.
//!
//! Two threads gave 1.8 times the rays when nothing else used the second core. Of 3.1 million rays per scene, 2 and 0 hit with
//! one of fast and exact and miss with the other; `t` differs by more than 10^-4 for 4 and 18.
//!
//! For a GPU, [`TriangleScene::wide`] makes an eight-wide hierarchy, and [`TriangleScene::decide`] turns a GPU's answers into the hits
//! of the exact caster.
//!
//! With the feature `embree`, `EmbreeScene` casts the same triangles by Embree; the example `triangle_race` measures all of them
//! and octrees in one run.

mod bvh;
#[cfg(feature = "embree")]
mod embree;
#[cfg(feature = "embree")]
mod embree_sys;
mod exact;
mod packet;
pub mod suite;
pub mod testing;
#[cfg(test)]
mod tests;
mod wide;

use std::sync::OnceLock;
use std::time::{Duration, Instant};

use esvo_core::CastError;
use esvo_core::exact::{CameraRays, ExactRay, TriangleHit};
use glam::{DVec3, Vec3A};
use rayon::prelude::*;

use crate::vectors::Vectors;

use bvh::{Bvh, Placement};
#[cfg(feature = "embree")]
pub use embree::{EmbreeRays, EmbreeScene};
use packet::Rows;
pub use wide::Decided;

/// Most triangles of a scene: splitting may double the boxes, which are numbered with 32 bits.
pub const MAX_TRIANGLES: usize = 1 << 29;

/// Triangles, ready to be cast.
pub struct TriangleScene {
    triangles: Vec<[DVec3; 3]>,
    placement: Placement,
    /// Built at the first use, as `exact`: many need only one of them, and this one takes long to build.
    fast: OnceLock<Fast>,
    exact: OnceLock<Bvh>,
}

/// What single-precision casts read.
struct Fast {
    bvh: Bvh,
    /// Corners in the space and the order of the hierarchy.
    corners: Vec<[Vec3A; 3]>,
}

impl TriangleScene {
    /// Takes triangles in mesh units. Triangles without area are kept, so that indices stay, but rays never hit them.
    ///
    /// # Errors
    /// Coordinates that are not finite or too large to subtract, more than [`MAX_TRIANGLES`] triangles.
    pub fn new(triangles: Vec<[[f64; 3]; 3]>) -> Result<Self, CastError> {
        if triangles.len() > MAX_TRIANGLES {
            return Err(CastError::Device(format!(
                "a scene of {} triangles: the triangle caster takes at most {MAX_TRIANGLES}; cast fewer at a time",
                triangles.len()
            )));
        }
        let triangles: Vec<[DVec3; 3]> = triangles.into_iter().map(|t| t.map(DVec3::from)).collect();
        // Differences of coordinates within this limit, and products of two of them, are finite.
        let limit = 1e150;
        let strange = triangles.iter().position(|t| t.iter().any(|p| !p.is_finite() || p.abs().max_element() > limit));
        if let Some(index) = strange {
            return Err(CastError::Device(format!(
                "triangle {index} has its corners at {:?}: coordinates must be finite numbers below 1e150; repair the mesh",
                triangles[index]
            )));
        }
        let corners = || triangles.iter().flatten().copied();
        let lo = corners().reduce(DVec3::min).unwrap_or_default();
        let hi = corners().reduce(DVec3::max).unwrap_or_default();
        let placement = Placement::of(lo, hi);

        Ok(Self { triangles, placement, fast: OnceLock::new(), exact: OnceLock::new() })
    }

    /// The triangles, in mesh units, in the order in which they were given.
    pub fn triangles(&self) -> &[[DVec3; 3]] {
        &self.triangles
    }

    /// Unit normal of a triangle, by the right-hand rule; zero for one without area.
    ///
    /// # Panics
    /// There is no triangle of this index.
    pub fn normal(&self, triangle: u32) -> DVec3 {
        let [a, b, c] = self.triangles[triangle as usize];
        (b - a).cross(c - a).normalize_or_zero()
    }

    /// Casts a picture in single precision on the threads of the current rayon pool: `hits[y * width + x]`, the first row
    /// on top. Resizes `hits`.
    ///
    /// Not watertight at corners; `t` is off by a few units in the last place of `f32`.
    pub fn cast(&self, rays: &CameraRays, hits: &mut Vec<TriangleHit>) {
        self.cast_with(Vectors::best(), rays, hits);
    }

    /// The same with these vectors, which the processor must have.
    fn cast_with(&self, vectors: Vectors, rays: &CameraRays, hits: &mut Vec<TriangleHit>) {
        hits.clear();
        hits.resize(rays.pixels(), TriangleHit::MISS);
        let fast = self.fast();
        if fast.bvh.nodes.is_empty() {
            return;
        }
        hits.par_chunks_mut(packet::EDGE * rays.width as usize).enumerate().for_each(|(strip, hits)| {
            let (bvh, corners, placement) = (&fast.bvh, &fast.corners[..], &self.placement);
            let first_row = strip * packet::EDGE;
            let rows = Rows { bvh, corners, placement, rays, first_row, hits: &mut *hits };
            assert!(vectors.run(rows).is_ok(), "the processor has the vectors that were found");
            for hit in hits.iter_mut().filter(|hit| !hit.is_miss()) {
                hit.triangle = fast.bvh.order[hit.triangle as usize];
            }
        });
    }

    /// Sorts the triangles for [`cast`](Self::cast), which otherwise does that when it is first called.
    pub fn prepare(&self) {
        self.fast();
    }

    /// Casts a picture as [`cast`](Self::cast) does and returns how long that took, without [`prepare`](Self::prepare).
    pub fn time(&self, rays: &CameraRays) -> Duration {
        self.prepare();
        let mut hits = Vec::with_capacity(rays.pixels());
        let start = Instant::now();
        self.cast(rays, &mut hits);
        std::hint::black_box(&hits);
        start.elapsed()
    }

    /// Casts a picture in double precision, watertight, on the threads of the current rayon pool.
    pub fn cast_exact(&self, rays: &CameraRays) -> Vec<TriangleHit> {
        let bvh = self.exact_bvh();
        let mut hits = vec![TriangleHit::MISS; rays.pixels()];
        hits.par_chunks_mut(rays.width as usize).enumerate().for_each(|(y, row)| {
            let mut stack = Vec::with_capacity(bvh.depth + 2);
            for (x, hit) in row.iter_mut().enumerate() {
                let ray = rays.ray(x as u32, y as u32);
                *hit = exact::closest(bvh, &self.placement, &self.triangles, &ray, &mut stack);
            }
        });
        hits
    }

    /// Casts one ray, given in mesh units, in double precision, watertight: the closest hit between its ends, of the
    /// lowest index if several are equally close. Rays that are not finite or have no direction miss.
    pub fn cast_exact_ray(&self, ray: &ExactRay) -> TriangleHit {
        exact::closest(self.exact_bvh(), &self.placement, &self.triangles, ray, &mut Vec::new())
    }

    /// Bytes that [`cast`](Self::cast) reads: nodes, order and single-precision corners.
    pub fn resident_bytes(&self) -> u64 {
        let fast = self.fast();
        (fast.bvh.bytes() + size_of_val(fast.corners.as_slice())) as u64
    }

    fn fast(&self) -> &Fast {
        self.fast.get_or_init(|| {
            let mut solid = Vec::new();
            let mut indices = Vec::new();
            for (index, triangle) in self.triangles.iter().enumerate() {
                let [a, b, c] = triangle.map(|p| Vec3A::from(self.placement.point(p).as_vec3()));
                if (b - a).cross(c - a) != Vec3A::ZERO {
                    solid.push([a, b, c]);
                    indices.push(index as u32);
                }
            }
            let bvh = Bvh::fastest(&solid, &indices);
            let single = |&i: &u32| self.triangles[i as usize].map(|p| Vec3A::from(self.placement.point(p).as_vec3()));
            let corners = bvh.order.iter().map(single).collect();
            Fast { bvh, corners }
        })
    }

    /// Built at the first use, since measuring time does not need it.
    fn exact_bvh(&self) -> &Bvh {
        self.exact.get_or_init(|| {
            let boxes: Vec<_> = self.triangles.iter().map(|t| exact::wide_box(t, &self.placement)).collect();
            let indices: Vec<u32> = (0..boxes.len() as u32).collect();
            Bvh::over_boxes(&boxes, &indices)
        })
    }
}
