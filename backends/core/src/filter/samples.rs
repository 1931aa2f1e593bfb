//! The look-up table of the filter: points of a disc, their weights, and the radii that a byte can say.

use std::sync::LazyLock;

/// Samples of the table.
pub const SAMPLES: usize = 96;

/// Radius of the disc in pixels, and the largest that the filter uses.
pub const DISC: i32 = 24;

/// Offsets in pixels, ascending by distance. Their density falls as the square root of the distance: sample `i` is the free pixel
/// that is next to the distance `24 ((i + 1/2) / 96)^(2/3)` and the angle of `i` golden angles.
#[rustfmt::skip]
const OFFSETS: [(i8, i8); SAMPLES] = [
    (0, 0), (-1, 1), (0, -2), (2, 2), (-3, -1), (3, -2), (-1, 4), (-2, -4), (4, 2), (2, -5), (-5, 2), (-5, -3),
    (6, -1), (2, 6), (-1, -7), (-4, 6), (6, 5), (0, 8), (-8, 0), (6, -6), (-5, -7), (-7, 5), (9, 1), (2, -9), (5, 8),
    (-9, -3), (9, -4), (-4, -10), (-4, 10), (10, 5), (2, 11), (-9, -7), (-11, 3), (6, -10), (12, -1), (-8, 9), (9, 9),
    (0, -13), (-13, -1), (-2, 13), (11, -8), (13, 4), (-7, -12), (5, -13), (-13, -6), (-13, 6), (14, -4), (6, 14),
    (-8, 13), (-3, -15), (10, -12), (13, 9), (1, 16), (-16, 2), (-12, -12), (17, 1), (-13, 11), (2, -17), (10, 14),
    (-17, -4), (-7, -16), (15, -9), (-6, 17), (-17, 6), (9, -16), (17, 7), (5, 18), (-16, -10), (-2, -19), (14, 13),
    (-12, 15), (19, -3), (15, -13), (-12, -16), (-20, 0), (-2, 20), (20, 4), (6, -20), (-18, 11), (10, 19), (-20, -8),
    (20, -8), (-6, -21), (-9, 20), (19, 11), (13, -18), (3, 22), (-22, 5), (-17, -15), (1, -23), (23, -1), (-23, -3),
    (-17, 16), (15, 18), (-5, 23), (20, -13),
];

/// A point of the disc.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Sample {
    /// Offset to the right, in pixels.
    pub x: i32,
    /// Offset downwards, in pixels.
    pub y: i32,
    /// Distance from the centre in pixels.
    pub distance: f32,
    /// Pixels of the disc that are nearer to this sample than to others.
    pub weight: f32,
}

/// The samples, ascending by distance; the first is the centre.
pub fn samples() -> &'static [Sample; SAMPLES] {
    static TABLE: LazyLock<[Sample; SAMPLES]> = LazyLock::new(|| {
        let mut samples = OFFSETS.map(|(x, y)| {
            let (x, y) = (i32::from(x), i32::from(y));
            Sample { x, y, distance: ((x * x + y * y) as f32).sqrt(), weight: 0.0 }
        });
        for y in -DISC..=DISC {
            for x in (-DISC..=DISC).filter(|x| x * x + y * y <= DISC * DISC) {
                let nearest = samples.iter_mut().min_by_key(|s| (s.x - x).pow(2) + (s.y - y).pow(2));
                if let Some(nearest) = nearest {
                    nearest.weight += 1.0;
                }
            }
        }
        samples
    });
    &TABLE
}

/// Radius of a code: `2^(code / 32)` pixels.
pub fn radii() -> &'static [f32; 256] {
    static TABLE: LazyLock<[f32; 256]> =
        LazyLock::new(|| std::array::from_fn(|code| (code as f64 / 32.0).exp2() as f32));
    &TABLE
}

/// The code of a radius in pixels: its logarithm in 3.5 fixed point. 0 for one pixel or less, and for NaN.
pub fn code_of(radius: f32) -> u8 {
    (f64::from(radius.max(1.0)).log2() * 32.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_as_the_paper_describes_it() {
        let samples = samples();
        assert_eq!((samples[0].x, samples[0].y), (0, 0));
        assert!(samples.is_sorted_by(|a, b| a.distance <= b.distance));
        assert!(samples.iter().all(|s| s.distance <= DISC as f32));
        let area: f32 = samples.iter().map(|s| s.weight).sum();
        assert_eq!(area, 1793.0, "the pixels of the disc");
        // The number of samples within a radius grows as its power of 3/2.
        for radius in [8.0f32, 12.0, 16.0, 20.0] {
            let within = samples.iter().filter(|s| s.distance <= radius).count() as f32;
            let expected = SAMPLES as f32 * (radius / DISC as f32).powf(1.5);
            assert!((within - expected).abs() <= 0.08 * SAMPLES as f32, "{radius}: {within}, {expected}");
        }
        let moment = |f: fn(&Sample) -> i32| samples.iter().map(|s| s.weight * f(s) as f32).sum::<f32>() / area;
        assert!(moment(|s| s.x).abs() < 0.1 && moment(|s| s.y).abs() < 0.1, "pictures do not move");
    }

    #[test]
    fn codes_are_fixed_point_logarithms() {
        for (radius, code) in [(f32::NAN, 0), (0.0, 0), (1.0, 0), (2.0, 32), (128.0, 224), (f32::INFINITY, 255)] {
            assert_eq!(code_of(radius), code, "{radius}");
        }
        for code in 0..=255u8 {
            assert_eq!(code_of(radii()[usize::from(code)]), code);
        }
    }
}
