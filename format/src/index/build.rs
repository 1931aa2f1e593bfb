//! The pages of the index: the coarse blocks in the root page, runs of subtrees in the others (spec section 4.5).

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::file::{BlockEntry, NO_PARENT, PAGE_BYTES, PartEntry};
use crate::index::MAX_PAGE;
use crate::index::page::{Page, PageBlock, PageLink, PagePart};
use crate::parts::block::first_level;

/// What a block and a part are expected to take in a page, in bytes. A page that becomes too large is made anew with less.
const BLOCK_WEIGHT: u64 = 12;
const PART_WEIGHT: u64 = 5;
/// Most links of a page.
const MAX_LINKS: usize = 200;

/// The tables that the index is made of.
pub(crate) struct Builder<'a> {
    blocks: &'a [BlockEntry],
    entries: &'a [PartEntry],
    offsets: &'a [u64],
    /// Parts by block, as indices into `entries`.
    own: Vec<Vec<u32>>,
    children: Vec<Vec<u32>>,
    /// Weight of a block and all below it.
    weights: Vec<u64>,
    /// The pages but the root page.
    pages: Vec<u8>,
}

impl<'a> Builder<'a> {
    /// `entries` are the parts in the order in which they are stored, `offsets` where they are in BLKS.
    pub(crate) fn new(blocks: &'a [BlockEntry], entries: &'a [PartEntry], offsets: &'a [u64]) -> Self {
        let mut own = vec![Vec::new(); blocks.len()];
        for (part, entry) in entries.iter().enumerate() {
            own[entry.block as usize].push(part as u32);
        }
        let mut children = vec![Vec::new(); blocks.len()];
        let mut weights: Vec<u64> = own.iter().map(|own| BLOCK_WEIGHT + PART_WEIGHT * own.len() as u64).collect();
        for (index, block) in blocks.iter().enumerate().rev().filter(|(_, block)| block.parent != NO_PARENT) {
            children[block.parent as usize].push(index as u32);
            weights[block.parent as usize] += weights[index];
        }
        children.iter_mut().for_each(|list| list.reverse());
        Self { blocks, entries, offsets, own, children, weights, pages: Vec::new() }
    }

    /// The root page and the others.
    pub(crate) fn build(mut self) -> std::io::Result<(Vec<u8>, Vec<u8>)> {
        let roots: Vec<u32> =
            (0..self.blocks.len() as u32).filter(|index| self.blocks[*index as usize].parent == NO_PARENT).collect();
        let (root, _) = self.page(&roots)?;
        Ok((root, self.pages))
    }

    /// The bytes of a page with these blocks, as many below them as fit, and links to pages for the rest; and a link to it, but
    /// for its place.
    fn page(&mut self, roots: &[u32]) -> std::io::Result<(Vec<u8>, PageLink)> {
        let mut budget = MAX_PAGE as u64;
        loop {
            let kept = self.pages.len();
            let (page, link) = self.fill(roots, budget)?;
            let bytes = page.encode()?;
            if bytes.len() <= MAX_PAGE || budget < 512 {
                return Ok((bytes, link));
            }
            self.pages.truncate(kept);
            budget /= 2;
        }
    }

    fn fill(&mut self, roots: &[u32], budget: u64) -> std::io::Result<(Page, PageLink)> {
        let weight = |index: u32, own: &[Vec<u32>]| BLOCK_WEIGHT + PART_WEIGHT * own[index as usize].len() as u64;
        let total: u64 = roots.iter().map(|root| self.weights[*root as usize]).sum();
        // Room for links is only needed where not all fits.
        let room = if total <= budget { budget } else { budget / 2 };
        let mut queue: BinaryHeap<Reverse<(u8, u32)>> =
            roots.iter().map(|root| Reverse((first_level(&self.blocks[*root as usize]), *root))).collect();
        let (mut chosen, mut used) = (Vec::new(), 0);
        let mut rest: Vec<u32> = Vec::new();
        while let Some(Reverse((_, index))) = queue.pop() {
            used += weight(index, &self.own);
            if used > room {
                rest.push(index);
                continue;
            }
            chosen.push(index);
            let below = self.children[index as usize].iter();
            queue.extend(below.map(|child| Reverse((first_level(&self.blocks[*child as usize]), *child))));
        }
        rest.sort_unstable();
        chosen.sort_unstable();
        let mut page = Page::default();
        for (number, &index) in chosen.iter().enumerate() {
            let block = &self.blocks[index as usize];
            page.blocks.push(PageBlock {
                index,
                object: block.object,
                parent: block.parent,
                position: block.cube_position,
                scale: block.cube_scale,
                codec: block.codec,
                image_pages: (block.image_size / PAGE_BYTES) as u32,
            });
            page.parts.extend(self.own[index as usize].iter().map(|&part| {
                let entry = &self.entries[part as usize];
                PagePart {
                    block: number as u32,
                    size: entry.size,
                    first_level: entry.first_level.into(),
                    last_level: entry.last_level.into(),
                    offset: self.offsets[part as usize],
                }
            }));
        }
        page.parts.sort_unstable_by_key(|part| part.offset);
        for group in self.groups(&rest, budget) {
            let (bytes, mut link) = self.page(&group)?;
            (link.offset, link.size) = (self.pages.len() as u32, bytes.len() as u32);
            link.crc = crc32fast::hash(&bytes);
            self.pages.extend(bytes);
            page.links.push(link);
        }
        Ok((page, self.link(roots)))
    }

    /// Runs of blocks that are a page each.
    fn groups(&self, rest: &[u32], budget: u64) -> Vec<Vec<u32>> {
        let total: u64 = rest.iter().map(|index| self.weights[*index as usize]).sum();
        let most = budget.max(total.div_ceil(MAX_LINKS as u64));
        let (mut groups, mut used): (Vec<Vec<u32>>, u64) = (Vec::new(), 0);
        for &index in rest {
            let weight = self.weights[index as usize];
            used += weight;
            match groups.last_mut() {
                Some(group) if used <= most => group.push(index),
                _ => {
                    groups.push(vec![index]);
                    used = weight;
                }
            }
        }
        groups
    }

    /// A link to a page with these blocks and all below them.
    fn link(&self, roots: &[u32]) -> PageLink {
        let blocks = || roots.iter().map(|index| &self.blocks[*index as usize]);
        let mut objects = blocks().map(|block| block.object);
        let first = objects.next().unwrap_or(u32::MAX);
        let object = if objects.all(|object| object == first) { first } else { u32::MAX };
        let mut scale = blocks().map(|block| block.cube_scale).max().unwrap_or(23);
        let position = |scale: u32| {
            let mut cubes = blocks().map(|block| block.cube_position.map(|x| x >> scale));
            let cube = cubes.next().unwrap_or_default();
            cubes.all(|other| other == cube).then(|| cube.map(|x| x << scale))
        };
        // The root cube has all of them.
        let found = loop {
            match position(scale) {
                Some(found) => break found,
                None if scale >= 23 => break [0; 3],
                None => scale += 1,
            }
        };
        let first_level = blocks().map(|block| u32::from(first_level(block))).min().unwrap_or(0);
        PageLink { offset: 0, size: 0, crc: 0, object, first_level, position: found, scale }
    }
}

#[cfg(all(test, feature = "zstd"))]
mod tests {
    use super::*;
    use crate::file::{CODEC_FIELDS, LAST_LEVEL};

    /// Tables as a builder of `count` blocks makes them: a root block, and subtrees of some levels below voxels of a surface.
    fn tables(count: u32) -> (Vec<BlockEntry>, Vec<PartEntry>, Vec<u64>) {
        let entry = |parent, cube| {
            let mut block = BlockEntry::in_memory(parent, cube, 0, 160 << 10);
            block.codec = CODEC_FIELDS;
            block
        };
        let mut blocks = vec![entry(NO_PARENT, ([0; 3], 23))];
        let fan = (count / 200).max(2);
        for k in 1..count {
            // Most blocks are below one that is itself below the root block.
            let (parent, scale) = if k <= fan { (0, 15) } else { ((k - 1) % fan + 1, 10) };
            let place = k.wrapping_mul(2_654_435_761);
            let outer = blocks[parent as usize].cube_position;
            let low = if parent == 0 { 0 } else { 1 << 5 };
            let cell = [place % 32, place / 32 % 32, place / 1024 % 32];
            let position = [0, 1, 2].map(|axis| {
                outer[axis] + if parent == 0 { (place >> (8 * axis) & 0xff) << 15 } else { (cell[axis] % low) << 10 }
            });
            blocks.push(entry(parent, (position, scale)));
        }
        blocks[1..].sort_by_key(|block| block.parent);
        let mut parts = Vec::new();
        for (index, block) in (0..).zip(&blocks) {
            let first = first_level(block);
            for level in first..(first + 8).min(LAST_LEVEL) {
                let size = 40 + (index * 7919 + u32::from(level) * 104_729) % (100 << (level - first));
                let (first_level, last_level) = (level, level);
                parts.push(PartEntry { block: index, size, first_level, last_level, reserved: 0 });
            }
        }
        parts.sort_by_key(|part| (part.first_level, part.block));
        let mut end = 0u64;
        let offsets = parts.iter().map(|part| {
            let at = end;
            end = (end + u64::from(part.size)).next_multiple_of(8);
            at
        });
        let offsets = offsets.collect();
        (blocks, parts, offsets)
    }

    #[test]
    fn pages_are_small_and_have_everything_once() {
        for count in [1, 2, 300, 6300, 40_000] {
            let (blocks, parts, offsets) = tables(count);
            let (root, pages) = Builder::new(&blocks, &parts, &offsets).build().expect("memory");
            assert!(root.len() <= MAX_PAGE, "{count} blocks: a root page of {} bytes", root.len());
            let (mut seen_blocks, mut seen_parts, mut seen_pages) = (0, 0, 0);
            let mut stack = vec![root];
            while let Some(bytes) = stack.pop() {
                assert!(bytes.len() <= MAX_PAGE, "{count} blocks: a page of {} bytes", bytes.len());
                let page = Page::decode(&bytes).expect("our own page");
                assert_eq!(page.encode().expect("memory"), bytes);
                seen_blocks += page.blocks.len();
                seen_parts += page.parts.len();
                seen_pages += 1;
                for link in page.links {
                    let bytes = &pages[link.offset as usize..][..link.size as usize];
                    assert_eq!(crc32fast::hash(bytes), link.crc);
                    stack.push(bytes.to_vec());
                }
            }
            assert_eq!((seen_blocks, seen_parts), (blocks.len(), parts.len()), "{count} blocks");
            assert_eq!(seen_pages > 1, count > 2000, "{count} blocks in {seen_pages} pages");
        }
    }
}
