//! A wavy sheet of equal triangles, for missing voxels by their size.

use glam::DVec3;

/// A sheet across the unit cube whose triangles have edges of about `edge`, in edges of the cube.
pub(crate) fn sheet(edge: f64) -> Vec<[DVec3; 3]> {
    // Not a multiple of the grid, and not parallel to its axes.
    let across = (0.83 / edge).round().max(1.0) as u32;
    let at = |i: u32, j: u32| {
        let (s, t) = (f64::from(i) / f64::from(across), f64::from(j) / f64::from(across));
        let (x, y) = (0.111 + 0.7 * s + 0.09 * t, 0.083 + 0.75 * t - 0.07 * s + 0.08);
        DVec3::new(x, y, 0.47 + 0.27 * (5.3 * x + 0.7 * y).sin() * (3.9 * y - 0.4 * x).cos())
    };
    let mut corners = Vec::with_capacity(2 * (across as usize).pow(2));
    for j in 0..across {
        for i in 0..across {
            corners.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            corners.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    corners
}

/// The mean length of the edges of triangles.
pub(crate) fn mean_edge(corners: &[[DVec3; 3]]) -> f64 {
    let sum: f64 = corners.iter().map(|[a, b, c]| a.distance(*b) + b.distance(*c) + c.distance(*a)).sum();
    sum / (3 * corners.len().max(1)) as f64
}
