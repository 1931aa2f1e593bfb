//! Blocks read from a file, and regions to select them by.

use glam::DVec3;

use crate::block::BlockParts;
use crate::file::{BlockEntry, CODEC_RAW, PartEntry};

/// A closed box in octree space, where the root cube is `[0, 1]³`.
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

    /// The cube with its lower corner at `position`, in units of 2^-23 of the root cube, and the edge `2^(scale - 23)`.
    /// Scales above 23 count as 23.
    pub fn cube(position: [u32; 3], scale: u32) -> Self {
        let unit = 1.0 / f64::from(1u32 << 23);
        let low = DVec3::from(position.map(f64::from)) * unit;
        Self { low, high: low + f64::from(1u32 << scale.min(23)) * unit }
    }

    /// Whether the two boxes have a point in common. False if either contains NaN.
    pub fn meets(&self, other: &Self) -> bool {
        self.low.cmple(other.high).all() && other.low.cmple(self.high).all()
    }
}

/// A block that has been read and decompressed. Its checksum and its info section have been checked, its descriptors
/// have not.
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

    /// The places of the parts of the block, relative to its own start.
    pub fn parts(&self) -> &BlockParts {
        &self.parts
    }

    /// The image of the block in slots of 8 bytes.
    pub fn slots(&self) -> &[u64] {
        &self.slots
    }
}

/// A part that has been read: some levels of a block. Its checksum and its header have been checked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Part {
    pub(crate) index: u32,
    pub(crate) entry: PartEntry,
    pub(crate) body: Vec<u8>,
}

impl Part {
    /// Index in the table of parts of the file.
    pub fn index(&self) -> u32 {
        self.index
    }

    /// Its entry: block, levels, size.
    pub fn entry(&self) -> &PartEntry {
        &self.entry
    }
}

/// Offset of byte `at` of a block in the file, or in the image if the block is compressed.
pub(crate) fn file_offset(block: &BlockEntry, at: u64) -> u64 {
    at + if block.codec == CODEC_RAW { block.file_offset } else { block.image_offset }
}
