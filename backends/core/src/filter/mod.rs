//! The paper's post-process filter (section 4.3): blurs a picture where voxels are larger than a pixel.
//!
//! Each pixel has a radius, the size of its voxel in pixels, whose logarithm is the fourth byte of a [`Frame`]. A pixel becomes
//! the weighted mean of 96 [samples] around it. They are added up in ascending distance, and the radius becomes the least of
//! those that were met: so neighbours of different levels agree, and no seam shows. The background has a radius of one pixel:
//! the sum ends there, and silhouettes stay sharp.
//!
//! [`Caster::filter`](crate::Caster::filter) filters on an engine. [`filter_rows`] is the paper's Figure 11.

pub mod kernel;
mod samples;

pub use samples::{DISC, SAMPLES, Sample, code_of, radii, samples};

use crate::{CastError, Hit, Picture, View, check_size};

/// The code of the size of a hit voxel in pixels; 0 for a miss.
pub fn code_at(view: &View, hit: &Hit) -> u8 {
    if hit.is_miss() { 0 } else { code_of(hit.size() / (view.pixel_size * hit.raw_t)) }
}

/// Which radius a pixel is filtered with.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default)]
pub enum Radius {
    /// The least of its own and those of the samples so far: the paper's filter.
    #[default]
    Adapted,
    /// That of its own voxel. Seams show where levels change: the left of the paper's Figure 10.
    Own,
}

/// A picture with the filter's radius of every pixel.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Frame {
    width: u32,
    height: u32,
    /// Red, green and blue, sRGB-encoded, in the bytes from the lowest; in the highest, the code of the radius.
    pixels: Vec<u32>,
}

impl Frame {
    /// A picture of hits, with the sizes of their voxels. What was not hit has a radius of one pixel.
    ///
    /// # Errors
    /// [`CastError::View`]: picture, view and hits do not have the same number of pixels, or there are none or too many.
    pub fn new(picture: &Picture, view: &View, hits: &[Hit]) -> Result<Self, CastError> {
        if (picture.width, picture.height) != (view.width, view.height) || hits.len() != view.pixels() {
            let what = format!(
                "a picture of {}x{}, a view of {}x{} and {} hits; all must have the same size",
                picture.width,
                picture.height,
                view.width,
                view.height,
                hits.len()
            );
            return Err(CastError::View(what));
        }
        Self::from_codes(picture, hits.iter().map(|hit| code_at(view, hit)))
    }

    /// A picture with these radii, as codes: see [`code_of`]. Missing ones are 0.
    ///
    /// # Errors
    /// [`CastError::View`]: a picture without pixels or with too many, or with a number of bytes that does not fit its size.
    pub fn from_codes(picture: &Picture, codes: impl IntoIterator<Item = u8>) -> Result<Self, CastError> {
        let Picture { width, height, .. } = *picture;
        check_size(width, height)?;
        if picture.rgb8.len() as u64 != 3 * u64::from(width) * u64::from(height) {
            return Err(CastError::View("a picture must have three bytes for every pixel".into()));
        }
        let codes = codes.into_iter().chain(std::iter::repeat(0));
        let pixels = picture.rgb8.chunks_exact(3).zip(codes);
        let pixels = pixels.map(|(rgb, code)| u32::from_le_bytes([rgb[0], rgb[1], rgb[2], code])).collect();
        Ok(Self { width, height, pixels })
    }

    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The pixels, row by row: red, green and blue in the bytes from the lowest, and the code of the radius.
    pub fn pixels(&self) -> &[u32] {
        &self.pixels
    }

    /// Whether the filter changes any pixel.
    pub fn is_filtered(&self) -> bool {
        self.pixels.iter().any(|pixel| pixel >> 24 != 0)
    }

    /// Colour from 0 to 255 and radius of a pixel.
    #[inline(always)]
    fn fetch(&self, x: i32, y: i32) -> Option<([f32; 3], f32)> {
        if x < 0 || y < 0 || x as u32 >= self.width || y as u32 >= self.height {
            return None;
        }
        let [r, g, b, code] = self.pixels[y as usize * self.width as usize + x as usize].to_le_bytes();
        Some(([f32::from(r), f32::from(g), f32::from(b)], radii()[usize::from(code)]))
    }
}

/// Filters rows, from `first_row` on, as many as `rgb8` has room for. What lies outside of the frame has no weight.
///
/// # Panics
/// `rgb8` is not whole rows of the frame.
pub fn filter_rows(frame: &Frame, radius: Radius, first_row: u32, rgb8: &mut [u8]) {
    let samples = samples();
    let width = frame.width as usize;
    for (i, pixel) in rgb8.chunks_exact_mut(3).enumerate() {
        let (x, y) = ((i % width) as i32, first_row as i32 + (i / width) as i32);
        let Some((color, mut r)) = frame.fetch(x, y) else { panic!("row {y} is not in the frame") };
        if r <= 1.0 {
            pixel.copy_from_slice(&color.map(|c| c as u8));
            continue;
        }
        let mut sum = [0.0; 3];
        let mut weights = 0.0;
        for sample in samples {
            if sample.distance >= r {
                break;
            }
            let Some((color, other)) = frame.fetch(x + sample.x, y + sample.y) else { continue };
            if radius == Radius::Adapted {
                r = r.min(other);
                if sample.distance >= r {
                    break;
                }
            }
            let weight = sample.weight * (r - sample.distance).min(1.0);
            for channel in 0..3 {
                sum[channel] += color[channel] * weight;
            }
            weights += weight;
        }
        pixel.copy_from_slice(&sum.map(|c| (c / weights + 0.5) as u8));
    }
}

/// Filters a frame on one thread.
pub fn filter(frame: &Frame, radius: Radius) -> Picture {
    let mut rgb8 = vec![0; 3 * frame.pixels.len()];
    filter_rows(frame, radius, 0, &mut rgb8);
    Picture { width: frame.width, height: frame.height, rgb8 }
}
