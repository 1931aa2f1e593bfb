//! The 32-bit contour: a pair of parallel planes that bounds the surface in a voxel (paper section 3.2; spec section
//! 7).

use bytemuck::{Pod, Zeroable};

/// A contour as stored.
///
/// ```text
/// 31..25 thickness (unsigned) | 24..18 position | 17..12 nx | 11..6 ny | 5..0 nz   (signed)
/// ```
///
/// Each field is decoded together with all the bits below it, which act as its fraction. The contour is the slab
/// `|n·p - position| <= thickness / 2` in voxel units: `p` is measured from the centre of the voxel, whose edge is 1.
/// The normal is not of unit length; its components are within ±32 and not all zero (K004). A voxel is its cube, cut by
/// its own contour and by those of all its ancestors (spec 7).
#[repr(transparent)]
#[derive(Clone, Copy, PartialEq, Eq, Debug, Pod, Zeroable, serde::Serialize, serde::Deserialize)]
pub struct Contour(pub u32);

/// A decoded contour. All values are exact in `f64`; in `f32` they are exact up to its 24 bits of precision.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Slab {
    /// Plane normal, not normalised, components within ±32.
    pub normal: [f64; 3],
    /// `n·p` of the middle of the slab, `p` from the voxel's centre in voxel units.
    pub position: f64,
    /// Distance between the two planes in units of `n·p`.
    pub thickness: f64,
}

impl Slab {
    /// Smallest `n·p` inside the slab.
    pub fn lo(&self) -> f64 {
        self.position - self.thickness * 0.5
    }

    /// Largest `n·p` inside the slab.
    pub fn hi(&self) -> f64 {
        self.position + self.thickness * 0.5
    }
}

/// Bound on `n·p` within the voxel; a plane further out cannot cut it.
const MAX_BOUND: f64 = 48.0;
/// Units of the position and thickness fields, in `n·p`.
const UNIT: f64 = 0.75;

/// The nearest integer. `f64::round` would be a library call on targets without an instruction for it.
fn nearest(x: f64) -> i32 {
    (x + 0.5f64.copysign(x)) as i32
}

/// The smallest integer not below `x`, clamped to 0..=129; no library call either. Zero for NaN.
fn round_up(x: f64) -> u32 {
    let x = x.clamp(0.0, 128.5);
    let whole = x as u32;
    whole + u32::from(x > f64::from(whole))
}

impl Contour {
    /// The exact slab of this contour.
    pub fn decode(self) -> Slab {
        let word = self.0;
        let signed = |shift: u32, unit: f64| f64::from((word << shift) as i32) * unit;
        Slab {
            normal: [
                signed(14, 1.0 / (1 << 26) as f64),
                signed(20, 1.0 / (1 << 26) as f64),
                signed(26, 1.0 / (1 << 26) as f64),
            ],
            position: signed(7, UNIT / (1 << 25) as f64),
            thickness: f64::from(word) * (UNIT / (1 << 25) as f64),
        }
    }

    /// The contour normal closest to `direction` (any length above zero), as the low 18 bits of a contour.
    ///
    /// The largest component becomes ±31. Returns `None` for a direction that is zero or not finite.
    pub fn encode_normal(direction: [f64; 3]) -> Option<u32> {
        let largest = direction.iter().fold(0.0f64, |m, c| m.max(c.abs()));
        if !(largest > 0.0 && largest.is_finite()) {
            return None;
        }
        let scale = 31.0 / largest;
        let mut word = 0u32;
        for (axis, shift) in [(2, 0), (1, 6), (0, 12)] {
            let fraction = f64::from(word) / f64::from(1u32 << shift);
            let field = nearest(direction[axis] * scale - fraction).clamp(-32, 31);
            word |= ((field as u32) & 0x3f) << shift;
        }
        Some(word)
    }

    /// The decoded normal of the low 18 bits made by [`encode_normal`](Self::encode_normal).
    pub fn decode_normal(normal_bits: u32) -> [f64; 3] {
        Contour(normal_bits & 0x3ffff).decode().normal
    }

    /// The tightest contour with these normal bits that encloses `lo <= n·p <= hi`, where `n` is the *decoded* normal.
    ///
    /// Bounds are clamped to ±48, which no point of the voxel's cube reaches. The decoded slab always encloses the
    /// clamped bounds: the position is rounded to nearest, then the thickness is rounded up. `None` if the thickness
    /// exceeds the range of its field; no slab with this normal would cut the voxel then.
    pub fn encode_bounds(normal_bits: u32, lo: f64, hi: f64) -> Option<Contour> {
        let (lo, hi) = (lo.max(-MAX_BOUND), hi.min(MAX_BOUND));
        let mut word = normal_bits & 0x3ffff;
        let fraction = f64::from(word) / f64::from(1u32 << 18);
        let field = nearest((lo + hi) * 0.5 / UNIT - fraction).clamp(-64, 63);
        word |= ((field as u32) & 0x7f) << 18;
        let position = Contour(word).decode().position;
        let thickness = 2.0 * (position - lo).max(hi - position);
        let fraction = f64::from(word) / f64::from(1u32 << 25);
        let field = round_up(thickness / UNIT - fraction);
        (field <= 127).then_some(Contour(word | field << 25))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn axis_normals_are_exact() {
        let bits = Contour::encode_normal([0.0, 0.0, 2.0]).unwrap();
        assert_eq!(Contour::decode_normal(bits), [31.0 / 4096.0, 31.0 / 64.0, 31.0]);
        let bits = Contour::encode_normal([-5.0, 0.0, 0.0]).unwrap();
        assert_eq!(Contour::decode_normal(bits), [-31.0, 0.0, 0.0]);
        assert_eq!(Contour::encode_normal([0.0; 3]), None);
        assert_eq!(Contour::encode_normal([f64::NAN, 0.0, 0.0]), None);
    }

    #[test]
    fn rounding_up_is_that_of_the_library() {
        let values =
            [f64::NAN, f64::INFINITY, -f64::INFINITY, -1.0, -1e-300, -0.0, 0.0, 1e-300, 127.0, 127.0f64.next_up()];
        let steps = (-50..1400).map(|k| f64::from(k) / 10.0);
        let whole = (0..130).flat_map(|k| [f64::from(k).next_down(), f64::from(k), f64::from(k).next_up()]);
        for x in values.into_iter().chain(steps).chain(whole) {
            let up = x.ceil().max(0.0);
            assert_eq!(f64::from(round_up(x)), if up > 129.0 { 129.0 } else { up }, "{x}");
        }
    }

    proptest! {
        #[test]
        fn encoded_bounds_are_enclosed(n in prop::array::uniform3(-1.0f64..1.0), a in -48.0f64..48.0, b in -48.0f64..48.0) {
            prop_assume!(n.iter().any(|c| c.abs() > 1e-3));
            let bits = Contour::encode_normal(n).unwrap();
            let (lo, hi) = (a.min(b), a.max(b));
            if let Some(contour) = Contour::encode_bounds(bits, lo, hi) {
                let slab = contour.decode();
                prop_assert!(slab.lo() <= lo && slab.hi() >= hi, "{slab:?} must enclose {lo}..{hi}");
                prop_assert_eq!(slab.normal, Contour::decode_normal(bits));
                // Rounding the position adds half a unit on each side, rounding the thickness up to one unit.
                prop_assert!(slab.thickness <= hi - lo + 2.0 * UNIT);
            } else {
                prop_assert!(hi - lo > 126.0 * UNIT - 1.0);
            }
        }

        #[test]
        fn normals_keep_their_direction(n in prop::array::uniform3(-1.0f64..1.0)) {
            let length = n.iter().map(|c| c * c).sum::<f64>().sqrt();
            prop_assume!(length > 1e-3);
            let d = Contour::decode_normal(Contour::encode_normal(n).unwrap());
            let dot = n.iter().zip(d).map(|(a, b)| a * b).sum::<f64>();
            let cosine = dot / length / d.iter().map(|c| c * c).sum::<f64>().sqrt();
            // The error is half a unit per axis; the largest component is 31.
            prop_assert!(cosine > 0.9993, "{n:?} became {d:?}");
        }
    }
}
