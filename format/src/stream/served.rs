//! A file with an index, read page by page: nothing of the tables is read (spec section 11.3).

use std::collections::{BTreeMap, BTreeSet};

use crate::file::open::{
    check_head, check_overlaps, check_section, check_tags, directory_range, read_directory, read_header,
};
use crate::file::*;
use crate::index::page::{Page, PageLink};
use crate::parts::block::{check_part, first_level};
use crate::stream::block::{Part, Region};
use crate::stream::parts::{MERGE_GAP, octree_of};
use crate::stream::reader::Input;
use crate::stream::source::RangeRead;
use crate::{Broken, FormatError, Octree, OpenOptions, ids};

/// Size of the first read in bytes: enough for the head of most files, whose root page has at most 16 KiB.
const PREFIX: u64 = 32 << 10;

/// A block of the index, and its parts by level with their offsets.
struct Known {
    entry: BlockEntry,
    parts: Vec<(PartEntry, u64)>,
}

/// Reads a file with an index by ranges, without its tables: the head first, then pages of the index where more of the octree
/// is wanted, then parts.
///
/// ```
/// # use esvo_format::*;
/// # let mut tree = Tree::default();
/// # let root = tree.open(&[Some(Voxel { leaf: true, ..Voxel::default() }); 8]);
/// # tree.close(root);
/// # let octree = assemble(&tree, glam::DMat4::IDENTITY, &AssembleOptions::default())?;
/// # let mut file = Vec::new();
/// # octree.write_to_with(&mut file, &WriteOptions { parts: true, ..WriteOptions::default() }).unwrap();
/// let mut reader = IndexReader::open(&file)?;
/// // The first object down to level 5: one more request, or two if the index has pages for it.
/// let octree = reader.octree(0, &Region::ALL, 5)?;
/// assert!(octree.sound().is_ok());
/// # Ok::<(), FormatError>(())
/// ```
pub struct IndexReader<S> {
    source: S,
    length: Option<u64>,
    options: OpenOptions,
    header: Header,
    objects: Vec<ObjectEntry>,
    /// Start and end of the sections BLKS and PAGE.
    data: (u64, u64),
    pages: (u64, u64),
    known: BTreeMap<u32, Known>,
    links: Vec<PageLink>,
    /// The first bytes of the file.
    prefix: Vec<u8>,
    bytes: u64,
    reads: u64,
}

impl<S: RangeRead> IndexReader<S> {
    /// Opens a file with the default [`OpenOptions`], see [`open_with`](Self::open_with).
    ///
    /// # Errors
    /// Those of [`open_with`](Self::open_with).
    pub fn open(source: S) -> Result<Self, FormatError> {
        Self::open_with(source, &OpenOptions::default())
    }

    /// Opens a file: reads its head, most often with one read of 32 KiB, else with two.
    ///
    /// # Errors
    /// The source's; the rule that the file breaks; a file without an index.
    pub fn open_with(source: S, options: &OpenOptions) -> Result<Self, FormatError> {
        let length = source.length().map_err(|source| FormatError::Source { offset: 0, source })?;
        let mut input = Input { source: &source, length, prefix: Vec::new(), bytes: 0, reads: 0 };
        input.prefix = match input.fetch(0, length.unwrap_or(PREFIX).min(PREFIX)) {
            Err(FormatError::Source { source, .. }) if source.kind() == std::io::ErrorKind::UnexpectedEof => {
                input.fetch(0, HEADER_BYTES)?
            }
            other => other?,
        };
        let header = read_header(&input.prefix, length)?;
        let without = || FormatError::Limit("the file has no index: use `StreamReader`".into());
        if header.head == 0 {
            return Err(without());
        }
        options.check(header.head.into())?;
        if u64::from(header.head) > input.prefix.len() as u64 {
            // The rest only.
            let start = input.prefix.len() as u64;
            let rest = input.fetch(start, u64::from(header.head) - start)?;
            input.prefix.extend(rest);
        }
        let (start, end) = directory_range(&header)?;
        let directory = read_directory(&input.fetch(start, end - start)?, &header)?;
        check_overlaps(&directory.ranges)?;
        check_tags(&directory.sections)?;
        check_head(&header, &directory.sections)?;
        let find = |tag| directory.sections.iter().find(|section| section.tag == tag);
        let (Some(objects), Some(index), Some(data)) = (find(TAG_OBJECTS), find(TAG_INDEX), find(TAG_DATA)) else {
            return Err(without());
        };
        let range = |section: &SectionEntry| (section.offset, section.offset + section.length);
        let mut fetch = |section: &SectionEntry| {
            let bytes = input.fetch(section.offset, section.length)?;
            check_section(section, &bytes)?;
            Ok::<_, FormatError>(bytes)
        };
        let table = fetch(objects)?;
        let root = fetch(index)?;
        let objects_at = objects.offset;
        let objects: Vec<ObjectEntry> = table.chunks_exact(OBJECT_BYTES as usize).filter_map(from_bytes).collect();
        crate::check::tables::check_objects(&objects, objects_at)?;
        let (bytes, reads, prefix) = (input.bytes, input.reads, input.prefix);
        let mut reader = Self {
            source,
            length,
            options: *options,
            header,
            objects,
            data: range(data),
            pages: find(TAG_PAGES).map_or((0, 0), range),
            known: BTreeMap::new(),
            links: Vec::new(),
            prefix,
            bytes,
            reads,
        };
        reader.take(&root, index.offset)?;
        Ok(reader)
    }

    /// The header.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The object table.
    pub fn objects(&self) -> &[ObjectEntry] {
        &self.objects
    }

    /// Number of bytes read from the source.
    pub fn bytes_read(&self) -> u64 {
        self.bytes
    }

    /// Number of reads from the source.
    pub fn reads(&self) -> u64 {
        self.reads
    }

    /// Number of blocks and of parts in the pages that have been read.
    pub fn known(&self) -> (usize, usize) {
        (self.known.len(), self.known.values().map(|block| block.parts.len()).sum())
    }

    /// An octree that shows an object within a region, down to voxels of level `max_level`. Reads the pages and parts that this
    /// needs.
    ///
    /// # Errors
    /// The source's; the rule that a page or a part breaks; no such object; the memory limit.
    pub fn octree(&mut self, object: usize, region: &Region, max_level: u32) -> Result<Octree, FormatError> {
        self.read_pages(object, region, max_level)?;
        let mut wanted: Vec<(u64, PartEntry, u32)> = Vec::new();
        let mut taken = BTreeSet::new();
        // Parents come first, as their indices are smaller.
        for (&index, block) in &self.known {
            let entry = &block.entry;
            let root = entry.parent == NO_PARENT;
            let meets = Region::cube(entry.cube_position, entry.cube_scale).meets(region);
            let above = root || taken.contains(&entry.parent);
            if entry.object as usize != object
                || !above
                || !(root || meets && u32::from(first_level(entry)) < max_level)
            {
                continue;
            }
            taken.insert(index);
            let parts = block.parts.iter().filter(|(part, _)| u32::from(part.first_level) < max_level.max(1));
            wanted.extend(parts.map(|(part, offset)| (*offset, *part, entry.codec)));
        }
        wanted.sort_unstable_by_key(|part| part.0);
        let mut parts = Vec::with_capacity(wanted.len());
        let end = |part: &(u64, PartEntry, u32)| part.0 + u64::from(part.1.size);
        for run in wanted.chunk_by(|a, b| b.0.saturating_sub(end(a)) <= MERGE_GAP) {
            let (Some(first), Some(last)) = (run.first(), run.last()) else { continue };
            let bytes = self.fetch(first.0, end(last) - first.0)?;
            for (offset, entry, codec) in run {
                let stored = bytes.get((offset - first.0) as usize..).and_then(|b| b.get(..entry.size as usize));
                let body = check_part(entry, *codec, stored.unwrap_or_default(), *offset)?.to_vec();
                parts.push(Part { index: 0, entry: *entry, body });
            }
        }
        let table: BTreeMap<u32, (BlockEntry, usize)> =
            self.known.iter().map(|(index, block)| (*index, (block.entry, block.parts.len()))).collect();
        octree_of(&self.objects, &table, &parts, &self.options)
    }

    /// Reads the pages that may have blocks of the region down to this level.
    fn read_pages(&mut self, object: usize, region: &Region, max_level: u32) -> Result<(), FormatError> {
        loop {
            let wanted = |link: &PageLink| {
                (link.object as usize == object || link.object == u32::MAX)
                    && link.first_level < max_level
                    && Region::cube(link.position, link.scale).meets(region)
            };
            let (mut now, later): (Vec<PageLink>, Vec<PageLink>) = self.links.iter().partition(|link| wanted(link));
            self.links = later;
            if now.is_empty() {
                return Ok(());
            }
            now.sort_unstable_by_key(|link| link.offset);
            let near = |a: &PageLink, b: &PageLink| {
                u64::from(b.offset).saturating_sub(u64::from(a.offset) + u64::from(a.size)) <= MERGE_GAP
            };
            for run in now.chunk_by(near) {
                let (Some(first), Some(last)) = (run.first(), run.last()) else { continue };
                let length = u64::from(last.offset) + u64::from(last.size) - u64::from(first.offset);
                let start = self.pages.0 + u64::from(first.offset);
                if start + length > self.pages.1 {
                    return Err(Broken::new(ids::INDEX_LINK, start, "a link leads out of PAGE").into());
                }
                let bytes = self.fetch(start, length)?;
                for link in run {
                    let from = (link.offset - first.offset) as usize;
                    let page = bytes.get(from..).and_then(|b| b.get(..link.size as usize)).unwrap_or_default();
                    let at = start + from as u64;
                    if crc32fast::hash(page) != link.crc {
                        return Err(Broken::new(ids::INDEX_LINK, at, "a page of the index is damaged").into());
                    }
                    self.take(page, at)?;
                }
            }
        }
    }

    /// Adds what is in a page that was read from byte `at`.
    fn take(&mut self, bytes: &[u8], at: u64) -> Result<(), FormatError> {
        let page = Page::decode(bytes).map_err(|what| Broken::new(ids::INDEX_PAGE, at, what))?;
        let broken = |what: String| FormatError::from(Broken::new(ids::INDEX_TABLES, at, what));
        for block in &page.blocks {
            let image_size = u64::from(block.image_pages) * PAGE_BYTES;
            let cube = (block.position, block.scale);
            let mut entry = BlockEntry::in_memory(block.parent, cube, 0, image_size);
            (entry.object, entry.codec) = (block.object, block.codec);
            let parent = self.known.get(&block.parent).map(|known| &known.entry);
            let fits = crate::check::tables::cube_within(&entry, parent)
                && (block.parent == NO_PARENT || parent.is_some_and(|p| p.object == block.object))
                && (block.parent == NO_PARENT || block.parent < block.index)
                && (block.object as usize) < self.objects.len();
            if !fits || image_size == 0 {
                return Err(broken(format!("block {} of the index has no such parent, cube or size", block.index)));
            }
            if self.known.insert(block.index, Known { entry, parts: Vec::new() }).is_some() {
                return Err(broken(format!("block {} is in two pages", block.index)));
            }
        }
        for part in &page.parts {
            let index = page.blocks[part.block as usize].index;
            let levels = (u8::try_from(part.first_level), u8::try_from(part.last_level));
            let (Ok(first_level), Ok(last_level)) = levels else {
                return Err(broken(format!("a part of block {index} has levels above 255")));
            };
            let offset = self.data.0.saturating_add(part.offset);
            let end = offset.saturating_add(part.size.into());
            if last_level > LAST_LEVEL || first_level > last_level || end > self.data.1 {
                return Err(broken(format!("a part of block {index} is not in the block data, or has no such levels")));
            }
            let entry = PartEntry { block: index, size: part.size, first_level, last_level, reserved: 0 };
            if let Some(known) = self.known.get_mut(&index) {
                known.parts.push((entry, offset));
            }
        }
        for block in &page.blocks {
            let Some(known) = self.known.get_mut(&block.index) else { continue };
            known.parts.sort_unstable_by_key(|(part, _)| part.first_level);
            let mut level = first_level(&known.entry);
            for (part, _) in &known.parts {
                if part.first_level != level {
                    return Err(broken(format!("the parts of block {} lack level {level}", block.index)));
                }
                level = part.last_level + 1;
            }
        }
        self.links.extend(page.links);
        Ok(())
    }

    fn fetch(&mut self, offset: u64, length: u64) -> Result<Vec<u8>, FormatError> {
        self.options.check(length)?;
        // What came with the head is not read again.
        let have = usize::try_from(offset).ok().and_then(|at| self.prefix.get(at..)).unwrap_or_default();
        let mut bytes = have[..have.len().min(length as usize)].to_vec();
        let start = offset + bytes.len() as u64;
        let rest = length - bytes.len() as u64;
        if rest > 0 {
            let mut input = Input { source: &self.source, length: self.length, prefix: Vec::new(), bytes: 0, reads: 0 };
            let read = input.fetch(start, rest);
            self.bytes += input.bytes;
            self.reads += input.reads;
            if bytes.is_empty() { bytes = read? } else { bytes.extend(read?) }
        }
        Ok(bytes)
    }
}
