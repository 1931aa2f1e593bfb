//! What a build is expected to take, from the mesh alone.

use glam::DVec3;

use crate::Mesh;

/// The number of voxels that the deepest level holds if all geometry is divided down to it: an upper bound in the mean, for a mesh
/// that lies anywhere in the grid. Triangles that share a voxel are counted each, so meshes whose triangles are smaller than a
/// voxel have fewer. Contours and materials that cut holes leave fewer too.
///
/// For a triangle it is the volume, in voxels, of the triangle grown by a voxel: 1 for the voxel, its three extents, and the areas of its
/// shadows along the three axes.
pub fn expected_leaves(mesh: &Mesh, levels: u32) -> f64 {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let corner = |i: u32| mesh.positions.get(i as usize).map_or(DVec3::ZERO, |p| DVec3::from(*p));
    for &i in mesh.triangles.iter().flatten() {
        low = low.min(corner(i));
        high = high.max(corner(i));
    }
    let scale = f64::from(levels).exp2() / (high - low).max_element();
    let grown = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| corner(i) * scale);
        let extents = a.max(b).max(c) - a.min(b).min(c);
        let shadows = (b - a).cross(c - a).abs() * 0.5;
        1.0 + extents.element_sum() + shadows.element_sum()
    };
    mesh.triangles.iter().map(grown).sum()
}
