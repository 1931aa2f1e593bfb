//! Reading a part of a file (spec section 11).

pub(crate) mod block;
mod partial;
pub(crate) mod reader;
pub(crate) mod source;
