//! Bounds of a texture's colours over boxes of texture coordinates, from pyramids of minima and maxima.
//!
//! What the finest voxels cannot show is of no interest to a coarser one: the bounds are over texels averaged to the size
//! of the finest voxels, so there is one pyramid per mip level of the texture.

use std::sync::LazyLock;

use glam::{Vec2, Vec3};

use crate::{MipLevel, Texture};

/// For every mip level, least and greatest texel of every texel's area on every level down to one texel.
pub struct RangeMap {
    pyramids: Vec<Vec<Level>>,
}

struct Level {
    width: u32,
    height: u32,
    texels: Vec<Bounds8>,
}

#[derive(Clone, Copy)]
struct Bounds8 {
    min: [u8; 3],
    max: [u8; 3],
    max_alpha: u8,
}

/// Bounds of linear colour, and the greatest alpha.
pub struct Bounds {
    /// Least value of each channel.
    pub min: Vec3,
    /// Greatest value of each channel.
    pub max: Vec3,
    /// Greatest alpha.
    pub max_alpha: f32,
}

impl RangeMap {
    /// Builds the pyramids.
    pub fn new(texture: &Texture) -> Self {
        Self { pyramids: texture.mips.iter().map(pyramid).collect() }
    }

    /// Bounds over a box of texture coordinates, which wrap, and the texels that filtering reaches around it.
    /// Texels are averaged over `footprint` texels of the full image.
    pub fn in_box(&self, lo: Vec2, hi: Vec2, footprint: f32) -> Bounds {
        let mip = (footprint.max(1.0).log2() as usize).min(self.pyramids.len() - 1);
        let pyramid = &self.pyramids[mip];
        let size = Vec2::new(pyramid[0].width as f32, pyramid[0].height as f32);
        let (lo, hi) = (lo * size - 0.5, hi * size + 0.5);
        let extent = (hi - lo).max_element().max(1.0);
        // On this level the box spans at most three texels each way.
        let level = (extent.log2().floor().max(0.0) as usize).min(pyramid.len() - 1);
        let scale = 1.0 / (1u64 << level) as f32;
        let map = &pyramid[level];
        let first = (lo * scale).floor();
        let count = ((hi * scale).floor() - first).clamp(Vec2::ZERO, Vec2::splat(2.0));
        let mut bounds: Option<Bounds8> = None;
        for dy in 0..=count.y as i64 {
            for dx in 0..=count.x as i64 {
                // Texels of the base wrap; on the last, partly filled texel of a level they wrap a little late, so its
                // neighbour is what matters, and both are visited.
                let x = (first.x as i64 + dx).rem_euclid(i64::from(map.width)) as u32;
                let y = (first.y as i64 + dy).rem_euclid(i64::from(map.height)) as u32;
                let texel = map.at(x, y);
                match &mut bounds {
                    Some(b) => b.extend(&texel),
                    None => bounds = Some(texel),
                }
            }
        }
        let b = bounds.unwrap_or(map.texels[0]);
        Bounds { min: decode_srgb(b.min), max: decode_srgb(b.max), max_alpha: f32::from(b.max_alpha) / 255.0 }
    }
}

/// The pyramid over one mip level.
fn pyramid(base: &MipLevel) -> Vec<Level> {
    let texels = base.texels.iter().map(|&[r, g, b, a]| Bounds8 { min: [r, g, b], max: [r, g, b], max_alpha: a });
    let mut levels = vec![Level { width: base.width, height: base.height, texels: texels.collect() }];
    while let Some(last) = levels.last().filter(|l| l.width > 1 || l.height > 1) {
        let (width, height) = (last.width.div_ceil(2), last.height.div_ceil(2));
        let mut texels = Vec::with_capacity((width * height) as usize);
        for y in 0..height {
            for x in 0..width {
                let (x1, y1) = ((2 * x + 1).min(last.width - 1), (2 * y + 1).min(last.height - 1));
                let mut bounds = last.at(2 * x, 2 * y);
                for (x, y) in [(x1, 2 * y), (2 * x, y1), (x1, y1)] {
                    bounds.extend(&last.at(x, y));
                }
                texels.push(bounds);
            }
        }
        levels.push(Level { width, height, texels });
    }
    levels
}

impl Level {
    fn at(&self, x: u32, y: u32) -> Bounds8 {
        self.texels[(y * self.width + x) as usize]
    }
}

impl Bounds8 {
    fn extend(&mut self, other: &Self) {
        for k in 0..3 {
            self.min[k] = self.min[k].min(other.min[k]);
            self.max[k] = self.max[k].max(other.max[k]);
        }
        self.max_alpha = self.max_alpha.max(other.max_alpha);
    }
}

static TO_LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|i| {
        let c = i as f32 / 255.0;
        if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    })
});

/// sRGB-encoded value of linear `i / 4095`.
static TO_SRGB: LazyLock<Vec<u8>> = LazyLock::new(|| {
    (0..4096)
        .map(|i| {
            let c = i as f32 / 4095.0;
            let s = if c <= 0.0031308 { c * 12.92 } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 };
            (s * 255.0).round() as u8
        })
        .collect()
});

/// Linear RGB of sRGB-encoded bytes.
pub fn decode_srgb(c: [u8; 3]) -> Vec3 {
    Vec3::from(c.map(|c| TO_LINEAR[c as usize]))
}

/// sRGB-encoded bytes of linear RGB, clamped to 0..=1. Within one step of exact.
pub fn encode_srgb(c: Vec3) -> [u8; 3] {
    (c.clamp(Vec3::ZERO, Vec3::ONE) * 4095.0 + 0.5).to_array().map(|i| TO_SRGB[i as usize])
}
