//! How normals and tangents are transformed by a matrix that moves vertices.

use glam::{DMat3, DMat4, DVec3};

/// Whether `matrix` mirrors, that is, turns outside into inside (negative determinant).
pub(crate) fn mirrors(matrix: &DMat4) -> bool {
    DMat3::from_mat4(*matrix).determinant() < 0.0
}

/// The inverse transpose of the linear part of `matrix`, up to a positive factor. It is made from cofactors, so that a
/// matrix that flattens the mesh into a plane still gives the normal of that plane.
pub(crate) fn normal_matrix(matrix: &DMat4) -> DMat3 {
    let linear = DMat3::from_mat4(*matrix);
    let (x, y, z) = (linear.x_axis, linear.y_axis, linear.z_axis);
    let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
    if linear.determinant() < 0.0 { -cofactors } else { cofactors }
}

/// `normal` transformed by a [`normal_matrix`] and brought to unit length; zero if the result has no length.
pub(crate) fn transform_normal(normal_matrix: &DMat3, normal: [f32; 3]) -> [f32; 3] {
    let n = DVec3::from(normal.map(f64::from));
    // The factor of the matrix may be tiny or huge: scale by the largest component before squaring.
    let turned = *normal_matrix * n;
    let largest = turned.abs().max_element();
    if largest > 0.0 && largest.is_finite() {
        (turned / largest).normalize_or_zero().as_vec3().to_array()
    } else {
        [0.0; 3]
    }
}

/// `tangent` transformed by the linear part of `matrix`; zero if the result has no length. A mirroring matrix changes the
/// sign of the handedness.
pub(crate) fn transform_tangent(matrix: &DMat4, [x, y, z, w]: [f32; 4]) -> [f32; 4] {
    let moved = matrix.transform_vector3(DVec3::new(x.into(), y.into(), z.into()));
    let largest = moved.abs().max_element();
    if !(largest > 0.0 && largest.is_finite()) {
        return [0.0; 4];
    }
    let t = (moved / largest).normalize_or_zero().as_vec3();
    [t.x, t.y, t.z, if mirrors(matrix) { -w } else { w }]
}
