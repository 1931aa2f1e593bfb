//! The post-process filter, sixteen pixels of a row at a time.
//!
//! The operations are those of [`esvo_core::filter::filter_rows`] in the same order, so that pictures are equal in every byte.
//! Lanes do not end: samples that are too far away have the weight 0.

use esvo_core::Picture;
use esvo_core::filter::{DISC, Frame, Radius, radii, samples};
use fearless_simd::prelude::*;
use fearless_simd::{f32x16, i32x16, u32x16};
use rayon::prelude::*;

use crate::vectors::{Vectors, Work, greatest};

/// Pixels that are filtered together.
const LANES: usize = 16;

/// Samples between two looks at whether all pixels are done.
const SAMPLES_PER_LOOK: usize = 8;

/// Columns on the left and on the right that are not of the frame.
const MARGIN: usize = DISC as usize;

/// A frame with margins on the left and on the right, so that no sample lies outside of a row.
struct Padded<'a> {
    frame: &'a Frame,
    /// Pixels of a row with its margins.
    stride: usize,
    pixels: Vec<u32>,
    /// Infinite in the margins.
    radii: Vec<f32>,
}

impl<'a> Padded<'a> {
    fn new(frame: &'a Frame) -> Self {
        let (width, height) = (frame.width() as usize, frame.height() as usize);
        let stride = width.next_multiple_of(LANES) + 2 * MARGIN;
        let mut pixels = vec![0; stride * height];
        let mut radius = vec![f32::INFINITY; stride * height];
        let rows = pixels.par_chunks_mut(stride).zip(radius.par_chunks_mut(stride));
        rows.zip(frame.pixels().par_chunks(width)).for_each(|((pixels, radius), from)| {
            pixels[MARGIN..MARGIN + width].copy_from_slice(from);
            for (radius, pixel) in radius[MARGIN..].iter_mut().zip(from) {
                *radius = radii()[(pixel >> 24) as usize];
            }
        });
        Self { frame, stride, pixels, radii: radius }
    }
}

/// Filters a frame on the threads of the pool that this is called in.
pub(crate) fn filter(frame: &Frame, radius: Radius) -> Picture {
    /// Rows of a task.
    const ROWS: usize = 8;
    let padded = Padded::new(frame);
    let row_bytes = 3 * frame.width() as usize;
    let mut rgb8 = vec![0; row_bytes * frame.height() as usize];
    rgb8.par_chunks_mut(row_bytes * ROWS).enumerate().for_each(|(task, rgb8)| {
        let rows = Rows { padded: &padded, radius, first_row: task * ROWS, rgb8 };
        // The best vectors are there.
        let _ = Vectors::best().run(rows);
    });
    Picture { width: frame.width(), height: frame.height(), rgb8 }
}

struct Rows<'a> {
    padded: &'a Padded<'a>,
    radius: Radius,
    first_row: usize,
    rgb8: &'a mut [u8],
}

impl Work for Rows<'_> {
    type Output = ();

    fn run<S: Simd, const TILES: bool, const LISTS: bool>(self, simd: S) {
        simd.vectorize(
            #[inline(always)]
            || match self.radius {
                Radius::Adapted => self.filter::<S, true>(simd),
                Radius::Own => self.filter::<S, false>(simd),
            },
        );
    }
}

impl Rows<'_> {
    #[inline(always)]
    fn filter<S: Simd, const ADAPTED: bool>(self, simd: S) {
        let width = self.padded.frame.width() as usize;
        for (y, row) in (self.first_row..).zip(self.rgb8.chunks_exact_mut(3 * width)) {
            for (k, rgb8) in row.chunks_mut(3 * LANES).enumerate() {
                let color = self.padded.filtered::<S, ADAPTED>(simd, k * LANES, y);
                for (lane, pixel) in rgb8.chunks_exact_mut(3).enumerate() {
                    pixel.copy_from_slice(&[color[0][lane] as u8, color[1][lane] as u8, color[2][lane] as u8]);
                }
            }
        }
    }
}

impl Padded<'_> {
    /// Channels of sixteen pixels of a row, from 0 to 255.
    #[inline(always)]
    fn filtered<S: Simd, const ADAPTED: bool>(&self, simd: S, x: usize, y: usize) -> [[f32; LANES]; 3] {
        let at = y * self.stride + MARGIN + x;
        let zero = f32x16::splat(simd, 0.0);
        let one = f32x16::splat(simd, 1.0);
        let mut r = f32x16::from_slice(simd, &self.radii[at..at + LANES]);
        let outside = f32x16::splat(simd, f32::INFINITY);
        // Lanes outside of the frame are filtered by nothing.
        r = r.simd_eq(outside).select(one, r);
        let mut sum = [zero; 3];
        let mut weights = zero;
        for some in samples().chunks(SAMPLES_PER_LOOK) {
            if some[0].distance >= greatest(r) {
                break;
            }
            for sample in some {
                let row = y as isize + sample.y as isize;
                if row < 0 || row >= self.frame.height() as isize {
                    continue;
                }
                let from = (row as usize * self.stride + MARGIN + x).wrapping_add_signed(sample.x as isize);
                let other = f32x16::from_slice(simd, &self.radii[from..from + LANES]);
                let pixel = u32x16::from_slice(simd, &self.pixels[from..from + LANES]);
                if ADAPTED {
                    r = r.min(other);
                }
                let share = (r - sample.distance).min(one).max(zero) * sample.weight;
                let weight = other.simd_eq(outside).select(zero, share);
                for channel in 0..3 {
                    let value = (pixel >> (8 * channel as u32)) & 255;
                    let value: f32x16<S> = value.bitcast::<i32x16<S>>().to_float();
                    sum[channel] += value * weight;
                }
                weights += weight;
            }
        }
        [(sum[0] / weights + 0.5).into(), (sum[1] / weights + 0.5).into(), (sum[2] / weights + 0.5).into()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_vectors_filter_as_one_pixel_at_a_time() {
        for (width, height) in [(1, 1), (15, 40), (16, 3), (17, 30), (70, 70)] {
            let noise = |x: u32, y: u32, salt: u32| ((x * 7 + y * 13 + salt).wrapping_mul(2_654_435_761) >> 9) as u8;
            let picture =
                Picture::from_fn((width, height), |x, y| [1, 2, 3].map(|c| f32::from(noise(x, y, c)) / 255.0));
            let codes = (0..width * height).map(|i| noise(i % width / 5, i / width / 5, 9) / 2);
            let frame = Frame::from_codes(&picture, codes).expect("is a frame");
            let padded = Padded::new(&frame);
            for radius in [Radius::Adapted, Radius::Own] {
                let expected = esvo_core::filter::filter(&frame, radius);
                assert_ne!((width > 1).then_some(&expected), Some(&picture), "something is filtered");
                assert_eq!(filter(&frame, radius), expected);
                for vectors in Vectors::available() {
                    let mut rgb8 = vec![0; expected.rgb8.len()];
                    let rows = Rows { padded: &padded, radius, first_row: 0, rgb8: &mut rgb8 };
                    assert!(vectors.run(rows).is_ok());
                    assert_eq!(rgb8, expected.rgb8, "{vectors:?}, {width}x{height}");
                }
            }
        }
    }
}
