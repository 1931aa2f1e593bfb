//! Areas and centroids of planar polygons.

use glam::{DVec3, Vec3A};

/// The two axes of the coordinate plane nearest to a plane with this unit normal, and the factor from an area projected
/// into the coordinate plane to the area itself.
fn projection(normal: Vec3A) -> (usize, usize, f32) {
    let n = normal.abs();
    let axis = if n.x >= n.y && n.x >= n.z {
        0
    } else if n.y >= n.z {
        1
    } else {
        2
    };
    ((axis + 1) % 3, (axis + 2) % 3, 1.0 / n[axis])
}

/// The area of a planar polygon with this unit normal.
#[inline(always)]
pub(crate) fn area(vertices: &[DVec3], normal: Vec3A) -> f32 {
    let (x, y, stretch) = projection(normal);
    let first = vertices[0].to_array();
    // Differences are taken in double precision; in a small voxel single precision holds them exactly enough.
    let edge = |v: &DVec3| {
        let v = v.to_array();
        [(v[x] - first[x]) as f32, (v[y] - first[y]) as f32]
    };
    let (mut twice, mut previous) = (0.0, [0.0; 2]);
    for v in &vertices[1..] {
        let next = edge(v);
        twice += previous[0] * next[1] - previous[1] * next[0];
        previous = next;
    }
    0.5 * twice.abs() * stretch
}

/// The area of a planar polygon with this unit normal, and its centroid (the mean of the vertices if it has no area).
pub(crate) fn area_and_centroid(vertices: &[DVec3], normal: Vec3A) -> (f32, DVec3) {
    let (x, y, stretch) = projection(normal);
    let (mut twice, mut moment, mut previous) = (0.0, Vec3A::ZERO, Vec3A::ZERO);
    for v in &vertices[1..] {
        let next = (*v - vertices[0]).as_vec3a();
        let (a, b) = (previous.to_array(), next.to_array());
        let part = a[x] * b[y] - a[y] * b[x];
        // Per triangle of a fan around the first vertex: twice the area, and three times the centroid.
        moment += (previous + next) * part;
        twice += part;
        previous = next;
    }
    let centroid = vertices[0] + (moment / (3.0 * twice)).as_dvec3();
    if twice != 0.0 && centroid.is_finite() {
        return (0.5 * twice.abs() * stretch, centroid);
    }
    (0.0, vertices.iter().sum::<DVec3>() / vertices.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn areas_and_centroids_of_polygons_in_space() {
        for normal in [DVec3::X, DVec3::NEG_Y, DVec3::new(1.0, -2.0, 3.0), DVec3::new(-5.0, 0.1, 4.9)] {
            let normal = normal.normalize();
            let (u, v) = normal.any_orthonormal_pair();
            let middle = DVec3::new(0.3, 0.7, 0.4);
            // A rectangle of 0.02 by 0.06 with a corner cut off: 1/8 of it.
            let corners = [(-0.01, -0.03), (0.01, -0.03), (0.01, 0.0), (0.0, 0.03), (-0.01, 0.03)];
            let polygon = corners.map(|(x, y)| middle + u * x + v * y);
            let (found, centroid) = area_and_centroid(&polygon, normal.as_vec3a());
            let expected = 0.0012 - 0.5 * 0.01 * 0.03;
            assert!((found - expected).abs() < 1e-8 && (area(&polygon, normal.as_vec3a()) - expected).abs() < 1e-8);
            let cut = (0.5 * 0.01 * 0.03) / f64::from(expected);
            let off = -cut * (u * (0.01 - 0.01 / 3.0) + v * (0.03 - 0.01));
            assert!((centroid - middle - off).length() < 1e-7, "{centroid} for {}", middle + off);
        }
        let line = [DVec3::ZERO, DVec3::X, DVec3::X * 0.5];
        assert_eq!(area_and_centroid(&line, Vec3A::Z), (0.0, DVec3::X * 0.5));
    }
}
