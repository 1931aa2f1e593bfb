//! Pictures in memory and, with the feature `png`, in files.

#[cfg(feature = "png")]
mod png;

use std::sync::{Mutex, PoisonError};

#[cfg(feature = "png")]
pub use png::{read_picture, write_png};

/// Channels in `0.0..=1.0` (others are clamped) as bytes.
pub(crate) fn to_bytes(color: [f32; 3]) -> [u8; 3] {
    color.map(|c| (c * 255.0 + 0.5) as u8)
}

/// A picture of 8-bit sRGB colours.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Picture {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Red, green, blue of each pixel, row by row, the first row on top: `3 * width * height` bytes.
    pub rgb8: Vec<u8>,
}

impl Picture {
    /// A picture from a colour for each pixel, sRGB-encoded, channels in `0.0..=1.0` (others are clamped).
    pub fn from_fn((width, height): (u32, u32), mut color: impl FnMut(u32, u32) -> [f32; 3]) -> Self {
        let mut rgb8 = Vec::with_capacity(3 * width as usize * height as usize);
        for y in 0..height {
            for x in 0..width {
                rgb8.extend(to_bytes(color(x, y)));
            }
        }
        Self { width, height, rgb8 }
    }

    /// The same on all cores.
    ///
    /// Where the system refuses a thread, those that it gives do the work; this one is always among them.
    pub fn from_fn_on_all_cores((width, height): (u32, u32), color: impl Fn(u32, u32) -> [f32; 3] + Sync) -> Self {
        /// Rows that a thread takes at a time.
        const ROWS: usize = 8;
        let mut rgb8 = vec![0; 3 * width as usize * height as usize];
        let bands = rgb8.chunks_mut((3 * width as usize * ROWS).max(1)).enumerate();
        let threads = std::thread::available_parallelism().map_or(1, usize::from).min(bands.len());
        let bands = Mutex::new(bands);
        let next = || bands.lock().unwrap_or_else(PoisonError::into_inner).next();
        let work = || {
            while let Some((number, band)) = next() {
                for (i, pixel) in band.chunks_exact_mut(3).enumerate() {
                    let (x, y) = (i as u32 % width, (number * ROWS) as u32 + i as u32 / width);
                    pixel.copy_from_slice(&to_bytes(color(x, y)));
                }
            }
        };
        std::thread::scope(|scope| {
            for _ in 1..threads {
                // A refused thread is no error: the others take its rows.
                let _ = std::thread::Builder::new().spawn_scoped(scope, work);
            }
            work();
        });
        Self { width, height, rgb8 }
    }

    /// Colour of a pixel.
    ///
    /// # Panics
    /// `x` or `y` outside of the picture.
    pub fn pixel(&self, x: u32, y: u32) -> [u8; 3] {
        let at = 3 * (y as usize * self.width as usize + x as usize);
        [self.rgb8[at], self.rgb8[at + 1], self.rgb8[at + 2]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_cores_make_the_picture_that_one_makes() {
        let color = |x: u32, y: u32| [x as f32 / 70.0, y as f32 / 50.0, (x * y % 7) as f32 / 6.0];
        for size in [(1, 1), (70, 1), (1, 50), (13, 8), (70, 50), (0, 5), (5, 0)] {
            assert_eq!(Picture::from_fn_on_all_cores(size, color), Picture::from_fn(size, color), "{size:?}");
        }
    }
}
