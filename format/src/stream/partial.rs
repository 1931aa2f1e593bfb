//! An octree of some of the blocks of a file: relocates blocks, corrects the pointers between them, and turns voxels
//! whose children are in missing blocks into leaves.

use crate::check::topology::Bits;
use crate::file::*;
use crate::octree::{Image, Stored};
use crate::stream::block::{Block, file_offset};
use crate::{Broken, ChildDescriptor, FormatError, Octree, ids};

/// Makes an octree of `blocks`, which must be in the order of the table.
pub(crate) fn assemble(
    objects: &[ObjectEntry],
    table: &[BlockEntry],
    blocks: &[&Block],
) -> Result<Octree, FormatError> {
    let mut partial = Partial::new(table, blocks)?;
    let mut kept = Vec::new();
    let mut numbers = vec![0; objects.len()];
    for (number, object) in objects.iter().enumerate() {
        let Some(place) = partial.place(object.root_block) else { continue };
        numbers[number] = kept.len() as u32;
        kept.push(partial.object(object, place)?);
    }
    let Partial { mut entries, image, .. } = partial;
    for entry in &mut entries {
        entry.object = numbers[entry.object as usize];
    }
    crate::check::tables::check_objects(&kept, 0)?;
    crate::check::tables::check_blocks(&entries, 0, &kept, Some(image.len() as u64 * 8))?;
    let octree = Octree::new(kept, entries, String::new(), Vec::new(), Image::Owned(image), None, Stored::Taken)?;
    octree.sound()?;
    Ok(octree)
}

/// A descriptor that the walk visits.
struct Step {
    /// Slot in the new image.
    slot: u32,
    /// Index of its block among `blocks`.
    place: usize,
    /// Level of its children.
    level: u32,
}

struct Partial<'a> {
    table: &'a [BlockEntry],
    blocks: &'a [&'a Block],
    /// For each block of the table, its index among `blocks`.
    places: Vec<Option<u32>>,
    entries: Vec<BlockEntry>,
    image: Vec<u64>,
    claimed: Bits,
}

impl<'a> Partial<'a> {
    /// Copies the blocks and gives them their new numbers.
    fn new(table: &'a [BlockEntry], blocks: &'a [&'a Block]) -> Result<Self, FormatError> {
        if blocks.is_empty() {
            return Err(FormatError::Limit(
                "no blocks were given: an octree needs at least the root block of an object".into(),
            ));
        }
        let mut places: Vec<Option<u32>> = vec![None; table.len()];
        let mut entries = Vec::with_capacity(blocks.len());
        let mut image = Vec::with_capacity(blocks.iter().map(|b| b.slots.len()).sum());
        for (place, block) in blocks.iter().enumerate() {
            let index = block.index as usize;
            // Blocks of which only the upper levels are there are smaller.
            let Some(entry) = table.get(index).filter(|entry| entry.image_size >= block.slots.len() as u64 * 8) else {
                return Err(FormatError::Limit(format!("block {index} does not belong to this file")));
            };
            let parent = match entry.parent {
                NO_PARENT => NO_PARENT,
                parent => places[parent as usize].ok_or_else(|| {
                    FormatError::Limit(format!("block {index} was given without block {parent}, its parent"))
                })?,
            };
            if places[index].replace(place as u32).is_some() {
                return Err(FormatError::Limit(format!("block {index} was given twice")));
            }
            let image_offset = image.len() as u64 * 8;
            let stored_size = block.slots.len() as u64 * 8;
            entries.push(BlockEntry {
                parent,
                image_offset,
                image_size: stored_size,
                file_offset: 0,
                stored_size,
                codec: CODEC_RAW,
                crc: 0,
                ..*entry
            });
            image.extend_from_slice(&block.slots);
            // The first word of the info section is the number of the block.
            let info = (image_offset / 8) as usize + block.parts.array_slots as usize;
            image[info] = image[info] & !0xffff_ffff | place as u64;
        }
        let claimed = Bits::new(image.len());
        Ok(Self { table, blocks, places, entries, image, claimed })
    }

    fn place(&self, index: u32) -> Option<usize> {
        self.places.get(index as usize).copied().flatten().map(|place| place as usize)
    }

    fn start(&self, place: usize) -> u32 {
        (self.entries[place].image_offset / 8) as u32
    }

    fn array_end(&self, place: usize) -> u64 {
        u64::from(self.start(place)) + u64::from(self.blocks[place].parts.array_slots)
    }

    /// A finding at a slot of the new image, reported with its offset in the file.
    fn broken(&self, rule: &'static str, place: usize, slot: u64, what: &str) -> Broken {
        let within = slot - u64::from(self.start(place));
        let block = self.blocks[place].index;
        let at = file_offset(&self.table[block as usize], within * 8);
        Broken::new(rule, at, format!("block {block}, slot {within}: {what}"))
    }

    /// Walks an object, corrects its pointers between blocks, and counts its parts.
    fn object(&mut self, object: &ObjectEntry, place: usize) -> Result<ObjectEntry, Broken> {
        let root = self.start(place) + FIRST_SLOT;
        let from = &self.table[object.root_block as usize];
        if object.root_slot != from.image_offset / 8 + u64::from(FIRST_SLOT) {
            let what = "the root slot is not the first descriptor of the root block";
            return Err(self.broken(ids::OBJECT_ROOT, place, root.into(), what));
        }
        let mut part = ObjectEntry {
            root_block: place as u32,
            levels: 0,
            root_slot: root.into(),
            descriptors: 0,
            leaf_voxels: 0,
            contours: 0,
            far_pointers: 0,
            ..*object
        };
        self.claim(root.into(), 1, place)?;
        let mut stack = vec![Step { slot: root, place, level: 1 }];
        while let Some(step) = stack.pop() {
            if step.level > object.levels {
                return Err(self.broken(
                    ids::CHILD_DEPTH,
                    step.place,
                    step.slot.into(),
                    "its voxels are deeper than the levels of its object",
                ));
            }
            let children = self.children(&step, &mut part)?;
            let descriptor = ChildDescriptor(self.image[step.slot as usize]);
            part.levels = part.levels.max(step.level);
            part.descriptors += 1;
            part.leaf_voxels += u64::from(descriptor.leaf_mask().count_ones());
            part.contours += u64::from(descriptor.contour_mask().count_ones());
            if let Some((first, place)) = children {
                let count = descriptor.nonleaf_mask().count_ones();
                self.claim(first.into(), count, place)?;
                stack.extend((first..first + count).map(|slot| Step { slot, place, level: step.level + 1 }));
            }
        }
        Ok(part)
    }

    /// Slot and block of the first child of a descriptor. `None` if it has no non-leaf children, or if they are in a
    /// missing block; they become leaves then.
    fn children(&mut self, step: &Step, part: &mut ObjectEntry) -> Result<Option<(u32, usize)>, Broken> {
        let (slot, place) = (step.slot, step.place);
        let fail = |rule, what| Err(self.broken(rule, place, slot.into(), what));
        let descriptor = ChildDescriptor(self.image[slot as usize]);
        let (valid, leaf) = (descriptor.valid_mask(), descriptor.leaf_mask());
        if leaf & !valid != 0 || valid == 0 {
            return fail(ids::CHILD_LEAF_MASK, "its valid and leaf masks do not fit");
        }
        if descriptor.nonleaf_mask() == 0 {
            return Ok(None);
        }
        let near = u64::from(slot) + u64::from(descriptor.child_ptr());
        if descriptor.child_ptr() == 0 || near >= self.array_end(place) {
            return fail(
                if descriptor.far() { ids::CHILD_FAR } else { ids::CHILD_RANGE },
                "its child pointer is zero or leads out of the descriptor array",
            );
        }
        if !descriptor.far() {
            return Ok(Some((near as u32, place)));
        }
        let distance = self.image[near as usize];
        if distance == 0 || distance > u64::from(u32::MAX) {
            return fail(ids::CHILD_FAR, "its far pointer is zero or has more than 32 bits");
        }
        self.claim(near, 1, place)?;
        let target = u64::from(slot) + distance;
        if target < self.array_end(place) {
            part.far_pointers += 1;
            return Ok(Some((target as u32, place)));
        }
        let index = self.blocks[place].index;
        let in_file = target - u64::from(self.start(place)) + self.table[index as usize].image_offset / 8;
        let found = self.table.partition_point(|b| b.image_offset / 8 <= in_file).saturating_sub(1);
        let block = &self.table[found];
        if block.parent != index || in_file != block.image_offset / 8 + u64::from(FIRST_SLOT) {
            return Err(self.broken(
                ids::CHILD_BLOCK,
                place,
                slot.into(),
                "its far pointer does not lead to the first descriptor of a child block",
            ));
        }
        match self.places[found] {
            Some(child) => {
                let first = self.start(child as usize) + FIRST_SLOT;
                // Blocks keep their order, so the child block comes later.
                self.image[near as usize] = u64::from(first - slot);
                part.far_pointers += 1;
                Ok(Some((first, child as usize)))
            }
            None => {
                let (contours, pointer) = (descriptor.contour_mask(), descriptor.contour_ptr());
                self.image[slot as usize] = ChildDescriptor::new(valid, valid, 0, false, contours, pointer).0;
                self.image[near as usize] = 0;
                Ok(None)
            }
        }
    }

    /// Marks slots of the descriptor array of a block as used. They must be unused.
    fn claim(&mut self, first: u64, count: u32, place: usize) -> Result<(), Broken> {
        if first + u64::from(count) > self.array_end(place) {
            return Err(self.broken(ids::CHILD_RANGE, place, first, "children leave the descriptor array"));
        }
        for slot in first..first + u64::from(count) {
            if !self.claimed.insert(slot as usize) {
                return Err(self.broken(ids::CHILD_ONCE, place, slot, "two pointers lead to it"));
            }
        }
        Ok(())
    }
}
