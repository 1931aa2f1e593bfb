//! Colour textures as the recursion samples them.

use std::sync::Arc;

use glam::{Vec2, Vec3A};

use super::srgb::linear_of_srgb;
use crate::{MipLevel, Texture, Wrap};

/// A colour texture, with a faster path for opaque textures that repeat: all their texels have the same weight.
pub(crate) struct ColorMap {
    pub texture: Arc<Texture>,
    /// Whether the texture is opaque and repeats.
    fast: bool,
}

impl ColorMap {
    pub(crate) fn new(texture: Arc<Texture>) -> Self {
        let fast = texture.alpha_range().0 == 255 && texture.wrap == [Wrap::Repeat; 2];
        Self { texture, fast }
    }

    /// Linear RGB at `uv`, from the level of the mip chain whose texels are nearest to `footprint` (texels of the full
    /// texture) in size.
    pub(crate) fn sample(&self, uv: Vec2, footprint: f32) -> Vec3A {
        let mips = &self.texture.mips;
        let level = nearest_level(footprint).min(mips.len() - 1);
        if !self.fast {
            let [r, g, b, _] = self.texture.sample(uv.into(), (level as f32).exp2());
            return Vec3A::new(r, g, b);
        }
        bilinear(&mips[level], Vec2::new(fraction(uv.x), fraction(uv.y)), linear_of_srgb())
    }
}

/// The binary logarithm of `x`, rounded to the nearest integer; 0 below 1 and for NaN.
fn nearest_level(x: f32) -> usize {
    if x > 1.0 { ((x * std::f32::consts::SQRT_2).to_bits() >> 23) as usize - 127 } else { 0 }
}

/// Adding this to a number whose magnitude is below 2^22 rounds it to the nearest integer, in the low bits of the sum.
const ROUND: f32 = 12_582_912.0;

/// `x` minus the next lower integer; 0 if `x` is too large to have a fraction, or NaN.
fn fraction(x: f32) -> f32 {
    // Not `floor`, which is a library call without SSE4.1; and a saturating conversion takes several instructions.
    let off = x - ((x + ROUND) - ROUND);
    let f = if off < 0.0 { off + 1.0 } else { off };
    if (0.0..=1.0).contains(&f) { f } else { 0.0 }
}

/// Bilinear interpolation at `uv` in 0..=1, wrapping at the edges.
fn bilinear(mip: &MipLevel, uv: Vec2, table: &[f32; 256]) -> Vec3A {
    let (x0, x1, fx) = neighbours(uv.x, mip.width);
    let (y0, y1, fy) = neighbours(uv.y, mip.height);
    let texel = |x: usize, y: usize| {
        let [r, g, b, _] = mip.texels[y * mip.width as usize + x];
        Vec3A::new(table[r as usize], table[g as usize], table[b as usize])
    };
    let (a, b, c, d) = (texel(x0, y0), texel(x1, y0), texel(x0, y1), texel(x1, y1));
    let (top, bottom) = (a + (b - a) * fx, c + (d - c) * fx);
    top + (bottom - top) * fy
}

/// The two texels around `u` (in 0..=1) on an axis of `size` texels, and the interpolation weight of the second.
fn neighbours(u: f32, size: u32) -> (usize, usize, f32) {
    let x = u * size as f32 - 0.5;
    // The next lower integer, or one less if `x` is very close above an integer; the weight is then close to 1.
    let below = (x - 0.5 + ROUND) - ROUND;
    let first = ((x - 0.5 + ROUND).to_bits() & 0x7f_ffff) as i32 - 0x40_0000;
    let last = size as i32 - 1;
    let wrapped = if first < 0 { last } else { first.min(last) };
    let next = if wrapped == last { 0 } else { wrapped + 1 };
    (wrapped as usize, next as usize, x - below)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_short_way_gives_the_same_colours() {
        let texels: Vec<u8> = (0..13 * 6u32)
            .flat_map(|i| [(i * 37 % 256) as u8, (i * 91 % 256) as u8, (i * 5 % 256) as u8, 255])
            .collect();
        let map = ColorMap::new(Arc::new(Texture::from_rgba8(13, 6, &texels).unwrap()));
        assert!(map.fast);
        for i in -40..40 {
            for (footprint, level) in
                [(0.0, 1.0), (1.0, 1.0), (1.4, 1.0), (1.42, 2.0), (2.8, 2.0), (4.0, 4.0), (f32::INFINITY, 8.0)]
            {
                let uv = Vec2::new(i as f32 * 0.083, 3.0 - i as f32 * 0.117);
                let [r, g, b, _] = map.texture.sample(uv.into(), level);
                let found = map.sample(uv, footprint);
                assert!((found - Vec3A::new(r, g, b)).abs().max_element() < 2e-5, "{uv} {footprint}: {found}");
            }
        }
        for odd in [f32::MAX, -f32::MAX, 1e12, -0.0, -1e-30] {
            assert!(map.sample(Vec2::splat(odd), 2.0).is_finite(), "{odd}");
        }
    }
}
