//! What every engine that runs the GPU kernel shares: the kernel's variants and buffers, and the part of an octree that a
//! device holds.

pub mod kernel;
pub mod resident;
