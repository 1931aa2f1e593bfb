//! Bounds of the rays of a tile, with a lane for each of its blocks.

use esvo_core::View;
use esvo_core::reference::EPSILON;
use fearless_simd::prelude::*;

use super::super::task::{BLOCK, LANES};
use super::fault;
use super::packet::{Contour, Floats, Packet, axes};
use crate::vectors::greatest;

/// Packets of a tile: its blocks of pixels, row by row.
pub(super) const BLOCKS: usize = 16;

/// Blocks along an edge of a tile.
pub(super) const EDGE: usize = 4;

/// The doubt of a ray for each unit of its greatest coefficient and of its `t_min` or `t_max`: see the proof.
pub(super) const DOUBT: f32 = 2.75e-7;

/// Bounds of the rays of each block.
pub(super) struct Bounds<S: Simd> {
    mirror: usize,
    /// For each axis the coefficients that are furthest from zero, and those that are nearest to it.
    coef: [[Floats<S>; 2]; 3],
    /// Of the rays, in mirrored space.
    origin: [f32; 3],
    /// More than the rounding of a `t`.
    slack: [Floats<S>; 3],
    /// More than what separates numbers that are looked at as equal.
    pub(super) doubt: Floats<S>,
    /// Edge of voxels that tiles do not enter: planes that are closer to each other cannot be told apart.
    pub(super) least_size: f32,
}

impl<S: Simd> Bounds<S> {
    #[inline(always)]
    pub(super) fn new(simd: S, area: &Area<S>, origin: [f32; 3], mirror: usize, packet: &Packet<S>) -> Self {
        let one = Floats::splat(simd, 1.0);
        let epsilon = Floats::splat(simd, EPSILON);
        let coef = axes(
            #[inline(always)]
            |axis: usize| {
                let [low, high] = area.directions[axis];
                let (near, far) = if mirror >> axis & 1 != 0 { (low, high) } else { (-high, -low) };
                [-(one / near.max(epsilon)), -(one / far.max(epsilon))]
            },
        );
        let span = packet.t_min.abs().max(packet.t_max.abs());
        let most = coef[0][0].min(coef[1][0]).min(coef[2][0]);
        let nearest = greatest(coef[0][1].max(coef[1][1]).max(coef[2][1]));
        Self {
            mirror,
            coef,
            origin: axes(
                #[inline(always)]
                |axis: usize| if mirror >> axis & 1 != 0 { 3.0 - origin[axis] } else { origin[axis] },
            ),
            slack: axes(
                #[inline(always)]
                |axis: usize| coef[axis][0] * (-(origin[axis].abs() + 3.0) / (1 << 21) as f32),
            ),
            doubt: (Floats::splat(simd, span) - most) * (5.0 * DOUBT),
            least_size: (1.0 - span / nearest) / (1 << 19) as f32,
        }
    }

    /// The earliest and the latest `t` at which rays cross a plane.
    #[inline(always)]
    pub(super) fn plane(&self, axis: usize, x: f32) -> [Floats<S>; 2] {
        let distance = x - self.origin[axis];
        let behind = usize::from(distance < 0.0);
        let other = if fault::made(fault::NARROW) { 1 - behind } else { behind };
        [
            self.coef[axis][other] * distance - self.slack[axis],
            self.coef[axis][1 - behind] * distance + self.slack[axis],
        ]
    }

    /// The earliest and the latest `t` at which rays enter and leave the slab of a contour of a voxel.
    #[inline(always)]
    pub(super) fn slab(
        &self,
        simd: S,
        area: &Area<S>,
        contour: Contour,
        pos: [f32; 3],
        size: f32,
    ) -> [[Floats<S>; 2]; 2] {
        let normal = contour.normal();
        // The rays' speed along the normal is linear in the pixels' coordinates.
        let dot = |v: [f32; 3]| normal[0] * v[0] + normal[1] * v[1] + normal[2] * v[2];
        let (right, down) = (dot(area.dx), dot(area.dy));
        let (across, along) = (right * (BLOCK - 1) as f32, down * (BLOCK - 1) as f32);
        let magnitude = normal.map(f32::abs);
        let rounding = (magnitude[0] * area.reach[0] + magnitude[1] * area.reach[1] + magnitude[2] * area.reach[2])
            / (1 << 21) as f32;
        let low = area.x * right + area.y * down + (dot(area.base) + across.min(0.0) + along.min(0.0) - rounding);
        let high = low + (across.abs() + along.abs() + 2.0 * rounding);
        let tiny = Floats::splat(simd, EPSILON);
        let crossed = low.simd_gt(tiny) | high.simd_lt(-tiny);
        let one = Floats::splat(simd, 1.0);
        let (inverse, other) = (one / low, one / high);
        // The distance from the origin to the plane is the same for all rays.
        let (mut distance, mut error) = (contour.offset(size), contour.offset(size).abs() + contour.reach(size));
        for axis in 0..3 {
            let to = normal[axis] * (pos[axis] + size * 0.5 - self.origin[axis]);
            distance += if self.mirror >> axis & 1 != 0 { -to } else { to };
            error += magnitude[axis] * (self.origin[axis].abs() + 3.0);
        }
        error /= (1 << 19) as f32;
        let (near, far) = (distance - contour.reach(size), distance + contour.reach(size));
        let slack = inverse.abs().max(other.abs()) * error;
        let (a, b, c, d) = (inverse * near, other * near, inverse * far, other * far);
        let (near, far) = ([a.min(b), a.max(b)], [c.min(d), c.max(d)]);
        let (most, least) = (Floats::splat(simd, f32::MAX), Floats::splat(simd, f32::MIN));
        [
            [crossed.select(near[0].min(far[0]) - slack, least), crossed.select(near[1].min(far[1]) + slack, most)],
            [crossed.select(near[0].max(far[0]) - slack, least), crossed.select(near[1].max(far[1]) + slack, most)],
        ]
    }
}

/// The part of a picture that a tile takes.
pub(super) struct Area<S: Simd> {
    /// The least and the greatest component of directions through each block.
    directions: [[Floats<S>; 2]; 3],
    /// The first pixel of each block.
    x: Floats<S>,
    y: Floats<S>,
    /// See [`View`].
    base: [f32; 3],
    dx: [f32; 3],
    dy: [f32; 3],
    /// What is added up to a direction is at most this.
    reach: [f32; 3],
}

impl<S: Simd> Area<S> {
    #[inline(always)]
    pub(super) fn new(simd: S, view: &View, left: usize, top: usize) -> Self {
        let spread = |offset: usize, block: fn(usize) -> usize| {
            let lanes: [f32; LANES] = std::array::from_fn(|k| (offset + BLOCK * block(k)) as f32 + 0.5);
            Floats::simd_from(simd, lanes)
        };
        let last = (BLOCK - 1) as f32;
        let (x, y) = (spread(left, |k| k % EDGE), spread(top, |k| k / EDGE));
        let directions = axes(
            #[inline(always)]
            |axis| {
                let along = [x * view.dx[axis] + view.base[axis], (x + last) * view.dx[axis] + view.base[axis]];
                let down = [y * view.dy[axis], (y + last) * view.dy[axis]];
                // Sums are monotonic in both terms, so that these are the extremes of the sums as they are rounded.
                [down[0].min(down[1]) + along[0].min(along[1]), down[0].max(down[1]) + along[0].max(along[1])]
            },
        );
        let edge = (EDGE * BLOCK) as f32;
        let reach = |axis: usize| {
            view.base[axis].abs()
                + (left as f32 + edge) * view.dx[axis].abs()
                + (top as f32 + edge) * view.dy[axis].abs()
        };
        Self { directions, x, y, base: view.base, dx: view.dx, dy: view.dy, reach: axes(reach) }
    }
}
