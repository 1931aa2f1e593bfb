//! Comparing the hits of two casters for the same rays.

use super::hits::HitRecord;

/// How two lists of hits differ.
#[derive(Clone, Copy, Default, PartialEq, Debug)]
pub struct Comparison {
    /// Rays that were compared.
    pub rays: u64,
    /// Rays that hit in both.
    pub both: u64,
    /// Rays that hit only in the first.
    pub only_first: u64,
    /// Rays that hit only in the second.
    pub only_second: u64,
    /// Rays that hit in both and name different voxels. Hits of size 0 name none.
    pub other_voxel: u64,
    /// Rays that hit in both with values of `t` that differ by more than the tolerance; also those with a `t` that is NaN.
    pub other_t: u64,
    /// Largest difference of `t`.
    pub largest_t: f64,
}

impl Comparison {
    /// Whether both hit the same, within the tolerance of `t`. Voxels may differ: rays meet edges.
    pub fn agrees(&self) -> bool {
        self.only_first + self.only_second + self.other_t == 0
    }
}

/// Adds the next hits of both lists, of equal length, to a comparison. `tolerance` is the difference of `t` that is allowed.
pub fn compare(first: &[HitRecord], second: &[HitRecord], tolerance: f64, sum: &mut Comparison) {
    for (a, b) in first.iter().zip(second) {
        sum.rays += 1;
        match (a.hit, b.hit) {
            (true, false) => sum.only_first += 1,
            (false, true) => sum.only_second += 1,
            (false, false) => {}
            (true, true) => {
                sum.both += 1;
                let difference = (f64::from(a.t) - f64::from(b.t)).abs();
                sum.largest_t = sum.largest_t.max(difference);
                sum.other_t += u64::from(difference.is_nan() || difference > tolerance);
                let named = a.size != 0.0 && b.size != 0.0;
                let same = (a.slot, a.child, a.scale) == (b.slot, b.child, b.scale);
                sum.other_voxel += u64::from(named && !same);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hit(t: f32, child: u8) -> HitRecord {
        HitRecord { hit: true, t, size: 0.5, slot: 2, child, scale: 22, position: [0.0; 3], iterations: 1 }
    }

    #[test]
    fn differences_are_counted() {
        let miss = HitRecord { hit: false, size: 0.0, ..hit(2.0, 0) };
        let first = [hit(0.5, 1), hit(0.5, 1), hit(0.5, 1), miss, miss, hit(0.5, 1)];
        let second =
            [hit(0.5, 1), hit(0.5, 2), hit(0.75, 1), miss, hit(0.1, 1), HitRecord { size: 0.0, ..hit(0.5, 7) }];
        let mut sum = Comparison::default();
        compare(&first, &second, 0.1, &mut sum);
        let expected =
            Comparison { rays: 6, both: 4, only_first: 0, only_second: 1, other_voxel: 1, other_t: 1, largest_t: 0.25 };
        assert_eq!(sum, expected);
        let mut sum = Comparison::default();
        compare(&[hit(f32::NAN, 1)], &[hit(0.5, 1)], 0.1, &mut sum);
        assert!(!sum.agrees());
    }
}
