//! Compares the hits of two casters.

use serde::{Deserialize, Serialize};

use crate::{DeviceKind, Hit};

/// What may differ between the hits of an engine and those of the reference caster.
#[derive(Clone, Copy, PartialEq, Debug, Default, Serialize, Deserialize)]
pub struct Allowed {
    /// Share of the rays that may end at another voxel, 0 to 1.
    pub share: f64,
    /// Difference of `t` where the voxel is the same: as a fraction of the far plane's distance in pictures, of `t` where it is
    /// above 1.
    pub t: f64,
}

impl Allowed {
    /// No ray may end elsewhere, and `t` must agree in every bit: for engines that compute in the order of the reference,
    /// with the same roundings.
    pub const EXACT: Self = Self { share: 0.0, t: 0.0 };
    /// One ray in 100,000 may end at another voxel, and `t` may differ by 1/8192 (2^11 units in the last place of `t` = 1)
    /// where the voxel is the same. A GPU may fuse or reorder operations within the rules of its shading language, so that
    /// a ray through an edge can fall to the other side.
    pub const GPU: Self = Self { share: 1e-5, t: 1.0 / 8192.0 };

    /// What engines on such a device are held to. Processors, and Vulkan drivers that run on them, round as the reference does.
    pub fn on(kind: DeviceKind) -> Self {
        if kind == DeviceKind::Gpu { Self::GPU } else { Self::EXACT }
    }

    /// Whether rays were compared, all of them, and differ by no more than this.
    pub fn admits(&self, found: &Comparison) -> bool {
        found.rays > 0
            && found.other_size == 0
            && found.mismatches() as f64 <= self.share * found.rays as f64
            && f64::from(found.max_t_difference) <= self.t
    }
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
    /// Largest difference in `t` among rays that hit the same voxel, divided by `t` where that is above 1. 0 if and only if all
    /// agree.
    pub max_t_difference: f32,
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
                let difference =
                    if a.raw_t == b.raw_t { 0.0 } else { (a.raw_t - b.raw_t).abs() / a.raw_t.abs().max(1.0) };
                // A maximum would ignore NaN.
                all.max_t_difference =
                    all.max_t_difference.max(if difference.is_nan() { f32::MAX } else { difference });
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
            other_size: self.other_size + other.other_size,
        }
    }

    /// Rays that do not end in the same voxel.
    pub fn mismatches(&self) -> u64 {
        self.hit_or_miss + self.other_voxel
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_each_kind_of_difference() {
        let hit = Hit::new(0.5, 7, 3, 20, 9);
        let ends = |share| Allowed { share, t: 0.0 };
        let same = Comparison::of(&[hit, Hit::miss(1)], &[Hit { iterations: 1, ..hit }, Hit::miss(4)]);
        assert!(Allowed::EXACT.admits(&same) && same.rays == 2);

        let next = Hit { raw_t: 0.5f32.next_up(), ..hit };
        let near = Comparison::of(&[hit], &[next]);
        assert!(Allowed::GPU.admits(&near) && !Allowed::EXACT.admits(&near));
        let far = |t: f32| Comparison::of(&[Hit { raw_t: t, ..hit }], &[Hit { raw_t: t * 1.0001, ..hit }]);
        assert!(
            Allowed::GPU.admits(&far(1.0)) && Allowed::GPU.admits(&far(1000.0)) && !Allowed::EXACT.admits(&far(1000.0))
        );
        assert!(!Allowed::GPU.admits(&Comparison::of(&[hit], &[Hit { raw_t: 0.5002, ..hit }])));

        let other = Comparison::of(&[hit, hit, Hit::miss(0)], &[Hit { slot: 8, ..hit }, Hit::miss(0), hit]);
        assert_eq!((other.other_voxel, other.hit_or_miss, other.mismatches()), (1, 2, 3));
        assert!(!ends(0.5).admits(&other) && ends(1.0).admits(&other));

        let anything = Allowed { share: 1.0, t: f64::INFINITY };
        assert!(!anything.admits(&Comparison::of(&[hit], &[])) && !anything.admits(&Comparison::default()));
        assert!(!Allowed::GPU.admits(&Comparison::of(&[Hit { raw_t: f32::NAN, ..hit }], &[hit])));
        assert_eq!(Comparison::of(&[Hit { raw_t: -0.0, ..hit }], &[Hit { raw_t: 0.0, ..hit }]).max_t_difference, 0.0);
        assert_eq!(near.and(other).rays, 4);
    }

    #[test]
    fn processors_are_held_to_every_bit() {
        assert_eq!(Allowed::on(DeviceKind::Cpu), Allowed::EXACT);
        assert_eq!(Allowed::on(DeviceKind::SoftwareGpu), Allowed::EXACT);
        assert_eq!(Allowed::on(DeviceKind::Gpu), Allowed::GPU);
    }
}
