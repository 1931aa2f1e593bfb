//! Colour blocks: 16 colours in 64 bits, DXT1 without its transparency (paper section 3.5; spec section 8.1).

use bytemuck::{Pod, Zeroable};
use glam::Vec4;

use crate::values::lanes::{sum, sums, weights};

/// Sixteen colours: two references in RGB 5:6:5 and a two-bit interpolation index per colour.
///
/// ```text
/// low word   31..16 reference 1 | 15..0 reference 0   (red in bits 15..11, green 10..5, blue 4..0 of each)
/// high word  index of colour i in bits 2i+1..2i: 0 = ref0, 1 = ref1, 2 = (2 ref0 + ref1) / 3, 3 = (ref0 + 2 ref1) / 3
/// ```
///
/// A channel is decoded together with all the bits below it in the low word, which act as its fraction. Decoded
/// channels are sRGB-encoded intensities in `0.0..1.0`.
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

    /// Encodes these colours. `None` entries are unused and do not affect the result.
    ///
    /// Starts with the two colours furthest apart as references, then fits the references to the resulting indices by
    /// least squares and repeats as long as the error decreases.
    ///
    /// The root mean square error is at most twice that of an exhaustive search over the references plus 1.5 steps of
    /// 1/255; in most cases it is within a few hundredths of that of the search.
    pub fn encode(colors: &[Option<[u8; 3]>; 16]) -> Self {
        // Move the used colours to the front and give them a fourth byte of 1. Branchless, as the pattern of used
        // entries is unpredictable.
        let (mut words, mut places, mut count) = ([0u32; 24], [0u8; 16], 0);
        for (i, color) in colors.iter().enumerate() {
            let word = color.map_or(0, |[r, g, b]| u32::from_le_bytes([r, g, b, 1]));
            (words[count & 15], places[count & 15]) = (word, 2 * i as u8);
            count += (word >> 24) as usize;
        }
        match count {
            0 => Self::default(),
            1..=8 => search::<2>(&mut words, &places, count),
            _ => search::<4>(&mut words, &places, count),
        }
    }
}

/// A block's references and index for a single colour. Index 2 decodes to `(2 ref0 + ref1) / 3`, so `ref1` corrects a
/// third of `ref0`'s quantization error.
fn one_color(word: u32) -> (u32, u32) {
    let bytes = word.to_le_bytes();
    let wanted = [0, 1, 2].map(|k| wide(bytes[k]));
    let ref0 = quantize_first(wanted);
    let first = [ref0 << 16, ref0 << 21, ref0 << 27];
    let head = quantize_second([0, 1, 2].map(|k| 3 * wanted[k] - 2 * i64::from(first[k])), ref0);
    let off = palette(head).map(|p| (0..3).map(|k| (p[k] * 255.0 - f32::from(bytes[k])).powi(2)).sum::<f32>());
    let nearest = (1..4).fold(0, |best, k| if off[k] < off[best] { k } else { best });
    (head, nearest as u32)
}

/// Up to `4 G` colours, four per vector, in units of 1/255. Lanes after the last colour repeat the first and have
/// weight 0.
struct Texels<const G: usize> {
    channels: [[Vec4; G]; 3],
    weights: [Vec4; G],
    count: f32,
}

/// References, and the best index for every colour.
struct Assigned<const G: usize> {
    head: u32,
    /// Low and high bits of the indices.
    bits: [u32; 2],
    /// Weight of the second reference in each colour.
    shares: [Vec4; G],
    /// Sum of the squared errors.
    error: f32,
}

/// Squared distance in units of 1/255 of the two colours furthest apart, below which the mean of all colours in full
/// precision is tried as well.
const CLOSE: i32 = 160;
/// Mean squared error above which the first, second and third fit are done. Below the first value, rounding accounts
/// for most of the error.
const WORTH_FITTING: [f32; 3] = [8.0, 32.0, 32.0];

/// The block for the first `count` words. The index of word `k` is stored at bit `places[k]`.
fn search<const G: usize>(words: &mut [u32; 24], places: &[u8; 16], count: usize) -> ColorBlock {
    let (first, mut differ) = (words[0], 0);
    for (i, word) in words.iter_mut().take(4 * G).enumerate() {
        *word = if i < count { *word } else { first };
        differ |= *word ^ first;
    }
    if differ == 0 {
        let (head, index) = one_color(first);
        return ColorBlock { head, indices: places[..count].iter().fold(0, |indices, place| indices | index << place) };
    }
    // Repeat the first `2 G` words, so that `2 G` others follow every colour.
    words.copy_within(..2 * G, 4 * G);
    let mut lanes = [[0.0f32; 24]; 3];
    for i in 0..6 * G {
        lanes[0][i] = (words[i] & 255) as i32 as f32;
        lanes[1][i] = (words[i] >> 8 & 255) as i32 as f32;
        lanes[2][i] = (words[i] >> 16 & 255) as i32 as f32;
    }
    let (i, j) = furthest_pair::<G>(&lanes);
    let (a, b) = (words[i].to_le_bytes(), words[j].to_le_bytes());
    let texels = Texels::<G>::new(&lanes, count);
    let mut best = texels.assign(quantize_pair(a, b));
    let apart: i32 = (0..3).map(|k| (i32::from(a[k]) - i32::from(b[k])).pow(2)).sum();
    if apart < CLOSE {
        let third = std::array::from_fn(|g| texels.weights[g] * (1.0 / 3.0));
        let mean = texels.assign(texels.fit(&third));
        if mean.error < best.error {
            best = mean;
        }
    }
    for worth in WORTH_FITTING {
        if best.error <= worth * texels.count {
            break;
        }
        // Fit the references to the indices. Helps on gradients whose extremes are outliers.
        let fitted = texels.assign(texels.fit(&best.shares));
        if fitted.error >= best.error {
            break;
        }
        best = fitted;
    }
    let used = (1 << count) - 1;
    let codes = spread(best.bits[0] & used) | spread(best.bits[1] & used) << 1;
    let index = |k: usize| (codes >> (2 * k) & 3) << (places[k] & 31);
    ColorBlock { head: best.head, indices: (0..4 * G).fold(0, |indices, k| indices | index(k)) }
}

/// Indices of the two colours furthest apart among the first `4 G`. The next `2 G` lanes repeat the first ones.
fn furthest_pair<const G: usize>(lanes: &[[f32; 24]; 3]) -> (usize, usize) {
    let mut furthest = [Vec4::ZERO; G];
    let mut tag = Vec4::ZERO;
    for shift in 1..=2 * G {
        for (g, furthest) in furthest.iter_mut().enumerate() {
            let apart =
                |channel: &[f32; 24]| Vec4::from_slice(&channel[4 * g..]) - Vec4::from_slice(&channel[4 * g + shift..]);
            let (r, g, b) = (apart(&lanes[0]), apart(&lanes[1]), apart(&lanes[2]));
            // The squared distance is an integer below 2^18: with three more bits for the shift it is still exact.
            *furthest = furthest.max((r * r + g * g + b * b) * 8.0 + tag);
        }
        tag += Vec4::ONE;
    }
    let mut best = 0;
    for (g, furthest) in furthest.iter().enumerate() {
        for (k, key) in furthest.to_array().into_iter().enumerate() {
            best = best.max((key as u32) << 4 | (4 * g + k) as u32);
        }
    }
    let (i, shift) = ((best & 15) as usize, (best >> 4 & 7) as usize + 1);
    (i, (i + shift) % (4 * G))
}

impl<const G: usize> Texels<G> {
    fn new(lanes: &[[f32; 24]; 3], count: usize) -> Self {
        let mut texels = Self { channels: [[Vec4::ZERO; G]; 3], weights: weights(count as f32), count: count as f32 };
        for g in 0..G {
            for k in 0..3 {
                texels.channels[k][g] = Vec4::from_slice(&lanes[k][4 * g..]);
            }
        }
        texels
    }

    /// The best indices for given references. The four colours of the block lie on a line, so thresholds along the line
    /// decide which one is nearest.
    #[inline]
    fn assign(&self, head: u32) -> Assigned<G> {
        let [a, b] = references(head).map(|r| r.map(|c| c * 255.0));
        let d = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
        let along = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        let start = d[0] * a[0] + d[1] * a[1] + d[2] * a[2];
        let at = |part: f32| Vec4::splat(start + along * part);
        let (t1, t2, t3) = (at(1.0 / 6.0), at(0.5), at(5.0 / 6.0));
        let (mut bits, mut shares, mut error) = ([0; 2], [Vec4::ZERO; G], Vec4::ZERO);
        for g in 0..G {
            let c = [self.channels[0][g], self.channels[1][g], self.channels[2][g]];
            let t = c[0] * d[0] + c[1] * d[1] + c[2] * d[2];
            let (m1, m2, m3) = (t.cmpgt(t1), t.cmpgt(t2), t.cmpgt(t3));
            // Along the line the indices are 0, 2, 3, 1.
            bits[0] |= m2.bitmask() << (4 * g);
            bits[1] |= (m1.bitmask() ^ m3.bitmask()) << (4 * g);
            let third = |mask| Vec4::select(mask, Vec4::splat(1.0 / 3.0), Vec4::ZERO);
            let share = third(m1) + third(m2) + third(m3);
            let off = |k: usize| c[k] - (share * d[k] + Vec4::splat(a[k]));
            let (r, g_off, b) = (off(0), off(1), off(2));
            shares[g] = share * self.weights[g];
            error += (r * r + g_off * g_off + b * b) * self.weights[g];
        }
        Assigned { head, bits, shares, error: sum(error) }
    }

    /// References with the least squared error for these shares. The second reference is fitted to the rounded first.
    #[inline]
    fn fit(&self, shares: &[Vec4; G]) -> u32 {
        let (mut bs, mut bb) = (Vec4::ZERO, Vec4::ZERO);
        let (mut ax, mut bx) = ([Vec4::ZERO; 3], [Vec4::ZERO; 3]);
        for g in 0..G {
            let (b, a) = (shares[g], self.weights[g] - shares[g]);
            (bs, bb) = (bs + b, bb + b * b);
            for k in 0..3 {
                ax[k] += self.channels[k][g] * a;
                bx[k] += self.channels[k][g] * b;
            }
        }
        let (b, bb) = (sum(bs), sum(bb));
        let (ab, aa) = (b - bb, self.count - 2.0 * b + bb);
        let ax = sums(ax);
        let bx = sums(bx);
        let det = aa * bb - ab * ab;
        // If all shares are equal, the system is singular; use the mean.
        let (pa, pb) = if det < 1e-3 { (1.0 / self.count, -1.0 / self.count) } else { (bb / det, ab / det) };
        let part = |k: usize| wide_part(ax[k] * pa - bx[k] * pb);
        let ref0 = quantize_first([part(0), part(1), part(2)]);
        let [a, _] = references(ref0);
        let inverse = if bb > 0.0 { 1.0 / bb } else { 0.0 };
        let part = |k: usize| wide_part((bx[k] - a[k] * 255.0 * ab) * inverse);
        quantize_second([part(0), part(1), part(2)], ref0)
    }
}

/// Moves bit i to bit 2i.
fn spread(bits: u32) -> u32 {
    let bits = (bits | bits << 8) & 0x00ff_00ff;
    let bits = (bits | bits << 4) & 0x0f0f_0f0f;
    let bits = (bits | bits << 2) & 0x3333_3333;
    (bits | bits << 1) & 0x5555_5555
}

/// A channel in the decoder's integer units, `2^-32`.
fn wide(byte: u8) -> i64 {
    i64::from(byte) * 0x0101_0101
}

/// A channel in the decoder's integer units, from units of 1/255.
fn wide_part(steps: f32) -> i64 {
    (steps.clamp(0.0, 255.0) * 0x0101_0101 as f32) as i64
}

/// The low word for two colours. The blue field of the first reference has no bits below it and so tends to decode too
/// dark: the colour with less blue becomes the first reference.
fn quantize_pair(a: [u8; 4], b: [u8; 4]) -> u32 {
    let (a, b) = if a[2] > b[2] { (b, a) } else { (a, b) };
    let wide = |color: [u8; 4]| [wide(color[0]), wide(color[1]), wide(color[2])];
    quantize_second(wide(b), quantize_first(wide(a)))
}

/// The nearest value of a field of `bits` bits. `below` is the decoded channel with the field at zero.
fn field(wanted: i64, below: i64, bits: u32) -> i64 {
    ((wanted - below + (1 << (31 - bits))) >> (32 - bits)).clamp(0, (1 << bits) - 1)
}

/// The first reference. Each field is rounded with the fields below it known.
fn quantize_first(wanted: [i64; 3]) -> u32 {
    let b = field(wanted[2], 0, 5);
    let g = field(wanted[1], b << 21, 6);
    let r = field(wanted[0], g << 21 | b << 16, 5);
    (r << 11 | g << 5 | b) as u32
}

/// The low word with this first reference and a second, rounded in the same way.
fn quantize_second(wanted: [i64; 3], ref0: u32) -> u32 {
    let low = i64::from(ref0);
    let low = field(wanted[2], low << 11, 5) << 16 | low;
    let low = field(wanted[1], low << 5, 6) << 21 | low;
    (field(wanted[0], low, 5) << 27 | low) as u32
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
            // Several pairs may be equally far apart; the encoder may take any of them.
            let plain = furthest_pairs(&colors)
                .into_iter()
                .map(|(a, b)| error(with_references(&colors, quantize_pair(wide4(a), wide4(b))).0))
                .fold(0.0, f32::max);
            prop_assert!(error(ColorBlock::encode(&colors)) <= plain * 1.0001 + 1e-6);
        }

        #[test]
        fn indices_are_those_of_the_nearest_colours(colors in prop::array::uniform16(prop::option::of(prop::array::uniform3(any::<u8>())))) {
            let block = ColorBlock::encode(&colors);
            let error = |block: ColorBlock| {
                let of = |(i, c): (usize, &Option<[u8; 3]>)| {
                    let d = block.decode(i);
                    c.map_or(0.0, |c| (0..3).map(|k| (d[k] * 255.0 - f32::from(c[k])).powi(2)).sum::<f32>())
                };
                colors.iter().enumerate().map(of).sum::<f32>()
            };
            let least = with_references(&colors, block.head).1;
            prop_assert!(error(block) <= least * 1.0001 + 0.01, "{} instead of {least}", error(block));
            let unused = (0..16).filter(|i| colors[*i].is_none()).fold(0, |mask, i| mask | 3 << (2 * i));
            prop_assert_eq!(block.indices & unused, 0);
        }

        #[test]
        fn fields_are_the_nearest_for_the_bits_below_them(a in prop::array::uniform3(any::<u8>()), b in prop::array::uniform3(any::<u8>())) {
            let head = quantize_pair(wide4(a), wide4(b));
            let (a, b) = if a[2] > b[2] { (b, a) } else { (a, b) };
            let off = |head: u32, which: usize, k: usize, c: u8| (references(head)[which][k] * 255.0 - f32::from(c)).abs();
            for (which, color) in [(0, a), (1, b)] {
                for (k, shift, bits) in [(0, 11, 5), (1, 5, 6), (2, 0, 5)] {
                    let shift = shift + 16 * which as u32;
                    let others = head & !(((1 << bits) - 1) << shift);
                    let least = (0..1u32 << bits).map(|f| off(others | f << shift, which, k, color[k])).fold(f32::MAX, f32::min);
                    prop_assert!(off(head, which, k, color[k]) <= least + 1e-4);
                }
            }
        }
    }

    fn wide4([r, g, b]: [u8; 3]) -> [u8; 4] {
        [r, g, b, 1]
    }

    /// All pairs of colours with the largest distance.
    fn furthest_pairs(colors: &[Option<[u8; 3]>; 16]) -> Vec<([u8; 3], [u8; 3])> {
        let used: Vec<[u8; 3]> = colors.iter().flatten().copied().collect();
        let apart = |a: [u8; 3], b: [u8; 3]| (0..3).map(|k| u32::from(a[k].abs_diff(b[k])).pow(2)).sum::<u32>();
        let pairs = || used.iter().flat_map(|a| used.iter().map(|b| (*a, *b)));
        let furthest = pairs().map(|(a, b)| apart(a, b)).max();
        pairs().filter(|(a, b)| Some(apart(*a, *b)) == furthest).collect()
    }

    /// The best indices for given references, by trying all, and the squared error in units of 1/255.
    fn with_references(colors: &[Option<[u8; 3]>; 16], head: u32) -> (ColorBlock, f32) {
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
        (ColorBlock { head, indices }, error)
    }

    /// The references with the least squared error for these indices, by trying all pairs of every channel.
    fn exhaustive_references(colors: &[Option<[u8; 3]>; 16], indices: u32) -> u32 {
        const WEIGHT: [f32; 4] = [1.0, 0.0, 2.0 / 3.0, 1.0 / 3.0];
        let mut head = 0u32;
        for (k, bits, shift) in [(0, 5, 11), (1, 6, 5), (2, 5, 0)] {
            // Sums over the colours, computed once, so that a pair needs no loop over them.
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
            head |= u32::from(p) << shift | u32::from(q) << (shift + 16);
        }
        head
    }

    /// The least error found from every pair of colours as start, by exhaustive search for the references, repeated as
    /// long as the error decreases.
    fn thorough(colors: &[Option<[u8; 3]>; 16]) -> f32 {
        let used: Vec<[u8; 3]> = colors.iter().flatten().copied().collect();
        let mut least = f32::MAX;
        for (i, a) in used.iter().enumerate() {
            for b in &used[i..] {
                let mut best = with_references(colors, quantize_pair(wide4(*a), wide4(*b)));
                for _ in 0..6 {
                    let next = with_references(colors, exhaustive_references(colors, best.0.indices));
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
                // Either on a line, as with one colour under varying light, or anywhere in a box.
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
