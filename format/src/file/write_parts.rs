//! The frame of a file whose blocks are stored in parts: what is before and after the block data (spec section 2).

use crate::file::extras::Extras;
use crate::file::write::header;
use crate::file::*;
use crate::index::build::Builder;
use crate::parts::table::block_crc;

/// Contents of a file with parts, without the parts themselves.
pub(crate) struct PartsFile<'a> {
    pub(crate) objects: &'a [ObjectEntry],
    /// The block table. File offsets, stored sizes, codecs and checksums are set by [`new`](Self::new).
    pub(crate) blocks: Vec<BlockEntry>,
    pub(crate) extras: Extras<'a>,
}

/// A part that waits to be written.
#[derive(Clone, Copy)]
pub(crate) struct Waiting {
    pub(crate) entry: PartEntry,
    pub(crate) codec: u32,
    /// Checksum in its header.
    pub(crate) crc: [u8; 4],
}

/// A file with parts, laid out.
pub(crate) struct Laid {
    /// The bytes before the parts.
    pub(crate) head: Vec<u8>,
    /// The order of the parts: indices into what was given.
    pub(crate) order: Vec<u32>,
    /// The bytes after the parts, but for HASH.
    pub(crate) tail: Vec<u8>,
}

impl PartsFile<'_> {
    /// Lays the file out. `parts` are those of all blocks, in the order of blocks and levels.
    pub(crate) fn lay_out(mut self, parts: &[Waiting]) -> std::io::Result<Laid> {
        let mut order: Vec<u32> = (0..parts.len() as u32).collect();
        order.sort_by_key(|&part| (parts[part as usize].entry.first_level, parts[part as usize].entry.block));
        let object_bytes: Vec<u8> = self.objects.iter().flat_map(to_bytes).collect();
        for own in parts.chunk_by(|a, b| a.entry.block == b.entry.block) {
            let block = &mut self.blocks[own[0].entry.block as usize];
            block.stored_size = own.iter().map(|part| u64::from(part.entry.size)).sum();
            block.codec = own[0].codec;
            block.crc = block_crc(own.iter().map(|part| part.crc));
        }
        // Offsets in BLKS, in the order of the parts given.
        let mut offsets = vec![0; parts.len()];
        let mut length = 0;
        for &part in &order {
            offsets[part as usize] = length;
            length = (length + u64::from(parts[part as usize].entry.size)).next_multiple_of(8);
        }
        let entries: Vec<PartEntry> = order.iter().map(|part| parts[*part as usize].entry).collect();
        let ordered: Vec<u64> = order.iter().map(|part| offsets[*part as usize]).collect();
        let (root, pages) = Builder::new(&self.blocks, &entries, &ordered).build()?;
        // OBJT, INDX, BLKS; PAGE, META, INST, unknown sections, PART, BLKT; HASH.
        let extras = self.extras.sections();
        let count = 5 + usize::from(!pages.is_empty()) + extras.len() + usize::from(self.extras.hash);
        let objects_at = HEADER_BYTES + count as u64 * SECTION_BYTES;
        let index_at = (objects_at + object_bytes.len() as u64).next_multiple_of(8);
        let head_length = index_at + root.len() as u64;
        let data_at = head_length.next_multiple_of(8);
        let end = data_at + length;
        for (part, at) in parts.iter().zip(&offsets).rev() {
            // The first part of a block is written last.
            self.blocks[part.entry.block as usize].file_offset = data_at + *at;
        }
        let compressed = self.blocks.iter().any(|b| b.codec != CODEC_RAW);
        let mut directory: Vec<SectionEntry> = Vec::with_capacity(count);
        let mut add = |tag, flags, offset, bytes: &[u8]| {
            let crc = if flags & SECTION_OWN_CHECKSUMS != 0 { 0 } else { crc32fast::hash(bytes) };
            directory.push(SectionEntry { tag, flags, offset, length: bytes.len() as u64, crc, reserved: 0 });
        };
        add(TAG_OBJECTS, SECTION_REQUIRED, objects_at, &object_bytes);
        add(TAG_INDEX, 0, index_at, &root);
        let mut tail = Vec::new();
        let mut put = |tag, flags, bytes: &[u8]| {
            add(tag, flags, end + tail.len() as u64, bytes);
            tail.extend_from_slice(bytes);
            tail.resize(tail.len().next_multiple_of(8), 0);
        };
        if !pages.is_empty() {
            put(TAG_PAGES, SECTION_OWN_CHECKSUMS, &pages);
        }
        for (tag, flags, bytes) in &extras {
            put(*tag, *flags, bytes);
        }
        let part_bytes: Vec<u8> = entries.iter().flat_map(to_bytes).collect();
        put(TAG_PARTS, SECTION_REQUIRED, &part_bytes);
        let block_bytes: Vec<u8> = self.blocks.iter().flat_map(to_bytes).collect();
        put(TAG_BLOCKS, SECTION_REQUIRED, &block_bytes);
        let flags = SECTION_REQUIRED | SECTION_OWN_CHECKSUMS;
        let data = SectionEntry { tag: TAG_DATA, flags, offset: data_at, length: end - data_at, crc: 0, reserved: 0 };
        directory.insert(2, data);
        let (hash, file_length) = self.extras.hash_at(end + tail.len() as u64);
        directory.extend(hash);
        let directory: Vec<u8> = directory.iter().flat_map(to_bytes).collect();
        let features = FEATURE_PARTS | if compressed { FEATURE_COMPRESSED } else { 0 };
        let mut head = header(features, file_length, count as u32, &directory, head_length as u32);
        head.extend_from_slice(&directory);
        head.extend_from_slice(&object_bytes);
        head.resize(index_at as usize, 0);
        head.extend_from_slice(&root);
        head.resize(data_at as usize, 0);
        Ok(Laid { head, order, tail })
    }
}
