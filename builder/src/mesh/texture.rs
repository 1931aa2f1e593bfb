//! Colour textures: mip levels by box filtering in linear light, and the sampler that reads them.

use std::sync::LazyLock;

use esvo_format::srgb::decode_f64 as srgb_to_linear;
use rayon::prelude::*;

use super::wrap::Wrap;

/// Most texels per side of a texture.
pub const MAX_TEXTURE_SIDE: u32 = 1 << 14;

/// An image with all its mip levels, 8 bits per channel: RGB encoded as sRGB, alpha linear.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Mip levels, the full image first. Each has half the size of the previous one (rounded down, at least 1).
    pub mips: Vec<MipLevel>,
    /// How it is read at coordinates outside 0..=1, along `u` and `v`.
    pub wrap: [Wrap; 2],
}

/// One mip level: row-major RGBA, first row on top.
#[derive(Clone, Debug)]
pub struct MipLevel {
    /// Width in texels, at least 1.
    pub width: u32,
    /// Height in texels, at least 1.
    pub height: u32,
    /// `width * height` texels.
    pub texels: Vec<[u8; 4]>,
}

/// Why a texture cannot be made from an image.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TextureError {
    /// A side is zero or above [`MAX_TEXTURE_SIDE`].
    #[error("the image has {width} x {height} texels; each side must be 1 to {MAX_TEXTURE_SIDE}")]
    Size {
        /// Width in texels.
        width: u32,
        /// Height in texels.
        height: u32,
    },
    /// The number of bytes does not fit the size of the image.
    #[error("an image of {width} x {height} texels needs {expected} bytes, but {found} were given")]
    Length {
        /// Width in texels.
        width: u32,
        /// Height in texels.
        height: u32,
        /// Bytes given.
        found: usize,
        /// Bytes needed.
        expected: usize,
    },
}

/// The weight of a fully transparent texel in an averaged colour. Above zero, so that a region of transparent texels keeps
/// its colour; too small to be visible next to an opaque texel.
const TRANSPARENT_WEIGHT: f32 = 1.0e-4;

/// Linear value of each sRGB byte (IEC 61966-2-1).
static DECODE: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|byte| srgb_to_linear(byte as f64 / 255.0) as f32));

/// The decoding table. Fetched once per sample, because every access to [`DECODE`] checks whether it is initialised.
fn decode_table() -> &'static [f32; 256] {
    &DECODE
}

/// For each byte except 0: the smallest linear value that rounds to it.
static ENCODE_FROM: LazyLock<[f32; 255]> =
    LazyLock::new(|| std::array::from_fn(|byte| srgb_to_linear((byte as f64 + 0.5) / 255.0) as f32));

/// Steps of the linear range in [`ENCODE_START`].
const ENCODE_STEPS: usize = 4096;

/// For the lower end of each step of the linear range: the byte it rounds to. The search for the right byte starts there.
static ENCODE_START: LazyLock<Vec<u8>> = LazyLock::new(|| {
    (0..=ENCODE_STEPS)
        .map(|step| ENCODE_FROM.partition_point(|&from| from <= step as f32 / ENCODE_STEPS as f32) as u8)
        .collect()
});

/// The sRGB byte nearest to linear light, in encoded values.
fn linear_to_srgb_byte(linear: f32) -> u8 {
    let clamped = linear.clamp(0.0, 1.0);
    let mut byte = ENCODE_START[(clamped * ENCODE_STEPS as f32) as usize];
    while byte < 255 && clamped >= ENCODE_FROM[byte as usize] {
        byte += 1;
    }
    byte
}

impl Texture {
    /// Makes a texture with all its mip levels from row-major RGBA bytes (first row on top; RGB encoded as sRGB).
    ///
    /// Each texel of a level is the average of the area that it covers in the previous level, in linear light and weighted
    /// by alpha, so that the colour of transparent texels does not bleed into their neighbours.
    ///
    /// # Errors
    /// See [`TextureError`].
    pub fn from_rgba8(width: u32, height: u32, bytes: &[u8]) -> Result<Self, TextureError> {
        check_size(width, height, 4, bytes.len())?;
        let texels: Vec<[u8; 4]> = bytes.as_chunks::<4>().0.to_vec();
        let mut mips = vec![MipLevel { width, height, texels }];
        // The averages stay in full precision until all levels are made, so that rounding errors do not add up.
        let mut previous: Vec<[f32; 4]> = Vec::new();
        while let Some(last) = mips.last()
            && (last.width > 1 || last.height > 1)
        {
            let (width, height, averages) = if mips.len() == 1 {
                let decode = decode_table();
                halve(last.width, last.height, |parts| average_of(parts, |i| linear(decode, last.texels[i])))
            } else {
                halve(last.width, last.height, |parts| average_of(parts, |i| previous[i]))
            };
            let texels = averages.par_iter().map(|&[r, g, b, a]| {
                let alpha = (a * 255.0 + 0.5) as u8;
                [linear_to_srgb_byte(r), linear_to_srgb_byte(g), linear_to_srgb_byte(b), alpha]
            });
            mips.push(MipLevel { width, height, texels: texels.collect() });
            previous = averages;
        }
        Ok(Self { mips, wrap: [Wrap::Repeat; 2] })
    }

    /// The same texture, read in another way at coordinates outside 0..=1.
    #[must_use]
    pub fn with_wrap(self, wrap: [Wrap; 2]) -> Self {
        Self { wrap, ..self }
    }

    /// Smallest and largest alpha of the full image.
    #[must_use]
    pub fn alpha_range(&self) -> (u8, u8) {
        self.mips[0].texels.iter().fold((255, 0), |(low, high), t| (low.min(t[3]), high.max(t[3])))
    }

    /// Colour at `uv` (`v` downwards from the first row; outside 0..=1 by `wrap`) as linear RGB and alpha, 0..=1.
    ///
    /// `footprint_texels` is the width of the area to average, in texels of the full image. 1 or less reads the full image
    /// with bilinear filtering; more blends the two mip levels whose texels are nearest in size. Interpolation is weighted
    /// by alpha. Coordinates or footprints that are infinite or NaN are taken as 0.
    #[must_use]
    pub fn sample(&self, uv: [f32; 2], footprint_texels: f32) -> [f32; 4] {
        let uv = fold(uv, self.wrap);
        let (fine, blend) = mip_level(footprint_texels, self.mips.len());
        let near = self.mips[fine].bilinear(uv, self.wrap);
        match blend {
            Some(t) => mix(near, self.mips[fine + 1].bilinear(uv, self.wrap), t),
            None => near,
        }
    }
}

impl MipLevel {
    /// Bilinear interpolation at `uv` in 0..=1.
    fn bilinear(&self, [u, v]: [f32; 2], [wrap_u, wrap_v]: [Wrap; 2]) -> [f32; 4] {
        let (x0, x1, fx) = neighbours(u, self.width, wrap_u);
        let (y0, y1, fy) = neighbours(v, self.height, wrap_v);
        let decode = decode_table();
        let texel = |x: usize, y: usize| linear(decode, self.texels[y * self.width as usize + x]);
        let corners = [
            ((1.0 - fx) * (1.0 - fy), texel(x0, y0)),
            (fx * (1.0 - fy), texel(x1, y0)),
            ((1.0 - fx) * fy, texel(x0, y1)),
            (fx * fy, texel(x1, y1)),
        ];
        average(&corners)
    }
}

/// Checks the size of an image with `texel_bytes` bytes per texel, of which `found` bytes are given.
pub(crate) fn check_size(width: u32, height: u32, texel_bytes: usize, found: usize) -> Result<(), TextureError> {
    if width == 0 || height == 0 || width > MAX_TEXTURE_SIDE || height > MAX_TEXTURE_SIDE {
        return Err(TextureError::Size { width, height });
    }
    let expected = width as usize * height as usize * texel_bytes;
    if found != expected { Err(TextureError::Length { width, height, found, expected }) } else { Ok(()) }
}

/// Folds coordinates into 0..=1; 0 for those that are infinite or NaN.
#[inline]
pub(crate) fn fold([u, v]: [f32; 2], [wrap_u, wrap_v]: [Wrap; 2]) -> [f32; 2] {
    [wrap_u.fold(u), wrap_v.fold(v)]
}

/// The finer one of the two mip levels (of `mips`) to blend for a footprint, and the weight of the next level if above 0.
#[inline]
pub(crate) fn mip_level(footprint_texels: f32, mips: usize) -> (usize, Option<f32>) {
    let deepest = mips - 1;
    let level = if footprint_texels > 1.0 { footprint_texels.log2().min(deepest as f32) } else { 0.0 };
    let fine = level as usize;
    let blend = level - fine as f32;
    (fine, (blend > 0.0 && fine < deepest).then_some(blend))
}

/// The two texels around `u` (in 0..=1) on an axis of `size` texels, and the interpolation weight of the second.
pub(crate) fn neighbours(u: f32, size: u32, wrap: Wrap) -> (usize, usize, f32) {
    let x = u * size as f32 - 0.5;
    let floor = x.floor();
    let last = size as usize - 1;
    if wrap != Wrap::Repeat {
        let texel = |at: f32| wrap.texel(at as i64, size) as usize;
        return (texel(floor), texel(floor + 1.0), x - floor);
    }
    // `floor` is -1 at the near edge and `size` - 1 at most; the minimum guards against rounding.
    let first = if floor < 0.0 { last } else { (floor as usize).min(last) };
    let second = if first == last { 0 } else { first + 1 };
    (first, second, x - floor)
}

/// A texel with its RGB decoded.
fn linear(decode: &[f32; 256], [r, g, b, a]: [u8; 4]) -> [f32; 4] {
    [decode[r as usize], decode[g as usize], decode[b as usize], f32::from(a) * (1.0 / 255.0)]
}

/// The weighted mean of colours; the weights add up to 1. RGB is also weighted by alpha.
fn average(parts: &[(f32, [f32; 4])]) -> [f32; 4] {
    let mut sum = [0.0; 4];
    let mut total = 0.0;
    for &(weight, [r, g, b, a]) in parts {
        let share = weight * (a + TRANSPARENT_WEIGHT);
        total += share;
        sum[0] += share * r;
        sum[1] += share * g;
        sum[2] += share * b;
        sum[3] += weight * a;
    }
    if total > 0.0 {
        let scale = 1.0 / total;
        [sum[0] * scale, sum[1] * scale, sum[2] * scale, sum[3].min(1.0)]
    } else {
        sum
    }
}

fn mix(a: [f32; 4], b: [f32; 4], t: f32) -> [f32; 4] {
    average(&[(1.0 - t, a), (t, b)])
}

fn half(size: u32) -> u32 {
    (size / 2).max(1)
}

/// The next mip level of a `width` x `height` image: its width, height and texels. `mean` makes a texel from the texels
/// that it covers, given as weights and indices; the weights add up to 1.
pub(crate) fn halve<T: Send>(
    width: u32,
    height: u32,
    mean: impl Fn(&[(f32, usize)]) -> T + Sync,
) -> (u32, u32, Vec<T>) {
    let (columns, rows) = (taps(width as usize), taps(height as usize));
    let texel = |k: usize| {
        let (row, column) = (&rows[k / columns.len()], &columns[k % columns.len()]);
        let mut parts = [(0.0, 0); 9];
        let mut used = 0;
        for (j, &wy) in row.weights().iter().enumerate() {
            for (i, &wx) in column.weights().iter().enumerate() {
                parts[used] = (wx * wy, (row.first + j) * width as usize + column.first + i);
                used += 1;
            }
        }
        mean(&parts[..used])
    };
    let texels = (0..columns.len() * rows.len()).into_par_iter().with_min_len(1024).map(texel).collect();
    (half(width), half(height), texels)
}

/// The mean of texels, given as weights and indices, that `fetch` returns by index.
fn average_of(parts: &[(f32, usize)], fetch: impl Fn(usize) -> [f32; 4]) -> [f32; 4] {
    let mut fetched = [(0.0, [0.0; 4]); 9];
    for (to, &(weight, index)) in fetched.iter_mut().zip(parts) {
        *to = (weight, fetch(index));
    }
    average(&fetched[..parts.len()])
}

/// The texels of one axis that a texel of the next level covers, and their weights.
struct Taps {
    first: usize,
    count: usize,
    shares: [f32; 3],
}

impl Taps {
    fn weights(&self) -> &[f32] {
        &self.shares[..self.count]
    }
}

/// The taps of all texels of the next level. An even size is halved exactly. An odd size 2n + 1 is spread over n texels,
/// each covering 2 + 1/n texels.
fn taps(size: usize) -> Vec<Taps> {
    let halved = (size / 2).max(1);
    (0..halved)
        .map(|i| {
            if size == 1 {
                Taps { first: 0, count: 1, shares: [1.0, 0.0, 0.0] }
            } else if size.is_multiple_of(2) {
                Taps { first: 2 * i, count: 2, shares: [0.5, 0.5, 0.0] }
            } else {
                let whole = size as f32;
                let shares = [(halved - i) as f32 / whole, halved as f32 / whole, (i + 1) as f32 / whole];
                Taps { first: 2 * i, count: 3, shares }
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texture(width: u32, height: u32, texels: &[[u8; 4]]) -> Texture {
        Texture::from_rgba8(width, height, texels.as_flattened()).unwrap()
    }

    fn assert_near(found: [f32; 4], expected: [f32; 4], tolerance: f32) {
        for (f, e) in found.iter().zip(expected) {
            assert!((f - e).abs() <= tolerance, "{found:?} is not {expected:?}");
        }
    }

    const BLACK: [u8; 4] = [0, 0, 0, 255];
    const WHITE: [u8; 4] = [255, 255, 255, 255];

    #[test]
    fn bytes_survive_decoding_and_encoding() {
        for byte in 0..=255u8 {
            assert_eq!(linear_to_srgb_byte(DECODE[byte as usize]), byte);
        }
        assert_eq!(linear_to_srgb_byte(f32::NAN.clamp(0.0, 1.0).max(0.0)), 0);
        assert_eq!((linear_to_srgb_byte(-3.0), linear_to_srgb_byte(7.0)), (0, 255));
        // Values in between go to the nearest byte on the encoded side.
        for i in 0..10_000 {
            let encoded = f64::from(i) / 9_999.0;
            let nearest = (encoded * 255.0).round();
            let found = f64::from(linear_to_srgb_byte(srgb_to_linear(encoded) as f32));
            assert!((found - nearest).abs() <= 0.0 || (encoded * 255.0).fract().abs() - 0.5 < 1e-3, "{encoded}");
        }
    }

    #[test]
    fn mips_average_in_linear_light() {
        let checker = texture(2, 2, &[BLACK, WHITE, WHITE, BLACK]);
        assert_eq!(checker.mips.len(), 2);
        // Half of the light is byte 188, not 128.
        assert_eq!(checker.mips[1].texels, [[188, 188, 188, 255]]);
    }

    #[test]
    fn transparent_texels_do_not_bleed() {
        let red = [255, 0, 0, 255];
        let green_hole = [0, 255, 0, 0];
        let mips = texture(2, 1, &[red, green_hole]).mips;
        assert_eq!(mips[1].texels, [[255, 0, 0, 128]].map(|[r, _, b, a]: [u8; 4]| [r, mips[1].texels[0][1], b, a]));
        assert!(mips[1].texels[0][1] <= 1, "green leaked: {:?}", mips[1].texels);
        let sampled = texture(2, 1, &[red, green_hole]).sample([0.5, 0.5], 1.0);
        assert_near(sampled, [1.0, 0.0, 0.0, 0.5], 1e-3);
        // All transparent: the colour is kept.
        assert_eq!(texture(2, 1, &[green_hole; 2]).mips[1].texels, [green_hole]);
    }

    #[test]
    fn odd_sizes_lose_no_light() {
        // Every level of an image with a single white texel has the same total light, wherever the texel is.
        for spot in 0..15 {
            let mut texels = [BLACK; 15];
            texels[spot] = WHITE;
            let (_, _, averages) = halve(5, 3, |parts| average_of(parts, |i| linear(decode_table(), texels[i])));
            assert_eq!(averages.len(), 2);
            let mean = averages.iter().map(|t| t[0]).sum::<f32>() / 2.0;
            assert!((mean - 1.0 / 15.0).abs() < 1e-6, "texel {spot}: {mean}");
        }
        let sizes: Vec<_> = texture(5, 3, &[BLACK; 15]).mips.iter().map(|m| (m.width, m.height)).collect();
        assert_eq!(sizes, [(5, 3), (2, 1), (1, 1)]);
    }

    #[test]
    fn sampling_at_texel_centres_gives_the_texels() {
        let t = texture(2, 2, &[BLACK, WHITE, [255, 0, 0, 255], [0, 0, 255, 255]]);
        assert_near(t.sample([0.25, 0.25], 0.0), [0.0, 0.0, 0.0, 1.0], 0.0);
        assert_near(t.sample([0.75, 0.25], 1.0), [1.0, 1.0, 1.0, 1.0], 0.0);
        // v grows downwards.
        assert_near(t.sample([0.25, 0.75], 1.0), [1.0, 0.0, 0.0, 1.0], 0.0);
        // Wrapping, both ways.
        assert_near(t.sample([-0.25, 1.75], 1.0), [0.0, 0.0, 1.0, 1.0], 0.0);
        assert_near(t.sample([100.75, -99.25], 1.0), [0.0, 0.0, 1.0, 1.0], 0.0);
    }

    #[test]
    fn edges_continue_as_asked() {
        let t = texture(4, 1, &[BLACK, BLACK, WHITE, WHITE]);
        let at = |wrap: Wrap, u: f32| t.clone().with_wrap([wrap; 2]).sample([u, 0.5], 1.0)[0];
        for (wrap, expected) in [
            (Wrap::Repeat, [0.5, 1.0, 0.5, 0.0]),
            (Wrap::Mirror, [0.0, 0.0, 1.0, 1.0]),
            (Wrap::Clamp, [0.0, 0.0, 1.0, 1.0]),
        ] {
            for (u, expected) in [0.0, -0.125, 1.0, 1.125].into_iter().zip(expected) {
                assert!((at(wrap, u) - expected).abs() < 1e-6, "{wrap:?} {u}: {}", at(wrap, u));
            }
        }
        assert_eq!((at(Wrap::Mirror, 1.875), at(Wrap::Clamp, 1.875)), (0.0, 1.0));
    }

    #[test]
    fn sampling_interpolates_across_the_seam() {
        let t = texture(4, 1, &[BLACK, BLACK, WHITE, WHITE]);
        assert_near(t.sample([0.5, 0.5], 1.0), [0.5, 0.5, 0.5, 1.0], 1e-6);
        assert_near(t.sample([0.0, 0.5], 1.0), [0.5, 0.5, 0.5, 1.0], 1e-6);
        assert_near(t.sample([1.0, 0.5], 1.0), [0.5, 0.5, 0.5, 1.0], 1e-6);
    }

    #[test]
    fn larger_footprints_read_coarser_levels() {
        let texels: Vec<[u8; 4]> = (0..16).map(|i| if (i % 4 + i / 4) % 2 == 0 { BLACK } else { WHITE }).collect();
        let t = texture(4, 4, &texels);
        let corner = [0.125, 0.125];
        assert_near(t.sample(corner, 1.0), [0.0, 0.0, 0.0, 1.0], 0.0);
        // Encoded as byte 188: a little above one half.
        assert_near(t.sample(corner, 2.0), [0.5, 0.5, 0.5, 1.0], 5e-3);
        assert_near(t.sample(corner, f32::MAX), [0.5, 0.5, 0.5, 1.0], 5e-3);
        assert_near(t.sample(corner, 2f32.sqrt()), [0.25, 0.25, 0.25, 1.0], 5e-3);
    }

    #[test]
    fn nothing_finite_is_needed_to_sample() {
        let t = texture(2, 2, &[BLACK, WHITE, WHITE, BLACK]);
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -f32::MAX, f32::MIN_POSITIVE, -1e-30] {
            for footprint in [1.0, bad] {
                let found = t.sample([bad, bad], footprint);
                assert!(found.iter().all(|x| (0.0..=1.0).contains(x)), "{bad} {footprint}: {found:?}");
            }
        }
    }

    #[test]
    fn bad_sizes_are_refused() {
        let message = |w, h, n| Texture::from_rgba8(w, h, &vec![0; n]).unwrap_err().to_string();
        assert_eq!(message(0, 4, 0), "the image has 0 x 4 texels; each side must be 1 to 16384");
        assert_eq!(message(1, 70_000, 280_000), "the image has 1 x 70000 texels; each side must be 1 to 16384");
        assert_eq!(message(2, 2, 15), "an image of 2 x 2 texels needs 16 bytes, but 15 were given");
    }

    #[test]
    fn alpha_range_covers_all_texels() {
        assert_eq!(texture(3, 1, &[[0, 0, 0, 9], [0, 0, 0, 7], [0, 0, 0, 200]]).alpha_range(), (7, 200));
    }
}
