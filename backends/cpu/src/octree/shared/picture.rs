//! Pictures and the coarse pass, tile by tile and packet by packet.

use esvo_core::reference::MAX_COMPONENT;
use esvo_core::{Hit, Ray, View};
use fearless_simd::prelude::*;

use super::super::counters::{What, count};
use super::super::scene::Scene;
use super::super::single;
use super::super::task::{BLOCK, LANES, first_lanes};
use super::bounds::{Area, BLOCKS, EDGE};
use super::packet::{ALL, Floats, Lanes, Packet, Results, axes, bits, finest_scale};
use super::tile::{self, Tiles};
use super::walk::{Stack, cast_alone};

/// See [`Task::Band`].
pub(super) struct Band<'a> {
    pub(super) view: &'a View,
    pub(super) coarse: &'a [f32],
    pub(super) first_row: u32,
    pub(super) hits: &'a mut [Hit],
}

/// Directions through points of a picture: [`View::direction`] lane by lane.
#[inline(always)]
fn directions<S: Simd>(simd: S, view: &View, x: [f32; LANES], y: [f32; LANES]) -> [Floats<S>; 3] {
    let (x, y) = (Floats::simd_from(simd, x), Floats::simd_from(simd, y));
    axes(
        #[inline(always)]
        |axis| y * view.dy[axis] + (x * view.dx[axis] + view.base[axis]),
    )
}

/// The rays with these directions that are [cast](Ray::is_cast).
#[inline(always)]
fn cast_lanes<S: Simd>(simd: S, directions: [Floats<S>; 3]) -> Lanes {
    // False for infinity and NaN.
    let limit = Floats::splat(simd, MAX_COMPONENT);
    let cast = axes(
        #[inline(always)]
        |axis| directions[axis].abs().simd_le(limit),
    );
    bits(cast[0] & cast[1] & cast[2])
}

/// The packet of a view's rays.
#[inline(always)]
fn packet<S: Simd>(simd: S, scene: &Scene, view: &View, directions: [Floats<S>; 3], finest_scale: u32) -> Packet<S> {
    let mut packet = Packet::new(simd, view.origin.map(|x| Floats::splat(simd, x)), directions, finest_scale);
    (packet.t_min, packet.t_max) = (view.t_near, 1.0);
    packet.size_per_t = view.pixel_size * view.max_voxel_pixels;
    packet.contours = if scene.clips(view.contours()) { 0xff } else { 0 };
    packet
}

/// Casts the pixels of some rows: with `TILES`, the blocks of a tile together.
#[inline(always)]
pub(super) fn band<S: Simd, const TILES: bool>(simd: S, scene: &Scene, band: Band) {
    let Band { view, coarse, first_row, hits } = band;
    let width = view.width as usize;
    let height = hits.len() / width;
    let mut stack = Stack::new(simd);
    let mut tiles = Tiles::new(simd);
    let finest_scale = finest_scale(view.origin);
    for top in (0..height).step_by(BLOCK * EDGE) {
        for left in (0..width).step_by(BLOCK * EDGE) {
            let corner = |k: usize| (left + k % EDGE * BLOCK, top + k / EDGE * BLOCK);
            let mut finite = true;
            for k in 0..BLOCKS {
                let (left, top) = corner(k);
                let at = |lane: usize| (left + lane % BLOCK, top + lane / BLOCK);
                let mut lanes = ALL;
                if left + BLOCK > width || top + BLOCK > height {
                    lanes = (0..LANES)
                        .filter(|lane| at(*lane).0 < width && at(*lane).1 < height)
                        .fold(0, |all, lane| all | 1 << lane);
                }
                let x = std::array::from_fn(|lane| at(lane).0 as f32 + 0.5);
                let y = std::array::from_fn(|lane| (first_row as usize + at(lane).1) as f32 + 0.5);
                let directions = directions(simd, view, x, y);
                let cast = cast_lanes(simd, directions);
                finite &= cast == ALL;
                let mut packet = packet(simd, scene, view, directions, finest_scale.unwrap_or(0));
                if view.beam() && lanes != 0 {
                    packet.t_min = view.beam_start(coarse, left as u32, first_row + top as u32);
                }
                tiles.blocks[k] = tile::Block::new(packet, Results::new(simd, lanes & cast));
            }
            if finest_scale.is_none() {
                tiles.blocks.iter_mut().for_each(|block| block.results.give_up(block.results.alive));
            } else if TILES && finite {
                let area = Area::new(simd, view, left, first_row as usize + top);
                tile::cast(simd, scene, &area, view.origin, &mut tiles, &mut stack);
            } else {
                for block in &mut tiles.blocks {
                    let lanes = block.results.alive;
                    cast_alone(
                        simd,
                        scene,
                        &block.packet,
                        block.packet.span(simd),
                        lanes,
                        &mut stack,
                        &mut block.results,
                    );
                }
            }
            for (k, block) in tiles.blocks.iter_mut().enumerate() {
                let (left, top) = corner(k);
                if left >= width || top >= height {
                    continue;
                }
                let found = &mut block.results.found;
                let mut again = block.results.again;
                count(What::CastAgain, again.count_ones());
                while again != 0 {
                    let lane = again.trailing_zeros() as usize;
                    again &= again - 1;
                    let mut ray = view.ray((left + lane % BLOCK) as u32, first_row + (top + lane / BLOCK) as u32);
                    ray.t_min = block.packet.t_min;
                    found.set(lane, single::cast_one(simd, scene, &ray, view.contours()));
                }
                for row in 0..BLOCK.min(height - top) {
                    let columns = BLOCK.min(width - left);
                    let first = (top + row) * width + left;
                    for (column, hit) in hits[first..first + columns].iter_mut().enumerate() {
                        *hit = found.get(row * BLOCK + column);
                    }
                }
            }
        }
    }
}

/// Casts a row of the coarse pass, packet by packet.
#[inline(always)]
pub(super) fn coarse_row<S: Simd>(simd: S, scene: &Scene, view: &View, row: u32, starts: &mut [f32]) {
    let mut stack = Stack::new(simd);
    let finest_scale = finest_scale(view.origin);
    for (k, starts) in starts.chunks_mut(LANES).enumerate() {
        let rays: [Ray; LANES] = std::array::from_fn(|lane| view.coarse_ray((k * LANES + lane) as u32, row));
        let directions = axes(
            #[inline(always)]
            |axis| {
                let lanes: [f32; LANES] = std::array::from_fn(|lane| rays[lane].direction[axis]);
                Floats::simd_from(simd, lanes)
            },
        );
        let lanes = Lanes::from(first_lanes(starts.len())) & cast_lanes(simd, directions);
        let mut results = Results::new(simd, lanes);
        if let Some(finest_scale) = finest_scale {
            let mut packet = Packet::new(simd, view.origin.map(|x| Floats::splat(simd, x)), directions, finest_scale);
            (packet.t_min, packet.t_max, packet.size_per_t) = (rays[0].t_min, rays[0].t_max, rays[0].size_per_t);
            cast_alone(simd, scene, &packet, packet.span(simd), lanes, &mut stack, &mut results);
        } else {
            results.give_up(lanes);
        }
        count(What::CastAgain, results.again.count_ones());
        for (lane, start) in starts.iter_mut().enumerate() {
            let again = results.again >> lane & 1 != 0;
            let hit = if again { single::cast_one(simd, scene, &rays[lane], false) } else { results.found.get(lane) };
            *start = if hit.is_miss() { 1.0 } else { view.coarse_start(hit.raw_t, hit.size()) };
        }
    }
}
