//! Normals: the 32-bit point on a cube, and blocks of 16 normals around it (paper section 3.5 and Figure 6; spec
//! section 8.2).

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// One normal as a point on a cube, 32 bits.
///
/// ```text
/// 31 sign of the main axis | 30..29 main axis (0 = x, 1 = y, 2 = z) | 28..14 u (signed) | 13..0 v (signed)
/// ```
///
/// `u` belongs to the axis after the main one (cyclically), `v` to the one after that; each is decoded together with the
/// bits below it.
#[repr(transparent)]
#[derive(Clone, Copy, PartialEq, Eq, Debug, Pod, Zeroable, Default, serde::Serialize, serde::Deserialize)]
pub struct RawNormal(pub u32);

/// The nearest integer; unlike `f32::round` no call into a library where the target has no instruction for it.
fn nearest(x: f32) -> i32 {
    (x + 0.5f32.copysign(x)) as i32
}

/// Length of the main axis in the decoder's integer units.
const MAIN: f32 = 2147483648.0;

impl RawNormal {
    /// The point on the cube, main component ±1.
    pub fn decode_point(self) -> Vec3 {
        let word = self.0;
        let main = if word >> 31 != 0 { -1.0 } else { 1.0 };
        let u = (word << 3) as i32 as f32 / MAIN;
        let v = (word << 18) as i32 as f32 / MAIN;
        match word >> 29 & 3 {
            0 => Vec3::new(main, u, v),
            1 => Vec3::new(v, main, u),
            _ => Vec3::new(u, v, main),
        }
    }

    /// The unit normal.
    pub fn decode(self) -> Vec3 {
        self.decode_point().normalize()
    }

    /// The nearest raw normal of a direction of any length; +z for one that is zero or not finite.
    pub fn encode(n: Vec3) -> Self {
        let n = if n.is_finite() && n != Vec3::ZERO { n } else { Vec3::Z };
        let a = n.abs();
        let axis = if a.x >= a.y && a.x >= a.z {
            0
        } else if a.y >= a.z {
            1
        } else {
            2
        };
        let (main, u, v) = match axis {
            0 => (n.x, n.y, n.z),
            1 => (n.y, n.z, n.x),
            _ => (n.z, n.x, n.y),
        };
        let v = nearest(v / main.abs() * 8192.0).clamp(-8192, 8191);
        let v_bits = v as u32 & 0x3fff;
        let fraction = v_bits as f32 / 16384.0;
        let u = nearest(u / main.abs() * 16384.0 - fraction).clamp(-16384, 16383);
        Self((u32::from(main < 0.0)) << 31 | axis << 29 | (u as u32 & 0x7fff) << 14 | v_bits)
    }
}

/// Sixteen normals: a base point on the cube and a 4 x 4 grid around it, spanned by two axis vectors.
///
/// ```text
/// word 0  base, a raw normal          word 1  u index of normal i in bits 2i+1..2i
/// word 2  v axis (31..16) | u axis    word 3  v index of normal i in bits 2i+1..2i
/// ```
///
/// An axis is three signed 4-bit integers (x 15..12, y 11..8, z 7..4) and an exponent (3..0), each component decoded
/// together with the bits below it. The normal is `base + c[iu] u + c[iv] v`, normalised, with
/// `c = {-1, -1/3, 1/3, 1}`.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, Debug, Pod, Zeroable, Default, serde::Serialize, serde::Deserialize)]
pub struct NormalBlock {
    /// Base normal.
    pub base: RawNormal,
    /// Indices into `c` for the u axis.
    pub u_indices: u32,
    /// The two axes.
    pub axes: u32,
    /// Indices into `c` for the v axis.
    pub v_indices: u32,
}

/// The grid coordinates.
const GRID: [f32; 4] = [-1.0, -1.0 / 3.0, 1.0 / 3.0, 1.0];

/// Decodes the axis in the top 16 bits of `word`, the bits below acting as fraction. Units: the main axis is 1.
fn decode_axis(word: u32) -> Vec3 {
    let exponent = word >> 16 & 15;
    // 2^(exponent - 10) in the units of the base, whose main axis is 2^31.
    let scale = f32::from_bits((exponent + 127 - 10) << 23) / MAIN;
    Vec3::new(word as i32 as f32, (word << 4) as i32 as f32, (word << 8) as i32 as f32) * scale
}

/// The 16-bit axis nearest to `axis`; `below` are the 16 bits that will lie under it in the decoder's word.
fn encode_axis(axis: Vec3, below: u32) -> u32 {
    let largest = axis.abs().max_element();
    // Smallest exponent for which the largest component still fits into 4 signed bits.
    let mut exponent = 0u32;
    while exponent < 15 && largest > 7.4 * f32::from_bits((exponent + 127 - 13) << 23) {
        exponent += 1;
    }
    let unit = f32::from_bits((exponent + 127 - 13) << 23);
    let mut bits = exponent << 16 | (below & 0xffff);
    for (component, shift) in [(axis.z, 20u32), (axis.y, 24), (axis.x, 28)] {
        let fraction = bits as f32 / (1u32 << shift) as f32;
        let field = nearest(component / unit - fraction).clamp(-8, 7) as u32 & 15;
        bits |= field << shift;
    }
    bits >> 16
}

impl NormalBlock {
    /// Normal `i` (0..16), unit length.
    pub fn decode(self, i: usize) -> Vec3 {
        let cu = GRID[(self.u_indices >> (2 * i) & 3) as usize];
        let cv = GRID[(self.v_indices >> (2 * i) & 3) as usize];
        let point = self.base.decode_point() + decode_axis(self.axes << 16) * cu + decode_axis(self.axes) * cv;
        point.normalize_or(Vec3::Z)
    }

    /// A block for these unit normals; `None` entries are unused. Two ways of placing the grid are tried (a patch
    /// around the mean, and axes that reach for the outliers) and the better one is kept.
    ///
    /// Normals that are all the same come back within 0.05 degrees; those in a cone of half angle `a`, up to 45 degrees,
    /// within `0.7 a` and 0.05 degrees, most of them within `0.2 a`.
    pub fn encode(normals: &[Option<Vec3>; 16]) -> Self {
        let Some(first) = normals.iter().flatten().next() else { return Self::default() };
        if normals.iter().flatten().all(|n| n == first) {
            // Axes of length zero: every point of the grid is the base.
            return Self { base: RawNormal::encode(*first), ..Self::default() };
        }
        let mean: Vec3 = normals.iter().flatten().sum();
        let greedy = Self::encode_reaching(normals, mean);
        match Self::encode_patch(normals, mean) {
            Some(patch) if patch.1 <= greedy.1 => patch.0,
            _ => greedy.0,
        }
    }

    /// The grid as a patch on the plane through the mean normal, along the principal axes of the normals there.
    fn encode_patch(normals: &[Option<Vec3>; 16], mean: Vec3) -> Option<(Self, f32)> {
        let axis = mean.try_normalize()?;
        if normals.iter().flatten().any(|n| n.dot(axis) < 0.25) {
            return None;
        }
        // Lengths as on the cube, so that what is measured here is in the decoder's units.
        let axis = axis / axis.abs().max_element();
        let (right, up) = axis.normalize().any_orthonormal_pair();
        let points = normals.map(|n| n.map(|n| n * (axis.length_squared() / n.dot(axis)) - axis));
        let plane = points.map(|p| p.map(|p| (p.dot(right), p.dot(up))));
        let count = plane.iter().flatten().count() as f32;
        let (mx, my) = plane.iter().flatten().fold((0.0, 0.0), |(x, y), p| (x + p.0 / count, y + p.1 / count));
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for (x, y) in plane.iter().flatten() {
            let (x, y) = (x - mx, y - my);
            (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
        }
        let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
        let (sin, cos) = angle.sin_cos();
        let (major, minor) = (right * cos + up * sin, up * cos - right * sin);
        let range = |direction: Vec3| {
            points.iter().flatten().fold((f32::MAX, f32::MIN), |(lo, hi), p| {
                let d = p.dot(direction);
                (lo.min(d), hi.max(d))
            })
        };
        let ((ulo, uhi), (vlo, vhi)) = (range(major), range(minor));
        let centre = axis + major * ((ulo + uhi) * 0.5) + minor * ((vlo + vhi) * 0.5);
        let base = RawNormal::encode(centre);
        let scale = base.decode_point().length() / centre.length();
        Some(Self::assign(normals, base, major * ((uhi - ulo) * 0.5 * scale), minor * ((vhi - vlo) * 0.5 * scale)))
    }

    /// Axes that reach from the mean to the normals furthest from what is expressible so far.
    fn encode_reaching(normals: &[Option<Vec3>; 16], mean: Vec3) -> (Self, f32) {
        let used = || normals.iter().flatten().copied();
        let count = used().count() as f32;
        let start = if mean.length() < 0.1 * count {
            used().max_by(|a, b| a.dot(mean).total_cmp(&b.dot(mean))).unwrap_or(Vec3::Z)
        } else {
            mean
        };
        let base = RawNormal::encode(start);
        let point = base.decode_point();
        let length = point.length();
        let fit = |n: Vec3, axis: Vec3| {
            GRID.map(|c| point + axis * c)
                .map(|p| (p, cosine(p, n)))
                .into_iter()
                .max_by(|a, b| a.1.total_cmp(&b.1))
                .unwrap_or((point, 0.0))
        };
        let worst = |axis: Vec3| {
            used().map(|n| (n, fit(n, axis).1)).min_by(|a, b| a.1.total_cmp(&b.1)).map_or(point, |(n, _)| n)
        };
        let n = worst(Vec3::ZERO);
        let u = n * length - point;
        let n = worst(u);
        let v = n * length - fit(n, u).0;
        Self::assign(normals, base, u, v)
    }

    /// Quantizes the axes, picks the best grid point for every normal, and returns the sum of `1 - cos(error)`.
    fn assign(normals: &[Option<Vec3>; 16], base: RawNormal, u: Vec3, v: Vec3) -> (Self, f32) {
        let u_bits = encode_axis(u, 0);
        let v_bits = encode_axis(v, u_bits);
        let mut block = Self { base, u_indices: 0, axes: v_bits << 16 | u_bits, v_indices: 0 };
        let (u, v, point) = (decode_axis(block.axes << 16), decode_axis(block.axes), base.decode_point());
        let grid: [Vec3; 16] =
            std::array::from_fn(|k| (point + u * GRID[k & 3] + v * GRID[k >> 2]).normalize_or(Vec3::Z));
        let mut error = 0.0;
        for (i, n) in normals.iter().enumerate() {
            let Some(n) = n else { continue };
            let (mut best, mut best_dot) = (0, f32::MIN);
            for (k, g) in grid.iter().enumerate() {
                let dot = g.dot(*n);
                if dot > best_dot {
                    (best, best_dot) = (k as u32, dot);
                }
            }
            block.u_indices |= (best & 3) << (2 * i);
            block.v_indices |= (best >> 2) << (2 * i);
            error += 1.0 - best_dot;
        }
        (block, error)
    }
}

fn cosine(a: Vec3, b: Vec3) -> f32 {
    a.dot(b) / a.length().max(1e-20)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn unit(n: [f32; 3]) -> Option<Vec3> {
        Vec3::from(n).try_normalize()
    }

    proptest! {
        #[test]
        fn raw_normals_are_within_a_hundredth_of_a_degree(n in prop::array::uniform3(-1.0f32..1.0)) {
            let Some(n) = unit(n) else { return Ok(()) };
            let angle = RawNormal::encode(n).decode().angle_between(n).to_degrees();
            prop_assert!(angle < 0.01 + 0.03, "{n} is {angle} degrees off");
        }

        #[test]
        fn equal_normals_stay_close(n in prop::array::uniform3(-1.0f32..1.0), count in 1usize..=16) {
            let Some(n) = unit(n) else { return Ok(()) };
            let mut normals = [None; 16];
            normals[..count].fill(Some(n));
            let block = NormalBlock::encode(&normals);
            for i in 0..count {
                prop_assert!(block.decode(i).dot(n) > 0.99999);
            }
        }

        #[test]
        fn normals_in_a_cone_come_back_within_seven_tenths_of_its_half_angle(
            axis in prop::array::uniform3(-1.0f32..1.0), degrees in 0.1f32..45.0,
            places in prop::array::uniform16(prop::option::of((0.0f32..=1.0, 0.0f32..7.0))),
        ) {
            let Some(axis) = unit(axis) else { return Ok(()) };
            let (right, up) = axis.any_orthonormal_pair();
            let normals = places.map(|place| {
                let (along, around) = place?;
                let tilt = degrees.to_radians() * along;
                Some((axis * tilt.cos() + (right * around.cos() + up * around.sin()) * tilt.sin()).normalize())
            });
            let block = NormalBlock::encode(&normals);
            for (i, n) in normals.iter().enumerate() {
                let Some(n) = n else { continue };
                let off = block.decode(i).angle_between(*n).to_degrees();
                prop_assert!(off <= 0.7 * degrees + 0.05, "{off} degrees off in a cone of {degrees}");
            }
        }
    }

    #[test]
    fn three_directions_are_all_reached() {
        let mut normals = [None; 16];
        normals[0] = Some(Vec3::X);
        normals[5] = Some(Vec3::Y);
        normals[15] = Some(Vec3::NEG_Z);
        let block = NormalBlock::encode(&normals);
        for (i, n) in normals.iter().enumerate() {
            if let Some(n) = n {
                assert!(block.decode(i).dot(*n) > 0.96, "{i}: {} for {n}", block.decode(i));
            }
        }
    }
}
