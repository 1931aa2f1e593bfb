//! The transfer functions of sRGB (IEC 61966-2-1): between encoded values and linear light, both in `0.0..=1.0`.

/// Linear light of an sRGB-encoded value.
pub fn decode(encoded: f32) -> f32 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// [`decode`] in double precision.
///
/// The builder filters textures with this function and tabulates colours with [`decode`]. Rounded to `f32`, the results
/// of the two differ in the last bits for most bytes, so neither can replace the other without changing files.
pub fn decode_f64(encoded: f64) -> f64 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// The sRGB encoding of linear light. Values outside `0.0..=1.0` are clamped.
pub fn encode(linear: f32) -> f32 {
    let linear = linear.clamp(0.0, 1.0);
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values() {
        assert!((decode(0.5) - 0.214_041_14).abs() < 1e-7);
        assert!((decode_f64(0.5) - 0.214_041_140_482_232_5).abs() < 1e-15);
        assert!((encode(0.5) - 0.735_357).abs() < 1e-6);
        assert_eq!((decode(0.0), decode(1.0), decode_f64(1.0)), (0.0, 1.0, 1.0));
        assert_eq!(decode(0.04), 0.04 / 12.92, "the linear part");
        assert_eq!((encode(-1.0), encode(7.0)), (0.0, encode(1.0)));
        assert!((encode(1.0) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn encoding_undoes_decoding() {
        for byte in 0..=255u8 {
            let encoded = f32::from(byte) / 255.0;
            assert!((encode(decode(encoded)) - encoded).abs() < 1e-5);
            assert!((f64::from(decode(encoded)) - decode_f64(f64::from(byte) / 255.0)).abs() < 1e-6);
        }
    }

    #[test]
    fn the_precisions_differ_in_last_bits() {
        let differing = (0..=255u8)
            .filter(|&byte| decode(f32::from(byte) / 255.0) != decode_f64(f64::from(byte) / 255.0) as f32)
            .count();
        assert_ne!(differing, 0, "then one function would do");
    }
}
