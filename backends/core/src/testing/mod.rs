//! For testing casters.

pub mod compare;
pub mod conformance;
pub mod sample;
pub mod speed;
