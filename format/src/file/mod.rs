//! Files: their records, opening and writing.

pub(crate) mod compression;
pub(crate) mod open;
mod records;
pub(crate) mod write;

pub use records::*;
