//! Turns triangle meshes into esvo sparse voxel octrees.

pub mod import;
pub mod mesh;

pub use mesh::{Material, Mesh, MipLevel, Texture};
