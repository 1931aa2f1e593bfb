//! Values of voxels and their encodings (spec sections 7 and 8).

pub(crate) mod ambient;
pub(crate) mod color;
pub(crate) mod components;
pub(crate) mod contour;
mod lanes;
pub(crate) mod normal;
pub(crate) mod plain;
pub mod srgb;
