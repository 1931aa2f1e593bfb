//! Octrees counted, shown and compared.

pub mod diff;
pub mod dump;
pub(crate) mod stats;
