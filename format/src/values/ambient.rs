//! Ambient occlusion blocks: 16 values in 64 bits, as two references and a three-bit weight per value (spec section
//! 8.4).

use bytemuck::{Pod, Zeroable};

/// Sixteen values of ambient light, each between two references.
///
/// ```text
/// bits 7..0    reference 1
/// bits 15..8   reference 0, decoded together with the bits below it
/// bits 16 + 3i .. 18 + 3i   weight of value i: 0 is reference 1, 7 is reference 0
/// ```
///
/// A value is the fraction of the ambient light that reaches the voxel, 0 to 1.
#[repr(transparent)]
#[derive(Clone, Copy, PartialEq, Eq, Debug, Pod, Zeroable, Default, serde::Serialize, serde::Deserialize)]
pub struct AmbientBlock(pub u64);

/// A stored weight is this times the weight of reference 0.
const STEPS: f32 = 7.0;

/// Starting points of the search for references: sixteenths of the range below its upper end and above its lower end.
const STARTS: [(i32, i32); 9] = [(0, 0), (1, 1), (2, 0), (0, 2), (1, 0), (0, 1), (2, 2), (2, 1), (1, 2)];

/// The references of the low 16 bits in units of 1/255.
fn references(head: u16) -> (f32, f32) {
    (f32::from(head) / 256.0, f32::from(head as u8))
}

/// The value of a weight in units of 1/255; can be slightly above 255.
fn mix((ref0, ref1): (f32, f32), weight: u32) -> f32 {
    (weight as f32 * ref0 + (STEPS - weight as f32) * ref1) / STEPS
}

/// Errors of a block: sum of squares and maximum, in units of 1/255.
#[derive(Clone, Copy)]
struct Cost {
    squares: f32,
    largest: f32,
}

impl AmbientBlock {
    /// Value `i` (0..16) in `0.0..=1.0`.
    pub fn decode(self, i: usize) -> f32 {
        (mix(references(self.0 as u16), self.weight(i)) / 255.0).min(1.0)
    }

    fn weight(self, i: usize) -> u32 {
        (self.0 >> (16 + 3 * i)) as u32 & 7
    }

    /// Encodes these values in units of 1/255. `None` entries are unused and do not affect the result.
    ///
    /// No decoded value is off by more than `(high - low + 1) / 14` units, where `low` and `high` are the least and the
    /// greatest value; equal values decode exactly. Within that bound the encoder searches for references with a small
    /// root mean square error: at most twice the optimum over all pairs of references plus half a unit, in most cases a
    /// few hundredths above the optimum.
    pub fn encode(values: &[Option<u8>; 16]) -> Self {
        let used = || values.iter().flatten().copied();
        let (Some(low), Some(high)) = (used().min(), used().max()) else { return Self::default() };
        if low == high {
            return Self(u64::from(u16::from_le_bytes([low, high])));
        }
        // With the ends of the range as references, a step is a seventh of the range (plus up to 1 for the fraction
        // bits), and no error exceeds half a step. References slightly inside or outside the range may be better.
        let bound = (f32::from(high - low) + 1.0) / 14.0;
        let part = |sixteenths: i32| (i32::from(high - low) * sixteenths + 8) >> 4;
        let mut best = Self::assign(values, (high.into(), low.into()));
        for (top, bottom) in STARTS {
            let mut block = Self::assign(values, (i32::from(high) - part(top), i32::from(low) + part(bottom)));
            for _ in 0..3 {
                let Some(fitted) = block.0.fit(values).map(|references| Self::assign(values, references)) else {
                    break;
                };
                if fitted.1.squares >= block.1.squares {
                    break;
                }
                block = fitted;
            }
            if block.1.squares < best.1.squares && block.1.largest <= bound {
                best = block;
            }
        }
        // Move one or both references by one step as long as the error decreases.
        loop {
            let (ref0, ref1) = best.0.head();
            let near = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, -1), (-1, 1)];
            let near = near.map(|(a, b)| Self::assign(values, (ref0 + a, ref1 + b)));
            let better = (near.into_iter().filter(|(_, cost)| cost.largest <= bound))
                .min_by(|a, b| a.1.squares.total_cmp(&b.1.squares));
            match better {
                Some(better) if better.1.squares < best.1.squares => best = better,
                _ => return best.0,
            }
        }
    }

    fn head(self) -> (i32, i32) {
        let [ref1, ref0, ..] = self.0.to_le_bytes();
        (ref0.into(), ref1.into())
    }

    /// The block with the best weights for these references, and its errors.
    fn assign(values: &[Option<u8>; 16], (ref0, ref1): (i32, i32)) -> (Self, Cost) {
        let head = u16::from_le_bytes([ref1.clamp(0, 255) as u8, ref0.clamp(0, 255) as u8]);
        let (ref0, ref1) = references(head);
        let scale = if ref0 == ref1 { 0.0 } else { STEPS / (ref0 - ref1) };
        let (mut block, mut cost) = (u64::from(head), Cost { squares: 0.0, largest: 0.0 });
        for (i, value) in values.iter().enumerate() {
            let Some(value) = value else { continue };
            let off = |weight: u32| (mix((ref0, ref1), weight).min(255.0) - f32::from(*value)).abs();
            let mut weight = ((f32::from(*value) - ref1) * scale + 0.5).clamp(0.0, STEPS) as u32;
            if ref0 > 255.0 {
                // Values above 255 are clamped, so the steps are not equal: try all weights.
                weight = (0..8).min_by(|a, b| off(*a).total_cmp(&off(*b))).unwrap_or(weight);
            }
            block |= u64::from(weight) << (16 + 3 * i);
            let error = off(weight);
            cost = Cost { squares: cost.squares + error * error, largest: cost.largest.max(error) };
        }
        (Self(block), cost)
    }

    /// References with the least squared error for the weights of this block. `None` if the weights do not determine
    /// them.
    fn fit(self, values: &[Option<u8>; 16]) -> Option<(i32, i32)> {
        let (mut aa, mut ab, mut bb, mut av, mut bv) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (i, value) in values.iter().enumerate() {
            let Some(value) = value else { continue };
            let (a, v) = (self.weight(i) as f32 / STEPS, f32::from(*value));
            let b = 1.0 - a;
            (aa, ab, bb, av, bv) = (aa + a * a, ab + a * b, bb + b * b, av + a * v, bv + b * v);
        }
        let determinant = aa * bb - ab * ab;
        if determinant < 1e-3 {
            return None;
        }
        let (ref0, ref1) = ((av * bb - bv * ab) / determinant, (bv * aa - av * ab) / determinant);
        Some(((ref0 - ref1 / 256.0).round() as i32, ref1.round() as i32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn squares(block: AmbientBlock, values: &[Option<u8>; 16]) -> f64 {
        let of = |(i, v): (usize, &Option<u8>)| {
            v.map_or(0.0, |v| (f64::from(block.decode(i)) * 255.0 - f64::from(v)).powi(2))
        };
        values.iter().enumerate().map(of).sum()
    }

    /// The least sum of squared errors over all pairs of references, with the best weight for each value.
    fn exhaustive(values: &[Option<u8>; 16]) -> f64 {
        let least = |head: u16| AmbientBlock::assign(values, ((head >> 8).into(), (head & 255).into())).1.squares;
        (0..=u16::MAX).map(least).fold(f32::MAX, f32::min).into()
    }

    fn values() -> impl Strategy<Value = [Option<u8>; 16]> {
        let centre = (any::<u8>(), 0u8..=128);
        centre.prop_flat_map(|(middle, spread)| {
            let (low, high) = (middle.saturating_sub(spread), middle.saturating_add(spread));
            prop::array::uniform16(prop::option::weighted(0.8, low..=high))
        })
    }

    proptest! {
        #[test]
        fn no_value_is_further_off_than_half_a_step_of_the_range(values in values()) {
            let block = AmbientBlock::encode(&values);
            let used = || values.iter().flatten().copied();
            let Some((low, high)) = used().min().zip(used().max()) else {
                prop_assert_eq!(block, AmbientBlock::default());
                return Ok(());
            };
            let bound = if low == high { 0.0 } else { (f32::from(high - low) + 1.0) / 14.0 };
            for (i, value) in values.iter().enumerate() {
                let Some(value) = value else { continue };
                let off = (block.decode(i) * 255.0 - f32::from(*value)).abs();
                prop_assert!(off <= bound + 1e-4, "{value} became {}, bound {bound}", block.decode(i) * 255.0);
            }
        }

        #[test]
        fn weights_are_the_best_for_their_references(values in values(), head: u16) {
            let block = AmbientBlock::assign(&values, ((head >> 8).into(), (head & 255).into())).0;
            for (i, value) in values.iter().enumerate().filter_map(|(i, v)| Some((i, f32::from((*v)?)))) {
                let off = |weight: u64| {
                    let other = block.0 & !(7 << (16 + 3 * i)) | weight << (16 + 3 * i);
                    (AmbientBlock(other).decode(i) * 255.0 - value).abs()
                };
                let best = (0..8).map(off).fold(f32::MAX, f32::min);
                prop_assert!((block.decode(i) * 255.0 - value).abs() <= best + 1e-3);
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 16, ..ProptestConfig::default() })]

        #[test]
        fn errors_are_near_the_least_that_there_are(values in values()) {
            let (found, best) = (squares(AmbientBlock::encode(&values), &values), exhaustive(&values));
            let count = values.iter().flatten().count() as f64;
            let mean = |squares: f64| (squares / count.max(1.0)).sqrt();
            prop_assert!(mean(found) <= 2.0 * mean(best) + 0.5, "{found} for {best}");
        }
    }

    #[test]
    fn the_bits_are_where_the_specification_says() {
        let block = AmbientBlock(0x0100 | 0x80 | 7 << 16 | 3 << 61);
        assert_eq!(block.decode(0), 1.5 / 255.0);
        assert_eq!(block.decode(1), 128.0 / 255.0);
        assert!((block.decode(15) - (3.0 * 1.5 + 4.0 * 128.0) / 7.0 / 255.0).abs() < 1e-7);
        assert_eq!(AmbientBlock(u64::MAX).decode(5), 1.0, "not more than all light");
    }
}
