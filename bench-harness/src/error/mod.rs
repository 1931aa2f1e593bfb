//! The error of an octree against its triangles: in depth ([`depth`]) and in pictures ([`image`]).

pub mod depth;
pub mod image;
