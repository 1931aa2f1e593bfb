//! Pictures of the pixels that methods shade.

use esvo_core::Picture;
use esvo_raster::{Method, Options, Surface, bounds, morton_place};
use glam::{DVec2, DVec3};

use super::{EXTRA, Pictures, TEST_LEVEL};
use crate::BenchError;
use crate::voxel_bench::surface::failed;

/// Edge of a pixel of a method in pictures of pixels.
const PIXEL: u32 = 16;

impl Pictures<'_> {
    /// Which pixels of triangles that face the z axis a method shades: green, if the middle is covered; red, if another part of the pixel
    /// is; yellow, if no part is. Pale red: a pixel that a part of is covered, and that is not shaded.
    pub(super) fn pixels(&self, corners: &[[DVec3; 3]], method: Method) -> Result<Picture, BenchError> {
        let surface = Surface { corners, looks: None };
        let counts = |method| {
            let options = Options::new(TEST_LEVEL, method);
            self.voxelizer.pixels(&surface, &options).map_err(|e| failed(method.name(), e))
        };
        let (shaded, covered) = (counts(method)?, counts(Method::DominantAxis)?);
        let mut touched = vec![false; (shaded.edge as usize).pow(2)];
        for code in bounds::voxels(corners, TEST_LEVEL) {
            let [x, y, _] = morton_place(code);
            touched[(y * shaded.edge + x) as usize] = true;
        }
        let edge = shaded.edge;
        let of_z = 2 * (edge as usize).pow(2);
        let scale = f64::from(edge * PIXEL);
        Ok(Picture::from_fn((edge * PIXEL, edge * PIXEL), |x, y| {
            // y points up.
            let y = edge * PIXEL - 1 - y;
            let at = (y / PIXEL * edge + x / PIXEL) as usize;
            let pixel = match (shaded.counts[of_z + at] > 0, covered.counts[of_z + at] > 0, touched[at]) {
                (true, true, _) => [0.45, 0.78, 0.45],
                (true, false, true) => [0.90, 0.45, 0.42],
                (true, false, false) => EXTRA,
                (false, _, true) => [1.0, 0.86, 0.85],
                (false, _, false) => [1.0; 3],
            };
            let border = x.is_multiple_of(PIXEL) || y.is_multiple_of(PIXEL);
            let p = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) / scale;
            if corners.iter().any(|triangle| near_edge(triangle.map(DVec3::truncate), p, 0.9 / scale)) {
                [0.1, 0.1, 0.4]
            } else if border {
                pixel.map(|c| c * 0.86)
            } else {
                pixel
            }
        }))
    }
}

/// Whether a point is so near to an edge of a triangle.
pub(super) fn near_edge(triangle: [DVec2; 3], p: DVec2, reach: f64) -> bool {
    (0..3).any(|edge| {
        let (a, b) = (triangle[edge], triangle[(edge + 1) % 3]);
        let t = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
        p.distance(a + (b - a) * t) <= reach
    })
}
