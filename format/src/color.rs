//! Colour blocks: 16 colours in 64 bits, DXT1 without its transparency (paper section 3.5; spec section 8.1).

use bytemuck::{Pod, Zeroable};

/// Sixteen colours: two references in RGB 5:6:5 and a two-bit interpolation index per colour.
///
/// ```text
/// low word   31..16 reference 1 | 15..0 reference 0   (red in bits 15..11, green 10..5, blue 4..0 of each)
/// high word  index of colour i in bits 2i+1..2i: 0 = ref0, 1 = ref1, 2 = (2 ref0 + ref1) / 3, 3 = (ref0 + 2 ref1) / 3
/// ```
///
/// Channels are decoded together with all the bits below them in the low word, which act as their fraction. Decoded
/// channels are in `0.0..1.0` and mean sRGB-encoded intensity.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, Debug, Pod, Zeroable, Default, serde::Serialize, serde::Deserialize)]
pub struct ColorBlock {
    /// The two references.
    pub head: u32,
    /// The sixteen indices.
    pub indices: u32,
}

const INV: f32 = 1.0 / 4294967296.0;

fn references(head: u32) -> [[f32; 3]; 2] {
    let channels = |r: u32, g: u32, b: u32| [r as f32 * INV, g as f32 * INV, b as f32 * INV];
    [channels(head << 16, head << 21, head << 27), channels(head, head << 5, head << 11)]
}

/// The four colours a block can express.
fn palette(head: u32) -> [[f32; 3]; 4] {
    let [a, b] = references(head);
    let mix = |wa: f32, wb: f32| std::array::from_fn(|i| a[i] * wa + b[i] * wb);
    [a, b, mix(2.0 / 3.0, 1.0 / 3.0), mix(1.0 / 3.0, 2.0 / 3.0)]
}

impl ColorBlock {
    /// Colour `i` (0..16), each channel in `0.0..1.0`.
    pub fn decode(self, i: usize) -> [f32; 3] {
        palette(self.head)[(self.indices >> (2 * i) & 3) as usize]
    }

    /// A block for these colours: with the two furthest apart as references, or with a fit of least squares for the indices
    /// that these give, if that is better. `None` entries are unused and cost nothing.
    ///
    /// The root of the mean square of the errors is at most twice that which an exhaustive search over the references
    /// finds, and 1.5 steps of 255; in most cases within a few hundredths of it.
    pub fn encode(colors: &[Option<[u8; 3]>; 16]) -> Self {
        let mut used = colors.iter().flatten();
        let Some(&first) = used.next() else { return Self::default() };
        let (mut a, mut b) = (first, first);
        if used.any(|c| *c != first) {
            (a, b) = furthest_pair(colors);
        }
        let refs = [quantize(a), quantize(b)];
        let mut best = Self::with_references(colors, refs[0], refs[1]);
        if a != b {
            // Least squares for the references given the indices: pays on gradients, where the extremes are outliers.
            let (block, error) = best;
            if let Some((a, b)) = fit_references(colors, block.indices) {
                let fitted = Self::with_references(colors, quantize(a), quantize(b));
                if fitted.1 < error {
                    best = fitted;
                }
            }
        }
        best.0
    }

    /// Best indices for given references, and the squared error.
    fn with_references(colors: &[Option<[u8; 3]>; 16], ref0: u16, ref1: u16) -> (Self, f32) {
        let head = (ref1 as u32) << 16 | ref0 as u32;
        let palette = palette(head).map(|c| c.map(|x| x * 255.0));
        let (mut indices, mut error) = (0, 0.0);
        for (i, color) in colors.iter().enumerate() {
            let Some(color) = color else { continue };
            let distance = |p: &[f32; 3]| (0..3).map(|k| (p[k] - color[k] as f32).powi(2)).sum::<f32>();
            let (index, d) =
                (0..4).map(|k| (k, distance(&palette[k]))).min_by(|x, y| x.1.total_cmp(&y.1)).unwrap_or((0, 0.0));
            indices |= (index as u32) << (2 * i);
            error += d;
        }
        (Self { head, indices }, error)
    }
}

fn furthest_pair(colors: &[Option<[u8; 3]>; 16]) -> ([u8; 3], [u8; 3]) {
    let mut best = (0, [0; 3], [0; 3]);
    for (i, a) in colors.iter().enumerate() {
        let Some(a) = a else { continue };
        for b in colors[i + 1..].iter().flatten() {
            let d: i32 = (0..3).map(|k| (a[k] as i32 - b[k] as i32).pow(2)).sum();
            if d > best.0 {
                best = (d, *a, *b);
            }
        }
    }
    (best.1, best.2)
}

/// References that minimise the squared error for fixed indices, or `None` where the indices do not tell them apart.
fn fit_references(colors: &[Option<[u8; 3]>; 16], indices: u32) -> Option<([u8; 3], [u8; 3])> {
    const WEIGHT: [f32; 4] = [1.0, 0.0, 2.0 / 3.0, 1.0 / 3.0];
    let (mut aa, mut ab, mut bb) = (0.0, 0.0, 0.0);
    let (mut ax, mut bx) = ([0.0f32; 3], [0.0f32; 3]);
    for (i, color) in colors.iter().enumerate() {
        let Some(color) = color else { continue };
        let wa = WEIGHT[(indices >> (2 * i) & 3) as usize];
        let wb = 1.0 - wa;
        (aa, ab, bb) = (aa + wa * wa, ab + wa * wb, bb + wb * wb);
        for k in 0..3 {
            ax[k] += wa * color[k] as f32;
            bx[k] += wb * color[k] as f32;
        }
    }
    let det = aa * bb - ab * ab;
    if det < 1e-3 {
        return None;
    }
    let a = std::array::from_fn(|k| ((ax[k] * bb - bx[k] * ab) / det).round().clamp(0.0, 255.0) as u8);
    let b = std::array::from_fn(|k| ((bx[k] * aa - ax[k] * ab) / det).round().clamp(0.0, 255.0) as u8);
    Some((a, b))
}

/// Nearest 5:6:5 value under the decoder's scale, where field `f` of `n` bits means `f / 2^n` and a little more.
fn quantize(c: [u8; 3]) -> u16 {
    let field = |v: u8, bits: u32| {
        let levels = (1u32 << bits) as f32;
        // The bits below add half a unit on average.
        (v as f32 / 255.0 * levels - 0.5).round().clamp(0.0, levels - 1.0) as u16
    };
    field(c[0], 5) << 11 | field(c[1], 6) << 5 | field(c[2], 5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn one_colour_comes_back_within_a_quantization_step(c in prop::array::uniform3(any::<u8>()), n in 1usize..16) {
            let mut colors = [None; 16];
            colors[..n].fill(Some(c));
            let block = ColorBlock::encode(&colors);
            for i in 0..n {
                let d = block.decode(i);
                for k in 0..3 {
                    let step = if k == 1 { 64.0 } else { 32.0 };
                    prop_assert!((d[k] - c[k] as f32 / 255.0).abs() <= 1.01 / step, "{c:?} became {d:?}");
                }
            }
        }

        #[test]
        fn a_block_is_no_worse_than_the_two_furthest_colours(colors in prop::array::uniform16(prop::option::of(prop::array::uniform3(any::<u8>())))) {
            let error = |block: ColorBlock| {
                let of = |(i, c): (usize, &Option<[u8; 3]>)| {
                    let d = block.decode(i);
                    c.map_or(0.0, |c| (0..3).map(|k| (d[k] - f32::from(c[k]) / 255.0).powi(2)).sum::<f32>())
                };
                colors.iter().enumerate().map(of).sum::<f32>()
            };
            prop_assume!(colors.iter().flatten().count() > 0);
            let (a, b) = furthest_pair(&colors);
            let plain = ColorBlock::with_references(&colors, quantize(a), quantize(b)).0;
            prop_assert!(error(ColorBlock::encode(&colors)) <= error(plain) * 1.0001 + 1e-6);
        }
    }

    /// The references with the least squares for these indices, each channel by trying all of its pairs.
    fn exhaustive_references(colors: &[Option<[u8; 3]>; 16], indices: u32) -> (u16, u16) {
        const WEIGHT: [f32; 4] = [1.0, 0.0, 2.0 / 3.0, 1.0 / 3.0];
        let (mut ref0, mut ref1) = (0u16, 0u16);
        for (k, bits, shift) in [(0, 5, 11), (1, 6, 5), (2, 5, 0)] {
            // Sums over the colours, so that a pair takes no loop over them.
            let (mut aa, mut ab, mut bb, mut av, mut bv) = (0.0, 0.0, 0.0, 0.0, 0.0);
            for (i, color) in colors.iter().enumerate() {
                let Some(color) = color else { continue };
                let (a, v) = (WEIGHT[(indices >> (2 * i) & 3) as usize], f32::from(color[k]) / 255.0);
                let b = 1.0 - a;
                (aa, ab, bb, av, bv) = (aa + a * a, ab + a * b, bb + b * b, av + a * v, bv + b * v);
            }
            let value = |field: u16| (f32::from(field) + 0.5) / f32::from(1u16 << bits);
            let cost = |(p, q): (u16, u16)| {
                let (p, q) = (value(p), value(q));
                aa * p * p + 2.0 * ab * p * q + bb * q * q - 2.0 * (av * p + bv * q)
            };
            let pairs = (0..1u16 << bits).flat_map(|p| (0..1u16 << bits).map(move |q| (p, q)));
            let (p, q) = pairs.min_by(|a, b| cost(*a).total_cmp(&cost(*b))).unwrap();
            (ref0, ref1) = (ref0 | p << shift, ref1 | q << shift);
        }
        (ref0, ref1)
    }

    /// What an encoder finds that starts from every pair of the colours, tries all references for the indices, and goes on
    /// as long as that is better.
    fn thorough(colors: &[Option<[u8; 3]>; 16]) -> f32 {
        let used: Vec<[u8; 3]> = colors.iter().flatten().copied().collect();
        let mut least = f32::MAX;
        for (i, a) in used.iter().enumerate() {
            for b in &used[i..] {
                let mut best = ColorBlock::with_references(colors, quantize(*a), quantize(*b));
                for _ in 0..6 {
                    let (ref0, ref1) = exhaustive_references(colors, best.0.indices);
                    let next = ColorBlock::with_references(colors, ref0, ref1);
                    if next.1 >= best.1 {
                        break;
                    }
                    best = next;
                }
                least = least.min(best.1);
            }
        }
        least
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 16, ..ProptestConfig::default() })]

        #[test]
        fn errors_are_near_those_of_a_thorough_search(
            base in prop::array::uniform3(0u8..128), spread in 1u8..128, grey: bool,
            parts in prop::array::uniform16(prop::option::weighted(0.5, prop::array::uniform3(0u8..=255))),
        ) {
            let channel = |base: u8, part: u8| base + (u16::from(part) * u16::from(spread) / 255) as u8;
            let colors = parts.map(|part| {
                // On a line, as where one colour is lit more and less, or anywhere in a box.
                part.map(|part| [0, 1, 2].map(|k| channel(base[k], if grey { part[0] } else { part[k] })))
            });
            prop_assume!(colors.iter().flatten().count() > 0);
            let count = 3.0 * colors.iter().flatten().count() as f32;
            let of = |(i, color): (usize, &Option<[u8; 3]>)| {
                let found = ColorBlock::encode(&colors).decode(i);
                color.map_or(0.0, |c| (0..3).map(|k| (found[k] * 255.0 - f32::from(c[k])).powi(2)).sum::<f32>())
            };
            let ours = (colors.iter().enumerate().map(of).sum::<f32>() / count).sqrt();
            let best = (thorough(&colors) / count).sqrt();
            prop_assert!(ours <= 2.0 * best + 1.5, "{ours} for {best} of 255");
        }
    }

    #[test]
    fn two_colours_are_both_kept() {
        let mut colors = [None; 16];
        colors[3] = Some([255, 0, 0]);
        colors[9] = Some([0, 0, 255]);
        let block = ColorBlock::encode(&colors);
        assert!(block.decode(3)[0] > 0.95 && block.decode(3)[2] < 0.05);
        assert!(block.decode(9)[2] > 0.95 && block.decode(9)[0] < 0.05);
    }
}
