//! Image error: how different two pictures look (ꟻLIP), mean absolute difference and PSNR.
//!
//! ꟻLIP for low dynamic range follows Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild:
//! *ꟻLIP: A Difference Evaluator for Alternating Images* (HPG 2020). It estimates, for each pixel, the difference that an
//! observer notices when flipping between two pictures, from 0 (none) to 1. Symbols are those of the paper.

use std::f32::consts::PI;

use esvo_core::Picture;
use esvo_core::shading::decode_srgb;
use serde::{Deserialize, Serialize};

/// Difference of two pictures.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub struct ImageError {
    /// Mean ꟻLIP at [`PIXELS_PER_DEGREE`].
    pub flip: f64,
    /// Mean absolute difference of the encoded channels, which lie in `0.0..=1.0`.
    pub mean_absolute: f64,
    /// Peak signal to noise ratio of the encoded channels in decibels; `None` for equal pictures.
    pub psnr: Option<f64>,
}

/// Pixels per degree of the observer's field of view: 0.7 m away from a monitor 0.7 m wide with 3840 pixels.
pub const PIXELS_PER_DEGREE: f32 = 0.7 * 3840.0 / 0.7 * PI / 180.0;

/// Compares two pictures; `None` if their sizes differ or they are empty.
pub fn image_error(reference: &Picture, test: &Picture) -> Option<ImageError> {
    let flip = flip_map(reference, test, PIXELS_PER_DEGREE)?;
    let count = reference.rgb8.len() as f64;
    let differences = || reference.rgb8.iter().zip(&test.rgb8).map(|(a, b)| f64::from(a.abs_diff(*b)) / 255.0);
    let square = differences().map(|d| d * d).sum::<f64>() / count;
    Some(ImageError {
        flip: flip.iter().map(|&e| f64::from(e)).sum::<f64>() / flip.len() as f64,
        mean_absolute: differences().sum::<f64>() / count,
        psnr: (square > 0.0).then(|| -10.0 * square.log10()),
    })
}

/// ꟻLIP of every pixel, `0.0..=1.0`, row by row; `None` if the sizes differ or the pictures are empty.
pub fn flip_map(reference: &Picture, test: &Picture, pixels_per_degree: f32) -> Option<Vec<f32>> {
    let bytes = 3 * reference.width as usize * reference.height as usize;
    let sound = |p: &Picture| p.rgb8.len() == bytes && (p.width, p.height) == (reference.width, reference.height);
    if bytes == 0 || !sound(reference) || !sound(test) {
        return None;
    }
    let (a, b) = (Observed::new(reference, pixels_per_degree), Observed::new(test, pixels_per_degree));
    let most = hyab(hunt_lab([0.0, 1.0, 0.0]), hunt_lab([0.0, 0.0, 1.0])).powf(Q_C);
    let error = |i: usize| {
        let color = redistribute(hyab(a.lab[i], b.lab[i]).powf(Q_C), most);
        let feature = (a.edge[i] - b.edge[i]).abs().max((a.point[i] - b.point[i]).abs());
        let feature = (feature / 2f32.sqrt()).powf(Q_F);
        color.powf(1.0 - feature)
    };
    Some((0..bytes / 3).map(error).collect())
}

/// Exponent of the colour difference.
const Q_C: f32 = 0.7;
/// Exponent of the feature difference.
const Q_F: f32 = 0.5;
/// Part of the largest colour difference that is mapped to the error [`P_T`].
const P_C: f32 = 0.4;
/// Error that the part [`P_C`] of the largest colour difference is mapped to.
const P_T: f32 = 0.95;
/// Width of the feature detectors in degrees.
const FEATURE_WIDTH: f32 = 0.082;
/// Contrast sensitivity of luminance, red-green and blue-yellow, each a sum of two Gaussians `(a, b)`.
const SENSITIVITY: [[(f32, f32); 2]; 3] =
    [[(1.0, 0.0047), (0.0, 1e-5)], [(1.0, 0.0053), (0.0, 1e-5)], [(34.1, 0.04), (13.5, 0.025)]];

/// A picture as the observer perceives it.
struct Observed {
    /// Filtered by contrast sensitivity, in L*a*b* with Hunt's adjustment.
    lab: Vec<[f32; 3]>,
    /// Strength of edges of the luminance.
    edge: Vec<f32>,
    /// Strength of points of the luminance.
    point: Vec<f32>,
}

impl Observed {
    fn new(picture: &Picture, pixels_per_degree: f32) -> Self {
        let decoded: [f32; 256] = std::array::from_fn(|i| decode_srgb(i as f32 / 255.0));
        let (width, height) = (picture.width as usize, picture.height as usize);
        let opponent: Vec<[f32; 3]> = (picture.rgb8.as_chunks::<3>().0.iter())
            .map(|rgb| opponent_of_xyz(xyz_of_rgb(rgb.map(|c| decoded[usize::from(c)]))))
            .collect();
        let plane = |channel: usize| Plane { width, height, values: opponent.iter().map(|p| p[channel]).collect() };

        // Wide enough for three deviations of the widest Gaussian.
        let radius = (3.0 * (0.04 / (2.0 * PI * PI)).sqrt() * pixels_per_degree).ceil() as usize;
        let seen: [Plane; 3] = std::array::from_fn(|channel| {
            let mut sum = Plane { width, height, values: vec![0.0; width * height] };
            let gaussians = SENSITIVITY[channel].map(|(a, b)| {
                let kernel = kernel(radius, |x| (-(PI * x / pixels_per_degree).powi(2) / b).exp());
                let total: f32 = kernel.iter().sum();
                // The weight of the Gaussian in two dimensions.
                (kernel.map_values(|k| k / total), a * (PI / b).sqrt() * total * total)
            });
            let weight: f32 = gaussians.iter().map(|g| g.1).sum();
            for (kernel, part) in gaussians.iter().filter(|g| g.1 > 0.0) {
                let filtered = plane(channel).convolved(kernel, kernel);
                for (sum, value) in sum.values.iter_mut().zip(&filtered.values) {
                    *sum += value * part / weight;
                }
            }
            sum
        });
        let lab = (0..width * height)
            .map(|i| {
                let rgb = rgb_of_xyz(xyz_of_opponent([0, 1, 2].map(|c| seen[c].values[i])));
                hunt_lab(rgb.map(|c| c.clamp(0.0, 1.0)))
            })
            .collect();

        let mut luminance = plane(0);
        luminance.values.iter_mut().for_each(|y| *y = (*y + 16.0) / 116.0);
        let deviation = 0.5 * FEATURE_WIDTH * pixels_per_degree;
        let radius = (3.0 * deviation).ceil() as usize;
        let gaussian = |x: f32| (-x * x / (2.0 * deviation * deviation)).exp();
        let blur = kernel(radius, gaussian);
        let total: f32 = blur.iter().sum();
        let blur = blur.map_values(|k| k / total);
        let strength = |detector: Vec<f32>| -> Vec<f32> {
            let detector = balanced(detector);
            let across = luminance.convolved(&detector, &blur);
            let down = luminance.convolved(&blur, &detector);
            across.values.iter().zip(&down.values).map(|(x, y)| x.hypot(*y)).collect()
        };
        let edge = strength(kernel(radius, |x| -x * gaussian(x)));
        let point = strength(kernel(radius, |x| (x * x / (deviation * deviation) - 1.0) * gaussian(x)));
        Self { lab, edge, point }
    }
}

/// Values of a function at the integers from `-radius` to `radius`.
fn kernel(radius: usize, value: impl Fn(f32) -> f32) -> Vec<f32> {
    (0..=2 * radius).map(|i| value(i as f32 - radius as f32)).collect()
}

/// Elementwise change of a kernel.
trait MapValues {
    fn map_values(&self, change: impl Fn(f32) -> f32) -> Self;
}

impl MapValues for Vec<f32> {
    fn map_values(&self, change: impl Fn(f32) -> f32) -> Self {
        self.iter().map(|&k| change(k)).collect()
    }
}

/// Positive weights scaled to a sum of 1, negative ones to -1.
fn balanced(kernel: Vec<f32>) -> Vec<f32> {
    let positive: f32 = kernel.iter().filter(|k| **k > 0.0).sum();
    let negative: f32 = kernel.iter().filter(|k| **k < 0.0).sum();
    kernel.map_values(|k| if k > 0.0 { k / positive } else { k / -negative })
}

/// One number for each pixel.
struct Plane {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Plane {
    /// Convolves along rows, then along columns. Pixels outside the picture have the value of the nearest border pixel.
    fn convolved(&self, along_rows: &[f32], along_columns: &[f32]) -> Plane {
        let (width, height) = (self.width, self.height);
        let mut rows = vec![0.0; self.values.len()];
        for (out, row) in rows.chunks_exact_mut(width).zip(self.values.chunks_exact(width)) {
            let radius = along_rows.len() / 2;
            let mut padded = vec![row[0]; radius];
            padded.extend_from_slice(row);
            padded.extend(std::iter::repeat_n(row[width - 1], radius));
            for (k, weight) in along_rows.iter().enumerate() {
                out.iter_mut().zip(&padded[k..]).for_each(|(out, value)| *out += weight * value);
            }
        }
        let mut values = vec![0.0; rows.len()];
        for (y, out) in values.chunks_exact_mut(width).enumerate() {
            for (k, weight) in along_columns.iter().enumerate() {
                let from = (y + k).saturating_sub(along_columns.len() / 2).min(height - 1);
                let row = &rows[from * width..][..width];
                out.iter_mut().zip(row).for_each(|(out, value)| *out += weight * value);
            }
        }
        Plane { width, height, values }
    }
}

/// X, Y, Z of the sRGB primaries, column by column (IEC 61966-2-1, chromaticities of BT.709, white D65).
const XYZ_OF_RGB: [[f32; 3]; 3] = [
    [0.412_390_8, 0.357_584_33, 0.180_480_8],
    [0.212_639, 0.715_168_7, 0.072_192_32],
    [0.019_330_82, 0.119_194_78, 0.950_532_15],
];
/// Its inverse.
const RGB_OF_XYZ: [[f32; 3]; 3] = [
    [3.240_97, -1.537_383_2, -0.498_610_76],
    [-0.969_243_65, 1.875_967_5, 0.041_555_06],
    [0.055_630_08, -0.203_976_96, 1.056_971_5],
];
/// White: the sums of the rows.
const WHITE: [f32; 3] = [0.950_456, 1.0, 1.089_057_8];

fn multiply(m: &[[f32; 3]; 3], v: [f32; 3]) -> [f32; 3] {
    m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

fn xyz_of_rgb(rgb: [f32; 3]) -> [f32; 3] {
    multiply(&XYZ_OF_RGB, rgb)
}

fn rgb_of_xyz(xyz: [f32; 3]) -> [f32; 3] {
    multiply(&RGB_OF_XYZ, xyz)
}

/// YyCxCz: L*a*b* without its cube roots.
fn opponent_of_xyz(xyz: [f32; 3]) -> [f32; 3] {
    let [x, y, z] = [0, 1, 2].map(|i| xyz[i] / WHITE[i]);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn xyz_of_opponent([yy, cx, cz]: [f32; 3]) -> [f32; 3] {
    let y = (yy + 16.0) / 116.0;
    let relative = [y + cx / 500.0, y, y - cz / 200.0];
    [0, 1, 2].map(|i| relative[i] * WHITE[i])
}

/// L*a*b* of linear RGB, a* and b* scaled with lightness: dark colours differ less (Hunt).
fn hunt_lab(rgb: [f32; 3]) -> [f32; 3] {
    const KNEE: f32 = 6.0 / 29.0;
    let root = |t: f32| if t > KNEE.powi(3) { t.cbrt() } else { t / (3.0 * KNEE * KNEE) + 4.0 / 29.0 };
    let xyz = xyz_of_rgb(rgb);
    let [x, y, z] = [0, 1, 2].map(|i| root(xyz[i] / WHITE[i]));
    let lightness = 116.0 * y - 16.0;
    [lightness, 0.01 * lightness * 500.0 * (x - y), 0.01 * lightness * 200.0 * (y - z)]
}

/// HyAB: city-block in lightness, Euclidean in colour.
fn hyab(a: [f32; 3], b: [f32; 3]) -> f32 {
    (a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])
}

/// Small differences get most of the range: `0..=P_C most` becomes `0..=P_T`, the rest what is left.
fn redistribute(error: f32, most: f32) -> f32 {
    let knee = P_C * most;
    if error < knee { error * P_T / knee } else { P_T + (error - knee) / (most - knee) * (1.0 - P_T) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Stripes, blocks and, from seed 1 on, noise.
    fn pattern(width: u32, height: u32, seed: u32) -> Picture {
        let byte = |x: u32, y: u32, c: u32| {
            let stripes = (x * (3 + c) + y * (5 - c)) % 97 * 2;
            let block = if (x / 16 + y / 16 + c).is_multiple_of(3) { 60 } else { 0 };
            let noise = (x * 7919 + y * 104_729 + c * 1299 + seed * 31_337) % 23 * seed;
            (stripes + block + noise).min(255) as u8
        };
        let mut rgb8 = Vec::new();
        for y in 0..height {
            for x in 0..width {
                rgb8.extend([0, 1, 2].map(|c| byte(x, y, c)));
            }
        }
        Picture { width, height, rgb8 }
    }

    /// Means that the authors' own program (by the crate nv-flip 0.1.2) gives for these pictures at 67 pixels per degree.
    #[test]
    fn agrees_with_the_authors_program() {
        let cases = [
            ((64, 48), (0, 1), 0.227_114),
            ((64, 48), (0, 5), 0.624_705),
            ((64, 48), (3, 1), 0.361_339),
            ((200, 150), (0, 2), 0.363_196),
            ((7, 5), (0, 5), 0.677_910),
        ];
        for ((width, height), (a, b), expected) in cases {
            let flip = flip_map(&pattern(width, height, a), &pattern(width, height, b), 67.0).unwrap();
            let mean = flip.iter().sum::<f32>() / flip.len() as f32;
            assert!((mean - expected).abs() < 3e-5, "{width}x{height}, {a} and {b}: {mean}, not {expected}");
        }
    }

    #[test]
    fn equal_pictures_do_not_differ() {
        let picture = pattern(40, 30, 1);
        let error = image_error(&picture, &picture).unwrap();
        assert!(error.flip.abs() < 1e-6 && error.mean_absolute == 0.0 && error.psnr.is_none(), "{error:?}");
        assert!(image_error(&picture, &pattern(30, 40, 1)).is_none());
        let none = Picture { width: 0, height: 0, rgb8: Vec::new() };
        assert!(image_error(&none, &none).is_none());
        assert!(image_error(&picture, &Picture { rgb8: vec![0; 5], ..picture.clone() }).is_none());
    }

    #[test]
    fn plain_measures_of_a_known_difference() {
        let gray = |v: u8| Picture { width: 8, height: 8, rgb8: vec![v; 192] };
        let error = image_error(&gray(100), &gray(151)).unwrap();
        assert!((error.mean_absolute - 0.2).abs() < 1e-12);
        assert!((error.psnr.unwrap() - 13.979_4).abs() < 1e-4, "{error:?}");
        let black_and_white = image_error(&gray(0), &gray(255)).unwrap();
        assert!(black_and_white.flip > 0.96 && black_and_white.flip < 1.0, "{black_and_white:?}");
    }

    #[test]
    fn more_noise_looks_more_different() {
        let mut last = 0.0;
        for seed in 1..5 {
            let flip = image_error(&pattern(64, 48, 0), &pattern(64, 48, seed)).unwrap().flip;
            assert!(flip > last && flip < 1.0, "{seed}: {flip}");
            last = flip;
        }
    }

    #[test]
    fn colours_go_there_and_back() {
        for rgb in [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [0.2, 0.5, 0.9], [1.0, 0.0, 0.0]] {
            let back = rgb_of_xyz(xyz_of_opponent(opponent_of_xyz(xyz_of_rgb(rgb))));
            assert!(rgb.iter().zip(back).all(|(a, b)| (a - b).abs() < 1e-5), "{rgb:?} {back:?}");
        }
    }
}
