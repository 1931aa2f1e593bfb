//! The table of parts, and where the parts of each block are (spec section 4.3).

use crate::file::*;
use crate::parts::block::first_level;
use crate::{Broken, ids};

/// The parts of a file.
#[derive(Clone, Debug, Default)]
pub(crate) struct PartTable {
    pub(crate) entries: Vec<PartEntry>,
    /// Offset of each part in the file.
    pub(crate) offsets: Vec<u64>,
    /// Offset of the table in the file.
    at: u64,
    /// The parts block by block, by level.
    order: Vec<u32>,
    /// Where the parts of each block begin in `order`, and where the last ones end.
    starts: Vec<u32>,
}

impl PartTable {
    /// The parts of a block by level: their indices.
    pub(crate) fn of_block(&self, block: usize) -> &[u32] {
        &self.order[self.starts[block] as usize..self.starts[block + 1] as usize]
    }

    /// Where the parts are not in the order of first level and block, and what is wrong.
    pub(crate) fn disorder(&self) -> Option<(u64, String)> {
        let key = |part: &PartEntry| (part.first_level, part.block);
        let index = self.entries.windows(2).position(|pair| key(&pair[0]) >= key(&pair[1]))? + 1;
        let what = format!("part {index} is not in the order of first level, then block");
        Some((self.at + index as u64 * PART_BYTES, what))
    }

    /// Start and end of a part in the file.
    pub(crate) fn range(&self, part: u32) -> (u64, u64) {
        let at = self.offsets[part as usize];
        (at, at + u64::from(self.entries[part as usize].size))
    }

    /// Checks the table, which starts at byte `at`, against the block table. `data` is the section of the block data. The
    /// block table must have been checked, but for where the blocks are stored.
    pub(crate) fn new(
        entries: Vec<PartEntry>,
        at: u64,
        blocks: &[BlockEntry],
        blocks_at: u64,
        data: &SectionEntry,
    ) -> Result<Self, Broken> {
        let fault = |rule, index: usize, what: String| {
            Err(Broken::new(rule, at + index as u64 * PART_BYTES, format!("part {index}: {what}")))
        };
        let mut offsets = Vec::with_capacity(entries.len());
        let mut end = data.offset;
        for (index, part) in entries.iter().enumerate() {
            if part.reserved != 0 {
                return fault(ids::PART_RESERVED, index, "reserved fields are not zero".into());
            }
            if u64::from(part.size) <= PART_HEADER_BYTES {
                return fault(ids::PART_PLACE, index, format!("it has {} bytes, too few for a header", part.size));
            }
            offsets.push(end);
            // At most 2^32 entries of 2^32 bytes: no wrapping.
            end = (end + u64::from(part.size)).next_multiple_of(8);
            let block = blocks.get(part.block as usize);
            let Some(block) = block.filter(|b| part.first_level >= first_level(b)) else {
                let what = format!("there is no level {} in a block {}", part.first_level, part.block);
                return fault(ids::PART_LEVELS, index, what);
            };
            let whole = block.codec != CODEC_FIELDS;
            let last_fits = if whole { part.last_level == LAST_LEVEL } else { part.last_level <= LAST_LEVEL };
            if part.first_level > part.last_level || !last_fits {
                let what = format!("levels {} to {} with codec {}", part.first_level, part.last_level, block.codec);
                return fault(ids::PART_LEVELS, index, what);
            }
        }
        if end != data.offset + data.length {
            let what = format!("the parts end at byte {end}, the block data at {}", data.offset + data.length);
            return Err(Broken::new(ids::PART_PLACE, at, what));
        }
        let mut order: Vec<u32> = (0..entries.len() as u32).collect();
        order.sort_by_key(|&part| (entries[part as usize].block, entries[part as usize].first_level));
        let mut starts = Vec::with_capacity(blocks.len() + 1);
        let mut next = 0;
        for (index, block) in blocks.iter().enumerate() {
            starts.push(next as u32);
            let mut level = first_level(block);
            let (mut size, first) = (0u64, next);
            while let Some(&part) = order.get(next).filter(|part| entries[**part as usize].block as usize == index) {
                let entry = &entries[part as usize];
                if entry.first_level != level {
                    let what = format!("it begins with level {}, expected {level}", entry.first_level);
                    return fault(ids::PART_LEVELS, part as usize, what);
                }
                level = entry.last_level + 1;
                size += u64::from(entry.size);
                next += 1;
            }
            let fail = |rule, field, what: String| {
                let at = blocks_at + index as u64 * BLOCK_BYTES + field;
                Err(Broken::new(rule, at, format!("block {index}: {what}")))
            };
            if first == next {
                return fail(ids::PART_LEVELS, 0, "it has no part".into());
            }
            let offset = offsets[order[first] as usize];
            if (block.file_offset, block.stored_size) != (offset, size) {
                let what = format!(
                    "{} bytes at file offset {}, but its parts have {size} from {offset} on",
                    block.stored_size, block.file_offset
                );
                return fail(ids::PART_BLOCK, 40, what);
            }
        }
        starts.push(next as u32);
        Ok(Self { entries, offsets, at, order, starts })
    }
}

/// The checksum of a block that is stored in parts: the CRC-32 of the checksums of its parts.
pub(crate) fn block_crc(parts: impl IntoIterator<Item = [u8; 4]>) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    parts.into_iter().for_each(|crc| hasher.update(&crc));
    hasher.finalize()
}
