//! The post-process filter: compared with the paper's Figure 11 in double precision.

use super::checks::view_of;
use super::{Fault, Subject, demand};
use crate::filter::{Frame, Radius, samples};
use crate::gpu::kernel::GpuOptions;
use crate::reference::ReferenceCaster;
use crate::testing::sample::Sample;
use crate::{Caster, Picture, shading};

/// A mistake in a filter.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Mistake {
    None,
    /// The last sample within the radius is left out.
    OneSampleLess,
    /// The radius is clamped after the weight was computed.
    ClampedLate,
    /// The radius is not clamped.
    NotClamped,
    /// Weights do not taper off.
    NoTaper,
    /// Samples outside of the frame are those of its edge.
    EdgesRepeat,
}

/// The paper's Figure 11, line by line. `None` means that there is no such pixel.
fn figure_11(frame: &Frame, x: i64, y: i64, radius: Radius, mistake: Mistake) -> [f64; 3] {
    let (width, height) = (i64::from(frame.width()), i64::from(frame.height()));
    let fetch = |mut x: i64, mut y: i64| {
        if mistake == Mistake::EdgesRepeat {
            (x, y) = (x.clamp(0, width - 1), y.clamp(0, height - 1));
        }
        if x < 0 || y < 0 || x >= width || y >= height {
            return None;
        }
        let [r, g, b, code] = frame.pixels()[(y * width + x) as usize].to_le_bytes();
        Some(([r, g, b].map(f64::from), (f64::from(code) / 32.0).exp2()))
    };
    let (c, mut r) = fetch(x, y).unwrap_or_default();
    if r <= 1.0 {
        return c;
    }
    let mut accum = [0.0; 3];
    let mut accum_w = 0.0;
    let distance = |x: i32, y: i32| f64::from(x * x + y * y).sqrt();
    let table = samples();
    for (i, s) in table.iter().enumerate() {
        let dist = distance(s.x, s.y);
        let next = table.get(i + 1).map_or(f64::INFINITY, |next| distance(next.x, next.y));
        let Some((c2, r2)) = fetch(x + i64::from(s.x), y + i64::from(s.y)) else { continue };
        let before = r;
        if radius == Radius::Adapted && mistake != Mistake::NotClamped {
            r = r.min(r2);
        }
        if dist > r || (mistake == Mistake::OneSampleLess && i > 0 && next > r) {
            break;
        }
        let reach = if mistake == Mistake::ClampedLate { before } else { r } - dist;
        let w = f64::from(s.weight) * if mistake == Mistake::NoTaper { 1.0 } else { reach.min(1.0) };
        for channel in 0..3 {
            accum[channel] += c2[channel] * w;
        }
        accum_w += w;
    }
    accum.map(|c| c / accum_w)
}

/// Channels of a picture that are more than one step off.
fn off(picture: &Picture, frame: &Frame, radius: Radius, mistake: Mistake) -> usize {
    let mut count = 0;
    for y in 0..frame.height() {
        for x in 0..frame.width() {
            let expected = figure_11(frame, i64::from(x), i64::from(y), radius, mistake);
            let found = picture.pixel(x, y).map(f64::from);
            count += expected.iter().zip(found).filter(|(a, b)| (*a - b).abs() > 1.0).count();
        }
    }
    count
}

/// Frames of noise with patches of different radii, smooth ones, of many sizes, and one of voxels.
fn frames() -> Result<Vec<Frame>, Fault> {
    let mut frames = Vec::new();
    for (n, (width, height)) in [(1, 1), (3, 60), (60, 3), (131, 75)].into_iter().enumerate() {
        for patch in [1, 7, 40] {
            let noise = |x: u32, y: u32, salt: u32| {
                let hash = (x.wrapping_mul(0x9e37_79b9) ^ y.wrapping_mul(0x85eb_ca6b) ^ salt).wrapping_mul(0xc2b2_ae35);
                ((hash ^ hash >> 15).wrapping_mul(0x27d4_eb2f) >> 24) as u8
            };
            let picture =
                Picture::from_fn((width, height), |x, y| [0, 1, 2].map(|c| f32::from(noise(x, y, c)) / 255.0));
            let codes = (0..width * height).map(|i| noise(i % width / patch, i / width / patch, 7 + n as u32));
            // Radii up to 24 pixels, beyond, and none.
            frames.push(Frame::from_codes(&picture, codes.map(|code| if code < 16 { 0 } else { code / 2 + 30 }))?);
        }
    }
    let octree = Sample::plain(5, true).octree()?;
    let view = view_of(&octree, 0, (131, 75), false)?;
    let mut caster = ReferenceCaster::default();
    caster.load(&octree)?;
    let mut hits = Vec::new();
    caster.cast(&view, &mut hits)?;
    frames.push(Frame::new(&shading::shade(&octree, &view, &hits), &view, &hits)?);
    Ok(frames)
}

/// Filtered pictures are those of the paper's Figure 11 in double precision, up to one step of 255; with the radius of each
/// pixel's own voxel, too.
///
/// # Errors
/// Pixels that are further off; what the caster said.
pub fn filters_agree(subject: &Subject) -> Result<(), Fault> {
    let mut caster = subject.open()?;
    for frame in frames()? {
        demand(frame.is_filtered() || frame.pixels().len() == 1, || "a frame without radii tests nothing".into())?;
        for radius in [Radius::Adapted, Radius::Own] {
            let picture = caster.filter(&frame, radius)?.picture;
            demand((picture.width, picture.height) == (frame.width(), frame.height()), || "another size".into())?;
            let count = off(&picture, &frame, radius, Mistake::None);
            let size = (frame.width(), frame.height());
            demand(count == 0, || format!("{count} channels of a frame of {size:?} are off, {radius:?}"))?;
        }
    }
    Ok(())
}

/// Pictures that are filtered in several bands are those of the paper's Figure 11, too: rows of other bands are read.
///
/// # Errors
/// Pixels that are further off; what the caster said.
pub fn filters_in_bands_agree(subject: &Subject) -> Result<(), Fault> {
    for frame in frames()?.iter().filter(|frame| frame.height() > 48) {
        // Bands of seven rows, and the rows of the disc above and below.
        let most = u64::from(frame.width()) * 4 * (7 + 48);
        let mut caster = subject.open_with(&GpuOptions { max_part_bytes: Some(most), ..GpuOptions::default() })??;
        let picture = caster.filter(frame, Radius::Adapted)?.picture;
        let count = off(&picture, frame, Radius::Adapted, Mistake::None);
        demand(count == 0, || format!("{count} channels of a frame of {} rows are off", frame.height()))?;
    }
    Ok(())
}

/// The comparison of [`filters_agree`] finds mistakes that a filter could make.
///
/// # Errors
/// A mistake that is not found; what the caster said.
pub fn broken_filters_are_caught(subject: &Subject) -> Result<(), Fault> {
    let mut caster = subject.open()?;
    let frames = frames()?;
    for mistake in
        [Mistake::OneSampleLess, Mistake::ClampedLate, Mistake::NotClamped, Mistake::NoTaper, Mistake::EdgesRepeat]
    {
        let mut count = 0;
        for frame in &frames {
            let picture = caster.filter(frame, Radius::Adapted)?.picture;
            count += off(&picture, frame, Radius::Adapted, mistake);
        }
        demand(count != 0, || format!("{mistake:?} makes no difference"))?;
    }
    Ok(())
}
