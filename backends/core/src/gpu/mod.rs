//! What every engine that runs the GPU kernel shares: the choice of a device, the variants and buffers of the kernel, and
//! the part of an octree that a device holds; and triangles.

pub mod arithmetic;
pub mod choice;
pub mod kernel;
pub mod resident;
pub mod slots;
pub mod triangles;
