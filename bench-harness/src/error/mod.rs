//! The error of an octree against its triangles: in depth ([`depth`]), of colours and normals ([`attributes`]) and in pictures ([`image`]).

pub mod attributes;
pub mod depth;
pub mod image;
