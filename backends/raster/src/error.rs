//! What can go wrong.

use esvo_device::DeviceError;

use crate::Method;

/// Why a mesh was not voxelized.
#[derive(Clone, PartialEq, Debug, thiserror::Error)]
pub enum RasterError {
    /// The grid's level.
    #[error("a grid of level {0} was asked for; there are levels 1 to {MAX_LEVEL}", MAX_LEVEL = crate::MAX_LEVEL)]
    Level(u32),
    /// A corner that is infinite, NaN, or too far outside of the grid.
    #[error(
        "triangle {triangle} has a corner at {at}, in units of the grid's edge; corners must be within {limit} of it. Cut off what \
         lies outside, or repair the mesh",
        limit = crate::records::FARTHEST
    )]
    Corner {
        /// Index of the triangle.
        triangle: usize,
        /// The coordinate.
        at: f64,
    },
    /// More triangles than numbers for them.
    #[error("{0} triangles were given; the most is 2^32 - 1")]
    TooManyTriangles(usize),
    /// A number of attributes that does not fit the triangles, or a material or texture that is not there.
    #[error("{0}")]
    Looks(String),
    /// The device lacks what the method needs.
    #[error("{method}: {device} {lacks}; choose another method or device")]
    Lacks {
        /// The method.
        method: Method,
        /// Name of the device.
        device: String,
        /// What it lacks, e.g. "has no conservative rasterization".
        lacks: &'static str,
    },
    /// A triangle too large for a rasterizer's precision.
    #[error(
        "triangle {triangle} is {voxels} voxels long; methods that rasterize take at most {most}. Use the method compute, or cut \
         the triangle"
    )]
    TooLong {
        /// Index of the triangle.
        triangle: usize,
        /// Its extent in voxels.
        voxels: u64,
        /// The largest extent.
        most: u64,
    },
    /// More triangles in one voxel than its sums have room for.
    #[error(
        "{triangles} triangles meet one voxel; sums of attributes have room for {most}. Choose a deeper level, or leave attributes out"
    )]
    TooManyInVoxel {
        /// How many.
        triangles: u32,
        /// How many there may be.
        most: u32,
    },
    /// The device.
    #[error(transparent)]
    Device(#[from] DeviceError),
}
