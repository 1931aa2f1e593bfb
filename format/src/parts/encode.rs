//! The fields of a block from its image, and the cut into parts (spec sections 4.3 and 11.1).

use crate::ChildDescriptor;
use crate::block::BlockParts;
use crate::file::{FIRST_SLOT, PAGE_SLOTS};
use crate::parts::fields::{Fields, MAX_KINDS, Start, Values, link};
use crate::parts::stored::corner_count;
use crate::values::plain::plain_count;

/// Fewest descriptors of a part, if the block has that many.
const PART_NODES: usize = 16;

/// The fields of a block. `image` and `parts` are relative to its start; `block_at` returns the index of the block whose slot 0
/// is at this distance in slots.
///
/// `None` if the block cannot be made of fields. That it can is only certain once [`layout`](super::layout) gave the same image.
pub(crate) fn fields(image: &[u64], parts: &BlockParts, block_at: &dyn Fn(u64) -> Option<u32>) -> Option<Fields> {
    let array = image.get(..parts.array_slots as usize)?;
    let levels = slots_by_level(array)?;
    let words: &[u32] = bytemuck::cast_slice(image);
    let mut fields = Fields { array_slots: parts.array_slots, ..Fields::default() };
    if parts.attachments.len() > MAX_KINDS {
        return None;
    }
    for (kind, ..) in &parts.attachments {
        fields.attachments.push((*kind, Values::of_kind(*kind)?));
    }
    fields.starts.push(Start::default());
    for slots in &levels {
        for &slot in slots {
            let descriptor = ChildDescriptor(array[slot as usize]);
            let (valid, nonleaf) = (descriptor.valid_mask(), descriptor.nonleaf_mask());
            fields.valid.push(valid);
            fields.nonleaf.push(nonleaf);
            fields.links.push(match target(array, slot)? {
                Target::None => link::NONE,
                Target::Near(_) => link::NEAR,
                Target::Far(_) => link::FAR,
                Target::Outside(to) => {
                    fields.children.push(block_at(to.checked_sub(u64::from(FIRST_SLOT))?)?);
                    link::BLOCK
                }
            });
            let mask = descriptor.contour_mask();
            fields.contour_masks.push(mask);
            let first = slot as usize * 2 + descriptor.contour_ptr() as usize;
            fields.contours.extend_from_slice(words.get(first..first + mask.count_ones() as usize)?);
        }
        for (number, (_, at, size)) in parts.attachments.iter().enumerate() {
            let data = image.get((at / 8) as usize..)?;
            let words: &[u32] = words.get((at / 4) as usize..((at + size) / 4) as usize)?;
            for &slot in slots {
                let slot = slot as usize;
                let valid = ChildDescriptor(array[slot]).valid_mask();
                match &mut fields.attachments[number].1 {
                    Values::Constant(value) => *value = *data.first()?,
                    Values::Pairs(unit, pairs) if slot.is_multiple_of(2) => {
                        pairs.extend_from_slice(data.get(slot / 2 * *unit..(slot / 2 + 1) * *unit)?);
                    }
                    Values::Pairs(..) => {}
                    Values::Plain(masks, values) => {
                        let (mask, first) = crate::values::plain::plain_entry(*words.get(slot)?);
                        masks.push(mask);
                        values.extend_from_slice(words.get(first..first + plain_count(mask, valid))?);
                    }
                    Values::Corners(masks, values) => {
                        let (mask, first) = (*words.get(slot * 2)?, *words.get(slot * 2 + 1)? as usize / 2);
                        masks.push(mask);
                        values.extend_from_slice(data.get(first..first + corner_count(mask))?);
                    }
                }
            }
        }
        let end = fields.end();
        fields.starts.push(end);
    }
    Some(fields)
}

/// Where the children of a descriptor are.
enum Target {
    None,
    Near(u32),
    Far(u32),
    /// At this slot, counted from the start of the block.
    Outside(u64),
}

fn target(array: &[u64], slot: u32) -> Option<Target> {
    let descriptor = ChildDescriptor(array[slot as usize]);
    if descriptor.nonleaf_mask() == 0 {
        return Some(Target::None);
    }
    let near = slot.checked_add(descriptor.child_ptr())?;
    let value = *array.get(near as usize)?;
    if !descriptor.far() {
        return Some(Target::Near(near));
    }
    let to = u64::from(slot).checked_add(value)?;
    Some(if to < array.len() as u64 { Target::Far(to as u32) } else { Target::Outside(to) })
}

/// The slots of the descriptors of each level, in order. `None` if the array is not a tree of groups.
fn slots_by_level(array: &[u64]) -> Option<Vec<Vec<u32>>> {
    let mut levels: Vec<Vec<u32>> = vec![(FIRST_SLOT..FIRST_SLOT + first_group(array)?).collect()];
    let mut found = levels[0].len();
    while levels.len() <= 23 {
        let mut next = Vec::new();
        for &slot in &levels[levels.len() - 1] {
            let (Target::Near(first) | Target::Far(first)) = target(array, slot)? else { continue };
            let count = ChildDescriptor(array[slot as usize]).nonleaf_mask().count_ones();
            found += count as usize;
            if first <= slot || (first + count) as usize > array.len() || found > array.len() {
                return None;
            }
            next.extend(first..first + count);
        }
        if next.is_empty() {
            return Some(levels);
        }
        levels.push(next);
    }
    None
}

/// Number of descriptors of the first group. It and its far pointers take the slots before the next group; neither is zero.
fn first_group(array: &[u64]) -> Option<u32> {
    let (mut far, mut end) = (0, array.len().min(FIRST_SLOT as usize + 16) as u32);
    for slot in FIRST_SLOT..FIRST_SLOT + 8 {
        if slot >= end || slot + far >= end || array[slot as usize] == 0 {
            return None;
        }
        let descriptor = ChildDescriptor(array[slot as usize]);
        far += u32::from(descriptor.far());
        if let Some(Target::Near(first) | Target::Far(first)) = target(array, slot) {
            end = end.min(first);
        }
        let used = slot + 1 + far;
        if used >= end || array[used as usize] == 0 || used.is_multiple_of(PAGE_SLOTS) {
            return (used <= end).then_some(slot + 1 - FIRST_SLOT);
        }
    }
    None
}

/// The runs of levels that are stored together: whole levels, each run with at least [`PART_NODES`] descriptors. First and last
/// level, counted from the first of the block.
pub(crate) fn runs(fields: &Fields) -> Vec<(usize, usize)> {
    let mut runs: Vec<(usize, usize)> = Vec::new();
    let (mut first, mut nodes) = (0, 0);
    for level in 0..fields.levels() {
        nodes += fields.count(level);
        if nodes >= PART_NODES {
            runs.push((first, level));
            (first, nodes) = (level + 1, 0);
        }
    }
    match runs.last_mut() {
        Some(last) => last.1 = fields.levels() - 1,
        None => runs.push((0, fields.levels() - 1)),
    }
    runs
}
