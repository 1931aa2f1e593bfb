//! Rays in whole numbers.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use crate::error::ShadowError;

/// Places on a ray are multiples of 2^-8 of a voxel.
pub const FRACTION_BITS: u32 = 8;
const ONE: f64 = (1 << FRACTION_BITS) as f64;
/// Largest component of a direction.
const LONGEST: i32 = (1 << 16) - 1;
/// Origins lie within so many voxels of the volume's origin.
const FARTHEST: f64 = (1 << 21) as f64;
/// Most voxels that a ray is long, along the axis on which it is longest.
const MOST: i32 = 8191;

/// A ray through voxels, in whole numbers: two programs that trace it get the same result, and no ray slips between two voxels.
///
/// Rays of floating-point numbers are rounded once, when the ray is made: the origin to 1/256 of a voxel, the direction to 1/65535 of its largest component.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Ray {
    /// In 1/256 of a voxel.
    pub(crate) origin: [i32; 3],
    /// Axis of the largest component of the direction.
    pub(crate) major: u32,
    /// From -65535 to 65535.
    pub(crate) direction: [i32; 3],
    /// Where the ray ends, along axis `major`, in 1/256 of a voxel.
    pub(crate) end: i32,
}

impl Ray {
    /// A ray from `origin` that is `length` long, both in voxels. The direction may have any length but 0. A ray ends after 8191 voxels along its major axis.
    ///
    /// # Errors
    /// A number that is infinite or NaN; a direction of zero; a negative length; an origin more than 2^21 voxels away.
    pub fn new(origin: DVec3, direction: DVec3, length: f64) -> Result<Self, ShadowError> {
        if length.is_nan() || length < 0.0 {
            return Err(ShadowError::Ray(format!("a ray of length {length} was given; a length is 0 or more")));
        }
        let origin = place(origin)?;
        let major = direction.abs().max_position();
        let largest = direction[major].abs();
        if !direction.is_finite() || largest == 0.0 {
            return Err(ShadowError::Ray(format!(
                "a ray of direction {direction} was given; it must be finite, and not zero"
            )));
        }
        let direction = direction / largest;
        let along = length * ONE / direction.length();
        let most = f64::from(MOST << FRACTION_BITS);
        let reach = nearest(along.min(most)) * direction[major].signum() as i32;
        let direction = (direction * f64::from(LONGEST)).to_array().map(nearest);
        Ok(Self { origin, major: major as u32, direction, end: origin[major] + reach })
    }

    /// The ray from one place to another, in voxels. It is cut after 8191 voxels along its major axis.
    ///
    /// # Errors
    /// As [`new`](Self::new). Places that are one are an error, since no direction leads from one to the other.
    pub fn between(from: DVec3, to: DVec3) -> Result<Self, ShadowError> {
        let (origin, target) = (place(from)?, place(to)?);
        let direction: [i32; 3] = std::array::from_fn(|axis| target[axis] - origin[axis]);
        Self::exact(origin, direction).ok_or_else(|| {
            ShadowError::Ray(format!("a ray from {from} to the same place was given; it has no direction"))
        })
    }

    /// The ray of these whole numbers, from `origin` to `origin` + `direction`, both in 1/256 of a voxel. `None` if the direction is zero, or the
    /// origin more than 2^21 voxels away. If a component of the direction is above 65535, all are divided by a power of two and rounded towards zero. The ray is cut
    /// after 8191 voxels along its major axis.
    pub fn exact(origin: [i32; 3], direction: [i32; 3]) -> Option<Self> {
        let major = (0..3).rev().max_by_key(|&axis| direction[axis].unsigned_abs())?;
        let is_far = |x: i32| f64::from(x).abs() > FARTHEST * ONE;
        if direction[major] == 0 || origin.into_iter().any(is_far) {
            return None;
        }
        let most = MOST << FRACTION_BITS;
        let end = origin[major] + direction[major].clamp(-most, most);
        let shift = (i32::BITS - direction[major].unsigned_abs().leading_zeros()).saturating_sub(16);
        let direction = direction.map(|d| (d.unsigned_abs() >> shift) as i32 * d.signum());
        Some(Self { origin, major: major as u32, direction, end })
    }

    /// Where it begins, in voxels.
    pub fn origin(&self) -> DVec3 {
        DVec3::from(self.origin.map(f64::from)) / ONE
    }

    /// Its direction; the length has no meaning.
    pub fn direction(&self) -> DVec3 {
        DVec3::from(self.direction.map(f64::from))
    }

    /// How long it is, in voxels.
    pub fn length(&self) -> f64 {
        let major = self.major as usize;
        let reach = f64::from(self.end - self.origin[major]) / ONE;
        reach.abs() * self.direction().length() / f64::from(self.direction[major]).abs()
    }

    /// Voxels from the origin to where the ray has gone `numerator / denominator` of its direction, in 1/256 of a voxel.
    pub(crate) fn distance_of_crossing(&self, numerator: i32, denominator: i32) -> f32 {
        let length = self.direction().length() / ONE;
        (f64::from(numerator) / f64::from(denominator) * length) as f32
    }

    /// Voxels from the origin to a sample that is so far along the major axis, in 2^-16 of a voxel.
    pub(crate) fn distance_of_sample(&self, along: i64) -> f32 {
        let largest = f64::from(self.direction[self.major as usize].abs());
        let length = self.direction().length() / (largest * f64::from(1 << super::steps::SAMPLE_BITS));
        (along.abs() as f64 * length) as f32
    }
}

fn place(voxels: DVec3) -> Result<[i32; 3], ShadowError> {
    if !voxels.is_finite() || voxels.abs().max_element() > FARTHEST {
        return Err(ShadowError::Ray(format!("a ray through {voxels} was given; places are within {FARTHEST} voxels")));
    }
    Ok((voxels * ONE).to_array().map(nearest))
}

/// The nearest whole number, that farther from zero of two: [`f64::round`] for numbers below 2^31, without a call on processors that have no instruction for it.
fn nearest(x: f64) -> i32 {
    // The number before 0.5. With 0.5 itself the sum would be 1 for the number before 0.5.
    (x + 0.499_999_999_999_999_94_f64.copysign(x)) as i32
}

#[cfg(test)]
mod tests {
    use super::nearest;

    #[test]
    fn nearest_is_round() {
        let halves = (-20_000..20_000).map(|n| f64::from(n) * 0.5);
        let large = (0..30).flat_map(|bit| [0.5, 1.0, 1.5].map(|half| f64::from(1 << bit) + half));
        for x in halves.chain(large) {
            for x in [x, x.next_up(), x.next_down(), -x, -x.next_up(), x * 0.9] {
                assert_eq!(nearest(x), x.round() as i32, "{x}");
            }
        }
        assert_eq!(nearest(0.499_999_999_999_999_94), 0);
    }
}
