//! The index: what is in a file with parts, in pages that are read as they are needed (spec section 4.5).
//!
//! `page.rs` has the bytes of a page, `build.rs` cuts the tables into pages, `check.rs` compares pages with the tables.

pub(crate) mod build;
pub(crate) mod check;
#[cfg(all(test, feature = "zstd"))]
mod large;
pub(crate) mod page;

/// Largest page in bytes, as stored.
pub(crate) const MAX_PAGE: usize = 16 << 10;
