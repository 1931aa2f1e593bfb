//! The mesh as the recursion reads it: corners in the root cube, normals, kinds of edges, and appearance.

pub(crate) mod attributes;
mod color_map;
mod edges;
mod look;
mod range;
mod shading;
mod srgb;
pub(crate) mod voxel;

use glam::{DMat4, DVec3, Vec3};
use rayon::prelude::*;

use crate::{BuildError, BuildSettings, Mesh, TextureTest};
pub(crate) use edges::Edges;
use look::Look;
pub(crate) use shading::Sample;
use shading::Shading;

/// A mesh prepared for building.
pub(crate) struct Surface<'a> {
    /// Corners in octree space: the root cube is `[0, 1]³`.
    pub corners: Vec<[DVec3; 3]>,
    /// Unit geometric normals.
    pub normals: Vec<Vec3>,
    /// Which edges of the triangles end or bend the surface.
    pub edges: Vec<Edges>,
    /// The transform from octree space to mesh space.
    pub octree_to_mesh: DMat4,
    /// Number of triangles that were left out because they have no area.
    pub dropped: usize,
    /// Whether alpha cuts holes into some material.
    pub has_holes: bool,
    /// Whether the test for refinement looks at every texel.
    pub tests_texels: bool,
    shading: Shading<'a>,
}

impl<'a> Surface<'a> {
    /// Checks the mesh and moves it into the root cube: centred, with its largest extent filling the cube.
    pub(crate) fn new(mesh: &'a Mesh, settings: &BuildSettings) -> Result<Self, BuildError> {
        mesh.validate().map_err(|e| BuildError::Mesh(e.to_string()))?;
        let octree_to_mesh = place(mesh)?;
        let scale = 1.0 / octree_to_mesh.x_axis.x;
        let origin = octree_to_mesh.w_axis.truncate();
        let corner = |i: u32| (DVec3::from(mesh.positions[i as usize]) - origin) * scale;
        let with_area: Vec<(u32, [DVec3; 3])> = (mesh.triangles.par_iter().enumerate())
            .map(|(i, t)| (i as u32, t.map(corner)))
            .filter(|(_, corners)| has_area(corners))
            .collect();
        if with_area.is_empty() {
            return Err(BuildError::Mesh("none of its triangles has an area; a mesh needs at least one".into()));
        }
        let (source, corners): (Vec<u32>, Vec<[DVec3; 3]>) = with_area.into_iter().unzip();
        let normals: Vec<Vec3> =
            (corners.par_iter()).map(|[a, b, c]| (*b - *a).cross(*c - *a).normalize_or(DVec3::Z).as_vec3()).collect();
        let looks = Look::all(mesh, settings.texture_test);
        let edges = edges::classify(&corners);
        let finest_voxel = (-(settings.levels as f32)).exp2();
        let shading = Shading::new(mesh, &source, &corners, &normals, looks, finest_voxel);
        Ok(Self {
            dropped: mesh.triangles.len() - source.len(),
            has_holes: shading.has_holes(),
            tests_texels: settings.texture_test == TextureTest::Texels,
            corners,
            normals,
            edges,
            octree_to_mesh,
            shading,
        })
    }

    /// Number of triangles.
    pub(crate) fn len(&self) -> usize {
        self.corners.len()
    }
}

/// The transform from the root cube to the mesh's bounding box: uniform scale, centred.
fn place(mesh: &Mesh) -> Result<DMat4, BuildError> {
    let (mut lo, mut hi) = (DVec3::MAX, DVec3::MIN);
    for &i in mesh.triangles.iter().flatten() {
        let p = DVec3::from(mesh.positions[i as usize]);
        lo = lo.min(p);
        hi = hi.max(p);
    }
    let extent = (hi - lo).max_element();
    if !(extent > 0.0 && extent.is_finite()) || (lo.abs().max(hi.abs()).max_element() / extent) > 1e12 {
        return Err(BuildError::Mesh(format!(
            "its largest extent is {extent:e} around {}; it must be finite, above 0 and at least 1e-12 of its coordinates",
            (lo + hi) * 0.5
        )));
    }
    // Far from the origin these are rounded. The cube must still contain all vertices.
    let origin = ((lo + hi) * 0.5 - DVec3::splat(extent * 0.5)).min(lo);
    let extent = extent.max((hi - origin).max_element());
    Ok(DMat4::from_translation(origin) * DMat4::from_scale(DVec3::splat(extent)))
}

/// Whether three points are not on a line. The test is exact: an area that rounds to zero can still be an area.
fn has_area(corners: &[DVec3; 3]) -> bool {
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
