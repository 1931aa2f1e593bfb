//! What every engine that runs the GPU kernel shares.

pub mod choice;
pub mod kernel;
pub mod resident;
