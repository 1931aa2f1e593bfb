//! A file with an index, read page by page: nothing of the tables is read (spec section 11.3).

use std::collections::{BTreeMap, BTreeSet};

use crate::file::open::{
    check_head, check_overlaps, check_section, check_tags, directory_range, read_directory, read_header,
};
use crate::file::*;
use crate::index::page::{Page, PageLink};
use crate::parts::block::{check_part, first_level};
use crate::stream::block::{Part, Region};
use crate::stream::parts::octree_of;
use crate::stream::reader::Input;
use crate::stream::runs::{batches, runs};
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
    /// Parts that have been read, by block and first level.
    kept: BTreeMap<(u32, u8), Part>,
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
            kept: BTreeMap::new(),
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

    /// Whether a block of codec 0 or 1 is among those known. Where its children are follows only from the tables, so that
    /// only [`StreamReader`](crate::StreamReader) reads it.
    pub fn needs_tables(&self) -> bool {
        self.known.values().any(|block| block.entry.codec != CODEC_FIELDS)
    }

    /// An octree that shows an object within a region, down to voxels of level `max_level`. Reads the pages and parts that this
    /// needs, but none that it has read before.
    ///
    /// # Errors
    /// The source's; the rule that a page or a part breaks; no such object; a block of codec 0 or 1, see
    /// [`needs_tables`](Self::needs_tables); the memory limit.
    pub fn octree(&mut self, object: usize, region: &Region, max_level: u32) -> Result<Octree, FormatError> {
        let level = |one: usize, cube: &Region| if one == object && cube.meets(region) { max_level } else { 0 };
        self.octree_of(|one| one == object, &level)
    }

    /// An octree that shows all objects as deep as `level` says: it gives the deepest level of voxels of an object that is
    /// wanted in a cube, 0 where nothing is. It must not give less for a cube than for one within it. Of each object there is at
    /// least the root. Reads the pages and parts that this needs, but none that it has read before.
    ///
    /// # Errors
    /// Those of [`octree`](Self::octree).
    pub fn octree_by(&mut self, level: impl Fn(usize, &Region) -> u32) -> Result<Octree, FormatError> {
        self.octree_of(|_| true, &level)
    }

    /// An octree of the objects that are `wanted`.
    fn octree_of(
        &mut self,
        wanted: impl Fn(usize) -> bool,
        level: &impl Fn(usize, &Region) -> u32,
    ) -> Result<Octree, FormatError> {
        self.read_pages(&wanted, level)?;
        let mut parts: Vec<(u64, PartEntry, u32)> = Vec::new();
        let mut taken = BTreeSet::new();
        // Parents come first, as their indices are smaller.
        for (&index, block) in &self.known {
            let entry = &block.entry;
            let (object, root) = (entry.object as usize, entry.parent == NO_PARENT);
            if !wanted(object) || !(root || taken.contains(&entry.parent)) {
                continue;
            }
            let cube = Region::cube(entry.cube_position, entry.cube_scale);
            // Of an object there is at least the root.
            let level = level(object, &cube).max(u32::from(root));
            if u32::from(first_level(entry)) >= level {
                continue;
            }
            taken.insert(index);
            // Descriptors of one level say which voxels the next has.
            let own = block.parts.iter().filter(|(part, _)| u32::from(part.first_level) < level);
            parts.extend(own.map(|(part, offset)| (*offset, *part, entry.codec)));
        }
        parts.sort_unstable_by_key(|part| part.0);
        self.keep(&parts)?;
        let table: BTreeMap<u32, (BlockEntry, usize)> =
            self.known.iter().map(|(index, block)| (*index, (block.entry, block.parts.len()))).collect();
        let parts = parts.iter().filter_map(|(_, entry, _)| self.kept.get(&(entry.block, entry.first_level))).collect();
        octree_of(&self.objects, &table, parts, &self.options)
    }

    /// Reads those parts, given by offset, entry and codec, that have not been read yet.
    fn keep(&mut self, parts: &[(u64, PartEntry, u32)]) -> Result<(), FormatError> {
        let is_new =
            |(_, entry, _): &&(u64, PartEntry, u32)| !self.kept.contains_key(&(entry.block, entry.first_level));
        let new: Vec<(u64, PartEntry, u32)> = parts.iter().filter(is_new).copied().collect();
        let all = self.kept.values().map(|part| part.entry.size).chain(new.iter().map(|part| part.1.size));
        self.options.check(all.map(u64::from).sum())?;
        let range = |(at, entry, _): &(u64, PartEntry, u32)| (*at, at + u64::from(entry.size));
        for batch in batches(&runs(&new, range)) {
            let read = self.fetch_many(batch.iter().map(|run| (run.start, run.end - run.start)))?;
            for (run, bytes) in batch.iter().zip(read) {
                for (offset, entry, codec) in run.pieces {
                    let stored = bytes.get((offset - run.start) as usize..).and_then(|b| b.get(..entry.size as usize));
                    let body = check_part(entry, *codec, stored.unwrap_or_default(), *offset)?.to_vec();
                    self.kept.insert((entry.block, entry.first_level), Part { index: 0, entry: *entry, body });
                }
            }
        }
        Ok(())
    }

    /// Reads the pages that may have wanted blocks.
    fn read_pages(
        &mut self,
        wanted: &impl Fn(usize) -> bool,
        level: &impl Fn(usize, &Region) -> u32,
    ) -> Result<(), FormatError> {
        let objects = self.objects.len();
        loop {
            let wanted = |link: &PageLink| {
                let cube = Region::cube(link.position, link.scale);
                // Roots are always wanted.
                let of = |object: usize| {
                    object < objects && wanted(object) && link.first_level < level(object, &cube).max(1)
                };
                if link.object == u32::MAX { (0..objects).any(of) } else { of(link.object as usize) }
            };
            let (mut now, later): (Vec<PageLink>, Vec<PageLink>) = self.links.iter().partition(|link| wanted(link));
            self.links = later;
            if now.is_empty() {
                return Ok(());
            }
            now.sort_unstable_by_key(|link| link.offset);
            let from = self.pages.0;
            let range = |link: &PageLink| {
                let start = from + u64::from(link.offset);
                (start, start + u64::from(link.size))
            };
            if let Some(out) = now.iter().find(|link| range(link).1 > self.pages.1) {
                return Err(Broken::new(ids::INDEX_LINK, range(out).0, "a link leads out of PAGE").into());
            }
            for batch in batches(&runs(&now, range)) {
                let read = self.fetch_many(batch.iter().map(|run| (run.start, run.end - run.start)))?;
                for (run, bytes) in batch.iter().zip(read) {
                    for link in run.pieces {
                        let at = range(link).0;
                        let page = bytes.get((at - run.start) as usize..).and_then(|b| b.get(..link.size as usize));
                        let page = page.unwrap_or_default();
                        if crc32fast::hash(page) != link.crc {
                            return Err(Broken::new(ids::INDEX_LINK, at, "a page of the index is damaged").into());
                        }
                        self.take(page, at)?;
                    }
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

    /// Reads ranges, given by offset and length.
    fn fetch_many(&mut self, ranges: impl Iterator<Item = (u64, u64)>) -> Result<Vec<Vec<u8>>, FormatError> {
        let ranges: Vec<(u64, u64)> = ranges.collect();
        self.options.check(ranges.iter().map(|range| range.1).sum())?;
        // What came with the head is not read again.
        let have = |(offset, length): &(u64, u64)| {
            let have = usize::try_from(*offset).ok().and_then(|at| self.prefix.get(at..)).unwrap_or_default();
            &have[..have.len().min(*length as usize)]
        };
        let missing = |range: &(u64, u64)| {
            let there = have(range).len() as u64;
            (range.0 + there, range.1 - there)
        };
        let rest: Vec<(u64, u64)> = ranges.iter().map(missing).filter(|range| range.1 > 0).collect();
        let mut input = Input { source: &self.source, length: self.length, prefix: Vec::new(), bytes: 0, reads: 0 };
        let read = input.fetch_many(rest);
        self.bytes += input.bytes;
        self.reads += input.reads;
        let mut read = read?.into_iter();
        let whole = |range: &(u64, u64)| {
            let front = have(range);
            let rest = if front.len() as u64 == range.1 { Vec::new() } else { read.next().unwrap_or_default() };
            if front.is_empty() { rest } else { [front, &rest].concat() }
        };
        Ok(ranges.iter().map(whole).collect())
    }
}
