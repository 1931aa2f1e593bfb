//! From a tree to blocks: a tree in depth-first order is cut into blocks (`plan`); in each block descriptors get slots
//! (`place`) and are encoded (`block`, `attachments`, `columns`). `assemble` does this for a whole tree, `pack` for one block at a
//! time. `reattach` adds an attachment to existing blocks, `join` brings octrees together.

pub(crate) mod assemble;
mod attachments;
mod block;
pub(crate) mod columns;
pub(crate) mod join;
pub(crate) mod pack;
mod place;
pub(crate) mod plan;
mod reattach;
pub(crate) mod tree;
