//! Checks of the index against the tables (spec section 4.5).

use crate::file::*;
use crate::index::page::Page;
use crate::parts::table::PartTable;
use crate::{Broken, ids};

/// Checks that the pages have the blocks and parts of the tables, each once. `root` are the bytes of the section INDX at byte
/// `at`, `pages` those of the section PAGE.
pub(crate) fn check_index(
    root: &[u8],
    at: u64,
    pages: &[u8],
    pages_at: u64,
    blocks: &[BlockEntry],
    parts: &PartTable,
) -> Result<(), Broken> {
    // The first part is at the start of BLKS.
    let start = parts.offsets.first().copied().unwrap_or(0);
    let mut seen_parts = 0;
    let mut seen = vec![false; blocks.len()];
    let mut ranges = Vec::new();
    let mut stack = vec![(root, at)];
    while let Some((bytes, at)) = stack.pop() {
        let page = Page::decode(bytes).map_err(|what| Broken::new(ids::INDEX_PAGE, at, what))?;
        let differs = |what: String| Broken::new(ids::INDEX_TABLES, at, format!("a page of the index: {what}"));
        for block in &page.blocks {
            let index = block.index as usize;
            let same = blocks.get(index).is_some_and(|entry| {
                (block.object, block.parent, block.codec) == (entry.object, entry.parent, entry.codec)
                    && (block.position, block.scale) == (entry.cube_position, entry.cube_scale)
                    && u64::from(block.image_pages) * PAGE_BYTES == entry.image_size
            });
            if !same || std::mem::replace(&mut seen[index], true) {
                return Err(differs(format!("block {index} is there twice, or differs from the block table")));
            }
        }
        for part in &page.parts {
            let index = page.blocks[part.block as usize].index;
            let found = parts.of_block(index as usize).iter().any(|&number| {
                let entry = &parts.entries[number as usize];
                let levels = (u32::from(entry.first_level), u32::from(entry.last_level));
                (part.size, part.first_level, part.last_level) == (entry.size, levels.0, levels.1)
                    && part.offset.checked_add(start) == Some(parts.offsets[number as usize])
            });
            if !found {
                return Err(differs(format!("a part of block {index} differs from the table of parts")));
            }
            seen_parts += 1;
        }
        if page.parts.windows(2).any(|pair| pair[0].offset >= pair[1].offset) {
            return Err(differs("its parts are not in the order of their offsets".into()));
        }
        for link in &page.links {
            let (start, end) = (link.offset as usize, link.offset as usize + link.size as usize);
            let Some(bytes) = pages.get(start..end).filter(|bytes| crc32fast::hash(bytes) == link.crc) else {
                let what =
                    format!("a link to the {} bytes at {start} of PAGE, which do not have its checksum", link.size);
                return Err(Broken::new(ids::INDEX_LINK, at, what));
            };
            // Pages that are linked twice would be walked without end.
            if link.size == 0 || ranges.len() > pages.len() {
                return Err(Broken::new(ids::INDEX_LINK, at, "a link to no bytes"));
            }
            ranges.push((start, end));
            stack.push((bytes, pages_at + start as u64));
        }
        // A page of more than its share cannot be: all of them fill the section.
        if ranges.iter().map(|range| range.1 - range.0).sum::<usize>() > pages.len() {
            return Err(Broken::new(ids::INDEX_LINK, at, "pages of the index overlap"));
        }
    }
    ranges.sort_unstable();
    let mut end = 0;
    for (from, to) in ranges {
        if from != end {
            return Err(Broken::new(
                ids::INDEX_LINK,
                pages_at + end as u64,
                "pages of the index overlap or leave room",
            ));
        }
        end = to;
    }
    if end != pages.len() {
        return Err(Broken::new(ids::INDEX_LINK, pages_at + end as u64, "bytes of PAGE that no link leads to"));
    }
    if seen_parts != parts.entries.len() || seen.contains(&false) {
        let what =
            format!("the index has {seen_parts} parts, or lacks a block; the tables have {}", parts.entries.len());
        return Err(Broken::new(ids::INDEX_TABLES, at, what));
    }
    Ok(())
}
