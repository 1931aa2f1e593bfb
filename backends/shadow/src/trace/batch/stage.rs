//! Rays made ready for lanes: their numbers beside each other.

use super::super::walk::Walk;
use crate::trace::FRACTION_BITS;
use crate::volume::Volume;

/// Rays that are traced at once.
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
    Level = 18,
    Major = 19,
    /// Voxel of the origin on the major axis.
    Start = 20,
}
pub(super) const FIELDS: usize = 21;

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
    pub(super) fn next(&self, field: usize) -> [i32; LANES] {
        let mut numbers = [0; LANES];
        numbers.copy_from_slice(&self.fields[field][self.first..self.first + LANES]);
        numbers
    }

    pub(super) fn take(&mut self, count: usize) {
        self.first += count;
    }

    /// Moves the rays that wait to the front, and says how many more there is room for.
    pub(super) fn make_room(&mut self) -> usize {
        for field in &mut self.fields {
            field.copy_within(self.first..self.end, 0);
        }
        (self.first, self.end) = (0, self.end - self.first);
        STAGED - self.end
    }

    /// Adds a ray at its origin.
    pub(super) fn push(&mut self, number: u32, walk: &Walk<Volume>) {
        let at = self.end;
        self.end += 1;
        let level = walk.coarsest;
        let denominator = walk.on_major(walk.direction);
        let mut put = |field: Field, axis: usize, value: i32| self.fields[field as usize + axis][at] = value;
        for axis in 0..3 {
            put(Field::Corner, axis, (walk.start[axis] >> level) << level << FRACTION_BITS);
            put(Field::Origin, axis, walk.origin[axis]);
            put(Field::Direction, axis, walk.direction[axis]);
            put(Field::Flip, axis, walk.flip[axis]);
            // Below 2^38, and the quotient of whole numbers that a double has exactly is never rounded up to the next one: the divisor is below 2^16.
            let reach = f64::from(walk.reach) * f64::from(walk.direction[axis]) / f64::from(denominator);
            let leaves = (walk.last[axis] << FRACTION_BITS).wrapping_sub(walk.origin[axis]);
            put(Field::Limit, axis, (reach as i32).min(leaves));
        }
        put(Field::Number, 0, number as i32);
        put(Field::Numerator, 0, 0);
        put(Field::Denominator, 0, denominator);
        put(Field::Level, 0, level as i32);
        put(Field::Major, 0, walk.major as i32);
        put(Field::Start, 0, walk.on_major(walk.start));
    }
}
