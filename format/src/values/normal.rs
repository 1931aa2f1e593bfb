//! Normals: the 32-bit point on a cube, and blocks of 16 normals around it (paper section 3.5 and Figure 6; spec
//! section 8.2).

use bytemuck::{Pod, Zeroable};
use glam::{Vec3, Vec4};

use crate::values::lanes::{sum, sums, weights};

/// One normal as a point on a cube, 32 bits.
///
/// ```text
/// 31 sign of the main axis | 30..29 main axis (0 = x, 1 = y, 2 = z) | 28..14 u (signed) | 13..0 v (signed)
/// ```
///
/// `u` is the coordinate along the axis after the main axis (cyclically), `v` along the axis after that. Each is
/// decoded together with the bits below it.
#[repr(transparent)]
#[derive(Clone, Copy, PartialEq, Eq, Debug, Pod, Zeroable, Default, serde::Serialize, serde::Deserialize)]
pub struct RawNormal(pub u32);

/// The nearest integer. `f32::round` would be a library call on targets without an instruction for it.
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

    /// The raw normal nearest to a direction of any length. +z if the direction is zero or not finite.
    #[inline]
    pub fn encode(n: Vec3) -> Self {
        let a = n.abs();
        // False for NaN.
        if !(a.x + a.y + a.z < f32::MAX && n != Vec3::ZERO) {
            return Self::encode_unusual(n);
        }
        let (axis, main, u, v) = if a.x >= a.y && a.x >= a.z {
            (0, n.x, n.y, n.z)
        } else if a.y >= a.z {
            (1, n.y, n.z, n.x)
        } else {
            (2, n.z, n.x, n.y)
        };
        let v = nearest(v / main.abs() * 8192.0).clamp(-8192, 8191);
        let v_bits = v as u32 & 0x3fff;
        let fraction = v_bits as i32 as f32 / 16384.0;
        let u = nearest(u / main.abs() * 16384.0 - fraction).clamp(-16384, 16383);
        Self(u32::from(main < 0.0) << 31 | axis << 29 | (u as u32 & 0x7fff) << 14 | v_bits)
    }

    #[cold]
    fn encode_unusual(n: Vec3) -> Self {
        // The sum of finite components can overflow; scaling down avoids that.
        let n = if n.is_finite() && n != Vec3::ZERO { n * 0.25 } else { Vec3::Z };
        Self::encode(n)
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
/// together with the bits below it. A normal is `base + c[iu] u + c[iv] v`, normalised, with
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

/// Decodes the axis in the top 16 bits of `word`; the bits below act as fraction. In units in which the main component
/// of the base is 1.
fn decode_axis(word: u32) -> Vec3 {
    let exponent = word >> 16 & 15;
    // The axis is scaled by 2^(exponent - 10) in integer units, in which the main component of the base is 2^31.
    let scale = f32::from_bits((exponent + 127 - 10) << 23) / MAIN;
    Vec3::new(word as i32 as f32, (word << 4) as i32 as f32, (word << 8) as i32 as f32) * scale
}

/// The 16-bit axis nearest to `axis`. `below` are the 16 bits below it in the decoder's word.
fn encode_axis(axis: Vec3, below: u32) -> u32 {
    // The smallest exponent for which the largest component fits into 4 signed bits: a base-2 logarithm, rounded up.
    let largest = axis.abs().max_element() * (1.0 / 7.4);
    let logarithm = ((largest.to_bits() as i32 + 0x7f_ffff) >> 23) - 127;
    let exponent = (logarithm + 13).clamp(0, 15) as u32;
    // In integers: the field of each component is rounded with the bits below it in the decoder's word known.
    let scale = f32::from_bits((127 + 41 - exponent) << 23);
    let [x, y, z] = (axis * scale).to_array().map(|component| component as i64);
    let field = |wanted: i64, below: u32| ((wanted - i64::from(below) + (1 << 27)) >> 28).clamp(-8, 7) as u32 & 15;
    let word = exponent << 24 | (below & 0xffff) << 8;
    let word = (field(z, word) << 28 | word) >> 4;
    let word = (field(y, word) << 28 | word) >> 4;
    (field(x, word) << 28 | word) >> 16
}

impl NormalBlock {
    /// Normal `i` (0..16), unit length.
    pub fn decode(self, i: usize) -> Vec3 {
        let cu = GRID[(self.u_indices >> (2 * i) & 3) as usize];
        let cv = GRID[(self.v_indices >> (2 * i) & 3) as usize];
        let point = self.base.decode_point() + decode_axis(self.axes << 16) * cu + decode_axis(self.axes) * cv;
        point.normalize_or(Vec3::Z)
    }

    /// Encodes these unit normals. `None` entries are unused and do not affect the result.
    ///
    /// Places the grid around the mean, along the principal axes of the normals; if the normals spread too far for
    /// that, places axes that reach the outliers. Then fits the grid to the resulting indices by least squares. Each
    /// rounded value is taken into account by those fitted after it.
    ///
    /// Equal normals decode within 0.05 degrees. Normals in a cone of half angle `a`, up to 45 degrees, decode within
    /// `0.6 a + 0.05` degrees, most of them within `0.2 a`.
    pub fn encode(normals: &[Option<Vec3>; 16]) -> Self {
        let Some(first) = normals.iter().flatten().next() else { return Self::default() };
        if normals.iter().flatten().all(|n| n == first) {
            // With axes of length zero every grid point is the base.
            return Self { base: RawNormal::encode(*first), ..Self::default() };
        }
        // Move the used normals to the front. Branchless, as the pattern of used entries is unpredictable.
        let (mut lanes, mut places, mut count) = ([[0.0f32; 16]; 3], [0u8; 16], 0);
        for (i, normal) in normals.iter().enumerate() {
            let n = normal.as_ref().unwrap_or(&Vec3::ZERO);
            (lanes[0][count & 15], lanes[1][count & 15], lanes[2][count & 15]) = (n.x, n.y, n.z);
            places[count & 15] = 2 * i as u8;
            count += usize::from(normal.is_some());
        }
        if count > 8 { search::<4>(&lanes, &places, count) } else { search::<2>(&lanes, &places, count) }
    }
}

/// Up to `4 G` unit normals, four per vector. Lanes after the last normal repeat the first and have weight 0.
struct Texels<const G: usize> {
    normals: [[Vec4; G]; 3],
    sum: Vec3,
    /// The direction of the sum; zero if the sum is zero.
    centre: Vec3,
    weights: [Vec4; G],
    count: f32,
}

/// A grid, and the best point of it for every normal.
struct Assigned<const G: usize> {
    base: RawNormal,
    axes: u32,
    /// Grid point of each normal: u index + 4 * v index.
    points: [Vec4; G],
    /// Sum of the squared chords between normals and grid points.
    error: f32,
}

/// Mean squared chord (about 1.8 degrees) below which no further fit is done.
const GOOD: f32 = 1e-3;
/// Ratio of the minor to the major extent of the normals below which the second axis does not cover the minor extent
/// but corrects the rounding error of the first axis. That error is up to half of a seventh.
const NARROW: f32 = 0.07;

/// The block for the first `count` lanes. The indices of lane `k` are stored at bit `places[k]`.
fn search<const G: usize>(lanes: &[[f32; 16]; 3], places: &[u8; 16], count: usize) -> NormalBlock {
    let texels = Texels::<G>::new(lanes, count);
    let mut best = texels.patch().unwrap_or_else(|| texels.reach());
    for _ in 0..2 {
        if best.error < GOOD * texels.count {
            break;
        }
        match texels.refine(&best) {
            Some(next) if next.error < best.error => best = next,
            _ => break,
        }
    }
    let mut block = NormalBlock { base: best.base, axes: best.axes, ..NormalBlock::default() };
    for g in 0..G {
        // Adding 2^23 leaves the integer in the low bits. Unused lanes become zero.
        let points = (best.points[g] * texels.weights[g] + Vec4::splat(8_388_608.0)).to_array().map(f32::to_bits);
        for (point, place) in points.into_iter().zip(&places[4 * g..]) {
            block.u_indices |= (point & 3) << (place & 31);
            block.v_indices |= (point >> 2 & 3) << (place & 31);
        }
    }
    block
}

fn dot(a: [Vec4; 3], b: Vec3) -> Vec4 {
    a[0] * b.x + a[1] * b.y + a[2] * b.z
}

/// The nearest integers. For magnitudes below 2^22.
fn round(x: Vec4) -> Vec4 {
    let big = Vec4::splat(12_582_912.0);
    (x + big) - big
}

/// The grid coordinates of indices.
fn coordinate(index: Vec4) -> Vec4 {
    index * (2.0 / 3.0) - Vec4::ONE
}

impl<const G: usize> Texels<G> {
    fn new(lanes: &[[f32; 16]; 3], count: usize) -> Self {
        let (mut normals, weights) = ([[Vec4::ZERO; G]; 3], weights::<G>(count as f32));
        let mut total = [Vec4::ZERO; 3];
        for g in 0..G {
            for k in 0..3 {
                let four = Vec4::from_slice(&lanes[k][4 * g..]);
                normals[k][g] = Vec4::select(weights[g].cmpgt(Vec4::ZERO), four, Vec4::splat(lanes[k][0]));
                total[k] += normals[k][g] * weights[g];
            }
        }
        let sum = Vec3::from(sums(total));
        Self { normals, sum, centre: sum.normalize_or_zero(), weights, count: count as f32 }
    }

    fn four(&self, g: usize) -> [Vec4; 3] {
        [self.normals[0][g], self.normals[1][g], self.normals[2][g]]
    }

    /// A grid on the tangent plane at the mean normal, along the principal axes of the projected normals. `None` if a
    /// normal is too far from the mean to be projected well.
    fn patch(&self) -> Option<Assigned<G>> {
        let axis = self.centre;
        if axis == Vec3::ZERO {
            return None;
        }
        let (right, up) = axis.any_orthonormal_pair();
        let (mut least, mut lengths) = (Vec4::ONE, [Vec4::ZERO; G]);
        let (mut x, mut y) = ([Vec4::ZERO; G], [Vec4::ZERO; G]);
        let (mut sx, mut sy, mut sxx, mut sxy, mut syy) = (Vec4::ZERO, Vec4::ZERO, Vec4::ZERO, Vec4::ZERO, Vec4::ZERO);
        for g in 0..G {
            let (n, weight) = (self.four(g), self.weights[g]);
            let along = dot(n, axis);
            least = least.min(along);
            lengths[g] = Vec4::ONE / along;
            (x[g], y[g]) = (dot(n, right) * lengths[g], dot(n, up) * lengths[g]);
            let (wx, wy) = (x[g] * weight, y[g] * weight);
            (sx, sy) = (sx + wx, sy + wy);
            (sxx, sxy, syy) = (sxx + wx * x[g], sxy + wx * y[g], syy + wy * y[g]);
        }
        if least.min_element() < 0.25 {
            return None;
        }
        let (sx, sy) = (sum(sx) / self.count, sum(sy));
        let (xx, xy) = (sum(sxx) - sx * sx * self.count, sum(sxy) - sx * sy);
        let yy = sum(syy) - sy * sy / self.count;
        let (cos, sin) = half_angle(xx - yy, 2.0 * xy);
        let rotated = |g: usize| (x[g] * cos + y[g] * sin, y[g] * cos - x[g] * sin);
        let (mut lo, mut hi) = ([Vec4::MAX; 2], [Vec4::MIN; 2]);
        for g in 0..G {
            let (u, v) = rotated(g);
            lo = [lo[0].min(u), lo[1].min(v)];
            hi = [hi[0].max(u), hi[1].max(v)];
        }
        let (lo, hi) = (lo.map(Vec4::min_element), hi.map(Vec4::max_element));
        let (wide, across) = (hi[0] - lo[0], hi[1] - lo[1]);
        let (u_steps, v_steps) = (3.0 / wide.max(1e-12), 3.0 / across.max(1e-12));
        let (mut us, mut vs) = ([Vec4::ZERO; G], [Vec4::ZERO; G]);
        for g in 0..G {
            let (u, v) = rotated(g);
            us[g] = coordinate(round((u - lo[0]) * u_steps));
            vs[g] = if across < NARROW * wide { us[g] } else { coordinate(round((v - lo[1]) * v_steps)) };
            lengths[g] *= self.weights[g];
        }
        let (base, axes) = self.fit(&lengths, &us, &vs)?;
        Some(self.assign(base, axes))
    }

    /// A grid around the mean, each axis in turn reaching to the normal that is furthest from the points so far.
    fn reach(&self) -> Assigned<G> {
        let start = if self.sum.length() < 0.1 * self.count { self.furthest(&[-self.sum]) } else { self.sum };
        let base = RawNormal::encode(start);
        let point = base.decode_point();
        let length = point.length();
        let u = encode_axis(self.furthest(&[point]) * length - point, 0);
        let points = GRID.map(|c| point + decode_axis(u << 16) * c);
        let n = self.furthest(&points);
        let cosine = |p: &Vec3| p.dot(n) / p.length().max(1e-20);
        let nearest = points.into_iter().max_by(|a, b| cosine(a).total_cmp(&cosine(b))).unwrap_or(point);
        self.assign(base, encode_axis(n * length - nearest, u) << 16 | u)
    }

    /// The normal that is furthest from all of these directions.
    fn furthest(&self, directions: &[Vec3]) -> Vec3 {
        let mut cosines = [Vec4::splat(-2.0); G];
        for direction in directions {
            let direction = *direction / direction.length().max(1e-20);
            for (g, cosine) in cosines.iter_mut().enumerate() {
                *cosine = cosine.max(dot(self.four(g), direction));
            }
        }
        let (mut least, mut furthest) = (f32::MAX, Vec3::Z);
        for (g, cosines) in cosines.iter().enumerate() {
            for (k, cosine) in cosines.to_array().into_iter().enumerate() {
                if cosine < least {
                    let [x, y, z] = self.four(g);
                    (least, furthest) = (cosine, Vec3::new(x[k], y[k], z[k]));
                }
            }
        }
        furthest
    }

    /// Fits the grid to the points that the normals are assigned to.
    fn refine(&self, found: &Assigned<G>) -> Option<Assigned<G>> {
        let (base, u, v) = (found.base.decode_point(), decode_axis(found.axes << 16), decode_axis(found.axes));
        let (mut lengths, mut us, mut vs) = ([Vec4::ZERO; G], [Vec4::ZERO; G], [Vec4::ZERO; G]);
        for g in 0..G {
            let n = self.four(g);
            let row = round(found.points[g] * 0.25 - Vec4::splat(0.375));
            (us[g], vs[g]) = (coordinate(found.points[g] - row * 4.0), coordinate(row));
            let point = |k: usize| us[g] * u[k] + vs[g] * v[k] + Vec4::splat(base[k]);
            // The length at which the normal comes closest to its grid point.
            let length = n[0] * point(0) + n[1] * point(1) + n[2] * point(2);
            lengths[g] = length.max(Vec4::splat(0.05)) * self.weights[g];
        }
        let (base, axes) = self.fit(&lengths, &us, &vs)?;
        Some(self.assign(base, axes))
    }

    /// Base and axes of the grid with the least sum of squared distances to the normals scaled to these lengths, at
    /// these grid coordinates. The u axis is rounded first; the v axis is fitted to the rounded u axis, and the base to
    /// both.
    fn fit(&self, lengths: &[Vec4; G], us: &[Vec4; G], vs: &[Vec4; G]) -> Option<(RawNormal, u32)> {
        let (mut su, mut sv, mut suu, mut suv, mut svv) = (Vec4::ZERO, Vec4::ZERO, Vec4::ZERO, Vec4::ZERO, Vec4::ZERO);
        let (mut sp, mut spu, mut spv) = ([Vec4::ZERO; 3], [Vec4::ZERO; 3], [Vec4::ZERO; 3]);
        for g in 0..G {
            let (u, v) = (us[g], vs[g]);
            let (wu, wv) = (u * self.weights[g], v * self.weights[g]);
            (su, sv, suu, suv, svv) = (su + wu, sv + wv, suu + u * wu, suv + u * wv, svv + v * wv);
            for k in 0..3 {
                let p = self.normals[k][g] * lengths[g];
                (sp[k], spu[k], spv[k]) = (sp[k] + p, spu[k] + p * u, spv[k] + p * v);
            }
        }
        let total = |s: [Vec4; 3]| Vec3::from(sums(s));
        // Means, and the moments about them.
        let part = 1.0 / self.count;
        let (u_mean, v_mean) = (sum(su) * part, sum(sv) * part);
        let (sp, spu, spv) = (total(sp), total(spu), total(spv));
        let uu = sum(suu) - u_mean * u_mean * self.count;
        let uv = sum(suv) - u_mean * v_mean * self.count;
        let vv = sum(svv) - v_mean * v_mean * self.count;
        let (pu, pv, p_mean) = (spu - sp * u_mean, spv - sp * v_mean, sp * part);
        let inverse = |x: f32| if x > 1e-3 * self.count { 1.0 / x } else { 0.0 };
        let det = uu * vv - uv * uv;
        let (u, v) = if det > 1e-6 * self.count * self.count {
            ((pu * vv - pv * uv) / det, (pv * uu - pu * uv) / det)
        } else {
            (pu * inverse(uu), Vec3::ZERO)
        };
        // The main component of an encoded base is ±1: scale everything so that it is.
        let unit = (p_mean - u * u_mean - v * v_mean).abs().max_element();
        if unit.is_nan() || unit < 0.01 {
            return None;
        }
        let scale = 1.0 / unit;
        let u_bits = encode_axis(u * scale, 0);
        let u = decode_axis(u_bits << 16) * unit;
        let v = (pv - u * uv) * inverse(vv);
        let axes = encode_axis(v * scale, u_bits) << 16 | u_bits;
        let v = decode_axis(axes) * unit;
        Some((RawNormal::encode(p_mean - u * u_mean - v * v_mean), axes))
    }

    /// The best point of a grid for every normal.
    fn assign(&self, base: RawNormal, axes: u32) -> Assigned<G> {
        let (u, v, point) = (decode_axis(axes << 16), decode_axis(axes), base.decode_point());
        // Relative to the mean direction, so that small angles keep their precision. The point with the least squared
        // chord is the one with the largest `2 n·p - p·p`.
        let centre = self.centre;
        let steps = Vec4::from_array(GRID);
        let row = [
            steps * u.x + Vec4::splat(point.x),
            steps * u.y + Vec4::splat(point.y),
            steps * u.z + Vec4::splat(point.z),
        ];
        let mut grid = [[0.0f32; 4]; 16];
        for (four, c) in grid.chunks_exact_mut(4).zip(GRID) {
            let [x, y, z] =
                [row[0] + Vec4::splat(v.x * c), row[1] + Vec4::splat(v.y * c), row[2] + Vec4::splat(v.z * c)];
            let square = x * x + y * y + z * z;
            let length = Vec4::from_array(square.to_array().map(f32::sqrt));
            let inverse = Vec4::ONE / length.max(Vec4::splat(1e-20));
            let [x, y, z] = [x * inverse - centre.x, y * inverse - centre.y, z * inverse - centre.z];
            let square = (x * x + y * y + z * z).to_array();
            let (x, y, z) = ((x + x).to_array(), (y + y).to_array(), (z + z).to_array());
            for (k, point) in four.iter_mut().enumerate() {
                *point = [x[k], y[k], z[k], square[k]];
            }
        }
        let (mut points, mut error) = ([Vec4::ZERO; G], Vec4::ZERO);
        // Two groups at a time, so that they stay in registers.
        for g in (0..G).step_by(2) {
            let [a, b] = [g, g + 1].map(|g| {
                let n = self.four(g);
                [n[0] - centre.x, n[1] - centre.y, n[2] - centre.z]
            });
            let (mut most, mut best, mut tag) = ([Vec4::MIN; 2], [Vec4::ZERO; 2], Vec4::ZERO);
            for &[x, y, z, square] in &grid {
                let scores = [a[0] * x + a[1] * y + a[2] * z - square, b[0] * x + b[1] * y + b[2] * z - square];
                best[0] = Vec4::select(scores[0].cmpgt(most[0]), tag, best[0]);
                best[1] = Vec4::select(scores[1].cmpgt(most[1]), tag, best[1]);
                most = [most[0].max(scores[0]), most[1].max(scores[1])];
                tag += Vec4::ONE;
            }
            (points[g], points[g + 1]) = (best[0], best[1]);
            error += (a[0] * a[0] + a[1] * a[1] + a[2] * a[2] - most[0]) * self.weights[g];
            error += (b[0] * b[0] + b[1] * b[1] + b[2] * b[2] - most[1]) * self.weights[g + 1];
        }
        Assigned { base, axes, points, error: sum(error) }
    }
}

/// Cosine and sine of half the angle of `(x, y)`.
fn half_angle(x: f32, y: f32) -> (f32, f32) {
    let length = (x * x + y * y).sqrt();
    if length == 0.0 {
        return (1.0, 0.0);
    }
    // Compute the larger of the two first, to avoid cancellation.
    let larger = (0.5 + 0.5 * x.abs() / length).sqrt();
    let smaller = 0.5 * y / (length * larger);
    if x >= 0.0 { (larger, smaller) } else { (smaller.abs(), larger.copysign(y)) }
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
        fn normals_in_a_cone_come_back_within_six_tenths_of_its_half_angle(
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
                prop_assert!(off <= 0.6 * degrees + 0.05, "{off} degrees off in a cone of {degrees}");
            }
        }
    }

    #[test]
    fn half_angles_are_those_of_trigonometry() {
        for k in -36..=36 {
            let angle = (k as f32 * 4.999).to_radians();
            let (cos, sin) = half_angle(angle.cos() * 3e-7, angle.sin() * 3e-7);
            assert!((cos - (0.5 * angle).cos()).abs() < 1e-5 && (sin - (0.5 * angle).sin()).abs() < 1e-5, "{angle}");
        }
        assert_eq!(half_angle(0.0, 0.0), (1.0, 0.0));
    }

    proptest! {
        #[test]
        fn raw_normals_are_those_of_the_plain_method(n in prop::array::uniform3(prop::num::f32::ANY)) {
            prop_assert_eq!(RawNormal::encode(n.into()), plain_raw(n.into()));
        }

        #[test]
        fn raw_normals_of_directions_are_too(n in prop::array::uniform3(-2i8..=2), f in prop::array::uniform3(-1.0f32..1.0), scale in 0.0f32..0.1) {
            // Includes equal components and components of zero.
            let n = Vec3::from(n.map(f32::from)) + Vec3::from(f) * scale.max(0.05) - Vec3::from(f) * 0.05;
            prop_assert_eq!(RawNormal::encode(n), plain_raw(n));
        }

        #[test]
        fn axes_are_the_nearest(axis in prop::array::uniform3(-1.0f32..1.0), scale in -9i32..3, below in 0u32..0x10000) {
            let axis = Vec3::from(axis) * 2f32.powi(scale);
            let bits = encode_axis(axis, below);
            let found = decode_axis(bits << 16 | below);
            let unit = 2f32.powi((bits & 15) as i32 - 13);
            for k in 0..3 {
                // At the ends of a field's range the fraction adds to the error.
                prop_assert!((found[k] - axis[k]).abs() <= unit * 0.66, "{axis} became {found} in units of {unit}");
            }
            prop_assert!(bits & 15 == 0 || axis.abs().max_element() > 3.69 * unit);
        }

        #[test]
        fn points_of_the_grid_are_the_nearest(
            seeds in prop::array::uniform16(prop::option::of(prop::array::uniform3(-1.0f32..1.0))), spread in 0.01f32..2.0,
        ) {
            let normals = seeds.map(|n| (Vec3::Y + Vec3::from(n?) * spread).try_normalize());
            let block = NormalBlock::encode(&normals);
            for (i, n) in normals.iter().enumerate() {
                let Some(n) = n else {
                    prop_assert_eq!((block.u_indices | block.v_indices) >> (2 * i) & 3, 0);
                    continue;
                };
                let with = |k: u32| NormalBlock { u_indices: k & 3, v_indices: k >> 2, ..block }.decode(0);
                let least = (0..16).map(|k| with(k).distance(*n)).fold(f32::MAX, f32::min);
                prop_assert!(block.decode(i).distance(*n) <= least + 2e-4);
            }
        }
    }

    /// The raw normal, computed as section 8.2 of the specification describes.
    fn plain_raw(n: Vec3) -> RawNormal {
        let n = if n.is_finite() && n != Vec3::ZERO { n } else { Vec3::Z };
        let a = n.abs();
        let (axis, main, u, v) = if a.x >= a.y && a.x >= a.z {
            (0, n.x, n.y, n.z)
        } else if a.y >= a.z {
            (1, n.y, n.z, n.x)
        } else {
            (2, n.z, n.x, n.y)
        };
        let v = nearest(v / main.abs() * 8192.0).clamp(-8192, 8191) as u32 & 0x3fff;
        let u = nearest(u / main.abs() * 16384.0 - v as f32 / 16384.0).clamp(-16384, 16383) as u32 & 0x7fff;
        RawNormal(u32::from(main < 0.0) << 31 | axis << 29 | u << 14 | v)
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
                assert!(block.decode(i).dot(*n) > 0.99, "{i}: {} for {n}", block.decode(i));
            }
        }
    }
}
