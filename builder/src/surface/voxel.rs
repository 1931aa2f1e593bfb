//! The surface in one voxel.

use glam::DVec3;

use super::Surface;
use crate::clip::{Arena, Piece};

/// The surface in one voxel, and where the voxel is.
pub(crate) struct VoxelSurface<'a> {
    /// The whole surface.
    pub surface: &'a Surface<'a>,
    /// Holds the vertices of the pieces.
    pub arena: &'a Arena,
    /// The pieces of triangles in the voxel.
    pub pieces: &'a [Piece],
    /// Centre of the voxel in octree space.
    pub centre: DVec3,
    /// Edge of the voxel in octree space.
    pub size: f64,
}

impl VoxelSurface<'_> {
    /// Whether the surface has a hole in the voxel. Called for surface that is not all hole.
    pub(crate) fn has_holes(&self) -> bool {
        self.surface.is_cut_through(self.arena, self.pieces)
    }
}
