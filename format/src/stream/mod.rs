//! Reading parts of a file from any source of bytes (spec section 11).

pub(crate) mod block;
mod partial;
mod parts;
pub(crate) mod reader;
mod runs;
pub(crate) mod served;
pub(crate) mod source;
