//! The triangles of a mesh in the root cube.

use glam::{DMat4, DVec3};
use rayon::prelude::*;

use crate::{BuildError, BuildSettings, Mesh};

/// The triangles of a mesh as every build sees them: those that have an area, in octree space, where the root cube is `[0, 1]³`.
///
/// A test of cubes against these triangles finds the voxels of a build (see [`crate::cells`]). Holes that alpha cuts into
/// materials are not considered: a triangle counts whole.
pub struct PreparedMesh {
    /// Corners in octree space.
    pub(crate) corners: Vec<[DVec3; 3]>,
    /// Index into the mesh's triangles.
    pub(crate) source: Vec<u32>,
    /// The transform from octree space to mesh space.
    pub(crate) octree_to_mesh: DMat4,
    /// Number of triangles that were left out because they have no area.
    pub(crate) dropped: usize,
}

impl PreparedMesh {
    /// Checks a mesh and moves its triangles into the root cube: uniformly scaled, centred, with the largest extent of the
    /// triangles that have an area filling the cube.
    ///
    /// `levels` is the number of levels of the build to compare with, 1 to 23. It matters only for a mesh that is flat along
    /// an axis: this mesh lies in the middle of one layer of voxels of that level.
    ///
    /// # Errors
    /// A number of levels out of its range; a mesh that is not valid, has no triangle with an area, or has an extent that is
    /// too small or too large for the format.
    pub fn new(mesh: &Mesh, levels: u32) -> Result<Self, BuildError> {
        BuildSettings { levels, ..BuildSettings::default() }.check()?;
        mesh.validate().map_err(|e| BuildError::Mesh(e.to_string()))?;
        let (lo, hi) = bounds(mesh);
        let prepared = Self::within(mesh, place(lo, hi, levels)?);
        if prepared.corners.is_empty() {
            return Err(BuildError::Mesh("none of its triangles has an area; a mesh needs at least one".into()));
        }
        Ok(prepared)
    }

    /// The triangles of a valid mesh that have an area, in a root cube that is given. There may be none.
    pub(crate) fn within(mesh: &Mesh, octree_to_mesh: DMat4) -> Self {
        let scale = 1.0 / octree_to_mesh.x_axis.x;
        let origin = octree_to_mesh.w_axis.truncate();
        let corner = |i: u32| (DVec3::from(mesh.positions[i as usize]) - origin) * scale;
        let with_area: Vec<(u32, [DVec3; 3])> = (mesh.triangles.par_iter().enumerate())
            .map(|(i, t)| (i as u32, t.map(corner)))
            .filter(|(_, corners)| has_area(corners) && corners.iter().all(in_cube))
            .collect();
        let (source, corners): (Vec<u32>, Vec<[DVec3; 3]>) = with_area.into_iter().unzip();
        let dropped = mesh.triangles.len() - source.len();
        Self { corners, source, octree_to_mesh, dropped }
    }

    /// The corners of each triangle in octree space. They may be outside of the root cube by 1e-9.
    pub fn corners(&self) -> &[[DVec3; 3]] {
        &self.corners
    }

    /// The index in [`Mesh::triangles`] of the triangle at `index` in [`corners`](Self::corners). Ascending.
    ///
    /// # Panics
    /// If there is no such triangle.
    pub fn source(&self, index: usize) -> u32 {
        self.source[index]
    }

    /// The transform from octree space to mesh space: that of the octree that a build makes of the mesh.
    pub fn octree_to_mesh(&self) -> DMat4 {
        self.octree_to_mesh
    }

    /// Number of triangles of the mesh that were left out because they have no area.
    pub fn dropped(&self) -> usize {
        self.dropped
    }
}

/// A mesh that is at most so thick along an axis, as a share of its largest extent, is flat: a plane that was turned, or one
/// far from the origin, is rarely exactly flat. A 256th of half a voxel on the deepest level that an octree can have.
const FLAT: f64 = 1.0 / (1u64 << 32) as f64;

/// The transform from the root cube to the bounding box of the triangles that have an area, from `lo` to `hi`: uniform scale,
/// centred, with the largest extent filling the cube.
///
/// Along an axis in which the box is flat but for rounding (see [`FLAT`]), the cube is moved by half a voxel of the deepest
/// level, so that the surface lies in the middle of one layer of voxels instead of on the border of two.
pub(crate) fn place(lo: DVec3, hi: DVec3, levels: u32) -> Result<DMat4, BuildError> {
    let extent = (hi - lo).max_element();
    let farthest = lo.abs().max(hi.abs()).max_element();
    if extent == 0.0 {
        return Err(BuildError::Mesh(
            "all its vertices lie at one point; a mesh needs at least one triangle with an area".into(),
        ));
    }
    // The third power of the extent is the determinant of the transform, which the format requires to be a normal number.
    if !(1e-100..=1e100).contains(&extent) {
        return Err(BuildError::Mesh(format!(
            "its largest extent is {extent:e}; it must be between 1e-100 and 1e100, choose another unit"
        )));
    }
    if farthest / extent > 1e12 {
        return Err(BuildError::Mesh(format!(
            "its largest extent is {extent:e}, with coordinates up to {farthest:e}; it must be at least 1e-12 of its coordinates, move \
             it closer to the origin"
        )));
    }
    // Far from the origin these are rounded. The cube must still contain all vertices.
    let mut origin = ((lo + hi) * 0.5 - DVec3::splat(extent * 0.5)).min(lo);
    let extent = extent.max((hi - origin).max_element());
    for axis in (0..3).filter(|&axis| hi[axis] - lo[axis] <= FLAT * extent) {
        origin[axis] = (lo[axis] + hi[axis]) * 0.5 - extent * (0.5 + 0.5 * (-f64::from(levels)).exp2());
    }
    Ok(DMat4::from_translation(origin) * DMat4::from_scale(DVec3::splat(extent)))
}

/// Smallest and largest coordinates over the triangles that have an area; over all triangles if none has.
fn bounds(mesh: &Mesh) -> (DVec3, DVec3) {
    let corners = |t: &[u32; 3]| t.map(|i| DVec3::from(mesh.positions[i as usize]));
    let of = |kept: &(dyn Fn(&[DVec3; 3]) -> bool + Sync)| {
        let empty = (DVec3::MAX, DVec3::MIN);
        let join = |a: (DVec3, DVec3), b: (DVec3, DVec3)| (a.0.min(b.0), a.1.max(b.1));
        let triangles = mesh.triangles.par_iter().map(corners).filter(kept);
        triangles.map(|[a, b, c]| (a.min(b).min(c), a.max(b).max(c))).reduce(|| empty, join)
    };
    let (all_lo, all_hi) = of(&|_| true);
    let scale = unit_scale(all_lo.abs().max(all_hi.abs()).max_element());
    let (lo, hi) = of(&|corners| has_area(&corners.map(|p| p * scale)));
    if lo.cmple(hi).all() { (lo, hi) } else { (all_lo, all_hi) }
}

/// The power of two that brings coordinates of this size near 1: exact, and products neither overflow nor vanish then.
pub(crate) fn unit_scale(largest: f64) -> f64 {
    (-largest.log2().floor().clamp(-1000.0, 1000.0)).exp2()
}

/// Whether a point lies in the root cube, with a margin for rounding. A triangle that has an area only because of rounding
/// does not count for the bounds, so it may lie outside.
fn in_cube(p: &DVec3) -> bool {
    const MARGIN: f64 = 1e-9;
    p.cmpge(DVec3::splat(-MARGIN)).all() && p.cmple(DVec3::splat(1.0 + MARGIN)).all()
}

/// Whether three points are not on a line. The test is exact: an area that rounds to zero can still be an area.
pub(crate) fn has_area(corners: &[DVec3; 3]) -> bool {
    let [a, b, c] = *corners;
    let (ab, ac) = (b - a, c - a);
    // Far above rounding errors and underflow: no exact test needed.
    if ab.cross(ac).length_squared() > 1e-24 * ab.length_squared() * ac.length_squared() + 1e-280 {
        return true;
    }
    [(0, 1), (1, 2), (2, 0)].into_iter().any(|(x, y)| {
        let [a, b, c] = corners.map(|p| robust::Coord { x: p[x], y: p[y] });
        robust::orient2d(a, b, c) != 0.0
    })
}
