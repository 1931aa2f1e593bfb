//! `esvo bench pictures`: octrees next to the triangles they were built from.

pub(crate) mod cutout;
pub(crate) mod mesh_picture;
pub mod pictures;
