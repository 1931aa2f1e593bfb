//! Parts of blocks by byte range, and octrees of them (spec section 11.3).

use std::collections::{BTreeMap, BTreeSet};

use crate::check::tables::block_parts;
use crate::file::compression;
use crate::file::*;
use crate::parts::block::{check_part, decode_fields, decode_stored};
use crate::parts::fields::Fields;
use crate::parts::instructions::InstructionSet;
use crate::parts::layout::{Block as Layout, measure, write};
use crate::parts::stored::Decoder;
use crate::parts::table::PartTable;
use crate::stream::block::{Block, Part, Region, file_offset};
use crate::stream::partial::assemble;
use crate::stream::reader::StreamReader;
use crate::stream::runs::{batches, runs};
use crate::stream::source::RangeRead;
use crate::{Broken, FormatError, Octree, OpenOptions, ids};

impl<S: RangeRead> StreamReader<S> {
    /// The table of parts, in the order in which they are stored. Empty if the blocks are not stored in parts.
    pub fn parts(&self) -> &[PartEntry] {
        self.parts.as_ref().map_or(&[], |parts| &parts.entries)
    }

    /// The parts needed to show an object within a region, down to voxels of level `max_level`. Empty if there is no such
    /// object, or if the blocks are not stored in parts.
    pub fn parts_for(&self, object: usize, region: &Region, max_level: u32) -> Vec<u32> {
        let Some(parts) = &self.parts else { return Vec::new() };
        let blocks = self.blocks_for(object, region, max_level);
        let all = blocks.iter().flat_map(|block| parts.of_block(*block as usize));
        // Descriptors of one level say which voxels the next has.
        let wanted = |part: &u32| u32::from(parts.entries[*part as usize].first_level) < max_level.max(1);
        let mut found: Vec<u32> = all.copied().filter(wanted).collect();
        found.sort_unstable();
        found
    }

    /// The parts needed to show all objects as deep as `level` says, as [`blocks_by`](Self::blocks_by). Empty if the blocks are
    /// not stored in parts.
    pub fn parts_by(&self, level: impl Fn(usize, &Region) -> u32) -> Vec<u32> {
        let Some(parts) = &self.parts else { return Vec::new() };
        let of_block = |block: u32| {
            let entry = &self.blocks()[block as usize];
            let cube = Region::cube(entry.cube_position, entry.cube_scale);
            let level = level(entry.object as usize, &cube).max(u32::from(entry.parent == NO_PARENT));
            let all = parts.of_block(block as usize).iter().copied();
            all.filter(move |part| u32::from(parts.entries[*part as usize].first_level) < level)
        };
        let mut found: Vec<u32> = self.blocks_by(&level).into_iter().flat_map(of_block).collect();
        found.sort_unstable();
        found
    }

    /// Reads parts and checks their headers and checksums. Parts that are near each other are read at once.
    ///
    /// # Errors
    /// The source's; the rule that a part breaks; no such part; the memory limit.
    pub fn read_parts(&self, indices: &[u32]) -> Result<Vec<Part>, FormatError> {
        let count = self.parts().len();
        let table = match (&self.parts, indices.iter().find(|index| **index as usize >= count)) {
            (Some(table), None) => table,
            (_, Some(index)) => {
                let what = format!("there is no part {index}: the file has {count} parts, counted from 0");
                return Err(FormatError::Limit(what));
            }
            (None, None) => return Ok(Vec::new()),
        };
        let mut wanted = indices.to_vec();
        // Parts are stored in the order of the table.
        wanted.sort_unstable();
        wanted.dedup();
        let mut found = Vec::with_capacity(wanted.len());
        let sizes = wanted.iter().map(|part| u64::from(table.entries[*part as usize].size));
        self.options().check(sizes.sum())?;
        for batch in batches(&runs(&wanted, |part| table.range(*part))) {
            let read = self.fetch_many(batch.iter().map(|run| (run.start, run.end - run.start)))?;
            for (run, bytes) in batch.iter().zip(read) {
                for &index in run.pieces {
                    let (at, end) = table.range(index);
                    let entry = table.entries[index as usize];
                    let stored = &bytes[(at - run.start) as usize..(end - run.start) as usize];
                    let body = check_part(&entry, self.blocks()[entry.block as usize].codec, stored, at)?.to_vec();
                    found.push(Part { index, entry, body });
                }
            }
        }
        Ok(found)
    }

    /// Reads parts and makes an octree of them, see [`octree_of_parts`](Self::octree_of_parts).
    ///
    /// # Errors
    /// Those of [`read_parts`](Self::read_parts) and [`octree_of_parts`](Self::octree_of_parts).
    pub fn partial_parts(&self, indices: &[u32]) -> Result<Octree, FormatError> {
        self.octree_of_parts(&self.read_parts(indices)?)
    }

    /// Makes an octree of parts of this file. Where a part is missing, the voxels above it are leaves; a block that nothing
    /// refers to, because the part of its parent that does is missing, is left out. Rays that would have ended at these voxels
    /// anyway end as they do in the whole octree.
    ///
    /// All pointers are checked: the octree is [sound](Octree::sound).
    ///
    /// # Errors
    /// A part without those above it of the same block, twice, or of another file; a block without its parent; no parts; the
    /// rule that a part breaks; the memory limit.
    pub fn octree_of_parts<'a>(&self, parts: impl IntoIterator<Item = &'a Part>) -> Result<Octree, FormatError> {
        let mut given: Vec<&Part> = parts.into_iter().collect();
        given.sort_by_key(|part| (part.entry.block, part.entry.first_level));
        let Some(table) = &self.parts else {
            return Err(FormatError::Limit("the blocks of this file are not stored in parts: use `partial`".into()));
        };
        let mut blocks: Vec<Block> = Vec::new();
        // Blocks that a part that is there refers to; those of codec 0 and 1 refer to all theirs.
        let mut referred = vec![false; self.blocks().len()];
        let mut whole = vec![false; self.blocks().len()];
        let mut bytes = 0;
        for own in given.chunk_by(|a, b| a.entry.block == b.entry.block) {
            let index = own[0].entry.block;
            let Some(entry) = self.blocks().get(index as usize) else {
                return Err(FormatError::Limit(format!("block {index} does not belong to this file")));
            };
            let expected = table.of_block(index as usize);
            if own.len() > expected.len() || own.iter().zip(expected).any(|(part, index)| part.index != *index) {
                let what = format!("the parts of block {index} are not the first ones of the block, each once");
                return Err(FormatError::Limit(what));
            }
            if entry.parent != NO_PARENT && !referred[index as usize] && !whole[entry.parent as usize] {
                continue;
            }
            let block = if entry.codec == CODEC_FIELDS {
                let block = self.cut_block(entry, own, own.len() < expected.len(), bytes)?;
                for child in block.1 {
                    // Others are refused when the pointers are corrected.
                    if let Some(referred) = referred.get_mut(child as usize) {
                        *referred = true;
                    }
                }
                block.0
            } else {
                whole[index as usize] = true;
                self.options().check(bytes + entry.image_size)?;
                let mut slots = vec![0u64; (entry.image_size / 8) as usize];
                let image = bytemuck::cast_slice_mut(&mut slots);
                compression::decode_body(index as usize, entry, &own[0].body, image)?;
                self.block(index, slots)?
            };
            bytes += block.slots.len() as u64 * 8;
            blocks.push(block);
        }
        assemble(self.objects(), self.blocks(), &blocks.iter().collect::<Vec<_>>())
    }

    /// A block of codec 2 of its first parts, and the blocks that it refers to. `taken` bytes of the memory are in use.
    fn cut_block(
        &self,
        entry: &BlockEntry,
        parts: &[&Part],
        cut: bool,
        taken: u64,
    ) -> Result<(Block, Vec<u32>), FormatError> {
        let index = parts[0].entry.block;
        let cut = Cut::new(entry, parts, cut)?;
        self.options().check(taken + cut.bytes)?;
        // Pointers to other blocks are those of the file; `assemble` corrects them.
        let outer = |block: u32| self.blocks().get(block as usize).map(|b| b.image_offset / 8);
        Ok((self.block(index, cut.image(entry, index, outer)?)?, cut.fields.children))
    }

    /// A block of its image.
    fn block(&self, index: u32, slots: Vec<u64>) -> Result<Block, FormatError> {
        let at = file_offset(&self.blocks()[index as usize], 0);
        let parts = block_parts(bytemuck::cast_slice(&slots), 0, at, index as usize)?;
        Ok(Block { index, parts, slots })
    }

    /// Reads all parts of a block.
    pub(super) fn block_of_parts(&self, table: &PartTable, index: u32) -> Result<Block, FormatError> {
        let block = &self.blocks()[index as usize];
        let parts = table.of_block(index as usize);
        let read = |part: &u32| {
            let (at, end) = table.range(*part);
            Ok((*part, self.fetch(at, end - at)?))
        };
        let stored: Vec<(u32, Vec<u8>)> = parts.iter().map(read).collect::<Result<_, FormatError>>()?;
        let stored: Vec<(u32, &[u8])> = stored.iter().map(|(part, bytes)| (*part, &bytes[..])).collect();
        let mut slots = vec![0u64; (block.image_size / 8) as usize];
        let mut decoder = Decoder::take().map_err(|what| broken(block, index, what))?;
        decode_stored(self.blocks(), table, index as usize, &stored, &mut slots, &mut decoder)?;
        decoder.keep();
        self.block(index, slots)
    }
}

/// The upper levels of a block of codec 2.
struct Cut {
    fields: Fields,
    array_slots: u32,
    /// Size of its image.
    bytes: u64,
}

impl Cut {
    /// Decodes the first parts of a block. `cut`: there are more.
    fn new(entry: &BlockEntry, parts: &[&Part], cut: bool) -> Result<Self, FormatError> {
        let broken = |what| broken(entry, parts[0].entry.block, what);
        let bodies = parts.iter().map(|part| (part.entry, &part.body[..]));
        let mut decoder = Decoder::take().map_err(broken)?;
        let mut fields = decode_fields(bodies, entry.image_size, &mut decoder).map_err(broken)?;
        decoder.keep();
        let (mut array_slots, mut bytes) = (fields.array_slots, entry.image_size);
        if cut {
            fields.cut();
            let size = measure(&fields);
            (array_slots, bytes) = (size.array_slots, size.bytes);
            if bytes > entry.image_size {
                let what = format!("its first parts make {bytes} bytes, all of it {}", entry.image_size);
                return Err(broken(what));
            }
        }
        Ok(Self { fields, array_slots, bytes })
    }

    /// The image. `index` is the number of the block in it, `outer` gives slot 0 of other blocks.
    fn image(
        &self,
        entry: &BlockEntry,
        index: u32,
        mut outer: impl FnMut(u32) -> Option<u64>,
    ) -> Result<Vec<u64>, FormatError> {
        let mut slots = vec![0u64; (self.bytes / 8) as usize];
        let start = entry.image_offset / 8;
        let block = Layout { fields: &self.fields, array_slots: self.array_slots, index, start };
        write(InstructionSet::best(), &block, &mut slots, &mut outer).map_err(|what| broken(entry, index, what))?;
        Ok(slots)
    }
}

fn broken(entry: &BlockEntry, index: u32, what: String) -> FormatError {
    Broken::new(ids::PART_FIELDS, entry.file_offset, format!("block {index}: {what}")).into()
}

/// An octree of the first parts of some blocks, which are known from an index: without the block table. `known` has the entries of
/// blocks, without their places in image and file, and the number of their parts.
pub(super) fn octree_of(
    objects: &[ObjectEntry],
    known: &BTreeMap<u32, (BlockEntry, usize)>,
    parts: Vec<&Part>,
    options: &OpenOptions,
) -> Result<Octree, FormatError> {
    let mut given = parts;
    given.sort_by_key(|part| (part.entry.block, part.entry.first_level));
    // A table of the blocks that are there. Parents come first, as their indices are smaller.
    let (mut numbers, mut table, mut cuts) = (BTreeMap::<u32, u32>::new(), Vec::new(), Vec::new());
    let (mut referred, mut end, mut bytes) = (BTreeSet::new(), 0, 0);
    for own in given.chunk_by(|a, b| a.entry.block == b.entry.block) {
        let index = own[0].entry.block;
        let Some((entry, count)) = known.get(&index) else { continue };
        if entry.codec != CODEC_FIELDS {
            let what = format!("block {index} has codec {}: read it with `StreamReader`", entry.codec);
            return Err(FormatError::Limit(what));
        }
        if entry.parent != NO_PARENT && !referred.contains(&index) {
            continue;
        }
        let cut = Cut::new(entry, own, own.len() < *count)?;
        bytes += cut.bytes;
        options.check(bytes)?;
        referred.extend(cut.fields.children.iter().copied());
        numbers.insert(index, table.len() as u32);
        let parent = numbers.get(&entry.parent).copied().unwrap_or(NO_PARENT);
        table.push(BlockEntry { parent, image_offset: end, ..*entry });
        end += entry.image_size;
        cuts.push(cut);
    }
    // Blocks that are not there get a place after the others: their voxels become leaves.
    let there = table.len();
    let mut places: BTreeMap<u32, u64> =
        numbers.iter().map(|(index, number)| (*index, table[*number as usize].image_offset / 8)).collect();
    for number in 0..there {
        for &child in &cuts[number].fields.children {
            if let std::collections::btree_map::Entry::Vacant(place) = places.entry(child) {
                place.insert(end / 8);
                table.push(BlockEntry {
                    parent: number as u32,
                    image_offset: end,
                    image_size: PAGE_BYTES,
                    ..table[number]
                });
                end += PAGE_BYTES;
            }
        }
    }
    let mut blocks = Vec::with_capacity(there);
    for (index, cut) in (0..).zip(&cuts) {
        let entry = &table[index as usize];
        let slots = cut.image(entry, index, |child| places.get(&child).copied())?;
        let parts = block_parts(bytemuck::cast_slice(&slots), 0, 0, index as usize)?;
        blocks.push(Block { index, parts, slots });
    }
    let objects: Vec<ObjectEntry> = (objects.iter())
        .map(|object| {
            let root = numbers.get(&object.root_block);
            let root_slot = root.map_or(0, |root| table[*root as usize].image_offset / 8 + u64::from(FIRST_SLOT));
            ObjectEntry { root_block: root.copied().unwrap_or(u32::MAX), root_slot, ..*object }
        })
        .collect();
    assemble(&objects, &table, &blocks.iter().collect::<Vec<_>>())
}
