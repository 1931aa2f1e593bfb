//! Sixteen rays, and what they have hit.

use esvo_core::reference::MAX_SCALE;
use fearless_simd::prelude::*;
use fearless_simd::{f32x16, mask32x16, u32x16};

use super::super::task::{Found, LANES};
use crate::vectors::away_from_zero;

/// One float for each ray of a packet.
pub(super) type Floats<S> = f32x16<S>;

/// A bit for each ray of a packet.
pub(super) type Lanes = u32;

/// A bit for each ray.
pub(super) const ALL: Lanes = (1 << LANES) - 1;

/// Finest scale of voxels at which a packet enters a node. Rays of coarser octrees take fewer steps than the reference's
/// [`MAX_ITERATIONS`](esvo_core::reference::MAX_ITERATIONS): on each level above, they meet at most three times as many
/// cubes as lie along an edge of the root, less than 2^20 in all.
const FINEST_SCALE: u32 = MAX_SCALE - 17;

/// The finest scale of voxels whose planes a ray from `origin` meets one after the other: the assumption of the proof. `None`
/// if there is no such scale, or if `origin` is not finite.
///
/// For `h` the edge of the voxels, `c` the absolute value of a coefficient and `r` the distance of the origin from 1.5 on an
/// axis, two planes that are `h` apart are met `h c` apart. Each of the two `t` is off by less than 2^-23 `c` from rounding
/// the product, which is at most `2 c`, and by less than 2^-24 `c (r + 1)` from rounding the difference. So `t` differ
/// if 2^23 `h > r + 3`, and 2^23 `h` is 2^scale.
pub(super) fn finest_scale(origin: [f32; 3]) -> Option<u32> {
    origin.iter().map(|x| finest_scale_at((x - 1.5).abs())).try_fold(FINEST_SCALE, |all, scale| Some(all.max(scale?)))
}

/// The same for one axis, on which the origin is this far from 1.5.
#[inline(always)]
pub(super) fn finest_scale_at(distance: f32) -> Option<u32> {
    (FINEST_SCALE..MAX_SCALE - 1).find(|scale| distance + 3.0 < (1u32 << *scale) as f32)
}

/// Sixteen rays, in the space that is mirrored for each of them so that it runs against every axis.
#[derive(Clone, Copy)]
pub(super) struct Packet<S: Simd> {
    /// As given, but for components that are too close to zero.
    pub(super) direction: [Floats<S>; 3],
    /// Ray `i` crosses the plane at `x` at `t = x * coef[i] - bias[i]`.
    pub(super) coef: [Floats<S>; 3],
    pub(super) bias: [Floats<S>; 3],
    /// The rays whose axis is mirrored.
    pub(super) mirrored: [Lanes; 3],
    /// Where rays start and end, if it is the same for all: see [`span`](Self::span).
    pub(super) t_min: f32,
    pub(super) t_max: f32,
    /// The children whose contours are clipped against: all or none.
    pub(super) contours: u8,
    /// At `t`, voxels whose edge is at most `t * size_per_t` end a ray.
    pub(super) size_per_t: f32,
    /// See [`finest_scale`].
    pub(super) finest_scale: u32,
}

impl<S: Simd> Packet<S> {
    #[inline(always)]
    pub(super) fn new(simd: S, origin: [Floats<S>; 3], direction: [Floats<S>; 3], finest_scale: u32) -> Self {
        let zero = Floats::splat(simd, 0.0);
        let mut packet = Self {
            direction,
            coef: [zero; 3],
            bias: [zero; 3],
            mirrored: [0; 3],
            t_min: 0.0,
            t_max: 1.0,
            contours: 0,
            size_per_t: 0.0,
            finest_scale,
        };
        for axis in 0..3 {
            let d = away_from_zero(simd, direction[axis]);
            let coef = Floats::splat(simd, 1.0) / -d.abs();
            let bias = coef * origin[axis];
            let positive = d.simd_gt(zero);
            packet.direction[axis] = d;
            packet.coef[axis] = coef;
            packet.bias[axis] = positive.select(coef * 3.0 - bias, bias);
            packet.mirrored[axis] = bits(positive);
        }
        packet
    }

    /// Where the rays start and end.
    #[inline(always)]
    pub(super) fn span(&self, simd: S) -> [Floats<S>; 2] {
        [Floats::splat(simd, self.t_min), Floats::splat(simd, self.t_max)]
    }

    /// The axes on which a ray is mirrored.
    #[inline(always)]
    pub(super) fn octant_of(&self, lane: u32) -> usize {
        let bit = |axis: usize| ((self.mirrored[axis] >> lane & 1) as usize) << axis;
        bit(0) | bit(1) | bit(2)
    }

    /// The rays that are mirrored on these axes and no others.
    #[inline(always)]
    pub(super) fn octant(&self, mirror: usize) -> Lanes {
        let [x, y, z] = axes(
            #[inline(always)]
            |axis: usize| if mirror >> axis & 1 != 0 { self.mirrored[axis] } else { !self.mirrored[axis] },
        );
        x & y & z
    }

    /// Where the rays cross the plane at `x`.
    #[inline(always)]
    pub(super) fn plane(&self, axis: usize, x: f32) -> Floats<S> {
        self.coef[axis] * x - self.bias[axis]
    }

    /// Where the rays cross the planes through the centre of a voxel of this edge, as the reference computes it.
    #[inline(always)]
    pub(super) fn centre(&self, simd: S, corner: [Floats<S>; 3], size: f32) -> [Floats<S>; 3] {
        let half = Floats::splat(simd, size * 0.5);
        // The product is exact, so that a fused operation gives the same.
        axes(
            #[inline(always)]
            |axis: usize| self.coef[axis].mul_add(half, corner[axis]),
        )
    }

    /// Where the rays enter and leave the slab of a contour.
    #[inline(always)]
    pub(super) fn slab(&self, contour: Contour, size: f32, centre: [Floats<S>; 3]) -> (Floats<S>, Floats<S>) {
        let normal = contour.normal();
        let a = self.direction[0] * normal[0];
        let b = self.direction[1] * normal[1];
        let c = self.direction[2] * normal[2];
        let simd = a.token();
        let inverse = Floats::splat(simd, 1.0) / away_from_zero(simd, a + b + c);
        let middle = (centre[0] * a + centre[1] * b + centre[2] * c + contour.offset(size)) * inverse;
        let reach = (inverse * contour.reach(size)).abs();
        (middle - reach, middle + reach)
    }

    /// Where the rays cross the planes through a point.
    #[inline(always)]
    pub(super) fn planes(&self, at: [f32; 3]) -> [Floats<S>; 3] {
        axes(
            #[inline(always)]
            |axis| self.plane(axis, at[axis]),
        )
    }
}

/// `f` of every axis. Not [`array::map`], which is not compiled for the instructions of the caller.
#[inline(always)]
pub(super) fn axes<T>(f: impl Fn(usize) -> T) -> [T; 3] {
    [f(0), f(1), f(2)]
}

/// The word of a contour.
#[derive(Clone, Copy)]
pub(super) struct Contour(pub(super) u32);

impl Contour {
    /// The normal; all numbers of a contour are multiples of what the word holds.
    #[inline(always)]
    pub(super) fn normal(self) -> [f32; 3] {
        [self.field(14), self.field(20), self.field(26)]
    }

    /// Where the slab's middle is, in a voxel of this edge.
    #[inline(always)]
    pub(super) fn offset(self, size: f32) -> f32 {
        self.field(7) * size * 1.5
    }

    /// Half of the slab's thickness in a voxel of this edge.
    #[inline(always)]
    pub(super) fn reach(self, size: f32) -> f32 {
        self.0 as f32 * size * 0.75
    }

    /// The field whose highest bit is this number of bits below the highest of the word.
    #[inline(always)]
    fn field(self, shift: u32) -> f32 {
        (self.0 << shift) as i32 as f32
    }
}

/// The lanes of a mask as bits.
#[inline(always)]
pub(super) fn bits<S: Simd>(mask: mask32x16<S>) -> Lanes {
    // By halves: one vector has no instruction for it with AVX2.
    let (low, high) = mask.token().split_mask32x16(mask);
    low.to_bitmask() as Lanes | (high.to_bitmask() as Lanes) << 8
}

/// Sets the lanes of a mask.
#[inline(always)]
fn set<S: Simd>(mask: mask32x16<S>, to: &mut [u32; LANES], value: u32) {
    let simd = mask.token();
    let old = u32x16::from_slice(simd, &to[..]);
    mask.select(u32x16::splat(simd, value), old).store_slice(&mut to[..]);
}

/// What the rays of a packet have hit so far.
#[derive(Clone, Copy)]
pub(super) struct Results<S: Simd> {
    simd: S,
    pub(super) found: Found,
    /// Rays that hit nothing yet.
    pub(super) alive: Lanes,
    /// Rays that rounding may lead elsewhere: to be cast one by one.
    pub(super) again: Lanes,
    /// Visits of voxels.
    pub(super) iterations: u32,
    /// Pushes, and the rays that went on.
    pub(super) pushes: u32,
    pub(super) rays_pushed: u32,
}

impl<S: Simd> Results<S> {
    #[inline(always)]
    pub(super) fn new(simd: S, lanes: Lanes) -> Self {
        Self { simd, found: Found::missed(), alive: lanes, again: 0, iterations: 0, pushes: 0, rays_pushed: 0 }
    }

    /// Rays end in a voxel.
    #[inline(always)]
    pub(super) fn hit(&mut self, lanes: Lanes, t: Floats<S>, slot: u32, voxel: u32) {
        let simd = self.simd;
        let mask = mask32x16::from_bitmask(simd, u64::from(lanes));
        let old = Floats::from_slice(simd, &self.found.t[..]);
        mask.select(t, old).store_slice(&mut self.found.t[..]);
        set(mask, &mut self.found.slot, slot);
        set(mask, &mut self.found.voxel, voxel);
        set(mask, &mut self.found.iterations, self.iterations);
        self.alive &= !lanes;
    }

    /// Rays are to be cast one by one.
    #[inline(always)]
    pub(super) fn give_up(&mut self, lanes: Lanes) {
        self.again |= lanes;
        self.alive &= !lanes;
    }
}
