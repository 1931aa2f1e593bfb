//! Pictures in memory and, with the feature `png`, in files.

#[cfg(feature = "png")]
mod png;

#[cfg(feature = "png")]
pub use png::{read_picture, write_png};

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
                rgb8.extend(color(x, y).map(|c| (c * 255.0 + 0.5) as u8));
            }
        }
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
