//! Every voxel that a ray touches, edges and corners included: the supercover.
//!
//! # How it works
//! Axes on which the ray goes down are mirrored, so that it goes up on all of them; cell `c` becomes `-1 - c`. The walk keeps a cell of some level and the
//! time at which the ray entered it. A full cell is left for the one of its eight cells that the ray is in at that time, an empty one for
//! the next cell along the ray, and where that leaves the cell of the level above, the walk goes up a level.
//!
//! Times are fractions: plane `p` of an axis is crossed at `(p - origin) / direction`. Two times are compared by multiplying crosswise. The products do
//! not fit 32 bits, but their difference does, and so it is right in numbers that wrap around: it is the distance of a point and a plane that
//! bound the same cell, at most 2^(8 + level) units, times a component of the direction, below 2^16. With levels up to 6 that is below 2^30.
//!
//! Cells are closed boxes. Where the ray crosses planes of several axes at once, it meets an edge or a corner of cells, and touches voxels that
//! it does not enter: these are looked at where the walk meets such a point, be it on the way to the next cell or on the way down into one. Along an axis that
//! the ray does not advance on, and where it lies in a plane between voxels, it touches those of both sides all the way.

use super::{Fidelity, Hit, MAX_LEVEL, Ray, Traced};
use crate::trace::FRACTION_BITS;
use crate::volume::Occupancy;

/// The first full voxel that the ray touches, from its origin to its end, both included. Of several that it touches at once, one.
///
/// Where the fidelity is coarse, the first cell of the level in question that it enters and that has a voxel; voxels that only an
/// edge or a corner of is touched count there too.
pub fn first_hit<O: Occupancy + ?Sized>(volume: &O, ray: &Ray, fidelity: Fidelity) -> Traced {
    let walk = Walk::new(volume, ray, fidelity);
    let mut steps = 0;
    let hit = walk.run(&mut steps).map(|(cell, level, time)| {
        let cell = walk.mirrored(cell);
        Hit { cell, level, distance: ray.distance_of_crossing(time.numerator, time.denominator) }
    });
    Traced { hit, steps }
}

/// Whether the ray touches a full voxel, and how many cells the volume was asked for.
pub fn is_blocked<O: Occupancy + ?Sized>(volume: &O, ray: &Ray, fidelity: Fidelity) -> (bool, u32) {
    let mut steps = 0;
    let hit = Walk::new(volume, ray, fidelity).run(&mut steps);
    (hit.is_some(), steps)
}

/// A time on the ray: `numerator / denominator`, in which the numerator is a distance along an axis, and the denominator the
/// direction's component on it.
#[derive(Clone, Copy)]
struct Time {
    numerator: i32,
    denominator: i32,
}

/// A ray that goes up on all axes.
pub(super) struct Walk<'a, O: ?Sized> {
    volume: &'a O,
    origin: [i32; 3],
    pub(super) direction: [i32; 3],
    /// -1 on axes that are mirrored, 0 on others: `c ^ flip` is the cell in the volume.
    flip: [i32; 3],
    major: usize,
    /// Distance to the ray's end along the major axis.
    reach: i32,
    /// The voxel of the origin; on axes on which the origin lies between two, the upper one.
    start: [i32; 3],
    /// Axes on which the ray lies between two voxels all the way.
    pub(super) between: [bool; 3],
    /// The greatest voxel on each axis.
    last: [i32; 3],
    coarsest: u32,
    fidelity: Fidelity,
}

const UNIT: i32 = 1 << FRACTION_BITS;

impl<'a, O: Occupancy + ?Sized> Walk<'a, O> {
    pub(super) fn new(volume: &'a O, ray: &Ray, fidelity: Fidelity) -> Self {
        let flip = ray.direction.map(|d| d >> 31);
        let up = |value: i32, axis: usize| (value ^ flip[axis]) - flip[axis];
        let origin: [i32; 3] = std::array::from_fn(|axis| up(ray.origin[axis], axis));
        let direction = ray.direction.map(i32::abs);
        let major = ray.major as usize;
        let last = match volume.bounds() {
            Some([low, high]) => std::array::from_fn(|axis| if flip[axis] == 0 { high[axis] - 1 } else { !low[axis] }),
            None => [i32::MAX; 3],
        };
        Self {
            volume,
            flip,
            major,
            reach: up(ray.end, major) - origin[major],
            start: origin.map(|x| x >> FRACTION_BITS),
            between: std::array::from_fn(|axis| direction[axis] == 0 && origin[axis] & (UNIT - 1) == 0),
            origin,
            direction,
            last,
            coarsest: fidelity.coarsest.min(volume.coarsest()).min(MAX_LEVEL),
            fidelity,
        }
    }

    fn mirrored(&self, cell: [i32; 3]) -> [i32; 3] {
        std::array::from_fn(|axis| cell[axis] ^ self.flip[axis])
    }

    /// Whether a plane lies ahead of the ray at a time (positive), on it (0), or behind.
    fn ahead(&self, plane: i32, axis: usize, time: Time) -> i32 {
        let distance = plane.wrapping_sub(self.origin[axis]);
        distance.wrapping_mul(time.denominator).wrapping_sub(time.numerator.wrapping_mul(self.direction[axis]))
    }

    /// The cell, level and time of the first full cell.
    fn run(&self, steps: &mut u32) -> Option<([i32; 3], u32, Time)> {
        let mut level = self.coarsest;
        let mut cell = self.start.map(|c| c >> level);
        let mut time = Time { numerator: 0, denominator: self.on_major(self.direction) };
        if let Some(voxel) = self.touched_at_origin(steps) {
            return Some((voxel, 0, time));
        }
        loop {
            if let Some(full) = self.full(level, cell, steps) {
                if level <= self.finest(cell, level) {
                    return Some((full, level, time));
                }
                level -= 1;
                let mut on_plane = false;
                for axis in 0..3 {
                    if self.direction[axis] == 0 {
                        cell[axis] = self.start[axis] >> level;
                        continue;
                    }
                    let middle = ((2 * cell[axis] + 1) << level) << FRACTION_BITS;
                    let ahead = self.ahead(middle, axis, time);
                    cell[axis] = 2 * cell[axis] + i32::from(ahead <= 0);
                    on_plane |= ahead == 0;
                }
                if on_plane && let Some(voxel) = self.touched(cell, level, time, steps) {
                    return Some((voxel, 0, time));
                }
                continue;
            }
            // Distances to the next planes, and which axes cross theirs first. An axis that the ray does not advance on is never first: its distance is
            // positive, and so are the differences with an axis that the ray advances on.
            let ahead: [i32; 3] = std::array::from_fn(|axis| {
                (((cell[axis] + 1) << level) << FRACTION_BITS).wrapping_sub(self.origin[axis])
            });
            let later = |a: usize, b: usize| {
                ahead[a].wrapping_mul(self.direction[b]).wrapping_sub(ahead[b].wrapping_mul(self.direction[a]))
            };
            let (xy, xz, yz) = (later(0, 1), later(0, 2), later(1, 2));
            let first = [xy <= 0 && xz <= 0, xy >= 0 && yz <= 0, xz >= 0 && yz >= 0];
            let together = first[0] as u32 + first[1] as u32 + first[2] as u32 > 1;
            let on_major = self.on_major(ahead);
            // A chain of conditions is faster here than a choice without jumps.
            time = if together && self.on_major(first) {
                Time { numerator: on_major, denominator: self.on_major(self.direction) }
            } else if first[0] {
                Time { numerator: ahead[0], denominator: self.direction[0] }
            } else if first[1] {
                Time { numerator: ahead[1], denominator: self.direction[1] }
            } else {
                Time { numerator: ahead[2], denominator: self.direction[2] }
            };
            if on_major > self.reach && self.reach_is_behind(time) {
                return None;
            }
            let (mut leaves_parent, mut leaves_volume) = (false, false);
            for axis in 0..3 {
                cell[axis] += i32::from(first[axis]);
                leaves_parent |= first[axis] & (cell[axis] & 1 == 0);
                leaves_volume |= first[axis] & (cell[axis] > self.last[axis] >> level);
            }
            if together && let Some(voxel) = self.touched(cell, level, time, steps) {
                return Some((voxel, 0, time));
            }
            if leaves_volume {
                return None;
            }
            if leaves_parent && level < self.coarsest {
                level += 1;
                cell = cell.map(|c| c >> 1);
            }
        }
    }

    /// A full voxel that the origin touches, if it lies in a plane between voxels. If it lies within one, the walk begins with that.
    pub(super) fn touched_at_origin(&self, steps: &mut u32) -> Option<[i32; 3]> {
        if (0..3).all(|axis| self.origin[axis] & (UNIT - 1) != 0) {
            return None;
        }
        let time = Time { numerator: 0, denominator: self.on_major(self.direction) };
        self.touched(self.start.map(|c| c >> self.coarsest), self.coarsest, time, steps)
    }

    /// Whether the origin lies outside of the volume.
    pub(super) fn starts_outside(&self) -> bool {
        self.volume.bounds().is_some_and(|[low, high]| {
            let start = self.mirrored(self.start);
            (0..3).any(|axis| start[axis] < low[axis] || start[axis] >= high[axis])
        })
    }

    /// What of three values is that of the major axis. An index would keep them out of registers.
    pub(super) fn on_major<T>(&self, [x, y, z]: [T; 3]) -> T {
        match self.major {
            0 => x,
            1 => y,
            _ => z,
        }
    }

    /// Whether the ray has ended before a time.
    fn reach_is_behind(&self, time: Time) -> bool {
        let major = self.on_major(self.direction);
        self.reach.wrapping_mul(time.denominator).wrapping_sub(time.numerator.wrapping_mul(major)) < 0
    }

    /// The cell, or the one beside it where the ray lies between two, if it is full.
    fn full(&self, level: u32, cell: [i32; 3], steps: &mut u32) -> Option<[i32; 3]> {
        if self.between == [false; 3] {
            *steps += 1;
            return self.volume.occupied(level, self.mirrored(cell)).then_some(cell);
        }
        let beside = std::array::from_fn(|axis| if self.between[axis] { (self.start[axis] - 1) >> level } else { 0 });
        self.any(level, cell, beside, self.between, steps)
    }

    /// A full voxel that touches the ray at a time. `cell`: the cell of a level that the ray is in at that time.
    fn touched(&self, cell: [i32; 3], level: u32, time: Time, steps: &mut u32) -> Option<[i32; 3]> {
        let mut voxel = [0; 3];
        let mut between = self.between;
        for axis in 0..3 {
            if self.direction[axis] == 0 {
                voxel[axis] = self.start[axis];
                continue;
            }
            voxel[axis] = cell[axis] << level;
            for half in (0..level).rev().map(|below| 1 << below) {
                if self.ahead((voxel[axis] + half) << FRACTION_BITS, axis, time) <= 0 {
                    voxel[axis] += half;
                }
            }
            between[axis] = self.ahead(voxel[axis] << FRACTION_BITS, axis, time) == 0;
        }
        self.any(0, voxel, voxel.map(|c| c - 1), between, steps)
    }

    /// A full cell of those that are `cell` on each axis, or `beside` on those axes where both are possible.
    fn any(&self, level: u32, cell: [i32; 3], beside: [i32; 3], both: [bool; 3], steps: &mut u32) -> Option<[i32; 3]> {
        for choice in 0..8u32 {
            let other: [bool; 3] = std::array::from_fn(|axis| choice >> axis & 1 == 1);
            if (0..3).any(|axis| other[axis] && !both[axis]) {
                continue;
            }
            let at = std::array::from_fn(|axis| if other[axis] { beside[axis] } else { cell[axis] });
            *steps += 1;
            if self.volume.occupied(level, self.mirrored(at)) {
                return Some(at);
            }
        }
        None
    }

    /// The level that is fine enough where a cell lies.
    fn finest(&self, cell: [i32; 3], level: u32) -> u32 {
        if self.fidelity.fine_until == 0 {
            return 0;
        }
        let voxels = (self.on_major(cell) << level) - self.on_major(self.start);
        self.fidelity.finest(voxels.max(0) as u32, self.coarsest)
    }
}
