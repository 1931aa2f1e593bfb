//! Checks what the descriptors say.

use crate::file::PAGE_SLOTS;
use crate::{Broken, Octree, ids};

/// Follows every pointer once, in order of the image, and stops at the first broken rule.
///
/// Time and memory are linear in the image: a bit per slot remembers what has been visited, and pointers only lead
/// forward, so no chain is followed twice.
pub(crate) fn check_topology(octree: &Octree) -> Result<(), Broken> {
    let slots = octree.slots();
    let mut claimed = vec![0u64; slots.len().div_ceil(64)];
    for (index, object) in octree.objects().iter().enumerate() {
        let root = octree
            .blocks()
            .get(object.root_block as usize)
            .filter(|block| block.object as usize == index && block.image_offset / 8 + 2 == object.root_slot);
        if root.is_none() {
            return Err(Broken::new(ids::OBJECT_ROOT, 0, format!("object {index}: root slot {}", object.root_slot)));
        }
        let mut stack = vec![(object.root_slot as u32, object.root_block, 1u32)];
        claim(octree, &mut claimed, object.root_slot as u32, 1, object.root_block)?;
        while let Some((slot, block, level)) = stack.pop() {
            let descriptor = octree.descriptor(slot);
            let at = u64::from(slot) * 8;
            let broken = |rule, what: String| Err(Broken::new(rule, at, format!("descriptor at slot {slot}: {what}")));
            let (valid, leaf, contours) = (descriptor.valid_mask(), descriptor.leaf_mask(), descriptor.contour_mask());
            if leaf & !valid != 0 || valid == 0 {
                return broken(ids::CHILD_LEAF_MASK, format!("valid mask {valid:08b}, leaf mask {leaf:08b}"));
            }
            if contours & !valid != 0 {
                return broken(ids::CONTOUR_MASK, format!("valid mask {valid:08b}, contour mask {contours:08b}"));
            }
            if level > object.levels {
                return broken(ids::CHILD_DEPTH, format!("level {level} of {}", object.levels));
            }
            let parts = &octree.parts()[block as usize];
            if contours != 0 {
                let first = slot as usize * 2 + descriptor.contour_ptr() as usize;
                let end = first + contours.count_ones() as usize;
                if first < parts.contour_words || end > parts.contour_words + parts.contour_count as usize {
                    return broken(ids::CONTOUR_RANGE, format!("contours at word {first}"));
                }
            }
            let count = descriptor.nonleaf_mask().count_ones();
            if count == 0 {
                if descriptor.child_ptr() != 0 || descriptor.far() {
                    return broken(ids::CHILD_NONE, "has a child pointer without children".into());
                }
                continue;
            }
            let near = u64::from(slot) + u64::from(descriptor.child_ptr());
            let array_end = u64::from(parts.start + parts.array_slots);
            if near >= array_end || descriptor.child_ptr() == 0 {
                return broken(ids::CHILD_RANGE, format!("child pointer {}", descriptor.child_ptr()));
            }
            let (first, child_block) = if descriptor.far() {
                let far = slots[near as usize];
                if far == 0 || far > u64::from(u32::MAX) {
                    return broken(ids::CHILD_FAR, format!("far pointer {far:#x}"));
                }
                claim(octree, &mut claimed, near as u32, 1, block)?;
                let target = u64::from(slot) + far;
                if target < array_end {
                    (target, block)
                } else {
                    let found =
                        octree.blocks().partition_point(|b| b.image_offset / 8 <= target).wrapping_sub(1) as u32;
                    let start = octree.blocks().get(found as usize).map(|b| b.image_offset / 8 + 2);
                    let parent = octree.blocks().get(found as usize).map(|b| b.parent);
                    if start != Some(target) || parent != Some(block) {
                        return broken(ids::CHILD_BLOCK, format!("far pointer to slot {target}"));
                    }
                    (target, found)
                }
            } else {
                (near, block)
            };
            let last = first + u64::from(count);
            let child_parts = &octree.parts()[child_block as usize];
            if last > u64::from(child_parts.start + child_parts.array_slots) {
                return broken(ids::CHILD_RANGE, format!("children at slots {first}..{last}"));
            }
            claim(octree, &mut claimed, first as u32, count, child_block)?;
            let first = first as u32;
            stack.extend((first..first + count).map(|child| (child, child_block, level + 1)));
        }
    }
    Ok(())
}

/// Marks slots as used; they must be free, in one page, and not its header.
fn claim(octree: &Octree, claimed: &mut [u64], first: u32, count: u32, block: u32) -> Result<(), Broken> {
    let at = u64::from(first) * 8;
    let in_page = first % PAGE_SLOTS;
    if in_page == 0 || in_page + count > PAGE_SLOTS {
        return Err(Broken::new(ids::CHILD_PAGE, at, format!("{count} slots at {first} reach over a page header")));
    }
    let page = first - in_page;
    let info = octree.slots()[page as usize];
    let parts = &octree.parts()[block as usize];
    if info != u64::from(parts.start + parts.array_slots - page) {
        return Err(Broken::new(ids::PAGE_HEADER, u64::from(page) * 8, format!("page header {info:#x}")));
    }
    for slot in first..first + count {
        let (word, bit) = (slot as usize / 64, 1u64 << (slot % 64));
        if claimed[word] & bit != 0 {
            return Err(Broken::new(ids::CHILD_ONCE, u64::from(slot) * 8, format!("slot {slot} is referred to twice")));
        }
        claimed[word] |= bit;
    }
    Ok(())
}
