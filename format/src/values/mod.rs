//! Values of voxels, and the ways in which they are encoded.

pub(crate) mod ambient;
pub(crate) mod color;
pub(crate) mod contour;
mod lanes;
pub(crate) mod normal;
pub(crate) mod plain;
pub mod srgb;
