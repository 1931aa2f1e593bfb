//! The filter on a GPU: one WGSL source, `kernels/filter.wgsl`.

use bytemuck::{Pod, Zeroable};

use super::{DISC, Frame, Radius, SAMPLES, radii, samples};
use crate::CastError;

/// The kernel. Bindings of group 0: [`Params`], the pixels of the band and its margins, the filtered pixels.
pub const FILTER_WGSL: &str = include_str!("../../kernels/filter.wgsl");

/// Its entry point.
pub const ENTRY_FILTER: &str = "filter_band";

/// The uniform buffer of the kernel. A test compares it with the kernel's struct of the same name.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Debug, Pod, Zeroable)]
pub struct Params {
    /// Pixels of a row.
    pub width: u32,
    /// Rows that are filtered.
    pub rows: u32,
    /// Rows of the input above the first that is filtered.
    pub margin: u32,
    /// Rows of the input.
    pub input_rows: u32,
    /// 1: [`Radius::Adapted`]; 0: [`Radius::Own`].
    pub adapted: u32,
    /// Zero.
    pub padding: [u32; 3],
    /// Of each sample: offset to the right and downwards, distance, weight.
    pub samples: [[f32; 4]; SAMPLES],
    /// Radius of each code, four to a row.
    pub radii: [[f32; 4]; 64],
}

/// Rows of a frame that one dispatch filters, with the rows around them that it reads.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Band {
    /// First row that is filtered.
    pub first: u32,
    /// Rows that are filtered.
    pub rows: u32,
    /// First row that is read.
    pub first_input: u32,
    /// Rows that are read.
    pub input_rows: u32,
}

impl Band {
    /// The bands of a frame, for buffers of at most `max_bytes` and at most `max_groups` workgroups along each side.
    ///
    /// # Errors
    /// [`CastError::Device`]: a row with its margins does not fit.
    pub fn all(frame: &Frame, max_bytes: u64, max_groups: u32) -> Result<Vec<Self>, CastError> {
        let margin = DISC as u32;
        let row_bytes = u64::from(frame.width) * 4;
        let fitting = (max_bytes / row_bytes).min(u64::from(u32::MAX)) as u32;
        let most = fitting.saturating_sub(2 * margin).min(max_groups.saturating_mul(8));
        if most == 0 || frame.width.div_ceil(8) > max_groups {
            let what =
                format!("the device cannot filter pictures of {} pixels in a row: render a smaller one", frame.width);
            return Err(CastError::Device(what));
        }
        let band = |first: u32| {
            let rows = most.min(frame.height - first);
            let first_input = first.saturating_sub(margin);
            let end = (first + rows).saturating_add(margin).min(frame.height);
            Self { first, rows, first_input, input_rows: end - first_input }
        };
        Ok((0..frame.height).step_by(most as usize).map(band).collect())
    }

    /// The pixels that the band reads.
    pub fn input<'a>(&self, frame: &'a Frame) -> &'a [u32] {
        let width = frame.width as usize;
        &frame.pixels[self.first_input as usize * width..][..self.input_rows as usize * width]
    }

    /// Workgroups along each side.
    pub fn workgroups(&self, frame: &Frame) -> (u32, u32) {
        (frame.width.div_ceil(8), self.rows.div_ceil(8))
    }

    /// The kernel's parameters.
    pub fn params(&self, frame: &Frame, radius: Radius) -> Params {
        let radii = radii();
        Params {
            width: frame.width,
            rows: self.rows,
            margin: self.first - self.first_input,
            input_rows: self.input_rows,
            adapted: u32::from(radius == Radius::Adapted),
            padding: [0; 3],
            samples: samples().map(|s| [s.x as f32, s.y as f32, s.distance, s.weight]),
            radii: std::array::from_fn(|row| std::array::from_fn(|k| radii[4 * row + k])),
        }
    }
}

/// Appends filtered pixels, as the kernel writes them, to the bytes of a picture.
pub fn unpack(pixels: &[u32], rgb8: &mut Vec<u8>) {
    rgb8.extend(pixels.iter().flat_map(|pixel| {
        let [r, g, b, _] = pixel.to_le_bytes();
        [r, g, b]
    }));
}

#[cfg(test)]
mod tests {
    use super::super::{filter, filter_rows};
    use super::*;
    use crate::Picture;

    fn frame(width: u32, height: u32) -> Frame {
        let picture =
            Picture::from_fn((width, height), |x, y| [(x * 5 + y * 3) % 7, x % 3, y % 5].map(|c| c as f32 / 6.0));
        Frame::from_codes(&picture, (0..width * height).map(|i| (i * 7 % 160) as u8)).expect("is a frame")
    }

    /// Each band, filtered as a frame of its own that has the rows that it reads.
    #[test]
    fn bands_have_all_rows_that_they_read() {
        let whole = frame(9, 130);
        let expected = filter(&whole, Radius::Adapted);
        let bands = Band::all(&whole, 9 * 4 * (48 + 10), 1000).expect("fit");
        assert_eq!((bands.len(), bands.iter().map(|band| band.rows).sum::<u32>()), (13, 130));
        let mut rgb8 = Vec::new();
        for band in bands {
            assert!(band.input_rows <= 58);
            let part = Frame { width: 9, height: band.input_rows, pixels: band.input(&whole).to_vec() };
            let mut rows = vec![0; 27 * band.rows as usize];
            filter_rows(&part, Radius::Adapted, band.params(&whole, Radius::Adapted).margin, &mut rows);
            rgb8.extend(rows);
        }
        assert_eq!(rgb8, expected.rgb8);
    }

    #[test]
    fn rows_that_no_band_can_hold_are_refused() {
        let frame = frame(100, 3);
        assert!(Band::all(&frame, 100 * 4 * 48, 1000).is_err(), "only margins fit");
        assert!(Band::all(&frame, u64::MAX, 12).is_err(), "13 workgroups in a row");
        let bands = Band::all(&frame, u64::MAX, 13).expect("fit");
        assert_eq!(bands, [Band { first: 0, rows: 3, first_input: 0, input_rows: 3 }]);
    }
}
