//! Octrees made block by block, without a tree of the whole octree in memory (paper section 3.1: blocks).
//!
//! A program that walks space depth-first [detaches](Tree::detach) every subtree that has become large enough,
//! [packs](pack) it into a finished block, [puts](BlockStore::put) the block into a store in memory or in a file, and
//! [attaches](Tree::attach) the number of the block. The rest of the tree becomes the root block in the end.
//! [`BlockStore::octree`] and [`BlockStore::write`] then order the blocks, assign addresses and set the far pointers
//! between blocks. The result depends only on the contents of the blocks, not on the order in which they were put.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use glam::DMat4;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::file::compression;
use crate::file::extras::Extras;
use crate::file::hash::{self, Hashing};
use crate::file::write::{Front, padding, replace_file, write_atomically};
use crate::file::write_parts::{PartsFile, Waiting};
use crate::file::{BlockEntry, FIRST_SLOT, NO_PARENT, ObjectEntry, PAGE_BYTES};
use crate::layout::block::Layout;
use crate::layout::plan::{Plan, PlannedBlock, subtree_slots};
use crate::parts::block::encode_block;
use crate::{AssembleOptions, Broken, FormatError, Octree, Tree, WriteOptions, ids};

/// A far pointer from one block to another.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Outer {
    /// Slot of the far pointer.
    pointer: u32,
    /// Slot of its descriptor.
    descriptor: u32,
    /// Number of the other block in the store.
    block: u32,
}

/// The facts about a block that are kept apart from its bytes.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct BlockSummary {
    cube_position: [u32; 3],
    cube_scale: u32,
    slots: u32,
    /// Deepest level of its voxels.
    levels: u32,
    descriptors: u64,
    leaf_voxels: u64,
    contours: u64,
    far_pointers: u64,
    outer: Vec<Outer>,
    /// Offset in bytes in a store in a file.
    at: u64,
    /// CRC-32 of the bytes of the block in the store. A block that was damaged in a file would get a right checksum
    /// when the octree is written.
    crc: u32,
}

impl BlockSummary {
    /// End of the block in bytes in a store in a file.
    pub fn end(&self) -> u64 {
        self.at + u64::from(self.slots) * 8
    }
}

/// An encoded block. Its far pointers to other blocks are not set yet.
pub struct PackedBlock {
    image: Vec<u64>,
    summary: BlockSummary,
}

/// Lays out a tree as one block and encodes it.
///
/// `cube` is the cube of the root of a [detached](Tree::detach) tree: lower corner in units of 2^-23 of the root cube,
/// and scale. `None`: the tree has the root of the octree, and the block becomes the root block.
///
/// # Errors
/// A tree that is not well-formed, deeper than 23 levels, or too large for a block (more than 2^22 slots of descriptors or
/// 4 GiB, or contours out of reach of the contour pointers); options out of range.
pub fn pack(tree: &Tree, cube: Option<([u32; 3], u32)>, options: &AssembleOptions) -> Result<PackedBlock, FormatError> {
    options.check()?;
    tree.check()?;
    let (cube_position, cube_scale) = cube.unwrap_or(([0; 3], 23));
    let levels = 23 - cube_scale + tree.levels();
    if cube_scale > 23 || levels > 23 {
        return Err(FormatError::Limit(format!("the octree has {levels} levels, expected at most 23")));
    }
    let sizes = subtree_slots(tree);
    let detached = (tree.nodes.iter().enumerate()).filter(|(_, node)| node.detached).map(|(index, _)| index);
    let above = cube.map(|_| 0);
    let plan = Plan {
        blocks: vec![PlannedBlock { above, parent: NO_PARENT, cube_position, cube_scale }],
        cuts: detached.zip(tree.outside.iter().copied()).collect(),
    };
    let layout = Layout::new(tree, &sizes, &plan, 0, options.near_limit)?;
    let bytes = layout.parts.total_bytes.next_multiple_of(PAGE_BYTES);
    if layout.array_slots > 1 << 22 || bytes > u64::from(u32::MAX) {
        return Err(FormatError::Limit(format!(
            "the block has {} slots of descriptors and {bytes} bytes, expected at most 2^22 slots and 4 GiB: split it",
            layout.array_slots
        )));
    }
    let mut image = vec![0; (bytes / 8) as usize];
    let mut outer = Vec::with_capacity(plan.cuts.len());
    layout.encode(tree, 0, &mut image, |pointer, descriptor, block| {
        outer.push(Outer { pointer, descriptor, block });
        0
    });
    let nodes = || layout.placed.iter().map(|placed| &tree.nodes[placed.node]);
    let summary = BlockSummary {
        cube_position,
        cube_scale,
        slots: image.len() as u32,
        levels,
        descriptors: layout.placed.len() as u64,
        leaf_voxels: nodes().map(|node| u64::from(node.leaf.count_ones())).sum(),
        contours: u64::from(layout.contour_count),
        far_pointers: layout.far_pointers,
        outer,
        at: 0,
        crc: crc32fast::hash(bytemuck::cast_slice(&image)),
    };
    Ok(PackedBlock { image, summary })
}

/// A store of packed blocks, numbered in the order in which they are put. Can be used from several threads.
pub struct BlockStore {
    summaries: Mutex<Vec<BlockSummary>>,
    images: Images,
}

enum Images {
    Memory(Mutex<Vec<Vec<u64>>>),
    File(Mutex<Spill>),
    Files(Gathered),
}

/// Blocks in a file that [`BlockStore::in_files`] takes over.
pub struct StoredBlocks {
    /// Its path, for errors.
    pub path: PathBuf,
    /// The file, open for reading.
    pub file: File,
    /// Where the first block begins, in bytes.
    pub start: u64,
    /// The blocks, in the order of their numbers in the store that wrote them.
    pub summaries: Vec<BlockSummary>,
}

/// Blocks in several files, and those that were put later.
struct Gathered {
    /// Path, file, where its blocks begin, and the number of the first.
    files: Vec<(PathBuf, Mutex<File>, u64, u32)>,
    own: Mutex<Vec<Vec<u64>>>,
    /// The number of the first block that was put later.
    first_own: u32,
}

/// A file with blocks one after the other.
struct Spill {
    file: File,
    end: u64,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl BlockStore {
    /// A store in memory.
    pub fn in_memory() -> Self {
        Self { summaries: Mutex::default(), images: Images::Memory(Mutex::default()) }
    }

    /// A store that keeps the bytes of the blocks in a file, which must be open for reading and writing.
    ///
    /// `summaries` are those of the blocks that are in the file already. Everything after those blocks is overwritten.
    /// [`check`](Self::check) tells whether the file still has them.
    pub fn in_file(file: File, summaries: Vec<BlockSummary>) -> Self {
        let end = summaries.iter().map(BlockSummary::end).max().unwrap_or(0);
        Self { summaries: Mutex::new(summaries), images: Images::File(Mutex::new(Spill { file, end })) }
    }

    /// A store of the blocks of several stores in files, one after the other: the blocks of each get the numbers after those of the files
    /// before it. Returns the first number of each file, too: trees that refer to its blocks are
    /// [moved](Tree::move_blocks) by it. Blocks that are put are kept in memory.
    ///
    /// # Errors
    /// More than 2^32 - 1 blocks.
    pub fn in_files(files: Vec<StoredBlocks>) -> Result<(Self, Vec<u32>), FormatError> {
        let (mut all, mut kept, mut firsts) = (Vec::new(), Vec::new(), Vec::new());
        for StoredBlocks { path, file, start, summaries } in files {
            let first = number(all.len())?;
            number(all.len() + summaries.len())?;
            firsts.push(first);
            kept.push((path, Mutex::new(file), start, first));
            all.extend(summaries.into_iter().map(|mut summary| {
                // A number that is no block's is found when the blocks are put in order.
                summary.outer.iter_mut().for_each(|outer| outer.block = outer.block.saturating_add(first));
                summary
            }));
        }
        let images = Images::Files(Gathered { files: kept, own: Mutex::default(), first_own: number(all.len())? });
        Ok((Self { summaries: Mutex::new(all), images }, firsts))
    }

    /// Adds a block and returns its number, for [`Tree::attach`].
    ///
    /// # Errors
    /// Those of writing the file; more than 2^32 - 1 blocks.
    pub fn put(&self, block: PackedBlock) -> Result<u32, FormatError> {
        let mut summary = block.summary;
        match &self.images {
            Images::Memory(images) | Images::Files(Gathered { own: images, .. }) => {
                let mut images = lock(images);
                images.push(block.image);
                let mut summaries = lock(&self.summaries);
                summaries.push(summary);
                number(summaries.len() - 1)
            }
            Images::File(spill) => {
                let bytes: &[u8] = bytemuck::cast_slice(&block.image);
                let mut spill = lock(spill);
                summary.at = spill.end;
                let at = spill.end;
                let done = spill.file.seek(SeekFrom::Start(at)).and_then(|_| spill.file.write_all(bytes));
                done.map_err(|e| FormatError::io(Path::new("temporary file of the build"), e))?;
                spill.end += bytes.len() as u64;
                let mut summaries = lock(&self.summaries);
                summaries.push(summary);
                number(summaries.len() - 1)
            }
        }
    }

    /// Reads all blocks of a store in a file and compares them with the checksums in their summaries, in parallel. Blocks
    /// are also compared when the octree is made; this finds damage before more work is done.
    ///
    /// # Errors
    /// The first block that is damaged (rule B006; the offset is that in the file); those of reading the file.
    pub fn check(&self) -> Result<(), FormatError> {
        let summaries = lock(&self.summaries).clone();
        let results: Vec<Result<(), FormatError>> = (summaries.par_iter().enumerate())
            .map(|(number, summary)| self.stored(number, summary).map(drop))
            .collect();
        results.into_iter().collect()
    }

    /// Number of blocks.
    pub fn len(&self) -> usize {
        lock(&self.summaries).len()
    }

    /// Whether there are no blocks.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The summaries of the blocks from number `first` on, in the order of their numbers.
    pub fn summaries_from(&self, first: usize) -> Vec<BlockSummary> {
        lock(&self.summaries).get(first..).unwrap_or_default().to_vec()
    }

    /// The octree whose root block has number `root`, in memory.
    ///
    /// # Errors
    /// Those of reading the file; a transform that is not finite, affine and invertible; more than 2^32 slots; blocks
    /// whose cubes are not within the cubes of their parents, or that were never put.
    pub fn octree(self, root: u32, octree_to_mesh: DMat4) -> Result<Octree, FormatError> {
        let ordered = self.order(root, octree_to_mesh)?;
        let slots = ordered.table.last().map_or(0, |b| (b.image_offset + b.image_size) / 8);
        let mut image = Vec::with_capacity(slots as usize);
        for index in 0..ordered.table.len() {
            image.extend_from_slice(&self.block(&ordered, index)?);
            if let Images::Memory(images) = &self.images {
                // Free each block as soon as it is copied, so that the octree is in memory only once.
                lock(images)[ordered.numbers[index] as usize] = Vec::new();
            }
        }
        Octree::from_parts(vec![ordered.object], ordered.table, image)
    }

    /// Writes the octree whose root block has number `root`, to a temporary file in the folder of `path` that is
    /// renamed. Only a few blocks are in memory at a time. The file is the same as that of the result of
    /// [`octree`](Self::octree) with this metadata.
    ///
    /// # Errors
    /// As [`octree`](Self::octree) and [`Octree::write_with`].
    pub fn write(
        &self,
        root: u32,
        octree_to_mesh: DMat4,
        meta: &str,
        path: &Path,
        options: &WriteOptions,
    ) -> Result<ObjectEntry, FormatError> {
        let mut ordered = self.order(root, octree_to_mesh)?;
        let extras = Extras { meta, hash: options.hash, ..Extras::default() };
        if options.parts {
            return self.write_parts(&ordered, extras, path, options.part_level());
        }
        crate::check::tables::check_objects(std::slice::from_ref(&ordered.object), 0)?;
        let object = ordered.object;
        let front = Front { objects: &[object], extras };
        let mut failed = None;
        let written = replace_file(path, |mut out| {
            let mut at = front.length(ordered.table.len());
            out.seek(SeekFrom::Start(at))?;
            let indices: Vec<usize> = (0..ordered.table.len()).collect();
            for group in indices.chunks(4 * rayon::current_num_threads()) {
                let encode = |&index: &usize| {
                    let image = self.block(&ordered, index)?;
                    let encoded = compression::encode(bytemuck::cast_slice(&image), options.compress);
                    let (codec, bytes) = encoded.map_err(|e| FormatError::io(path, e))?;
                    Ok((codec, crc32fast::hash(&bytes), bytes.into_owned()))
                };
                let blocks: Vec<_> = group.par_iter().map(encode).collect::<Result<_, FormatError>>().map_err(|e| {
                    failed = Some(e);
                    std::io::Error::other("a block could not be encoded")
                })?;
                for (&index, (codec, crc, bytes)) in group.iter().zip(&blocks) {
                    let entry = &mut ordered.table[index];
                    (entry.file_offset, entry.stored_size) = (at, bytes.len() as u64);
                    (entry.codec, entry.crc) = (*codec, *crc);
                    out.write_all(bytes)?;
                    out.write_all(padding(bytes.len()))?;
                    at += (bytes.len() as u64).next_multiple_of(PAGE_BYTES);
                }
            }
            out.seek(SeekFrom::Start(0))?;
            out.write_all(&front.bytes(&ordered.table))?;
            if options.hash { hash::append(out) } else { Ok(()) }
        });
        if let Some(error) = failed {
            return Err(error);
        }
        written.map_err(|e| FormatError::io(path, e))?;
        Ok(object)
    }

    /// Like [`write`](Self::write), in parts. They are written to another temporary file first, as those of all blocks are
    /// needed before the first can have its place.
    fn write_parts(
        &self,
        ordered: &Ordered,
        extras: Extras<'_>,
        path: &Path,
        level: i32,
    ) -> Result<ObjectEntry, FormatError> {
        let io = |e| FormatError::io(path, e);
        crate::check::tables::check_objects(std::slice::from_ref(&ordered.object), 0)?;
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut spool = tempfile::tempfile_in(folder).map_err(io)?;
        let (mut waiting, mut places, mut end) = (Vec::new(), Vec::new(), 0u64);
        let indices: Vec<usize> = (0..ordered.table.len()).collect();
        for group in indices.chunks(4 * rayon::current_num_threads()) {
            let encode = |&index: &usize| {
                let image = self.block(ordered, index)?;
                let parts = crate::check::tables::block_parts(bytemuck::cast_slice(&image), 0, 0, index)?;
                encode_block(&ordered.table, index as u32, &image, &parts, level).map_err(io)
            };
            let blocks: Vec<_> = group.par_iter().map(encode).collect::<Result<_, FormatError>>()?;
            for (codec, parts) in blocks {
                for part in parts {
                    spool.write_all(&part.bytes).map_err(io)?;
                    waiting.push(Waiting { entry: part.entry, codec, crc: part.crc() });
                    places.push(end);
                    end += part.bytes.len() as u64;
                }
            }
        }
        let objects = &[ordered.object];
        let laid = PartsFile { objects, blocks: ordered.table.clone(), extras }.lay_out(&waiting).map_err(io)?;
        write_atomically(path, |out| {
            let mut out = Hashing::new(out, extras.hash);
            out.write_all(&laid.head)?;
            let mut bytes = Vec::new();
            for part in &laid.order {
                let size = waiting[*part as usize].entry.size as usize;
                bytes.clear();
                bytes.resize(size.next_multiple_of(8), 0);
                spool.seek(SeekFrom::Start(places[*part as usize]))?;
                spool.read_exact(&mut bytes[..size])?;
                out.write_all(&bytes)?;
            }
            out.write_all(&laid.tail)?;
            out.finish(None)
        })
        .map_err(io)?;
        Ok(ordered.object)
    }

    /// The blocks of the octree in breadth-first order, with addresses in the image.
    fn order(&self, root: u32, octree_to_mesh: DMat4) -> Result<Ordered, FormatError> {
        let summaries = lock(&self.summaries).clone();
        let mut place = vec![u32::MAX; summaries.len()];
        let mut numbers = vec![root];
        let mut table: Vec<BlockEntry> = Vec::new();
        let mut parents = vec![NO_PARENT];
        let mut image_offset = 0;
        let mut object = ObjectEntry {
            octree_to_mesh: octree_to_mesh.to_cols_array(),
            root_block: 0,
            levels: 0,
            root_slot: u64::from(FIRST_SLOT),
            descriptors: 0,
            leaf_voxels: 0,
            contours: 0,
            far_pointers: 0,
            reserved: [0; 4],
        };
        let mut next = 0;
        while let Some(&number) = numbers.get(next) {
            let summary = summaries.get(number as usize).filter(|_| place[number as usize] == u32::MAX);
            let Some(summary) = summary else {
                return Err(FormatError::Limit(format!(
                    "block {number} was never put, or is attached twice; the store has {} blocks",
                    summaries.len()
                )));
            };
            place[number as usize] = next as u32;
            let image_size = u64::from(summary.slots) * 8;
            table.push(BlockEntry::in_memory(
                parents[next],
                (summary.cube_position, summary.cube_scale),
                image_offset,
                image_size,
            ));
            image_offset += image_size;
            object.levels = object.levels.max(summary.levels);
            object.descriptors += summary.descriptors;
            object.leaf_voxels += summary.leaf_voxels;
            object.contours += summary.contours;
            object.far_pointers += summary.far_pointers;
            for outer in &summary.outer {
                numbers.push(outer.block);
                parents.push(next as u32);
            }
            next += 1;
        }
        if image_offset / 8 > u64::from(u32::MAX) {
            return Err(FormatError::Limit(format!(
                "the image has {image_offset} bytes, expected less than 2^32 slots of 8 bytes"
            )));
        }
        crate::check::tables::check_blocks(&table, 0, std::slice::from_ref(&object), Some(image_offset))?;
        Ok(Ordered { object, table, numbers, place, summaries })
    }

    /// The bytes of block `number` as they were put.
    fn stored(&self, number: usize, summary: &BlockSummary) -> Result<Vec<u64>, FormatError> {
        let mut image = vec![0u64; summary.slots as usize];
        let mut fill = |file: &mut File, start: u64| {
            let found = file.seek(SeekFrom::Start(start + summary.at));
            found.and_then(|_| file.read_exact(bytemuck::cast_slice_mut(&mut image)))
        };
        let (name, read) = match &self.images {
            Images::Memory(images) => return Ok(lock(images)[number].clone()),
            Images::File(spill) => (Path::new("temporary file of the build"), fill(&mut lock(spill).file, 0)),
            Images::Files(Gathered { files, own, first_own }) => {
                if let Some(own_number) = number.checked_sub(*first_own as usize) {
                    return Ok(lock(own)[own_number].clone());
                }
                // The first file begins with block 0.
                let (path, file, start, _) = &files[files.partition_point(|file| file.3 as usize <= number) - 1];
                (path.as_path(), fill(&mut lock(file), *start))
            }
        };
        read.map_err(|e| FormatError::io(name, e))?;
        if crc32fast::hash(bytemuck::cast_slice(&image)) == summary.crc {
            return Ok(image);
        }
        let what = format!("block {number} of {} is damaged: its checksum differs", name.display());
        Err(Broken::new(ids::BLOCK_CHECKSUM, summary.at, what).into())
    }

    /// The bytes of the block at index `index` of the table, with its index and its far pointers set.
    fn block(&self, ordered: &Ordered, index: usize) -> Result<Vec<u64>, FormatError> {
        let number = ordered.numbers[index] as usize;
        let summary = &ordered.summaries[number];
        let mut image = self.stored(number, summary)?;
        let info = (image[0] as u32) as usize;
        image[info] = image[info] & !u64::from(u32::MAX) | index as u64;
        let start = |index: usize| ordered.table[index].image_offset / 8;
        for outer in &summary.outer {
            let target = start(ordered.place[outer.block as usize] as usize) + u64::from(FIRST_SLOT);
            image[outer.pointer as usize] = target - (start(index) + u64::from(outer.descriptor));
        }
        Ok(image)
    }
}

fn number(index: usize) -> Result<u32, FormatError> {
    u32::try_from(index).map_err(|_| FormatError::Limit("the store has more than 2^32 - 1 blocks".into()))
}

/// The blocks of an octree in the order of its block table.
struct Ordered {
    object: ObjectEntry,
    table: Vec<BlockEntry>,
    /// For each block of the table, its number in the store.
    numbers: Vec<u32>,
    /// For each block of the store, its index in the table; `u32::MAX` if it does not belong to the octree.
    place: Vec<u32>,
    summaries: Vec<BlockSummary>,
}
