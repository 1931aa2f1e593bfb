//! Blocks stored in parts by level, as streams of fields (spec section 4.3).
//!
//! `split.rs` takes words apart into streams and puts them together, `recent.rs` leaves out what repeats, `fields.rs` has the fields of a block level by level,
//! `encode.rs` makes them of an image, `layout.rs` makes the image of them, `stored.rs` has the bytes of a part, `block.rs` all
//! parts of a block.

pub(crate) mod block;
pub(crate) mod encode;
pub(crate) mod fields;
pub(crate) mod instructions;
pub(crate) mod layout;
pub(crate) mod recent;
pub(crate) mod split;
pub(crate) mod stored;
pub(crate) mod table;

#[cfg(all(test, feature = "zstd"))]
mod tests;
