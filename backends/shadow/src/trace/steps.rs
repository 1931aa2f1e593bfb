//! Samples in fixed steps: cheaper than every voxel, and not watertight.

use bytemuck::{Pod, Zeroable};

use super::{Fidelity, Hit, MAX_LEVEL, Ray, Traced};
use crate::error::ShadowError;
use crate::trace::FRACTION_BITS;
use crate::volume::Occupancy;

/// Samples are multiples of 2^-16 of a voxel.
pub(super) const SAMPLE_BITS: u32 = 16;
/// Longest step, in voxels.
const LONGEST: f64 = 64.0;
/// Samples are counted from a place that is a multiple of this many voxels: a cell of the coarsest level.
const BASE: i32 = 1 << MAX_LEVEL;

/// A ray that is looked at every so many voxels, at its origin first. Light leaks between two samples: a wall that is thinner than the step, or
/// an edge between two voxels, may lie between them.
///
/// With mips a sample in a large empty cell is followed by the first sample behind that cell. The result is the same as without mips.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Steps {
    /// From sample to sample, in 2^-16 of a voxel.
    pub(crate) step: [i32; 3],
    /// Number of samples.
    pub(crate) samples: u32,
}

impl Steps {
    /// Steps of `length` voxels along a ray, up to its end.
    ///
    /// # Errors
    /// A length that is not above 0, or above 64 voxels; one so small that the step is zero.
    pub fn new(ray: &Ray, length: f64) -> Result<Self, ShadowError> {
        let direction = ray.direction();
        let step = direction * (length / direction.length() * f64::from(1 << SAMPLE_BITS));
        let step = step.round();
        if !(length > 0.0 && length <= LONGEST) || step[ray.major as usize] == 0.0 {
            let least = 1.0 / f64::from(1 << SAMPLE_BITS);
            return Err(ShadowError::Ray(format!(
                "a step of {length} voxels was given; steps are longer than {least} voxels and at most {LONGEST}"
            )));
        }
        let samples = (ray.length() / length).floor().min(f64::from(u32::MAX - 1)) as u32 + 1;
        Ok(Self { step: step.as_ivec3().to_array(), samples })
    }

    /// The first sample that lies in a full voxel. Where the fidelity is coarse, the steps are twice as long for each level, and samples are compared
    /// with cells of that level.
    pub fn first_hit<O: Occupancy + ?Sized>(&self, volume: &O, ray: &Ray, fidelity: Fidelity) -> Traced {
        let base = ray.origin.map(|x| (x >> FRACTION_BITS) & !(BASE - 1));
        let from: [i32; 3] = std::array::from_fn(|axis| {
            (ray.origin[axis] - (base[axis] << FRACTION_BITS)) << (SAMPLE_BITS - FRACTION_BITS)
        });
        let coarsest = fidelity.coarsest.min(volume.coarsest()).min(MAX_LEVEL);
        let major = ray.major as usize;
        // Samples until cells of the next level are fine enough. Steps grow as cells do, so it is one number.
        let reach = i64::from(fidelity.fine_until) << SAMPLE_BITS;
        let each = u32::try_from(reach / i64::from(self.step[major].abs()) + 1).unwrap_or(u32::MAX);
        let (mut at, mut step, mut left, mut finest) = (from, self.step, self.samples, 0);
        let mut steps = 0;
        loop {
            let last = fidelity.fine_until == 0 || finest == coarsest;
            let samples = if last { left } else { left.min(each) };
            let part = Part { volume, base, at, step, samples, finest, coarsest };
            if let Some((cell, level, sample)) = part.first_hit(&mut steps) {
                let along = i64::from(at[major] - from[major]) + i64::from(step[major]) * i64::from(sample);
                return Traced { hit: Some(Hit { cell, level, distance: ray.distance_of_sample(along) }), steps };
            }
            if samples == left {
                return Traced { hit: None, steps };
            }
            left = (left - samples).div_ceil(2);
            for axis in 0..3 {
                at[axis] = at[axis].wrapping_add(step[axis].wrapping_mul(samples as i32));
                step[axis] = step[axis].wrapping_mul(2);
            }
            finest += 1;
        }
    }
}

/// Samples of one step length.
struct Part<'a, O: ?Sized> {
    volume: &'a O,
    base: [i32; 3],
    at: [i32; 3],
    step: [i32; 3],
    samples: u32,
    finest: u32,
    coarsest: u32,
}

impl<O: Occupancy + ?Sized> Part<'_, O> {
    fn first_hit(&self, steps: &mut u32) -> Option<([i32; 3], u32, u32)> {
        let mut sample = 0;
        let mut level = self.coarsest;
        let bounds = self.volume.bounds();
        while sample < self.samples {
            let at: [i32; 3] = std::array::from_fn(|axis| {
                self.at[axis].wrapping_add(self.step[axis].wrapping_mul(sample as i32)) >> SAMPLE_BITS
            });
            let cell: [i32; 3] = std::array::from_fn(|axis| (self.base[axis] + at[axis]) >> level);
            *steps += 1;
            if self.volume.occupied(level, cell) {
                if level <= self.finest {
                    return Some((cell, level, sample));
                }
                level -= 1;
                continue;
            }
            if let Some([low, high]) = bounds {
                let leaves = |axis: usize| {
                    let voxel = self.base[axis] + at[axis];
                    (self.step[axis] >= 0 && voxel >= high[axis]) || (self.step[axis] <= 0 && voxel < low[axis])
                };
                if (0..3).any(leaves) {
                    return None;
                }
            }
            let next = self.behind(at.map(|c| c >> level), level);
            if level < self.coarsest {
                let parent = |sample: u32, axis: usize| {
                    let place = self.at[axis].wrapping_add(self.step[axis].wrapping_mul(sample as i32));
                    place >> (SAMPLE_BITS + level + 1)
                };
                let leaves = (0..3).any(|axis| parent(sample, axis) != parent(next.min(self.samples), axis));
                level += u32::from(leaves);
            }
            sample = next;
        }
        None
    }

    /// The first sample behind a cell, which is counted from the base.
    fn behind(&self, cell: [i32; 3], level: u32) -> u32 {
        let mut first = u32::MAX;
        for axis in 0..3 {
            let (at, step) = (self.at[axis], self.step[axis]);
            let samples = if step > 0 {
                let end = ((cell[axis] + 1) << level) << SAMPLE_BITS;
                (end - at + step - 1) / step
            } else if step < 0 {
                let end = (cell[axis] << level) << SAMPLE_BITS;
                (at - end) / -step + 1
            } else {
                continue;
            };
            first = first.min(samples as u32);
        }
        first
    }
}
