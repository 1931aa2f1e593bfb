//! Counts of the octree in a file, with one block at a time in memory.

use crate::check::topology::Bits;
use crate::file::{FIRST_SLOT, NO_PARENT, PAGE_SLOTS};
use crate::inspect::stats::Stats;

use crate::{Block, Broken, ChildDescriptor, FormatError, RangeRead, StreamReader, ids};

/// Descriptors of siblings, which are in consecutive slots of one block.
#[derive(Clone, Copy)]
struct Siblings {
    /// Slot of the first, from the start of the block.
    first: u32,
    count: u32,
    /// Level of their children.
    level: u32,
}

/// The counts of [`stats`](crate::stats()), from a file of which one block at a time is in memory: for files that are larger than the
/// memory. Compares all checksums.
///
/// # Errors
/// The source's; the rule that a block or a pointer breaks; the memory limit of the reader, for one block.
pub fn stream_stats<S: RangeRead>(reader: &StreamReader<S>) -> Result<Stats, FormatError> {
    let blocks = reader.blocks();
    let image = blocks.iter().map(|block| block.image_size).sum();
    let mut stats = Stats::none(reader.objects().len(), blocks.len(), image);
    // What leads into each block: known before the block is read, as blocks come after their parents (B012).
    let root = |block: &crate::file::BlockEntry| {
        (block.parent == NO_PARENT).then_some(Siblings { first: FIRST_SLOT, count: 1, level: 1 })
    };
    let mut entries: Vec<Option<Siblings>> = blocks.iter().map(root).collect();
    for index in 0..blocks.len() {
        let block = reader.read_block(index as u32)?;
        stats.bytes.add(block.parts());
        let Some(entry) = entries[index] else { continue };
        let mut walk = Walk { reader, block: &block, claimed: Bits::new(block.slots().len()), entries: &mut entries };
        walk.count(entry, &mut stats)?;
    }
    let mut bytes = stats.bytes;
    bytes.finish(&stats);
    stats.bytes = bytes;
    stats.averages();
    Ok(stats)
}

struct Walk<'a, S> {
    reader: &'a StreamReader<S>,
    block: &'a Block,
    /// Slots of descriptors and far pointers that were counted.
    claimed: Bits,
    /// What leads into each block of the file.
    entries: &'a mut [Option<Siblings>],
}

impl<S: RangeRead> Walk<'_, S> {
    fn count(&mut self, entry: Siblings, stats: &mut Stats) -> Result<(), FormatError> {
        self.claim(entry)?;
        let mut stack = vec![entry];
        while let Some(Siblings { first, count, level }) = stack.pop() {
            for slot in first..first + count {
                let descriptor = ChildDescriptor(self.block.slots()[slot as usize]);
                let (valid, leaf) = (descriptor.valid_mask(), descriptor.leaf_mask());
                if leaf & !valid != 0 || valid == 0 {
                    return Err(self.broken(ids::CHILD_LEAF_MASK, slot, "its masks do not fit"));
                }
                if level > 23 {
                    return Err(self.broken(ids::CHILD_DEPTH, slot, "its voxels are below level 23"));
                }
                stats.count(level, descriptor);
                let count = (valid & !leaf).count_ones();
                if count == 0 {
                    continue;
                }
                if let Some(first) = self.first_child(slot, descriptor, (count, level + 1), stats)? {
                    let children = Siblings { first, count, level: level + 1 };
                    self.claim(children)?;
                    stack.push(children);
                }
            }
        }
        Ok(())
    }

    /// Slot of the first child; `None` if the children are in another block, which then gets its entry.
    fn first_child(
        &mut self,
        slot: u32,
        descriptor: ChildDescriptor,
        (count, level): (u32, u32),
        stats: &mut Stats,
    ) -> Result<Option<u32>, FormatError> {
        let near = u64::from(slot) + u64::from(descriptor.child_ptr());
        if !descriptor.far() {
            return Ok(Some(u32::try_from(near).unwrap_or(u32::MAX)));
        }
        let near = u32::try_from(near).unwrap_or(u32::MAX);
        self.claim(Siblings { first: near, count: 1, level })?;
        stats.far_pointers += 1;
        // The value may be anything.
        let target = self.block.slots()[near as usize].saturating_add(slot.into());
        if target < u64::from(self.block.parts().array_slots) {
            return Ok(Some(target as u32));
        }
        let (blocks, own) = (self.reader.blocks(), self.block.index() as usize);
        let place = target.saturating_add(blocks[own].image_offset / 8);
        let found = blocks.partition_point(|block| block.image_offset / 8 <= place).wrapping_sub(1);
        let is_entry = blocks.get(found).is_some_and(|block| {
            found > own && block.image_offset / 8 + u64::from(FIRST_SLOT) == place && block.parent as usize == own
        });
        if !is_entry || self.entries[found].replace(Siblings { first: FIRST_SLOT, count, level }).is_some() {
            return Err(self.broken(ids::CHILD_BLOCK, near, "it leads to no child block that nothing else leads to"));
        }
        Ok(None)
    }

    /// Marks slots as counted. They must be in the descriptor array, no page header, and not counted yet.
    fn claim(&mut self, siblings: Siblings) -> Result<(), FormatError> {
        let Siblings { first, count, .. } = siblings;
        if u64::from(first) + u64::from(count) > u64::from(self.block.parts().array_slots) {
            return Err(self.broken(ids::CHILD_RANGE, first, "it is outside of the descriptor array"));
        }
        if first % PAGE_SLOTS == 0 || first % PAGE_SLOTS + count > PAGE_SLOTS {
            return Err(self.broken(ids::CHILD_PAGE, first, "siblings include a page header"));
        }
        match self.claimed.insert_run(first as usize, count) {
            Some(slot) => Err(self.broken(ids::CHILD_ONCE, slot as u32, "two pointers lead to it")),
            None => Ok(()),
        }
    }

    #[cold]
    fn broken(&self, rule: &'static str, slot: u32, what: &str) -> FormatError {
        let block = &self.reader.blocks()[self.block.index() as usize];
        let what = format!("slot {slot} of block {}: {what}", self.block.index());
        Broken::new(rule, block.file_offset + u64::from(slot) * 8, what).into()
    }
}
