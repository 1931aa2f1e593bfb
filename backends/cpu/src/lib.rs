//! CPU casters of esvo: octrees on all cores, triangles through a BVH.

pub mod triangles;

mod machine;
mod octree;
mod scalar;
mod wide;

pub use machine::cpu_name;
pub use octree::{CpuCaster, Engine};
