//! The method of the paper's authors. Colours: the references are the two colours furthest apart. Normals: the base is
//! the mean of the normals, one axis points to the normal furthest from it, the other to the normal with the largest
//! remaining error. Fields are rounded as well as in our encoder, so that only the choice of the values is compared.

use esvo_format::{ColorBlock, NormalBlock, RawNormal};
use glam::Vec3;

use super::blocks::{Colors, Normals};

/// A reference: each channel is rounded to nearest with the bits below it in `head` known.
fn reference(color: [u8; 3], below: u32, shifts: [u32; 3]) -> u32 {
    let mut head = below;
    // Blue, green, red: width and position in the reference.
    for (channel, bits, at) in [(2, 5, 0), (1, 6, 5), (0, 5, 11)] {
        let at = at + 16 - shifts[0];
        let word = |field: u32| (head | field << at) << shifts[channel];
        let wanted = i64::from(color[channel]) * 0x0101_0101;
        let off = |field: &u32| (i64::from(word(*field)) - wanted).abs();
        head |= (0..1u32 << bits).min_by_key(off).unwrap_or(0) << at;
    }
    head
}

/// Encodes colours.
pub(crate) fn colors(colors: &Colors) -> ColorBlock {
    let used: Vec<[u8; 3]> = colors.iter().flatten().copied().collect();
    let Some(&first) = used.first() else { return ColorBlock::default() };
    let apart = |a: [u8; 3], b: [u8; 3]| (0..3).map(|k| u32::from(a[k].abs_diff(b[k])).pow(2)).sum::<u32>();
    let mut furthest = (0, first, first);
    for (i, &a) in used.iter().enumerate() {
        for &b in &used[i..] {
            if apart(a, b) > furthest.0 {
                furthest = (apart(a, b), a, b);
            }
        }
    }
    let head = reference(furthest.1, 0, [16, 21, 27]);
    let head = reference(furthest.2, head, [0, 5, 11]);
    let mut indices = 0;
    for (i, color) in colors.iter().enumerate() {
        let Some(color) = color else { continue };
        let off = |index: &u32| {
            let found = ColorBlock { head, indices: *index }.decode(0);
            (0..3).map(|k| (found[k] - f32::from(color[k]) / 255.0).powi(2)).sum::<f32>()
        };
        indices |= (0..4).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(0) << (2 * i);
    }
    ColorBlock { head, indices }
}

/// A raw normal, with fractions truncated.
fn raw(n: Vec3) -> RawNormal {
    let n = n.to_array();
    let mut axis = 0;
    for k in 1..3 {
        if n[k].abs() > n[axis].abs() {
            axis = k;
        }
    }
    let main = n[axis].abs().max(1e-30);
    let u = ((n[(axis + 1) % 3] / main * 16383.0) as i32).clamp(-16384, 16383) as u32 & 0x7fff;
    let v = ((n[(axis + 2) % 3] / main * 8191.0) as i32).clamp(-8192, 8191) as u32 & 0x3fff;
    RawNormal(u32::from(n[axis] < 0.0) << 31 | (axis as u32) << 29 | u << 14 | v)
}

/// The 16 bits of an axis. `below` are the bits below it.
fn axis(v: Vec3, below: u32) -> u32 {
    let unit = |exponent: u32| 2f32.powi(exponent as i32 - 13);
    let exponent = (0..15).find(|e| v.abs().max_element() <= 7.4 * unit(*e)).unwrap_or(15);
    let mut word = exponent << 16 | below;
    for (component, at) in [(v.z, 20u32), (v.y, 24), (v.x, 28)] {
        let fraction = word as f32 / 2f32.powi(at as i32);
        word |= ((component / unit(exponent) - fraction).round().clamp(-8.0, 7.0) as i32 as u32 & 15) << at;
    }
    word >> 16
}

/// For each texel the best point of the grid with the axes so far, and its pair of indices.
fn nearest(block: &NormalBlock, n: Vec3) -> (u32, u32, Vec3) {
    let mut best = (0, 0, Vec3::ZERO, f32::MIN);
    for (u, v) in (0..16).map(|k| (k & 3, k >> 2)) {
        let found = NormalBlock { u_indices: u, v_indices: v, ..*block }.decode(0);
        if found.dot(n) > best.3 {
            best = (u, v, found, found.dot(n));
        }
    }
    (best.0, best.1, best.2)
}

/// Encodes normals.
pub(crate) fn normals(normals: &Normals) -> NormalBlock {
    let used: Vec<Vec3> = normals.iter().flatten().copied().collect();
    if used.is_empty() {
        return NormalBlock::default();
    }
    let closest = |to: Vec3| used.iter().copied().max_by(|a, b| a.dot(to).total_cmp(&b.dot(to))).unwrap_or(Vec3::Z);
    let mut mean: Vec3 = used.iter().sum();
    if mean.length() < 0.1 * used.len() as f32 {
        mean = closest(mean);
    }
    let mut block = NormalBlock { base: raw(mean), ..NormalBlock::default() };
    let length = block.base.decode_point().length();
    for half in 0..2 {
        let off = |n: &Vec3| nearest(&block, *n).2.dot(*n);
        let worst = used.iter().copied().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(Vec3::Z);
        let (u, v, ..) = nearest(&block, worst);
        // The grid point, not normalised.
        let c = [-1.0, -1.0 / 3.0, 1.0 / 3.0, 1.0];
        let [u_axis, _] = axes(block.axes);
        let point = block.base.decode_point() + if half == 0 { Vec3::ZERO } else { u_axis * c[u as usize] };
        debug_assert!(half == 1 || (u, v) == (0, 0));
        let bits = axis(worst * length - point, if half == 0 { 0 } else { block.axes });
        block.axes |= bits << (16 * half);
    }
    for (i, n) in normals.iter().enumerate() {
        let Some(n) = n else { continue };
        let (u, v, _) = nearest(&block, *n);
        block.u_indices |= u << (2 * i);
        block.v_indices |= v << (2 * i);
    }
    block
}

/// The two axes, in units in which the main component of the base is 1.
fn axes(word: u32) -> [Vec3; 2] {
    [word << 16, word].map(|h| {
        let e = (h >> 16 & 15) as i32;
        Vec3::new(h as i32 as f32, (h << 4) as i32 as f32, (h << 8) as i32 as f32) * 2f32.powi(e - 41)
    })
}
