//! CPU casters of esvo: octrees on all cores, triangles through a BVH.

pub mod triangles;

mod machine;
mod octree;

pub use machine::cpu_name;
pub use octree::{CpuCaster, InstructionSet};
