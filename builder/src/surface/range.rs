//! Bounds of a texture's channels over boxes of texture coordinates, and which parts of a texture are holes. Both use
//! pyramids of minima and maxima.
//!
//! Detail that the finest voxels cannot show must not refine a coarser voxel. So the bounds are over texels averaged to the
//! size of the finest voxels, and there is one pyramid per mip level of the texture.

use glam::Vec2;

use crate::{LinearTexture, Texture, Wrap};

/// For every mip level a pyramid: its texels, and on each further level the bounds over 2 x 2 entries of the previous one,
/// down to one entry.
pub(crate) struct RangeMap<const N: usize> {
    pyramids: Vec<Vec<Level<N>>>,
    /// How the texture is read at coordinates outside 0..=1.
    wrap: [Wrap; 2],
}

/// One level of a pyramid: bounds in rows.
pub(crate) struct Level<const N: usize> {
    pub width: u32,
    pub height: u32,
    pub texels: Vec<Bounds<N>>,
}

/// Smallest and largest value of each channel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds<const N: usize> {
    /// The smallest values.
    pub min: [u8; N],
    /// The largest values.
    pub max: [u8; N],
}

impl<const N: usize> Bounds<N> {
    pub(crate) fn extend(&mut self, other: &Self) {
        for k in 0..N {
            self.min[k] = self.min[k].min(other.min[k]);
            self.max[k] = self.max[k].max(other.max[k]);
        }
    }
}

impl RangeMap<3> {
    /// Bounds of the sRGB-encoded colours of a texture.
    pub(crate) fn of_colors(texture: &Texture) -> Self {
        let bounds = |&[r, g, b, _]: &[u8; 4]| Bounds { min: [r, g, b], max: [r, g, b] };
        let base = |mip: &crate::MipLevel| (mip.width, mip.height, mip.texels.iter().map(bounds).collect());
        Self::new(texture.mips.iter().map(base), texture.wrap)
    }

    /// Bounds of linear channels, rounded outwards to 8 bits.
    pub(crate) fn of_channels(texture: &LinearTexture<3>) -> Self {
        let down = |c: u16| (c / 257) as u8;
        let up = |c: u16| c.div_ceil(257) as u8;
        let bounds = |t: &[u16; 3]| Bounds { min: t.map(down), max: t.map(up) };
        let base = |mip: &crate::LinearMip<3>| (mip.width, mip.height, mip.texels.iter().map(bounds).collect());
        Self::new(texture.mips.iter().map(base), texture.wrap)
    }
}

impl<const N: usize> RangeMap<N> {
    /// Builds the pyramids over mip levels given as width, height and texels.
    fn new(mips: impl Iterator<Item = (u32, u32, Vec<Bounds<N>>)>, wrap: [Wrap; 2]) -> Self {
        Self { pyramids: mips.map(|(width, height, texels)| pyramid(Level { width, height, texels })).collect(), wrap }
    }

    /// The coarsest mip level whose texels are not larger than `footprint` texels of the full image.
    fn mip(&self, footprint: f32) -> usize {
        (footprint.max(1.0).log2() as usize).min(self.pyramids.len() - 1)
    }

    /// Bounds over a box of texture coordinates, of any place and size, including the texels around it that filtering reads. The
    /// texels are averaged over `footprint` texels of the full image.
    pub(crate) fn in_box(&self, lo: Vec2, hi: Vec2, footprint: f32) -> Bounds<N> {
        let pyramid = &self.pyramids[self.mip(footprint)];
        let size = Vec2::new(pyramid[0].width as f32, pyramid[0].height as f32);
        let [wrap_u, wrap_v] = self.wrap;
        let (u, v) = (wrap_u.fold_range(lo.x, hi.x), wrap_v.fold_range(lo.y, hi.y));
        let (lo, hi) = (Vec2::new(u.0, v.0) * size - 0.5, Vec2::new(u.1, v.1) * size + 0.5);
        let extent = (hi - lo).max_element().max(1.0);
        // On this level the box spans at most three texels along each axis.
        let level = (extent.log2().floor().max(0.0) as usize).min(pyramid.len() - 1);
        let scale = 1.0 / (1u64 << level) as f32;
        let map = &pyramid[level];
        let first = (lo * scale).floor();
        let count = ((hi * scale).floor() - first).clamp(Vec2::ZERO, Vec2::splat(2.0));
        // On a level with a partly filled last texel, coordinates wrap up to one texel late; the next texel is then the one
        // needed. The loop visits both.
        let place = |dx: i64, dy: i64| {
            (wrap_u.texel(first.x as i64 + dx, map.width), wrap_v.texel(first.y as i64 + dy, map.height))
        };
        let (x, y) = place(0, 0);
        let mut bounds = map.at(x, y);
        for dy in 0..=count.y as i64 {
            for dx in 0..=count.x as i64 {
                let (x, y) = place(dx, dy);
                bounds.extend(&map.at(x, y));
            }
        }
        bounds
    }
}

/// The pyramid over one mip level.
pub(crate) fn pyramid<const N: usize>(base: Level<N>) -> Vec<Level<N>> {
    let mut levels = vec![base];
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

impl<const N: usize> Level<N> {
    pub(crate) fn at(&self, x: u32, y: u32) -> Bounds<N> {
        self.texels[(y * self.width + x) as usize]
    }
}

/// Which parts of a texture are holes, at every resolution.
///
/// With the same alpha limit on every mip level, thin leaves would vanish and narrow gaps would close as alpha is averaged
/// over larger texels. So every mip level has its own limit: the one that leaves the same share of its texels solid as in
/// the full image (rounded up, so that something is always left).
pub(crate) struct AlphaMap {
    range: RangeMap<1>,
    /// Per mip level the smallest alpha, 0..=255, that is solid.
    limits: Vec<f32>,
}

/// What a part of a surface with holes contains.
pub(crate) struct Parts {
    /// Some of it is solid.
    pub solid: bool,
    /// Some of it is hole.
    pub hole: bool,
}

impl AlphaMap {
    /// Texels with alpha below `least`, 0..=1, are holes.
    pub(crate) fn new(texture: &Texture, least: f32) -> Self {
        let bounds = |&[_, _, _, a]: &[u8; 4]| Bounds { min: [a], max: [a] };
        let base = |mip: &crate::MipLevel| (mip.width, mip.height, mip.texels.iter().map(bounds).collect());
        let solid = |a: u8| f32::from(a) / 255.0 >= least;
        let texels = &texture.mips[0].texels;
        let share = texels.iter().filter(|t| solid(t[3])).count() as f64 / texels.len() as f64;
        let mut limits: Vec<f32> = texture.mips.iter().map(|mip| limit(&mip.texels, share)).collect();
        // The limit of the full image is exactly the given one, even between two values of a byte.
        limits[0] = least * 255.0;
        Self { range: RangeMap::new(texture.mips.iter().map(base), texture.wrap), limits }
    }

    /// Whether nothing of the texture is solid.
    pub(crate) fn is_all_hole(&self) -> bool {
        f32::from(self.whole(0).max[0]) < self.limits[0]
    }

    /// Whether nothing of the texture is a hole.
    pub(crate) fn is_all_solid(&self) -> bool {
        f32::from(self.whole(0).min[0]) >= self.limits[0]
    }

    fn whole(&self, mip: usize) -> Bounds<1> {
        let top = &self.range.pyramids[mip];
        top[top.len() - 1].texels[0]
    }

    /// What a box of texture coordinates contains, with the same texels as [`RangeMap::in_box`].
    pub(crate) fn in_box(&self, lo: Vec2, hi: Vec2, footprint: f32) -> Parts {
        let limit = self.limits[self.range.mip(footprint)];
        let bounds = self.range.in_box(lo, hi, footprint);
        Parts { solid: f32::from(bounds.max[0]) >= limit, hole: f32::from(bounds.min[0]) < limit }
    }

    /// Whether the texture, averaged over `footprint` texels of the full image, has a hole at `uv`.
    pub(crate) fn is_hole(&self, uv: Vec2, footprint: f32) -> bool {
        let mip = self.range.mip(footprint);
        let map = &self.range.pyramids[mip][0];
        let [wrap_u, wrap_v] = self.range.wrap;
        // Of a repeated texture, the texels wrap.
        let folded = |wrap: Wrap, x: f32| if wrap == Wrap::Repeat { x } else { wrap.fold(x) };
        let uv = Vec2::new(folded(wrap_u, uv.x), folded(wrap_v, uv.y));
        let p = uv * Vec2::new(map.width as f32, map.height as f32) - 0.5;
        let (cell, f) = (p.floor(), p - p.floor());
        let alpha = |dx: i64, dy: i64| {
            let x = wrap_u.texel(cell.x as i64 + dx, map.width);
            let y = wrap_v.texel(cell.y as i64 + dy, map.height);
            f32::from(map.at(x, y).max[0])
        };
        let low = alpha(0, 0) * (1.0 - f.x) + alpha(1, 0) * f.x;
        let high = alpha(0, 1) * (1.0 - f.x) + alpha(1, 1) * f.x;
        low * (1.0 - f.y) + high * f.y < self.limits[mip]
    }
}

/// The largest alpha that at least this share of the texels reach; 256 if the share is zero.
fn limit(texels: &[[u8; 4]], share: f64) -> f32 {
    let mut histogram = [0usize; 256];
    texels.iter().for_each(|t| histogram[t[3] as usize] += 1);
    let wanted = (share * texels.len() as f64).ceil() as usize;
    let mut reached = 0;
    for alpha in (0..256).rev() {
        if reached >= wanted {
            return (alpha + 1) as f32;
        }
        reached += histogram[alpha];
    }
    0.0
}
