//! Rays made ready for lanes: their numbers beside each other.

use bytemuck::Zeroable;
use fearless_simd::prelude::*;
use fearless_simd::{i32x8, mask32x8, u32x8};

use super::gather::Gather;
use crate::trace::{FRACTION_BITS, Ray};
use crate::volume::Volume;

/// Rays of a vector.
pub(super) const LANES: usize = 8;
/// Rays that are made ready at once.
const STAGED: usize = 128;

/// A number of a ray; those of three axes have three each.
#[derive(Clone, Copy)]
#[repr(usize)]
pub(super) enum Field {
    /// Which of the list's rays it is.
    Number = 0,
    /// Least corner of the cell, in 1/256 of a voxel, in mirrored space, as all below.
    Corner = 1,
    Origin = 4,
    Direction = 7,
    /// -1 on mirrored axes.
    Flip = 10,
    /// Greatest distance to a plane that is crossed before the ray ends or leaves the volume, in 1/256 of a voxel.
    Limit = 13,
    Numerator = 16,
    Denominator = 17,
    /// The cell's level, plus 8.
    Shift = 18,
    Major = 19,
    /// Voxel of the origin on the major axis.
    Start = 20,
    /// Half of the cell's edge, in 1/256 of a voxel.
    Half = 21,
}
pub(super) const FIELDS: usize = 22;

/// Rays that wait for a lane.
pub(super) struct Staged {
    fields: [[i32; STAGED + LANES]; FIELDS],
    /// The first that waits.
    first: usize,
    /// One past the last.
    end: usize,
}

impl Staged {
    pub(super) fn new() -> Box<Self> {
        Box::new(Self { fields: [[0; STAGED + LANES]; FIELDS], first: 0, end: 0 })
    }

    pub(super) fn left(&self) -> usize {
        self.end - self.first
    }

    /// A number of the rays that wait, the first ones.
    #[inline(always)]
    pub(super) fn next<S: Simd>(&self, simd: S, field: usize) -> i32x8<S> {
        i32x8::from_slice(simd, &self.fields[field][self.first..self.first + LANES])
    }

    pub(super) fn take(&mut self, count: usize) {
        self.first += count;
    }

    /// Moves the rays that wait to the front, and says for how many vectors there is room behind them.
    pub(super) fn make_room(&mut self) -> usize {
        for field in &mut self.fields {
            field.copy_within(self.first..self.end, 0);
        }
        (self.first, self.end) = (0, self.end - self.first);
        (STAGED - self.end) / LANES
    }

    /// Adds rays, eight or less, of a list in which the first of them has a number. `except` says which of those are left out whose origins lie in a plane between
    /// voxels, or outside of the volume: it gets a bit for each of these.
    #[inline(always)]
    pub(super) fn add<S: Gather>(
        &mut self,
        simd: S,
        number: usize,
        rays: &[Ray],
        volume: &Volume,
        coarsest: u32,
        except: impl FnOnce(u32) -> u32,
    ) {
        let mut eight = [Ray::zeroed(); LANES];
        let all = (1u32 << rays.len()) - 1;
        let rays: &[Ray] = if rays.len() == LANES {
            rays
        } else {
            eight[..rays.len()].copy_from_slice(rays);
            &eight
        };
        let [x, y, z, major, dx, dy, dz, end] = columns(simd, rays);
        let (origins, directions) = ([x, y, z], [dx, dy, dz]);
        let zero = i32x8::splat(simd, 0);
        let (is_x, is_y) = (major.simd_eq(zero), major.simd_eq(i32x8::splat(simd, 1)));
        let [mut flip, mut origin, mut direction, mut corner] = [[zero; 3]; 4];
        let level = coarsest + FRACTION_BITS;
        let mut special = zero.simd_gt(zero);
        let voxels = volume.voxels();
        for axis in 0..3 {
            flip[axis] = directions[axis] >> 31;
            origin[axis] = (origins[axis] ^ flip[axis]) - flip[axis];
            direction[axis] = (directions[axis] ^ flip[axis]) - flip[axis];
            corner[axis] = (origin[axis] >> level) << level;
            let outside =
                (origins[axis] >> FRACTION_BITS).bitcast::<u32x8<S>>().simd_ge(u32x8::splat(simd, voxels[axis]));
            special |= (origin[axis] & 255).simd_eq(zero) | outside;
        }
        let up = is_x.select(flip[0], is_y.select(flip[1], flip[2]));
        let start = is_x.select(origin[0], is_y.select(origin[1], origin[2]));
        let reach = (end ^ up) - up - start;
        let denominator = is_x.select(direction[0], is_y.select(direction[1], direction[2]));
        let mut limit = [zero; 3];
        for axis in 0..3 {
            // The last plane that is reached. Products are below 2^38, and a quotient that is not whole is at least 2^-16 below the next whole number, which a
            // double never rounds away.
            let (r, d, n): ([i32; LANES], [i32; LANES], [i32; LANES]) =
                (reach.into(), direction[axis].into(), denominator.into());
            let mut last = [0; LANES];
            for lane in 0..LANES {
                let quotient = f64::from(r[lane]) * f64::from(d[lane]) / f64::from(n[lane]);
                // The low bits of a number from 2^52 on are those of the whole number.
                last[lane] = (quotient.floor() + (1u64 << 52) as f64).to_bits() as i32;
            }
            let leaves = i32x8::splat(simd, voxels[axis] as i32 - 1);
            let leaves = ((leaves | flip[axis]) << FRACTION_BITS) - origin[axis];
            limit[axis] = i32x8::simd_from(simd, last).min(leaves);
        }

        let special = special.to_bitmask() as u32 & all;
        let kept = if special == 0 { all } else { all & !except(special) };
        let mask = mask32x8::from_bitmask(simd, u64::from(kept));
        let numbers = i32x8::simd_from(simd, [0, 1, 2, 3, 4, 5, 6, 7]) + number as i32;
        let at = self.end;
        self.end += kept.count_ones() as usize;
        let [[cx, cy, cz], [ox, oy, oz], [dx, dy, dz], [fx, fy, fz], [lx, ly, lz]] =
            [corner, origin, direction, flip, limit];
        let shift = i32x8::splat(simd, level as i32);
        let half = i32x8::splat(simd, 1 << (level - 1));
        let fields: [i32x8<S>; FIELDS] = [
            numbers,
            cx,
            cy,
            cz,
            ox,
            oy,
            oz,
            dx,
            dy,
            dz,
            fx,
            fy,
            fz,
            lx,
            ly,
            lz,
            zero,
            denominator,
            shift,
            major,
            start >> FRACTION_BITS,
            half,
        ];
        for (to, from) in self.fields.iter_mut().zip(fields) {
            from.compress(mask).store_slice(&mut to[at..at + LANES]);
        }
    }
}

/// The numbers of eight rays, each with those of all rays in a vector.
#[inline(always)]
fn columns<S: Simd>(simd: S, rays: &[Ray]) -> [i32x8<S>; 8] {
    let numbers: &[i32] = bytemuck::cast_slice(rays);
    let mut rows = [i32x8::splat(simd, 0); 8];
    for (row, numbers) in rows.iter_mut().zip(numbers.chunks_exact(LANES)) {
        *row = i32x8::from_slice(simd, numbers);
    }
    // Each round turns the six bits of the place of a number, row and column, by one.
    for _ in 0..3 {
        let before = rows;
        for i in 0..4 {
            (rows[2 * i], rows[2 * i + 1]) = before[i].interleave(before[i + 4]);
        }
    }
    rows
}
