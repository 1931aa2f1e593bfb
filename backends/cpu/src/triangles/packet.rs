//! Closest hits in single precision, fast: packets of 4 x 4 rays from one eye go down the hierarchy together.
//!
//! The code is generic over the vectors of `fearless_simd`, with one float for each ray of a packet, and compiled for each of
//! [`Vectors`](crate::vectors::Vectors). Hits are the same for all of them: products and sums are rounded one by one.
//!
//! A packet has one stack. Of two children that rays enter, the one that a ray enters first comes first, and the other is left out
//! if all rays have hit something before it when its turn comes. A child that no ray enters costs a test of a mask; only
//! two children to choose from cost the least of all lanes. In a leaf, `t` is computed only if a ray is inside a triangle. Where the
//! rays run the same way on each axis, as in nearly all packets, the sides by which they enter and leave boxes are known.
//!
//! results/amd-epyc-2-threads/casting-approaches.md says what each of these gained.

use esvo_core::exact::{CameraRays, TriangleHit};
use fearless_simd::prelude::*;
use fearless_simd::{f32x16, mask32x16, u32x16};
use glam::{DVec3, Vec3A};

use super::bvh::{Bvh, Node, Placement};
use crate::vectors::{Work, greatest, least};

/// Edge of a packet in pixels.
pub(super) const EDGE: usize = 4;
/// Rays of a packet.
const LANES: usize = EDGE * EDGE;
/// One float for each ray of a packet.
type Floats<S> = f32x16<S>;

/// Factor on where a ray leaves a box, which covers the rounding of six products and differences.
const SLACK: f32 = 1.0 + 4.0 * f32::EPSILON;

/// Rows of a picture, from `first_row` on as many as `hits` has room for.
pub(super) struct Rows<'a> {
    pub(super) bvh: &'a Bvh,
    pub(super) corners: &'a [[Vec3A; 3]],
    pub(super) placement: &'a Placement,
    pub(super) rays: &'a CameraRays,
    pub(super) first_row: usize,
    pub(super) hits: &'a mut [TriangleHit],
}

impl Work for Rows<'_> {
    type Output = ();

    /// Casts the rows.
    fn run<S: Simd, const TILES: bool, const LISTS: bool>(self, simd: S) {
        simd.vectorize(
            #[inline(always)]
            || self.cast(simd),
        );
    }
}

impl Rows<'_> {
    #[inline(always)]
    fn cast<S: Simd>(self, simd: S) {
        let Self { bvh, corners, placement, rays, first_row, hits } = self;
        let width = rays.width as usize;
        let rows = hits.len() / width;
        let eye: [f32; 3] = placement.point(rays.origin).as_vec3().into();
        let mut stack = vec![(0u32, 0f32); bvh.depth + 1];
        for row in (0..rows).step_by(EDGE) {
            for column in (0..width).step_by(EDGE) {
                let mut packet = Packet::new(simd, rays, placement.scale, column, first_row + row);
                packet.descend(bvh, corners, eye, &mut stack);
                let (t, triangle) = packet.found();
                for y in row..(row + EDGE).min(rows) {
                    for x in column..(column + EDGE).min(width) {
                        let lane = (y - row) * EDGE + (x - column);
                        if triangle[lane] != TriangleHit::NONE {
                            hits[y * width + x] = TriangleHit { t: f64::from(t[lane]), triangle: triangle[lane] };
                        }
                    }
                }
            }
        }
    }
}

/// Rays from one eye, lane by lane.
struct Packet<S: Simd> {
    simd: S,
    direction: [Floats<S>; 3],
    inverse: [Floats<S>; 3],
    /// Closest `t` found so far.
    t: Floats<S>,
    /// The triangle there, or [`TriangleHit::NONE`].
    triangle: u32x16<S>,
    t_near: Floats<S>,
    /// Whether rays run against each axis; of rays that all do or all do not, only.
    against: [bool; 3],
    /// On each axis, all rays run the same way.
    one_octant: bool,
}

/// The rays that enter a box before their closest hit, and where they do.
#[derive(Clone, Copy)]
struct Entry<S: Simd> {
    rays: mask32x16<S>,
    t: Floats<S>,
}

impl<S: Simd> Entry<S> {
    /// The least `t` at which one of the rays enters the box; infinite if none does.
    #[inline(always)]
    fn least(self) -> f32 {
        least(self.rays.select(self.t, Floats::splat(self.t.token(), f32::INFINITY)))
    }
}

impl<S: Simd> Packet<S> {
    /// The packet whose first pixel is this one. Lanes beyond the picture have the rays of pixels beyond it.
    #[inline(always)]
    fn new(simd: S, rays: &CameraRays, scale: f64, x: usize, y: usize) -> Self {
        let vector = |v: DVec3| (v * scale).as_vec3();
        let (corner, dx, dy) =
            (vector(rays.direction(x as f64 + 0.5, y as f64 + 0.5)), vector(rays.dx), vector(rays.dy));
        let zero = Floats::splat(simd, 0.0);
        let mut packet = Self {
            simd,
            direction: [zero; 3],
            inverse: [zero; 3],
            t: Floats::splat(simd, 1.0),
            triangle: u32x16::splat(simd, TriangleHit::NONE),
            t_near: Floats::splat(simd, rays.t_near as f32),
            against: [false; 3],
            one_octant: true,
        };
        let columns = Floats::simd_from(simd, COLUMNS);
        let rows = Floats::simd_from(simd, ROWS);
        let least = Floats::splat(simd, f32::MIN_POSITIVE);
        for axis in 0..3 {
            let d = columns * dx[axis] + corner[axis] + rows * dy[axis];
            // For a ray that is parallel to a slab, the inverse is huge instead of infinite, so that nothing becomes NaN.
            let d = d.abs().simd_lt(least).select(least.copysign(d), d);
            let negative = d.simd_lt(zero);
            packet.against[axis] = negative.any_true();
            packet.one_octant &= negative.any_true() == negative.all_true();
            packet.direction[axis] = d;
            packet.inverse[axis] = Floats::splat(simd, 1.0) / d;
        }
        packet
    }

    /// Closest `t` and the triangle there, ray by ray.
    #[inline(always)]
    fn found(&self) -> ([f32; LANES], [u32; LANES]) {
        let (mut t, mut triangle) = ([0.0; LANES], [0; LANES]);
        self.t.store_slice(&mut t);
        self.triangle.store_slice(&mut triangle);
        (t, triangle)
    }

    /// Finds the closest hits.
    #[inline(always)]
    fn descend(&mut self, bvh: &Bvh, corners: &[[Vec3A; 3]], eye: [f32; 3], stack: &mut [(u32, f32)]) {
        let mut waiting = 0;
        let mut farthest = 1.0f32;
        let mut at = 0;
        if self.enter(&bvh.nodes[0], eye).rays.all_false() {
            return;
        }
        loop {
            let node = &bvh.nodes[at as usize];
            if node.count > 0 {
                for place in node.first..node.first + node.count {
                    self.meet(&corners[place as usize], place, eye);
                }
                farthest = greatest(self.t);
            } else {
                let (near, far) = (node.first, node.first + 1);
                let (a, b) = (self.enter(&bvh.nodes[near as usize], eye), self.enter(&bvh.nodes[far as usize], eye));
                match (a.rays.any_true(), b.rays.any_true()) {
                    (true, true) => {
                        let (t_a, t_b) = (a.least(), b.least());
                        let (near, far, t_far) = if t_b < t_a { (far, near, t_a) } else { (near, far, t_b) };
                        stack[waiting] = (far, t_far);
                        waiting += 1;
                        at = near;
                        continue;
                    }
                    (true, false) => {
                        at = near;
                        continue;
                    }
                    (false, true) => {
                        at = far;
                        continue;
                    }
                    (false, false) => {}
                }
            }
            at = loop {
                if waiting == 0 {
                    return;
                }
                waiting -= 1;
                if stack[waiting].1 <= farthest {
                    break stack[waiting].0;
                }
            };
        }
    }

    /// The rays that enter the box before their closest hit. The sides by which rays of one octant enter are known.
    #[inline(always)]
    fn enter(&self, node: &Node, eye: [f32; 3]) -> Entry<S> {
        let mut enter = self.t_near;
        let mut leave = Floats::splat(self.simd, f32::INFINITY);
        for axis in 0..3 {
            let (lo, hi) = (node.lo[axis] - eye[axis], node.hi[axis] - eye[axis]);
            let (a, b) = if self.one_octant {
                let (near, far) = if self.against[axis] { (hi, lo) } else { (lo, hi) };
                (self.inverse[axis] * near, self.inverse[axis] * far)
            } else {
                let (a, b) = (self.inverse[axis] * lo, self.inverse[axis] * hi);
                (a.min(b), a.max(b))
            };
            enter = enter.max(a);
            leave = leave.min(b);
        }
        // Rounding is monotonic, so that one product is enough for the least.
        Entry { rays: enter.simd_le((leave * SLACK).min(self.t)), t: enter }
    }

    /// Records the triangle for the rays that hit it before their closest hit so far.
    ///
    /// With corners relative to the eye, the sign of `d · (a × b)` tells on which side of an edge a ray passes; the other
    /// triangle at the edge has the same number, negated. Both sides of the triangle count.
    #[inline(always)]
    fn meet(&mut self, corners: &[Vec3A; 3], place: u32, eye: [f32; 3]) {
        let simd = self.simd;
        let eye = Vec3A::from(eye);
        let (a, b, c) = (corners[0] - eye, corners[1] - eye, corners[2] - eye);
        let (u, v, w) = (self.dot(b.cross(c)), self.dot(c.cross(a)), self.dot(a.cross(b)));
        let zero = Floats::splat(simd, 0.0);
        let inside = (u.simd_ge(zero) & v.simd_ge(zero) & w.simd_ge(zero))
            | (u.simd_le(zero) & v.simd_le(zero) & w.simd_le(zero));
        if inside.all_false() {
            return;
        }
        let normal = (b - a).cross(c - a);
        let t = Floats::splat(simd, normal.dot(a)) / self.dot(normal);
        let closer = inside & t.simd_ge(self.t_near) & t.simd_lt(self.t);
        self.t = closer.select(t, self.t);
        self.triangle = closer.select(u32x16::splat(simd, place), self.triangle);
    }

    /// Products of a vector and the rays' directions.
    #[inline(always)]
    fn dot(&self, v: Vec3A) -> Floats<S> {
        self.direction[0] * v.x + self.direction[1] * v.y + self.direction[2] * v.z
    }
}

/// Columns and rows of the pixels of a packet.
const COLUMNS: [f32; LANES] = [0., 1., 2., 3., 0., 1., 2., 3., 0., 1., 2., 3., 0., 1., 2., 3.];
const ROWS: [f32; LANES] = [0., 0., 0., 0., 1., 1., 1., 1., 2., 2., 2., 2., 3., 3., 3., 3.];
