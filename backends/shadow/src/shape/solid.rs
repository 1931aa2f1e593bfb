//! What a closed mesh encloses, exactly: the parity of how often a row of voxels crosses the surface.

use super::mesh::UNIT;
use super::stamp::Stamp;

/// Inverts, in each row along x whose middle line crosses the triangle, all voxels whose middle is behind the crossing. Of triangles that share an
/// edge, exactly one has a line through the edge, so that each line crosses a closed mesh an even number of times.
pub(super) fn invert(stamp: &mut Stamp, corners: [[i64; 3]; 3]) {
    // Half units, so that the middle of a voxel is whole.
    let mut p = corners.map(|corner| corner.map(|x| 2 * x));
    let area = |a: [i64; 3], b: [i64; 3], y: i64, z: i64| {
        i128::from(b[1] - a[1]) * i128::from(z - a[2]) - i128::from(b[2] - a[2]) * i128::from(y - a[1])
    };
    let mut twice = area(p[0], p[1], p[2][1], p[2][2]);
    if twice == 0 {
        return;
    }
    if twice < 0 {
        p.swap(1, 2);
        twice = -twice;
    }
    let row = |voxel: i64| (2 * voxel + 1) * UNIT;
    // The rows whose middle lies between the least and greatest corner.
    let range = |axis: usize| {
        let least = p.iter().map(|corner| corner[axis]).min().unwrap_or(0);
        let greatest = p.iter().map(|corner| corner[axis]).max().unwrap_or(0);
        (least - UNIT).div_euclid(2 * UNIT)..=(greatest - UNIT).div_euclid(2 * UNIT)
    };
    let extent = stamp.extent();
    let first_voxel = i64::from(extent.low[0]) * 2;
    let end = i64::from(extent.high[0]) * 2;
    for k in range(2) {
        for j in range(1) {
            let (y, z) = (row(j), row(k));
            let mut weights = [0; 3];
            let inside = (0..3).all(|i| {
                let (a, b) = (p[(i + 1) % 3], p[(i + 2) % 3]);
                weights[i] = area(a, b, y, z);
                // A line through an edge is in the triangle that lies on the greater side of it.
                let (dy, dz) = (b[1] - a[1], b[2] - a[2]);
                weights[i] > 0 || weights[i] == 0 && (dz < 0 || dz == 0 && dy > 0)
            });
            if !inside {
                continue;
            }
            // The crossing, times `twice`.
            let x: i128 = (0..3).map(|i| weights[i] * i128::from(p[i][0])).sum();
            // The first voxel with (2 i + 1) * UNIT * twice > x.
            let unit = i128::from(UNIT) * twice;
            let first = ((x - unit).div_euclid(2 * unit) + 1) as i64;
            let first = first.max(first_voxel);
            if first < end {
                stamp.invert_from([first as i32, j as i32, k as i32]);
            }
        }
    }
}
