//! Random numbers and trigonometry that give the same bits on every platform.
//!
//! The standard library's `sin` and `cos` come from the platform's C library and differ in their last bits between
//! systems. A mesh that is identified by its seed has to be the same mesh everywhere, so only operations that IEEE 754
//! defines exactly (`+ - * /`, square root, rounding) are used here.

use std::f64::consts::{FRAC_2_PI, PI};

use glam::DVec3;

/// SplitMix64: a 64-bit counter passed through a mixing function. Small and fast; all seeds are equally good.
#[derive(Clone, Debug)]
pub(crate) struct Rng(u64);

impl Rng {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed)
    }

    fn next_u64(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in 0..1 with 53 random bits.
    pub(crate) fn unit(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
    }

    /// Uniform in `low..high`.
    pub(crate) fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Uniform in `0..n`; `n` must not be zero. The bias of the fixed-point product is below 2^-32 for the small `n` used here.
    pub(crate) fn below(&mut self, n: usize) -> usize {
        (((self.next_u64() >> 32) * n as u64) >> 32) as usize
    }

    /// True with probability `p`.
    pub(crate) fn chance(&mut self, p: f64) -> bool {
        self.unit() < p
    }

    /// A uniformly distributed unit vector (rejection from the cube, which needs no trigonometry).
    pub(crate) fn direction(&mut self) -> DVec3 {
        loop {
            let v = DVec3::new(self.range(-1.0, 1.0), self.range(-1.0, 1.0), self.range(-1.0, 1.0));
            let length2 = v.length_squared();
            if length2 > 1e-4 && length2 <= 1.0 {
                return v / length2.sqrt();
            }
        }
    }

    /// Fisher-Yates.
    pub(crate) fn shuffle<T>(&mut self, items: &mut [T]) {
        for i in (1..items.len()).rev() {
            items.swap(i, self.below(i + 1));
        }
    }
}

/// Sine and cosine, within 1e-15 for arguments of moderate size (|x| < 1e5).
pub(crate) fn sin_cos(x: f64) -> (f64, f64) {
    // Subtract the nearest multiple of a quarter turn in two parts, so that the remainder keeps its low bits.
    const QUARTER_HIGH: f64 = 1.570_796_326_734_125_6;
    const QUARTER_LOW: f64 = 6.077_100_506_506_192e-11;
    let quarters = (x * FRAC_2_PI).round();
    let r = (x - quarters * QUARTER_HIGH) - quarters * QUARTER_LOW;
    let r2 = r * r;
    // Taylor series around zero; |r| <= pi/4, so the first term left out is below 1e-16.
    let mut s = 1.0;
    for k in [15.0, 13.0, 11.0, 9.0, 7.0, 5.0, 3.0] {
        s = 1.0 - s * r2 / (k * (k - 1.0));
    }
    let s = s * r;
    let mut c = 1.0;
    for k in [16.0, 14.0, 12.0, 10.0, 8.0, 6.0, 4.0, 2.0] {
        c = 1.0 - c * r2 / (k * (k - 1.0));
    }
    match (quarters as i64).rem_euclid(4) {
        0 => (s, c),
        1 => (c, -s),
        2 => (-s, -c),
        _ => (-c, s),
    }
}

/// Sine and cosine of `i / n` of a full turn.
pub(crate) fn turn(i: usize, n: usize) -> (f64, f64) {
    sin_cos(2.0 * PI * i as f64 / n as f64)
}

/// Two unit vectors that form a right-handed frame with the unit vector `n`: `(a, b)` with `a x b = n`.
pub(crate) fn tangents(n: DVec3) -> (DVec3, DVec3) {
    let helper = if n.x.abs() < 0.6 { DVec3::X } else { DVec3::Y };
    let a = helper.cross(n).normalize();
    (a, n.cross(a))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trigonometry_agrees_with_the_standard_library() {
        for i in -4000..4000 {
            let x = i as f64 * 0.0173;
            let (s, c) = sin_cos(x);
            assert!((s - x.sin()).abs() < 2e-15 && (c - x.cos()).abs() < 2e-15, "{x}: {s} {c}");
        }
    }

    #[test]
    fn random_numbers_are_the_published_sequence_and_stay_in_range() {
        // First outputs of SplitMix64 for seed 0, as its authors' generator prints them.
        let mut rng = Rng::new(0);
        assert_eq!(rng.next_u64(), 0xe220_a839_7b1d_cdaf);
        assert_eq!(rng.next_u64(), 0x6e78_9e6a_a1b9_65f4);
        let mut seen = [0usize; 7];
        for _ in 0..7000 {
            assert!((0.0..1.0).contains(&rng.unit()));
            seen[rng.below(7)] += 1;
            assert!((rng.direction().length() - 1.0).abs() < 1e-12);
        }
        assert!(seen.iter().all(|&n| (800..1200).contains(&n)), "{seen:?}");
    }
}
