//! The meshes of pictures, made for what the document shows.

use glam::{DMat3, DVec3};

/// A plane that rises three voxels for each voxel along x: Figures 3 and 4.
pub(super) fn steep() -> Vec<[DVec3; 3]> {
    let (a, b, side) = (DVec3::new(0.3, 0.1, 0.05), DVec3::new(0.59, 0.1, 0.92), DVec3::new(0.0, 0.8, 0.0));
    vec![[a, b, b + side], [a, b + side, a + side]]
}

/// A triangle that is largest along y: Figures 5 and 6.
pub(super) fn one_triangle() -> [DVec3; 3] {
    [DVec3::new(0.16, 0.55, 0.24), DVec3::new(0.86, 0.34, 0.37), DVec3::new(0.47, 0.68, 0.88)]
}

/// A closed mesh of twenty triangles, an icosahedron that no axis is a symmetry of: Figures 5 and 6.
pub(super) fn closed() -> Vec<[DVec3; 3]> {
    let golden = f64::midpoint(1.0, 5f64.sqrt());
    let turned = DMat3::from_rotation_z(0.43) * DMat3::from_rotation_x(0.31);
    let corners: Vec<DVec3> = (0..12)
        .map(|i| {
            let (one, other) = (if i & 1 == 0 { 1.0 } else { -1.0 }, if i & 2 == 0 { golden } else { -golden });
            let place = [DVec3::new(0.0, one, other), DVec3::new(one, other, 0.0), DVec3::new(other, 0.0, one)][i / 4];
            DVec3::splat(0.5) + turned * place * (0.33 / golden)
        })
        .collect();
    // Corners are neighbours at the length of an edge: a face is three of them.
    let edge = 2.0 * 0.33 / golden;
    let near = |a: usize, b: usize| corners[a].distance(corners[b]) < 1.1 * edge;
    let mut faces = Vec::new();
    for a in 0..12 {
        for b in (a + 1..12).filter(|b| near(a, *b)) {
            faces.extend(
                (b + 1..12).filter(|c| near(a, *c) && near(b, *c)).map(|c| [corners[a], corners[b], corners[c]]),
            );
        }
    }
    faces
}

/// Strips that are projected along different axes: Figures 7 and 8.
pub(super) fn profile() -> Vec<[DVec3; 3]> {
    let at = |x: f64, z: f64| [DVec3::new(x / 16.0, 0.03, z / 16.0), DVec3::new(x / 16.0, 0.97, z / 16.0)];
    let points = [at(1.2, 5.3), at(6.7, 4.7), at(6.9, 5.45), at(12.2, 5.2), at(12.4, 8.6), at(15.3, 9.4)];
    let strip = |pair: &[[DVec3; 2]]| [[pair[0][0], pair[1][0], pair[1][1]], [pair[0][0], pair[1][1], pair[0][1]]];
    points.windows(2).flat_map(strip).collect()
}

/// A fan of narrow triangles: Figures 9 and 10.
pub(super) fn needles() -> Vec<[DVec3; 3]> {
    let tip = DVec3::new(0.22, 0.2, 0.4);
    let end = |angle: f64| DVec3::new(0.22 + 0.55 * angle.cos(), 0.2 + 0.55 * angle.sin(), 0.4 + 0.06 * angle);
    (0..6).map(|i| f64::from(i) * 0.29).map(|angle| [tip, end(angle), end(angle + 0.045)]).collect()
}

/// A plane that rises almost one voxel for each voxel along x, and along y: Figure 11.
pub(super) fn slope() -> Vec<[DVec3; 3]> {
    // Its corners lie in the outermost columns, which they hardly enter: there one voxel is met.
    let (low, high) = (4.85 / 16.0, 11.15 / 16.0);
    let at = |x: f64, y: f64| DVec3::new(x, y, 0.031 + 0.97 * (x - low) + 0.93 * (y - low));
    let (a, b, c, d) = (at(low, low), at(high, low), at(high, high), at(low, high));
    vec![[a, b, c], [a, c, d]]
}

/// Triangles that face the z axis: Figures 15 to 17.
pub(super) fn facing() -> Vec<[DVec3; 3]> {
    let p = |x: f64, y: f64| DVec3::new(x / 32.0, y / 32.0, 0.5 + 0.01 * x / 32.0);
    vec![
        [p(3.2, 4.1), p(26.7, 8.3), p(9.4, 27.6)],
        [p(14.3, 27.2), p(29.6, 12.4), p(28.1, 14.9)],
        [p(5.1, 1.6), p(30.2, 2.9), p(29.5, 3.6)],
    ]
}
