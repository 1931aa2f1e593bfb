//! The part of an octree that a device holds: descriptors, far pointers and contours, without the attachments.

use std::borrow::Cow;

use esvo_format::Octree;

use crate::Hit;

/// The part of an octree's image that rays read.
///
/// A block keeps everything before its attachments: its descriptor array, info section and contour pool. All pointers within
/// the block stay as they are. Blocks keep their order and move together; far pointers from block to block are shortened. The octree must be [sound](Octree::sound).
pub struct Resident<'a> {
    slots: Cow<'a, [u64]>,
    map: SlotMap,
}

/// Slots of the resident image and of the octree's image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SlotMap {
    /// For each block, its first slot in the resident image and in the octree's image; both ascend.
    starts: Vec<(u32, u32)>,
}

impl<'a> Resident<'a> {
    /// Leaves out what casting does not read. An octree of one block is borrowed, not copied.
    pub fn new(octree: &'a Octree) -> Self {
        let mut starts = Vec::with_capacity(octree.parts().len());
        let mut ranges = Vec::with_capacity(octree.parts().len());
        let mut next = 0u32;
        for parts in octree.parts() {
            let first = parts.start as usize;
            let end = (parts.contour_words + parts.contour_count as usize).div_ceil(2);
            // Without contours, the contour offset of an info section has no meaning.
            let end = if parts.contour_count == 0 { first + parts.array_slots as usize } else { end };
            starts.push((next, parts.start));
            ranges.push(first..end);
            next += (end - first) as u32;
        }
        if let [only] = &ranges[..] {
            return Self { slots: Cow::Borrowed(&octree.slots()[only.clone()]), map: SlotMap { starts } };
        }
        let mut slots = Vec::with_capacity(next as usize);
        for range in ranges {
            slots.extend_from_slice(&octree.slots()[range]);
        }
        let map = SlotMap { starts };
        patch(octree, &map, &mut slots);
        Self { slots: Cow::Owned(slots), map }
    }

    /// The slots to upload.
    pub fn slots(&self) -> &[u64] {
        &self.slots
    }

    /// The map between the slots of both images.
    pub fn into_map(self) -> SlotMap {
        self.map
    }

    /// The map between the slots of both images.
    pub fn map(&self) -> &SlotMap {
        &self.map
    }
}

/// Corrects the far pointers that lead to another block.
///
/// Only a walk from the root tells descriptors from far pointers. Pointers lead forward, so that one pass over the image in
/// order visits every descriptor after its parent; a bit for each slot says that a descriptor leads to it.
fn patch(octree: &Octree, map: &SlotMap, resident: &mut [u64]) {
    let mut reached = vec![0u64; octree.slots().len().div_ceil(64)];
    for object in octree.objects() {
        reached[object.root_slot as usize / 64] |= 1 << (object.root_slot % 64);
    }
    for (parts, (to, from)) in octree.parts().iter().zip(&map.starts) {
        let end = parts.start + parts.array_slots;
        for slot in parts.start..end {
            if reached[slot as usize / 64] >> (slot % 64) & 1 == 0 {
                continue;
            }
            let descriptor = octree.descriptor(slot);
            let count = descriptor.nonleaf_mask().count_ones();
            if count == 0 {
                continue;
            }
            let first = octree.first_child(slot);
            for child in first..first + count {
                reached[child as usize / 64] |= 1 << (child % 64);
            }
            if first >= end {
                let here = slot - from + to;
                let far = here + descriptor.child_ptr();
                resident[far as usize] = u64::from(map.to_resident(first) - here);
            }
        }
    }
}

impl SlotMap {
    /// The resident slot of a slot of the octree's image, which must be one of a descriptor array.
    pub fn to_resident(&self, slot: u32) -> u32 {
        let block = self.starts.partition_point(|start| start.1 <= slot).saturating_sub(1);
        slot - self.starts[block].1 + self.starts[block].0
    }

    /// The slot of the octree's image of a resident slot.
    pub fn to_image(&self, slot: u32) -> u32 {
        let block = self.starts.partition_point(|start| start.0 <= slot).saturating_sub(1);
        slot - self.starts[block].0 + self.starts[block].1
    }

    /// Replaces the resident slots of hits by slots of the octree's image.
    pub fn restore(&self, hits: &mut [Hit]) {
        if let [(0, start)] = self.starts[..] {
            hits.iter_mut().filter(|hit| !hit.is_miss()).for_each(|hit| hit.slot += start);
            return;
        }
        // Neighbouring rays tend to hit the same block, so that its range is kept.
        let (mut first, mut end, mut image) = (0, 0, 0);
        for hit in hits.iter_mut().filter(|hit| !hit.is_miss()) {
            if !(first..end).contains(&hit.slot) {
                let next = self.starts.partition_point(|start| start.0 <= hit.slot);
                (first, image) = self.starts[next.saturating_sub(1)];
                end = self.starts.get(next).map_or(u32::MAX, |start| start.0);
            }
            hit.slot = hit.slot - first + image;
        }
    }
}

#[cfg(test)]
mod tests {
    use esvo_format::{ChildDescriptor, Octree};

    use super::*;
    use crate::testing::sample::Sample;

    /// Walks both images from the root and compares every descriptor, contour and slot. Returns the number of descriptors.
    fn same_tree(octree: &Octree, resident: &Resident) -> u64 {
        let slots = resident.slots();
        let word = |at: usize| (slots[at / 2] >> (at % 2 * 32)) as u32;
        let root = octree.objects()[0].root_slot as u32;
        let mut stack = vec![(root, resident.map().to_resident(root))];
        let mut seen = 0;
        while let Some((ours, theirs)) = stack.pop() {
            seen += 1;
            assert_eq!(resident.map().to_image(theirs), ours);
            let descriptor = ChildDescriptor(slots[theirs as usize]);
            assert_eq!(descriptor, octree.descriptor(ours));
            let first = descriptor.contour_ptr() as usize + theirs as usize * 2;
            for child in (0..8).filter(|child| descriptor.contour_mask() >> child & 1 != 0) {
                let contour = word(first + descriptor.contour_rank(child) as usize);
                assert_eq!(Some(contour), octree.contour(ours, child).map(|contour| contour.0));
            }
            let near = theirs + descriptor.child_ptr();
            let first = if descriptor.far() { theirs + slots[near as usize] as u32 } else { near };
            let children = (0..8).filter_map(|child| Some((child, octree.child(ours, child)?)));
            stack.extend(children.map(|(child, slot)| (slot, first + descriptor.child_rank(child))));
        }
        seen
    }

    #[test]
    fn the_same_tree_in_fewer_bytes() {
        for sample in [Sample::plain(6, true), Sample::scattered(6, true), Sample::scattered(6, false)] {
            let octree = sample.octree().expect("assembles");
            let resident = Resident::new(&octree);
            assert!(resident.slots().len() < octree.slots().len());
            assert_eq!(same_tree(&octree, &resident), octree.objects()[0].descriptors);
        }
    }

    #[test]
    fn hits_get_their_slots_back() {
        for sample in [Sample::plain(5, false), Sample::scattered(5, true)] {
            let octree = sample.octree().expect("assembles");
            let map = Resident::new(&octree).into_map();
            let hit = |slot| Hit::new(0.5, slot, 1, 20, 3);
            let mut images: Vec<Hit> = octree.parts().iter().map(|parts| hit(parts.start + 2)).collect();
            images.extend(images.clone().into_iter().rev());
            images.push(Hit::miss(4));
            let mut hits = images.clone();
            for hit in hits.iter_mut().filter(|hit| !hit.is_miss()) {
                hit.slot = map.to_resident(hit.slot);
            }
            map.restore(&mut hits);
            assert_eq!(hits, images);
        }
    }

    #[test]
    fn slots_map_both_ways() {
        let octree = Sample::scattered(5, true).octree().expect("assembles");
        let resident = Resident::new(&octree);
        assert!(octree.parts().len() > 3);
        for parts in octree.parts() {
            for slot in [parts.start, parts.start + 2, parts.start + parts.array_slots - 1] {
                let there = resident.map().to_resident(slot);
                assert_eq!(resident.map().to_image(there), slot);
                assert_eq!(resident.slots()[there as usize] as u32 >> 17, octree.slots()[slot as usize] as u32 >> 17);
            }
        }
    }

    #[test]
    fn one_block_is_not_copied() {
        let octree = Sample::plain(5, true).octree().expect("assembles");
        let resident = Resident::new(&octree);
        assert!(std::ptr::eq(resident.slots().as_ptr(), octree.slots().as_ptr()));
    }
}
