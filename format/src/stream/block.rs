//! Blocks read from a file, and the regions that they are chosen by.

use glam::DVec3;

use crate::block::BlockParts;
use crate::file::{BlockEntry, CODEC_RAW};

/// A box in octree space, where the root cube is `[0, 1]³`; faces belong to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// Lower corner.
    pub low: DVec3,
    /// Upper corner.
    pub high: DVec3,
}

impl Region {
    /// All of the root cube.
    pub const ALL: Self = Self { low: DVec3::ZERO, high: DVec3::ONE };

    /// The cube at `position`, in units of 2^-23 of the root cube, of this scale: its edge is `2^(scale - 23)`.
    /// Scales beyond 23 count as 23.
    pub fn cube(position: [u32; 3], scale: u32) -> Self {
        let unit = 1.0 / f64::from(1u32 << 23);
        let low = DVec3::from(position.map(f64::from)) * unit;
        Self { low, high: low + f64::from(1u32 << scale.min(23)) * unit }
    }

    /// Whether the two have a point in common. With a NaN in either they have none.
    pub fn meets(&self, other: &Self) -> bool {
        self.low.cmple(other.high).all() && other.low.cmple(self.high).all()
    }
}

/// A block that has been read: its stored bytes match their checksum, it is not compressed any more, and its info
/// section fits. What its descriptors say has not been checked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Block {
    pub(crate) index: u32,
    pub(crate) parts: BlockParts,
    pub(crate) slots: Vec<u64>,
}

impl Block {
    /// Index in the block table of the file.
    pub fn index(&self) -> u32 {
        self.index
    }

    /// Where the parts of the block lie, counted from its own first slot, word and byte.
    pub fn parts(&self) -> &BlockParts {
        &self.parts
    }

    /// The image of the block in slots of 8 bytes.
    pub fn slots(&self) -> &[u64] {
        &self.slots
    }
}

/// Where byte `at` of a block lies in the file, or in the image if the block is compressed.
pub(crate) fn file_offset(block: &BlockEntry, at: u64) -> u64 {
    at + if block.codec == CODEC_RAW { block.file_offset } else { block.image_offset }
}
