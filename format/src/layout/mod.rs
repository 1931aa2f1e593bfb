//! From a tree to blocks.

pub(crate) mod assemble;
mod attachments;
mod block;
pub(crate) mod pack;
mod place;
pub(crate) mod plan;
mod reattach;
pub(crate) mod tree;
