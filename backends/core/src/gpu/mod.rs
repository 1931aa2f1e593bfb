//! What every engine that runs the GPU kernel shares.

pub mod kernel;
pub mod resident;
