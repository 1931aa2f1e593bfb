//! sRGB-encoded bytes to linear light and back, by tables.

use std::sync::LazyLock;

use esvo_format::srgb;
use glam::Vec3;

/// Linear value of every sRGB-encoded byte.
static TO_LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| std::array::from_fn(|i| srgb::decode(i as f32 / 255.0)));

/// Linear value of every sRGB-encoded byte.
pub(crate) fn linear_of_srgb() -> &'static [f32; 256] {
    &TO_LINEAR
}

/// sRGB-encoded value of linear `i / 4095`.
static TO_SRGB: LazyLock<Vec<u8>> =
    LazyLock::new(|| (0..4096).map(|i| (srgb::encode(i as f32 / 4095.0) * 255.0).round() as u8).collect());

/// Linear RGB of sRGB-encoded bytes.
pub(crate) fn decode_srgb(c: [u8; 3]) -> Vec3 {
    Vec3::from(c.map(|c| TO_LINEAR[c as usize]))
}

/// sRGB-encoded bytes of linear RGB, clamped to 0..=1. Within one step of exact.
pub(crate) fn encode_srgb(c: Vec3) -> [u8; 3] {
    // The conversion to an integer saturates: negative values and NaN become 0.
    (c * 4095.0 + 0.5).to_array().map(|i| TO_SRGB[usize::from(i as u16).min(4095)])
}
