//! By how much single precision can be wrong about a triangle and a voxel.
//!
//! Let `u = 2^-24`, and let `m` be a triangle's largest coordinate from its own origin, in voxels; `k = m + 2`. Voxels that are
//! tested are next to the triangle's bounding box at most, so that coordinates relative to a voxel's middle are at most `k`. A shader may
//! fuse a product with a sum: that only takes roundings away. Divisions are not used.
//!
//! * A corner is rounded once: it is off by at most `u m`. (Its computation in double precision adds `2^-50` of the grid's edge, which is
//!   less than a thousandth of every bound below.)
//! * **Box**: the extent of the triangle along an axis is off by `u m`, its difference to a voxel's middle by `u k`, the sum with 1/2
//!   by `u k`. Bound: `3 u k`.
//! * **Plane**: the slopes are computed in double precision and rounded, off by `u`, where double precision knows them: see
//!   `records`. `slope * (x - a)` is off by `u k` for the slope, `u m + u k` for the difference, `u k` for
//!   the product: `4 u k`, where slopes are at most 1; steeper ones, of one fixed projection, multiply it. Two of them, the corner's own `u m`, and four sums of at most `3 k + 2` add up to `21 u k`.
//! * **Edge**: a component of an edge is off by `2 u m` for its ends and `u m` for the difference; a coordinate relative to the
//!   voxel by `u m + u k`. A product is then off by `m * 2 u k + k * 3 u m + u m k = 6 u m k`; two of them and the difference by
//!   `14 u m k`. The radius is off by `5 u m`, the last sum by `u (m + 2 m k)`. Bound: `16 u m k + 6 u m`, less than `20 u k^2`.
//!
//! The constants here are a little larger, for products of errors.
//!
//! Much of what is close in single precision is not so in double precision: walls that lie in borders of voxels, and edges that are parallel
//! to an axis. `records` decides these beforehand: which voxels the bounding box meets along each axis, whether an edge adds an axis to
//! those of the box, whether a triangle is perpendicular to an axis.
//!
//! A shader calls triangle and voxel apart where the value that it computes is below minus the bound. The value without rounding is then
//! negative: no voxel is lost. What is kept may have a value that is negative by the bound, and by the bound once more for rounding: a voxel can
//! be wrong only if a value is within twice the bound of zero, [`may_differ`]. As a distance: an edge of length `l` (the sum of its two
//! components) may be off by `48 u k^2 / l` voxels. That is 2^-14 of a voxel for a triangle of four voxels, 2^-8 for one of a
//! thousand; only edges much shorter than their triangle are less certain.

use glam::DVec3;
use rayon::prelude::*;

/// Half a unit in the last place of 1 in single precision.
const U: f64 = 1.0 / (1u64 << 24) as f64;
/// The bound of an edge's test, over `(m + 2)^2`.
pub const EDGE: f64 = 24.0 * U;
/// The bound of the plane's test, over `m + 2`.
pub const PLANE: f64 = 24.0 * U;
/// The bound of the box's test, over `m + 2`.
pub const BOX: f64 = 4.0 * U;

/// The bounds as constants of the shading language.
pub(crate) fn source() -> String {
    format!("const EDGE_ERROR: f32 = {EDGE:e};\nconst PLANE_ERROR: f32 = {PLANE:e};\nconst BOX_ERROR: f32 = {BOX:e};\n")
}

/// The tests of a triangle and a voxel in double precision.
#[derive(Clone, Copy, Debug)]
pub struct Separation {
    /// The least value of the thirteen tests: not negative where triangle and closed voxel meet. In voxels for box and plane,
    /// in voxels times the length of the edge for edges.
    pub value: f64,
    /// The least value of a test over its bound: below -1, single precision says that they are apart; above 1, that they meet.
    pub over_bound: f64,
}

/// Tests whether a closed triangle meets a closed voxel. `corners` are in voxels; the voxel's lower corner is at `cell`.
///
/// Thirteen axes are tested: three of the box, the triangle's normal, and the nine that are perpendicular to an edge and to an axis.
#[must_use]
pub fn separation(corners: &[DVec3; 3], cell: [i64; 3]) -> Separation {
    let middle = DVec3::from(cell.map(|x| x as f64 + 0.5));
    let v = corners.map(|corner| (corner - middle).to_array());
    let low = corners[0].min(corners[1]).min(corners[2]);
    let high = corners[0].max(corners[1]).max(corners[2]);
    let k = (high - low.floor()).max_element() + 2.0;
    let mut found = Separation { value: f64::MAX, over_bound: f64::MAX };
    let mut test = |value: f64, bound: f64| {
        found.value = found.value.min(value);
        found.over_bound = found.over_bound.min(value / bound);
    };
    for axis in 0..3 {
        let least = v[0][axis].min(v[1][axis]).min(v[2][axis]);
        let most = v[0][axis].max(v[1][axis]).max(v[2][axis]);
        test(0.5 - least.max(-most), BOX * k);
    }
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    let size = normal.abs().max_element();
    if size > 0.0 {
        let reach = 0.5 * normal.abs().element_sum();
        let distance = normal.dot(DVec3::from(v[0])).abs();
        // In units of the largest component, as shaders measure it: along the axis of projection.
        test((reach - distance) / size, PLANE * k);
    }
    for edge in 0..3 {
        let (start, end, third) = (v[edge], v[(edge + 1) % 3], v[(edge + 2) % 3]);
        for axis in 0..3 {
            let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
            let (x, y) = (end[i] - start[i], end[j] - start[j]);
            let (p, q) = (x * start[j] - y * start[i], x * third[j] - y * third[i]);
            test(0.5 * (x.abs() + y.abs()) - p.min(q).max(-p.max(q)), EDGE * k * k);
        }
    }
    found
}

/// Whether a closed triangle meets a closed voxel, in double precision.
#[must_use]
pub fn meets(corners: &[DVec3; 3], cell: [i64; 3]) -> bool {
    separation(corners, cell).value >= 0.0
}

/// Whether a method that tests in single precision may find differently from double precision whether they meet: a value is within twice the
/// bound of zero.
#[must_use]
pub fn may_differ(corners: &[DVec3; 3], cell: [i64; 3]) -> bool {
    separation(corners, cell).over_bound.abs() <= 2.001
}

/// The voxels of a grid of this level that closed triangles meet, in double precision, as ascending [Morton codes](esvo_format::morton()).
/// `corners` are in edges of the grid. Each voxel of a triangle's bounding box is tested: for tests and small meshes.
#[must_use]
pub fn voxels(corners: &[[DVec3; 3]], level: u32) -> Vec<u64> {
    let edge = 1i64 << level;
    let of_triangle = |triangle: &[DVec3; 3]| {
        let scaled = triangle.map(|corner| corner * edge as f64);
        let end = |x: f64, step: i64| (x.floor() as i64 + step).clamp(0, edge - 1);
        let low = scaled[0].min(scaled[1]).min(scaled[2]).to_array().map(|x| end(x, -1));
        let high = scaled[0].max(scaled[1]).max(scaled[2]).to_array().map(|x| end(x, 1));
        let mut found = Vec::new();
        for (z, y) in (low[2]..=high[2]).flat_map(|z| (low[1]..=high[1]).map(move |y| (z, y))) {
            let met = (low[0]..=high[0]).filter(|&x| meets(&scaled, [x, y, z]));
            found.extend(met.map(|x| esvo_format::morton([x, y, z].map(|c| c as u32))));
        }
        found
    };
    let mut all: Vec<u64> = corners.par_iter().flat_map_iter(of_triangle).collect();
    all.par_sort_unstable();
    all.dedup();
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of the voxels that the method d found beside SIBENIK in a grid of 2048, the two that were furthest beyond one bound.
    #[test]
    fn what_is_kept_may_be_wrong_by_twice_the_bound() {
        for (cell, corners, value) in [
            (
                [29, 985, 998],
                [
                    [20.84493895566777, 980.5200502455178, 1009.9997255363413],
                    [31.013252702186097, 986.9121761969307, 993.2019585822027],
                    [31.013252702186097, 990.563090993044, 1008.4090533287656],
                ],
                -2.72e-5,
            ),
            (
                [1542, 1661, 1113],
                [
                    [1578.648236690151, 1635.877965751622, 1093.716305067747],
                    [1565.648112565848, 1662.4781415116354, 1088.3301762068606],
                    [1474.6706307004088, 1662.4780906703209, 1179.3071496591547],
                ],
                -1.537e-4,
            ),
        ] {
            let corners = corners.map(DVec3::from);
            let found = separation(&corners, cell);
            assert!((found.value / value - 1.0).abs() < 0.01 && found.over_bound < -1.001, "{found:?}");
            assert!(may_differ(&corners, cell) && !meets(&corners, cell));
            // A voxel further away is apart for both.
            assert!(!may_differ(&corners, [cell[0] + 9, cell[1] + 9, cell[2]]));
        }
    }
}
