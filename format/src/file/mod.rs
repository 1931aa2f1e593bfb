//! The bytes of a file: records of headers and tables (re-exported from this module), opening, writing, compression.

pub(crate) mod compression;
pub(crate) mod extras;
pub(crate) mod hash;
pub(crate) mod open;
mod records;
pub(crate) mod write;
pub(crate) mod write_parts;

pub use records::*;
