//! The mesh as the recursion reads it: corners in the root cube, normals, kinds of edges, and appearance.

pub(crate) mod attributes;
mod color_map;
mod edges;
mod look;
pub(crate) mod prepared;
pub(crate) mod properties;
mod range;
mod shading;
pub(crate) mod span;
pub(crate) mod srgb;
mod texels;
pub(crate) mod voxel;

use std::sync::Arc;

use esvo_format::Column;
use esvo_format::file::attachment;
use glam::{DMat4, DVec3, Vec3};
use rayon::prelude::*;

use crate::{BuildError, BuildSettings, Mesh, TextureTest};
pub(crate) use edges::Edges;
pub(crate) use look::Look;
pub(crate) use prepared::PreparedMesh;
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
    /// Whether colours are stored, and normals. What is not stored is not looked up.
    colors: bool,
    normals_stored: bool,
    /// What the attributes of a voxel are compared with.
    pub test: TextureTest,
    /// Colours that differ by more than this in a channel are never within the bound of one.
    color_reach: u8,
    /// Columns of the trees of components, without values.
    pub columns: Vec<Column>,
    /// Whether emission varies over some triangle, or from one to another.
    pub emission_varies: bool,
    shading: Shading<'a>,
}

impl<'a> Surface<'a> {
    /// Checks the mesh and moves it into the root cube, see [`PreparedMesh::new`].
    pub(crate) fn new(mesh: &'a Mesh, settings: &BuildSettings) -> Result<Self, BuildError> {
        Ok(Self::of(
            mesh,
            PreparedMesh::new(mesh, settings.levels)?,
            Look::all(mesh, settings.texture_test, settings.components),
            settings,
        ))
    }

    /// Some triangles of a larger mesh, in the root cube of the whole. `looks` are those of its materials; whether it has normals,
    /// texture coordinates, colours and tangents must be the same for both.
    pub(crate) fn part(mesh: &'a Mesh, octree_to_mesh: DMat4, looks: Arc<[Look]>, settings: &BuildSettings) -> Self {
        Self::of(mesh, PreparedMesh::within(mesh, octree_to_mesh), looks, settings)
    }

    fn of(mesh: &'a Mesh, prepared: PreparedMesh, looks: Arc<[Look]>, settings: &BuildSettings) -> Self {
        let PreparedMesh { corners, source, octree_to_mesh, dropped } = prepared;
        let normals: Vec<Vec3> =
            (corners.par_iter()).map(|[a, b, c]| (*b - *a).cross(*c - *a).normalize_or(DVec3::Z).as_vec3()).collect();
        let edges = edges::classify(&corners);
        let finest_voxel = (-(settings.levels as f32)).exp2();
        let columns = properties::columns(&looks);
        let emission_varies = columns.iter().any(|column| column.kind == attachment::EMISSION);
        let shading = Shading::new(mesh, &source, &corners, &normals, looks, finest_voxel);
        Self {
            dropped,
            has_holes: shading.has_holes(),
            colors: settings.colors,
            normals_stored: settings.normals,
            test: settings.texture_test,
            color_reach: (settings.color_error * 2.0).ceil().min(255.0) as u8,
            corners,
            normals,
            edges,
            octree_to_mesh,
            columns,
            emission_varies,
            shading,
        }
    }

    /// Whether voxels store anything that comes from the surface in them.
    pub(crate) fn stores(&self, settings: &BuildSettings) -> bool {
        settings.stores_attributes() || !self.columns.is_empty()
    }

    /// Number of triangles.
    pub(crate) fn len(&self) -> usize {
        self.corners.len()
    }
}
