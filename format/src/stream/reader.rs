//! Reading parts of a file: the tables first, then the blocks of a region down to a level (spec section 11).

use std::sync::atomic::{AtomicU64, Ordering};

use crate::check::tables::block_parts;
use crate::file::compression;
use crate::file::open::{
    Tables, check_head, check_overlaps, check_section, check_tags, directory_range, read_directory, read_header,
};
use crate::file::*;
use crate::parts::table::PartTable;
use crate::stream::block::{Block, Region, file_offset};
use crate::stream::partial::assemble;
use crate::stream::runs::{batches, runs};
use crate::stream::source::RangeRead;
use crate::{FormatError, Octree, OpenOptions};

/// Size of the first read in bytes. Most files have their directory and tables within it.
const PREFIX: u64 = 8192;

/// Reads single blocks of a file from any [`RangeRead`].
///
/// ```
/// # use esvo_format::*;
/// # let mut tree = Tree::default();
/// # let root = tree.open(&[Some(Voxel { leaf: true, ..Voxel::default() }); 8]);
/// # tree.close(root);
/// # let octree = assemble(&tree, glam::DMat4::IDENTITY, &AssembleOptions::default())?;
/// # let mut file = Vec::new();
/// # octree.write_to(&mut file).unwrap();
/// let reader = StreamReader::open(&file)?;
/// // The blocks that show the voxels of the lower corner down to level 9, and an octree of them that can be cast.
/// let corner = Region { low: glam::DVec3::ZERO, high: glam::DVec3::splat(0.25) };
/// let blocks = reader.blocks_for(0, &corner, 9);
/// let octree = reader.partial(&blocks)?;
/// assert!(octree.sound().is_ok());
/// # Ok::<(), FormatError>(())
/// ```
pub struct StreamReader<S> {
    source: S,
    length: Option<u64>,
    options: OpenOptions,
    header: Header,
    sections: Vec<SectionEntry>,
    objects: Vec<ObjectEntry>,
    blocks: Vec<BlockEntry>,
    pub(super) parts: Option<PartTable>,
    bytes: AtomicU64,
    reads: AtomicU64,
}

impl<S: RangeRead> StreamReader<S> {
    /// Opens a file with the default [`OpenOptions`], see [`open_with`](Self::open_with).
    ///
    /// # Errors
    /// The source's, or the rule that the file breaks.
    pub fn open(source: S) -> Result<Self, FormatError> {
        Self::open_with(source, &OpenOptions::default())
    }

    /// Opens a file: reads header, directory and tables, and checks them and their checksums. Reads nothing else. Files
    /// written by this library need one read of 8 KiB, and another one if their tables are longer.
    ///
    /// # Errors
    /// The source's, or the rule that the file breaks.
    pub fn open_with(source: S, options: &OpenOptions) -> Result<Self, FormatError> {
        let fail = |source| FormatError::Source { offset: 0, source };
        let length = source.length().map_err(fail)?;
        let mut input = Input { source: &source, length, prefix: Vec::new(), bytes: 0, reads: 0 };
        let first = length.unwrap_or(PREFIX).min(PREFIX);
        input.prefix = match input.fetch(0, first) {
            // Too short for a file of this version, but the header may tell what kind of file it is.
            Err(FormatError::Source { source, .. }) if source.kind() == std::io::ErrorKind::UnexpectedEof => {
                input.fetch(0, HEADER_BYTES)?
            }
            other => other?,
        };
        let header = read_header(&input.prefix, length)?;
        let (start, end) = directory_range(&header)?;
        let directory = read_directory(&input.fetch(start, end - start)?, &header)?;
        check_overlaps(&directory.ranges)?;
        check_head(&header, &directory.sections)?;
        let tables = Tables::read(&header, &directory.sections, |section| {
            let bytes = input.fetch(section.offset, section.length)?;
            check_section(section, &bytes)?;
            Ok(bytes)
        })?;
        check_tags(&directory.sections)?;
        let (bytes, reads) = (input.bytes.into(), input.reads.into());
        let Tables { objects, blocks, parts, .. } = tables;
        let sections = directory.sections;
        Ok(Self { source, length, options: *options, header, sections, objects, blocks, parts, bytes, reads })
    }

    /// The header.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The directory.
    pub fn sections(&self) -> &[SectionEntry] {
        &self.sections
    }

    /// The object table.
    pub fn objects(&self) -> &[ObjectEntry] {
        &self.objects
    }

    /// The block table.
    pub fn blocks(&self) -> &[BlockEntry] {
        &self.blocks
    }

    /// Number of bytes read from the source.
    pub fn bytes_read(&self) -> u64 {
        self.bytes.load(Ordering::Relaxed)
    }

    /// Number of reads from the source.
    pub fn reads(&self) -> u64 {
        self.reads.load(Ordering::Relaxed)
    }

    /// Reads and checks the bytes of a section other than the block data. `None` if there is no section with this tag.
    ///
    /// # Errors
    /// The source's; a wrong checksum; the memory limit.
    pub fn section(&self, tag: [u8; 4]) -> Result<Option<Vec<u8>>, FormatError> {
        let Some(section) = self.sections.iter().find(|s| s.tag == tag && tag != TAG_DATA) else { return Ok(None) };
        self.options.check(section.length)?;
        let bytes = self.fetch(section.offset, section.length)?;
        check_section(section, &bytes)?;
        Ok(Some(bytes))
    }

    /// The blocks needed to show the part of an object within a region, down to voxels of level `max_level`: the root
    /// block and all blocks whose cubes meet the region and that have voxels of these levels. In the order of the
    /// table, that is, parents first. Empty if there is no such object.
    pub fn blocks_for(&self, object: usize, region: &Region, max_level: u32) -> Vec<u32> {
        let wanted = |block: &BlockEntry| {
            // A block below a voxel of level L has the descriptors of voxels from level L + 1 on, which list the voxels
            // from level L + 2 on.
            let first_level = 23 - block.cube_scale + 2;
            let cube = Region::cube(block.cube_position, block.cube_scale);
            block.parent == NO_PARENT || first_level <= max_level && cube.meets(region)
        };
        let blocks = self.blocks.iter().enumerate();
        blocks.filter(|(_, b)| b.object as usize == object && wanted(b)).map(|(index, _)| index as u32).collect()
    }

    /// The blocks needed to show all objects as deep as `level` says, parents first: `level` gives the deepest level of voxels
    /// of an object that is wanted in a cube, 0 where nothing is. It must not give less for a cube than for one within it. The
    /// root block of each object is among them.
    pub fn blocks_by(&self, level: impl Fn(usize, &Region) -> u32) -> Vec<u32> {
        let mut taken = vec![false; self.blocks.len()];
        for (index, block) in self.blocks.iter().enumerate() {
            let cube = Region::cube(block.cube_position, block.cube_scale);
            // As in `blocks_for`.
            let first_level = 23 - block.cube_scale + 2;
            taken[index] = match block.parent {
                NO_PARENT => true,
                parent => taken[parent as usize] && first_level <= level(block.object as usize, &cube),
            };
        }
        (0..).zip(&taken).filter(|(_, taken)| **taken).map(|(index, _)| index).collect()
    }

    /// Reads a block, checks its stored bytes against their checksum, decompresses it and checks its info section.
    ///
    /// # Errors
    /// The source's; the rule that the block breaks; no such block; the memory limit.
    pub fn read_block(&self, index: u32) -> Result<Block, FormatError> {
        let Some(block) = self.blocks.get(index as usize) else {
            return Err(FormatError::Limit(format!(
                "there is no block {index}: the file has {} blocks, counted from 0",
                self.blocks.len()
            )));
        };
        self.options.check(block.image_size)?;
        if let Some(parts) = &self.parts {
            return self.block_of_parts(parts, index);
        }
        self.block_of(index, &self.fetch(block.file_offset, block.stored_size)?)
    }

    /// A block of a file without parts from its stored bytes.
    fn block_of(&self, index: u32, stored: &[u8]) -> Result<Block, FormatError> {
        let block = &self.blocks[index as usize];
        compression::check_crc(index as usize, block, stored)?;
        // Allocated only now: the stored bytes exist, and the table has been checked for impossible ratios.
        let mut slots = vec![0u64; (block.image_size / 8) as usize];
        let image: &mut [u8] = bytemuck::cast_slice_mut(&mut slots);
        compression::decode(index as usize, block, stored, image)?;
        let parts = block_parts(image, 0, file_offset(block, 0), index as usize)?;
        Ok(Block { index, parts, slots })
    }

    /// Reads blocks, in ascending order and each once. Of files without parts, blocks that are near each other are read at once.
    ///
    /// # Errors
    /// Those of [`read_block`](Self::read_block); the memory limit for all of them.
    pub fn read_blocks(&self, blocks: &[u32]) -> Result<Vec<Block>, FormatError> {
        let mut wanted = blocks.to_vec();
        wanted.sort_unstable();
        wanted.dedup();
        let image = wanted.iter().filter_map(|index| self.blocks.get(*index as usize)).map(|b| b.image_size).sum();
        self.options.check(image)?;
        if self.parts.is_some() || wanted.last().is_some_and(|last| *last as usize >= self.blocks.len()) {
            return wanted.iter().map(|index| self.read_block(*index)).collect();
        }
        let range = |index: &u32| {
            let block = &self.blocks[*index as usize];
            (block.file_offset, block.file_offset.saturating_add(block.stored_size))
        };
        // Blocks need not be stored in the order of the table.
        wanted.sort_by_key(range);
        let mut found = Vec::with_capacity(wanted.len());
        for batch in batches(&runs(&wanted, range)) {
            let read = self.fetch_many(batch.iter().map(|run| (run.start, run.end - run.start)))?;
            for (run, bytes) in batch.iter().zip(read) {
                for index in run.pieces {
                    let (start, end) = range(index);
                    let stored = &bytes[(start - run.start) as usize..(end - run.start) as usize];
                    found.push(self.block_of(*index, stored)?);
                }
            }
        }
        found.sort_unstable_by_key(|block| block.index);
        Ok(found)
    }

    /// Reads blocks and makes an octree of them, see [`partial_of`](Self::partial_of).
    ///
    /// # Errors
    /// Those of [`read_blocks`](Self::read_blocks) and [`partial_of`](Self::partial_of).
    pub fn partial(&self, blocks: &[u32]) -> Result<Octree, FormatError> {
        self.partial_of(&self.read_blocks(blocks)?)
    }

    /// Makes an octree of blocks of this file, in the order of the table. Descriptors whose children are in a missing
    /// block get leaves as children. Objects without blocks are left out; counts and levels of the others are those of
    /// the part. With all blocks, the image is identical to that of the file. Metadata and unknown sections are not
    /// included.
    ///
    /// All pointers are checked: the octree is [sound](Octree::sound).
    ///
    /// # Errors
    /// A block without its parent, twice, or of another file; no blocks; the rule that a descriptor breaks; the memory
    /// limit.
    pub fn partial_of<'a>(&self, blocks: impl IntoIterator<Item = &'a Block>) -> Result<Octree, FormatError> {
        let mut blocks: Vec<&Block> = blocks.into_iter().collect();
        blocks.sort_unstable_by_key(|block| block.index);
        self.options.check(blocks.iter().map(|block| block.slots.len() as u64 * 8).sum())?;
        assemble(&self.objects, &self.blocks, &blocks)
    }

    /// The limits of this reader.
    pub(super) fn options(&self) -> &OpenOptions {
        &self.options
    }

    pub(super) fn fetch(&self, offset: u64, length: u64) -> Result<Vec<u8>, FormatError> {
        self.counted(|input| input.fetch(offset, length))
    }

    /// Reads ranges, given by offset and length, at the same time if the source can.
    pub(super) fn fetch_many(&self, ranges: impl IntoIterator<Item = (u64, u64)>) -> Result<Vec<Vec<u8>>, FormatError> {
        self.counted(|input| input.fetch_many(ranges))
    }

    fn counted<T>(&self, read: impl FnOnce(&mut Input<'_, S>) -> T) -> T {
        let mut input = Input { source: &self.source, length: self.length, prefix: Vec::new(), bytes: 0, reads: 0 };
        let found = read(&mut input);
        self.bytes.fetch_add(input.bytes, Ordering::Relaxed);
        self.reads.fetch_add(input.reads, Ordering::Relaxed);
        found
    }
}

/// The source, with the bytes and reads counted.
pub(super) struct Input<'a, S> {
    pub(super) source: &'a S,
    pub(super) length: Option<u64>,
    /// The first bytes of the source, if they have been read.
    pub(super) prefix: Vec<u8>,
    pub(super) bytes: u64,
    pub(super) reads: u64,
}

impl<S: RangeRead> Input<'_, S> {
    pub(super) fn fetch(&mut self, offset: u64, length: u64) -> Result<Vec<u8>, FormatError> {
        let end = offset.saturating_add(length);
        if end <= self.prefix.len() as u64 {
            return Ok(self.prefix[offset as usize..end as usize].to_vec());
        }
        let mut bytes = Vec::new();
        while (bytes.len() as u64) < length {
            let have = bytes.len() as u64;
            // If the length is unknown, allocate at most twice the bytes read so far (at least 1 MiB).
            let ahead = if self.length.is_some_and(|all| end <= all) { length } else { have.max(1 << 20) };
            bytes.resize(length.min(have + ahead) as usize, 0);
            let part = &mut bytes[have as usize..];
            self.bytes += part.len() as u64;
            self.reads += 1;
            let at = offset + have;
            self.source.read_at(at, part).map_err(|source| FormatError::Source { offset: at, source })?;
        }
        Ok(bytes)
    }

    /// Reads ranges, given by offset and length.
    pub(super) fn fetch_many(
        &mut self,
        ranges: impl IntoIterator<Item = (u64, u64)>,
    ) -> Result<Vec<Vec<u8>>, FormatError> {
        let ranges: Vec<(u64, u64)> = ranges.into_iter().collect();
        let within = |(at, length): &(u64, u64)| self.length.is_some_and(|all| at.saturating_add(*length) <= all);
        if !ranges.iter().all(within) {
            // A length that is wrong or unknown: nothing is allocated that is not there.
            return ranges.into_iter().map(|(offset, length)| self.fetch(offset, length)).collect();
        }
        let mut reads: Vec<_> = ranges.into_iter().map(|(offset, length)| (offset, vec![0; length as usize])).collect();
        self.reads += reads.len() as u64;
        self.bytes += reads.iter().map(|(_, buf)| buf.len() as u64).sum::<u64>();
        self.source.read_many(&mut reads).map_err(|(offset, source)| FormatError::Source { offset, source })?;
        Ok(reads.into_iter().map(|(_, buf)| buf).collect())
    }
}
