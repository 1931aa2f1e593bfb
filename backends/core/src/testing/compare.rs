//! Compares the hits of two casters.

use serde::{Deserialize, Serialize};

use crate::Hit;

/// What may differ between the hits of an engine and those of the reference caster.
#[derive(Clone, Copy, PartialEq, Debug, Default, Serialize, Deserialize)]
pub struct Allowed {
    /// Share of the rays that may end at another voxel, 0 to 1.
    pub share: f64,
    /// Difference of `t` where the voxel is the same, as a fraction of the far plane's distance.
    pub t: f64,
}

/// How the hits of one frame differ from those of another.
#[derive(Clone, Copy, PartialEq, Debug, Default, Serialize)]
pub struct Comparison {
    /// Rays compared.
    pub rays: u64,
    /// Rays that hit with one caster and miss with the other.
    pub hit_or_miss: u64,
    /// Rays that hit different voxels.
    pub other_voxel: u64,
    /// Largest difference in `t` among rays that hit the same voxel.
    pub max_t_difference: f32,
    /// The same difference in representable numbers; 0 if all agree in every bit.
    pub max_t_ulps: u32,
    /// Frames that did not have the same number of rays.
    pub other_size: u64,
}

impl Comparison {
    /// Compares ray by ray. Of frames of different sizes, the rays that both have are compared.
    pub fn of(ours: &[Hit], theirs: &[Hit]) -> Self {
        let mut all = Self { other_size: u64::from(ours.len() != theirs.len()), ..Self::default() };
        for (a, b) in ours.iter().zip(theirs) {
            all.rays += 1;
            if a.is_miss() != b.is_miss() {
                all.hit_or_miss += 1;
            } else if !a.is_miss() && !a.same_voxel(b) {
                all.other_voxel += 1;
            } else {
                let difference = (a.raw_t - b.raw_t).abs();
                // A maximum would ignore NaN.
                all.max_t_difference =
                    all.max_t_difference.max(if difference.is_nan() { f32::MAX } else { difference });
                all.max_t_ulps = all.max_t_ulps.max(ordinal(a.raw_t).abs_diff(ordinal(b.raw_t)));
            }
        }
        all
    }

    /// The sum of two comparisons.
    pub fn and(self, other: Self) -> Self {
        Self {
            rays: self.rays + other.rays,
            hit_or_miss: self.hit_or_miss + other.hit_or_miss,
            other_voxel: self.other_voxel + other.other_voxel,
            max_t_difference: self.max_t_difference.max(other.max_t_difference),
            max_t_ulps: self.max_t_ulps.max(other.max_t_ulps),
            other_size: self.other_size + other.other_size,
        }
    }

    /// Rays that do not end in the same voxel.
    pub fn mismatches(&self) -> u64 {
        self.hit_or_miss + self.other_voxel
    }

    /// Whether at most `share` of the rays end elsewhere, and `t` of the others differs by at most `ulps` representable
    /// numbers.
    pub fn within(&self, share: f64, ulps: u32) -> bool {
        self.other_size == 0 && self.mismatches() as f64 <= share * self.rays as f64 && self.max_t_ulps <= ulps
    }
}

/// Position of a number among all of its type; both zeros have the same.
fn ordinal(x: f32) -> i32 {
    let bits = x.to_bits();
    let magnitude = (bits & 0x7fff_ffff) as i32;
    if bits >> 31 == 0 { magnitude } else { -magnitude }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_each_kind_of_difference() {
        let hit = Hit::new(0.5, 7, 3, 20, 9);
        let same = Comparison::of(&[hit, Hit::miss(1)], &[Hit { iterations: 1, ..hit }, Hit::miss(4)]);
        assert!(same.within(0.0, 0) && same.rays == 2);

        let next = Hit { raw_t: f32::from_bits(0.5f32.to_bits() + 3), ..hit };
        let near = Comparison::of(&[hit], &[next]);
        assert!(near.within(0.0, 3) && !near.within(0.0, 2));

        let other = Comparison::of(&[hit, hit, Hit::miss(0)], &[Hit { slot: 8, ..hit }, Hit::miss(0), hit]);
        assert_eq!((other.other_voxel, other.hit_or_miss, other.mismatches()), (1, 2, 3));
        assert!(!other.within(0.5, 0) && other.within(1.0, 0));

        assert!(!Comparison::of(&[hit], &[]).within(1.0, u32::MAX));
        assert!(!Comparison::of(&[Hit { raw_t: f32::NAN, ..hit }], &[hit]).within(0.0, 100));
        assert_eq!(Comparison::of(&[Hit { raw_t: -0.0, ..hit }], &[Hit { raw_t: 0.0, ..hit }]).max_t_ulps, 0);
        assert_eq!(near.and(other).rays, 4);
    }
}
