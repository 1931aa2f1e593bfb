//! Bits of voxels and their mips: one array for a bounded world, bricks for one that is mostly empty.

mod bricks;
mod dense;

pub use bricks::Bricks;
pub use dense::{MAX_MIPS, MAX_VOXELS, Volume};

/// What rays are traced through: whether cells of several levels have a voxel.
///
/// Cells of level `l` are `2^l` voxels wide; those of level 0 are the voxels. Cell `c` of an axis reaches from voxel `c * 2^l` up to the next.
pub trait Occupancy {
    /// Greatest level that [`occupied`](Self::occupied) can be asked for.
    fn coarsest(&self) -> u32;

    /// Whether a cell has a voxel. Cells outside of the world have none. At levels above 0 the answer may be yes of a cell without a voxel, but never no
    /// of one with a voxel.
    fn occupied(&self, level: u32, cell: [i32; 3]) -> bool;

    /// Least voxel, and one past the greatest, along each axis; nothing is outside. `None`: the world has no bounds.
    fn bounds(&self) -> Option<[[i32; 3]; 2]>;

    /// The volume, if this is one: lists of rays are traced faster through it.
    fn dense(&self) -> Option<&Volume> {
        None
    }
}

/// The bit of a voxel, or of a cell, in the byte of the eight: `x + 2 y + 4 z` of what is odd in its place.
pub(crate) fn octant(cell: [i32; 3]) -> u32 {
    (cell[0] & 1 | (cell[1] & 1) << 1 | (cell[2] & 1) << 2) as u32
}
