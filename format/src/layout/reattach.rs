//! Adds ambient occlusion to an existing octree. Everything else stays the same.

use std::ops::ControlFlow;

use rayon::prelude::*;

use crate::check::topology::{Bits, Step, Visitor, walk};
use crate::file::*;
use crate::octree::{Image, Stored};
use crate::{AmbientBlock, Broken, ChildDescriptor, FormatError, MAX_CONTOUR_POINTER, Octree};

/// Words per entry of an attachment directory.
const ENTRY_WORDS: u32 = (ATTACHMENT_BYTES / 4) as u32;

impl Octree {
    /// The same octree with ambient occlusion: for every voxel the fraction of the ambient light that reaches it, in
    /// units of 1/255. Calls `value(slot, child)` once for each voxel of each object; `slot` is the slot of the
    /// descriptor in the image of *this* octree. Existing ambient occlusion is replaced.
    ///
    /// Descriptors keep their slots within their block. Contours and other attachments keep their bits and their order;
    /// metadata, instances, unknown sections and blocks stay; an [id](Self::file_id) does not, as it names octrees. Blocks may grow, which moves the blocks after them. Values are
    /// stored in [`AmbientBlock`]s, 8 bytes for every pair of slots.
    ///
    /// # Errors
    /// The octree came from a file and is not [verified](Self::verified), or is not [sound](Self::sound); a block has the largest number of attachments already, or its contours
    /// get out of reach of the contour pointers; the image would have more than 2^32 slots.
    pub fn with_ambient_occlusion(&self, value: impl Fn(u32, u8) -> u8 + Sync) -> Result<Self, FormatError> {
        self.verified()?;
        self.sound()?;
        let mut seen = Seen { descriptors: Bits::new(self.slots().len()), enters: Vec::new() };
        walk(self, &mut seen);
        let changes: Vec<Change> =
            (0..self.parts.len()).map(|block| Change::new(self, block)).collect::<Result<_, _>>()?;
        let mut blocks = self.blocks.clone();
        let mut image_offset = 0;
        for (block, change) in blocks.iter_mut().zip(&changes) {
            (block.image_offset, block.image_size) = (image_offset, change.size);
            (block.file_offset, block.stored_size, block.codec, block.crc) = (0, change.size, CODEC_RAW, 0);
            image_offset += change.size;
        }
        if image_offset / 8 > MAX_IMAGE_SLOTS - 1 {
            return Err(FormatError::Limit(format!(
                "the image has {image_offset} bytes, expected less than 2^32 slots of 8 bytes"
            )));
        }
        let mut image = vec![0u64; (image_offset / 8) as usize];
        let mut rest = &mut image[..];
        let mut slices = Vec::with_capacity(blocks.len());
        for change in &changes {
            let (head, tail) = rest.split_at_mut((change.size / 8) as usize);
            slices.push(head);
            rest = tail;
        }
        (slices.into_par_iter().zip(&changes).enumerate())
            .try_for_each(|(block, (slots, change))| change.fill(self, block, &seen.descriptors, slots, &value))?;
        for &(slot, from, to) in &seen.enters {
            // Blocks never shrink, so the distance does not become smaller.
            let start = |block: u32| blocks[block as usize].image_offset / 8;
            let here = start(from) + u64::from(slot - self.parts[from as usize].start);
            let far = here + u64::from(self.descriptor(slot).child_ptr());
            image[far as usize] = start(to) + u64::from(FIRST_SLOT) - here;
        }
        let mut objects = self.objects.clone();
        for object in &mut objects {
            object.root_slot = blocks[object.root_block as usize].image_offset / 8 + u64::from(FIRST_SLOT);
        }
        let (meta, unknown) = (self.meta.clone(), self.unknown.clone());
        let mut made = Self::new(objects, blocks, meta, unknown, Image::Owned(image), None, Stored::Made)?;
        made.instances.clone_from(&self.instances);
        Ok(made)
    }
}

/// Collects the descriptors and the pointers between blocks.
struct Seen {
    descriptors: Bits,
    /// For each descriptor whose children are in another block: its slot, its block, the other block.
    enters: Vec<(u32, u32, u32)>,
}

impl Visitor for Seen {
    fn broken(&mut self, _: Broken) -> ControlFlow<()> {
        ControlFlow::Continue(()) // The octree is sound; other rules do not matter here.
    }

    fn descriptor(&mut self, _: u32, step: &Step, _: ChildDescriptor) {
        self.descriptors.insert(step.slot as usize);
    }

    fn enter(&mut self, step: &Step, block: u32) -> ControlFlow<()> {
        self.enters.push((step.slot, step.block, block));
        ControlFlow::Continue(())
    }
}

/// How one block changes.
struct Change {
    /// Number of words by which everything after the attachment directory moves.
    moved: u32,
    /// First word of the ambient blocks, from the start of the block.
    values: usize,
    /// Size of the block in bytes.
    size: u64,
}

impl Change {
    fn new(octree: &Octree, block: usize) -> Result<Self, FormatError> {
        let (parts, start) = (&octree.parts[block], octree.blocks[block].image_offset);
        let there = parts.attachments.iter().find(|attachment| attachment.0 == attachment::AMBIENT_BLOCKS);
        if let Some((_, at, _)) = there {
            let values = ((at - start) / 4) as usize;
            return Ok(Self { moved: 0, values, size: octree.blocks[block].image_size });
        }
        if parts.attachments.len() >= MAX_ATTACHMENTS as usize {
            let what = format!("block {block} has {MAX_ATTACHMENTS} attachments already, the largest number allowed");
            return Err(FormatError::Limit(what));
        }
        let ends = parts.attachments.iter().map(|(_, at, size)| at + size);
        let end = ends.fold((parts.contour_words as u64 + u64::from(parts.contour_count)) * 4, u64::max) - start;
        let values = (end + ATTACHMENT_BYTES).next_multiple_of(8);
        let size = values + u64::from(parts.array_slots.div_ceil(2)) * 8;
        if values - u64::from(parts.array_slots) * 8 > u64::from(u32::MAX) {
            return Err(FormatError::Limit(format!("block {block} is too large for another attachment")));
        }
        let values = (values / 4) as usize;
        Ok(Self { moved: ENTRY_WORDS, values, size: size.next_multiple_of(PAGE_BYTES) })
    }

    /// Copies the block, moves its parts, and writes the ambient blocks.
    fn fill(
        &self,
        octree: &Octree,
        block: usize,
        descriptors: &Bits,
        slots: &mut [u64],
        value: &impl Fn(u32, u8) -> u8,
    ) -> Result<(), FormatError> {
        let parts = &octree.parts[block];
        let (first, array) = (parts.start as usize, parts.array_slots as usize);
        slots[..array].copy_from_slice(&octree.slots()[first..first + array]);
        if self.moved > 0 {
            for (index, slot) in slots[..array].iter_mut().enumerate() {
                let descriptor = ChildDescriptor(*slot);
                if !descriptors.has(first + index) || descriptor.contour_mask() == 0 {
                    continue;
                }
                if descriptor.contour_ptr() + self.moved > MAX_CONTOUR_POINTER {
                    let what = format!(
                        "the contours of block {block} would be out of reach of the descriptor at its slot {index}"
                    );
                    return Err(FormatError::Limit(what));
                }
                *slot += u64::from(self.moved) << 40;
            }
        }
        let from = &octree.words()
            [first * 2..(octree.blocks[block].image_offset + octree.blocks[block].image_size) as usize / 4];
        let words: &mut [u32] = bytemuck::cast_slice_mut(slots);
        self.fill_info(from, words, array * 2, parts.attachments.len());
        let range = |start: usize, count: usize, words: &mut [u32]| {
            words[start + self.moved as usize..][..count].copy_from_slice(&from[start..start + count]);
        };
        range(parts.contour_words - first * 2, parts.contour_count as usize, words);
        for (_, at, size) in parts.attachments.iter().filter(|(kind, ..)| *kind != attachment::AMBIENT_BLOCKS) {
            // The rest of the last word is zero.
            range((at / 4) as usize - first * 2, size.div_ceil(4) as usize, words);
        }
        for pair in (0..array).step_by(2) {
            let mut texels = [None; 16];
            for slot in (pair..array.min(pair + 2)).filter(|slot| descriptors.has(first + slot)) {
                let valid = ChildDescriptor(octree.slots()[first + slot]).valid_mask();
                for child in (0..8u8).filter(|child| valid >> child & 1 != 0) {
                    texels[8 * (slot - pair) + usize::from(child)] = Some(value((first + slot) as u32, child));
                }
            }
            let AmbientBlock(bits) = AmbientBlock::encode(&texels);
            words[self.values + pair] = bits as u32;
            words[self.values + pair + 1] = (bits >> 32) as u32;
        }
        Ok(())
    }

    /// Writes the info section at word `info`, with another attachment unless ambient blocks are replaced.
    fn fill_info(&self, from: &[u32], words: &mut [u32], info: usize, count: usize) {
        let directory = info + (INFO_BYTES / 4) as usize;
        let end = directory + count * ENTRY_WORDS as usize;
        words[info..end].copy_from_slice(&from[info..end]);
        if self.moved == 0 {
            return;
        }
        words[info + 3] += self.moved; // Contours.
        words[info + 5] += 1;
        for entry in words[directory..end].chunks_exact_mut(ENTRY_WORDS as usize) {
            entry[1] += self.moved * 4;
        }
        let bytes = (info as u32 / 2).div_ceil(2) * 8;
        words[end..end + ENTRY_WORDS as usize].copy_from_slice(&[
            attachment::AMBIENT_BLOCKS,
            ((self.values - info) * 4) as u32,
            bytes,
            0,
        ]);
    }
}
