//! How far an octree is from its triangles: in depth, and as a picture.

pub mod depth;
pub mod image;
