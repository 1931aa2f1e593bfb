//! The voxels that a triangle meets, exactly, in whole numbers.

use super::mesh::UNIT;
use super::stamp::Stamp;

type Place = [i64; 3];

fn minus(a: Place, b: Place) -> Place {
    std::array::from_fn(|axis| a[axis] - b[axis])
}

fn cross(a: Place, b: Place) -> [i128; 3] {
    let term = |i: usize, j: usize| i128::from(a[i]) * i128::from(b[j]) - i128::from(a[j]) * i128::from(b[i]);
    [term(1, 2), term(2, 0), term(0, 1)]
}

/// A triangle's separating axes: what does not depend on the voxel. Numbers are in half units, so that a voxel's middle is whole.
struct Axes {
    corners: [Place; 3],
    normal: [i128; 3],
    /// `normal` times a corner.
    plane: i128,
    /// How far a voxel reaches along the normal.
    normal_reach: i128,
    edges: [Place; 3],
}

const HALF: i64 = UNIT;

impl Axes {
    fn new(corners: [Place; 3]) -> Self {
        let corners = corners.map(|corner| corner.map(|x| 2 * x));
        let edges = [minus(corners[1], corners[0]), minus(corners[2], corners[1]), minus(corners[0], corners[2])];
        let normal = cross(edges[0], edges[1]);
        let plane = (0..3).map(|axis| normal[axis] * i128::from(corners[0][axis])).sum();
        let normal_reach = normal.iter().map(|n| n.abs()).sum::<i128>() * i128::from(HALF);
        Self { corners, normal, plane, normal_reach, edges }
    }

    /// Whether the plane meets a voxel with this middle.
    fn plane_meets(&self, middle: Place) -> bool {
        let at: i128 = (0..3).map(|axis| self.normal[axis] * i128::from(middle[axis])).sum();
        (at - self.plane).abs() <= self.normal_reach
    }

    /// Whether the triangle and a voxel, seen along an axis, meet.
    fn meet_along(&self, axis: usize, middle: Place) -> bool {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for edge in self.edges {
            let across = [-edge[v], edge[u]];
            let reach = (across[0].abs() + across[1].abs()) * HALF;
            let along = |corner: Place| (corner[u] - middle[u]) * across[0] + (corner[v] - middle[v]) * across[1];
            let [a, b, c] = self.corners.map(along);
            if a.min(b).min(c) > reach || a.max(b).max(c) < -reach {
                return false;
            }
        }
        true
    }
}

/// Sets the voxels that a triangle with these corners, in 1/256 of a voxel, meets: those whose closed boxes have a point of it.
pub(super) fn add(stamp: &mut Stamp, corners: [Place; 3]) {
    let axes = Axes::new(corners);
    let low: Place = std::array::from_fn(|axis| {
        let least = corners.iter().map(|corner| corner[axis]).min().unwrap_or(0);
        // A corner in a plane touches the voxel below it.
        (least + UNIT - 1).div_euclid(UNIT) - 1
    });
    let high: Place = std::array::from_fn(|axis| {
        let greatest = corners.iter().map(|corner| corner[axis]).max().unwrap_or(0);
        greatest.div_euclid(UNIT)
    });
    let depth = (0..3).max_by_key(|&axis| axes.normal[axis].unsigned_abs()).unwrap_or(2);
    let (u, v) = ((depth + 1) % 3, (depth + 2) % 3);
    let middle = |voxel: i64| (2 * voxel + 1) * HALF;
    for j in low[v]..=high[v] {
        for i in low[u]..=high[u] {
            let mut place = [0; 3];
            (place[u], place[v]) = (middle(i), middle(j));
            if !axes.meet_along(depth, place) {
                continue;
            }
            let (first, last) = depths(&axes, depth, place, low[depth], high[depth]);
            for k in first..=last {
                place[depth] = middle(k);
                if axes.plane_meets(place) && axes.meet_along(u, place) && axes.meet_along(v, place) {
                    let mut voxel = [0; 3];
                    (voxel[depth], voxel[u], voxel[v]) = (k as i32, i as i32, j as i32);
                    stamp.set(voxel);
                }
            }
        }
    }
}

/// Voxels of a column that the plane may meet: rounded outwards, for the exact test to choose from.
fn depths(axes: &Axes, depth: usize, column: Place, low: i64, high: i64) -> (i64, i64) {
    let slope = axes.normal[depth];
    if slope == 0 {
        return (low, high);
    }
    let mut rest = axes.plane;
    for axis in (0..3).filter(|&axis| axis != depth) {
        rest -= axes.normal[axis] * i128::from(column[axis]);
    }
    let (rest, reach) = if slope < 0 { (-rest, axes.normal_reach) } else { (rest, axes.normal_reach) };
    let edge = i128::from(2 * UNIT) * slope.abs();
    // |slope * middle - rest| <= reach, and middle = (2 k + 1) * HALF.
    let first = (rest - reach).div_euclid(edge) - 1;
    let last = (rest + reach).div_euclid(edge) + 1;
    let within = |k: i128| k.clamp(i128::from(low) - 1, i128::from(high) + 1) as i64;
    (within(first).max(low), within(last).min(high))
}
