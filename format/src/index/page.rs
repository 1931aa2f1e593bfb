//! The bytes of a page of the index (spec section 4.5).

use crate::file::compression::{MAX_RATIO, Packer, Unpacker};
use crate::parts::split::{BYTES, join, split};

/// A block in a page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct PageBlock {
    /// Index in the block table.
    pub(crate) index: u32,
    pub(crate) object: u32,
    /// Index in the block table, or `NO_PARENT`.
    pub(crate) parent: u32,
    pub(crate) position: [u32; 3],
    pub(crate) scale: u32,
    pub(crate) codec: u32,
    /// Size in the image in pages.
    pub(crate) image_pages: u32,
}

/// A part in a page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct PagePart {
    /// Which block of the page it belongs to.
    pub(crate) block: u32,
    pub(crate) size: u32,
    pub(crate) first_level: u32,
    pub(crate) last_level: u32,
    /// Offset in BLKS; a multiple of 8.
    pub(crate) offset: u64,
}

/// A link to another page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct PageLink {
    /// Offset in the section PAGE.
    pub(crate) offset: u32,
    pub(crate) size: u32,
    pub(crate) crc: u32,
    /// The only object of its blocks, or `u32::MAX` if there are several.
    pub(crate) object: u32,
    /// Least first level of the parts in that page and those below it.
    pub(crate) first_level: u32,
    /// A cube that has the cubes of all these blocks.
    pub(crate) position: [u32; 3],
    pub(crate) scale: u32,
}

/// A page.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Page {
    /// By index.
    pub(crate) blocks: Vec<PageBlock>,
    /// In the order in which they are stored.
    pub(crate) parts: Vec<PagePart>,
    pub(crate) links: Vec<PageLink>,
}

const BLOCK_COLUMNS: usize = 9;
const PART_COLUMNS: usize = 6;
const LINK_COLUMNS: usize = 9;

impl Page {
    /// The columns of the page, each a word for every block, part or link.
    fn columns(&self) -> Vec<Vec<u32>> {
        let mut columns = Vec::with_capacity(BLOCK_COLUMNS + PART_COLUMNS + LINK_COLUMNS);
        let mut before = 0u32;
        let step = |value: u32, before: &mut u32| {
            let step = value.wrapping_sub(*before);
            *before = value;
            step
        };
        columns.push(self.blocks.iter().map(|block| step(block.index, &mut before)).collect());
        columns.push(self.blocks.iter().map(|block| block.object).collect());
        columns.push(self.blocks.iter().map(|block| block.index.wrapping_sub(block.parent)).collect());
        for axis in 0..3 {
            columns.push(self.blocks.iter().map(|block| block.position[axis]).collect());
        }
        columns.push(self.blocks.iter().map(|block| block.scale).collect());
        columns.push(self.blocks.iter().map(|block| block.codec).collect());
        columns.push(self.blocks.iter().map(|block| block.image_pages).collect());
        let mut before = 0u32;
        columns.push(self.parts.iter().map(|part| step(part.block, &mut before)).collect());
        columns.push(self.parts.iter().map(|part| part.size).collect());
        columns.push(self.parts.iter().map(|part| part.first_level).collect());
        columns.push(self.parts.iter().map(|part| part.last_level).collect());
        let mut end = 0u64;
        let gaps: Vec<u64> = (self.parts.iter())
            .map(|part| {
                let gap = part.offset.wrapping_sub(end) / 8;
                end = (part.offset + u64::from(part.size)).next_multiple_of(8);
                gap
            })
            .collect();
        columns.push(gaps.iter().map(|gap| *gap as u32).collect());
        columns.push(gaps.iter().map(|gap| (gap >> 32) as u32).collect());
        columns.push(self.links.iter().map(|link| link.offset).collect());
        columns.push(self.links.iter().map(|link| link.size).collect());
        columns.push(self.links.iter().map(|link| link.crc).collect());
        columns.push(self.links.iter().map(|link| link.object).collect());
        columns.push(self.links.iter().map(|link| link.first_level).collect());
        for axis in 0..3 {
            columns.push(self.links.iter().map(|link| link.position[axis]).collect());
        }
        columns.push(self.links.iter().map(|link| link.scale).collect());
        columns
    }

    /// The stored bytes.
    pub(crate) fn encode(&self) -> std::io::Result<Vec<u8>> {
        let mut streams = Vec::new();
        for column in self.columns() {
            split(&column, BYTES, &mut streams);
        }
        let mut out = Vec::new();
        for count in [self.blocks.len(), self.parts.len(), self.links.len()] {
            out.extend((count as u32).to_le_bytes());
        }
        out.extend(Packer::new(19)?.pack(&streams.concat())?);
        Ok(out)
    }

    /// A page of its stored bytes.
    ///
    /// # Errors
    /// What is wrong with them.
    pub(crate) fn decode(stored: &[u8]) -> Result<Self, String> {
        let (counts, frame) = stored.split_at_checked(12).ok_or("a page of the index has less than 12 bytes")?;
        let count = |k: usize| u32::from_le_bytes([counts[k], counts[k + 1], counts[k + 2], counts[k + 3]]) as usize;
        let [blocks, parts, links] = [count(0), count(4), count(8)];
        let words = [(blocks, BLOCK_COLUMNS), (parts, PART_COLUMNS), (links, LINK_COLUMNS)];
        let total: u64 = words.iter().map(|(count, columns)| *count as u64 * *columns as u64 * 4).sum();
        // Compared before memory is taken.
        if total / MAX_RATIO > frame.len() as u64 {
            return Err(format!("a page of the index cannot have {total} bytes"));
        }
        let mut bytes = vec![0; total as usize];
        Unpacker::new()?.unpack(frame, &mut bytes)?;
        let mut rest = &bytes[..];
        let mut next = |count: usize| {
            let (head, tail) = rest.split_at(4 * count);
            rest = tail;
            let streams = [0, 1, 2, 3].map(|k| &head[k * count..(k + 1) * count]);
            let mut words = vec![0; count];
            // All bits of a byte are in use.
            let _ = join(streams, BYTES, &mut words);
            words
        };
        let mut page = Self::default();
        let columns: [Vec<u32>; BLOCK_COLUMNS] = std::array::from_fn(|_| next(blocks));
        let [index, object, parent, x, y, z, scale, codec, image_pages] = &columns;
        let mut at = 0u32;
        for k in 0..blocks {
            at = at.wrapping_add(index[k]);
            page.blocks.push(PageBlock {
                index: at,
                object: object[k],
                parent: at.wrapping_sub(parent[k]),
                position: [x[k], y[k], z[k]],
                scale: scale[k],
                codec: codec[k],
                image_pages: image_pages[k],
            });
        }
        let columns: [Vec<u32>; PART_COLUMNS] = std::array::from_fn(|_| next(parts));
        let [block, size, first, last, low, high] = &columns;
        let (mut owner, mut end) = (0u32, 0u64);
        for k in 0..parts {
            owner = owner.wrapping_add(block[k]);
            let gap = u64::from(high[k]) << 32 | u64::from(low[k]);
            let offset = end.wrapping_add(gap.wrapping_mul(8));
            if owner as usize >= blocks || offset > u64::MAX >> 1 {
                return Err(format!("part {k} of a page of the index belongs to no block of it, or is at {offset}"));
            }
            end = (offset + u64::from(size[k])).next_multiple_of(8);
            page.parts.push(PagePart {
                block: owner,
                size: size[k],
                first_level: first[k],
                last_level: last[k],
                offset,
            });
        }
        let columns: [Vec<u32>; LINK_COLUMNS] = std::array::from_fn(|_| next(links));
        let [offset, size, crc, object, level, x, y, z, scale] = &columns;
        for k in 0..links {
            page.links.push(PageLink {
                offset: offset[k],
                size: size[k],
                crc: crc[k],
                object: object[k],
                first_level: level[k],
                position: [x[k], y[k], z[k]],
                scale: scale[k],
            });
        }
        Ok(page)
    }
}
