//! The walk that follows every pointer of an image whose descriptors have not been checked yet. Soundness, validation
//! and statistics are visitors of it.

use std::ops::ControlFlow;

use crate::block::BlockParts;
use crate::file::{BlockEntry, FIRST_SLOT, NO_PARENT, OBJECT_BYTES, ObjectEntry, PAGE_SLOTS};
use crate::{Broken, ChildDescriptor, Octree, ids};

/// A descriptor that the walk visits.
#[derive(Clone, Copy)]
pub(crate) struct Step {
    /// Slot in the image.
    pub(crate) slot: u32,
    /// Index of its block.
    pub(crate) block: u32,
    /// Level of its children; the root's are at level 1.
    pub(crate) level: u32,
    /// Lower corner of its voxel in units of 2^-23 of the root cube.
    pub(crate) position: [u32; 3],
}

/// The descriptors of the children of one voxel, which are in consecutive slots.
#[derive(Clone, Copy)]
struct Siblings {
    /// Slot of the first.
    first: u32,
    /// Index of their block.
    block: u32,
    /// Level of their children.
    level: u32,
    /// The child slots of the voxel that they belong to.
    mask: u8,
    /// Lower corner of the voxel whose children they are, in units of 2^-23 of the root cube.
    parent: [u32; 3],
}

/// Number of set bits in a byte, from a table. The portable code of `count_ones` takes a dozen instructions.
pub(crate) fn ones(mask: u8) -> u32 {
    const ONES: [u8; 256] = {
        let mut table = [0; 256];
        let mut i = 1;
        while i < 256 {
            table[i] = table[i / 2] + (i % 2) as u8;
            i += 1;
        }
        table
    };
    u32::from(ONES[usize::from(mask)])
}

/// Receives what the walk finds. Everything except [`broken`](Self::broken) has been checked.
pub(crate) trait Visitor {
    /// A rule is broken. [`ControlFlow::Break`] ends the walk; otherwise it continues with the unaffected parts.
    fn broken(&mut self, finding: Broken) -> ControlFlow<()>;
    /// A descriptor whose masks are consistent.
    fn descriptor(&mut self, _object: u32, _step: &Step, _descriptor: ChildDescriptor) {}
    /// The contours of a descriptor: `count` words of the image from word `first` on.
    fn contours(&mut self, _step: &Step, _first: usize, _count: u32) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
    /// A far pointer at this slot.
    fn far_pointer(&mut self, _slot: u32) {}
    /// The children of this descriptor are in another block.
    fn enter(&mut self, _step: &Step, _block: u32) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

/// A set of slots of the image.
pub(crate) struct Bits(Vec<u64>);

impl Bits {
    pub(crate) fn new(len: usize) -> Self {
        Self(vec![0; len.div_ceil(64)])
    }

    pub(crate) fn has(&self, index: usize) -> bool {
        self.0[index / 64] >> (index % 64) & 1 != 0
    }

    /// The elements of `range` that are not in the set, in order. The range must start at a multiple of 64.
    pub(crate) fn missing(&self, range: std::ops::Range<usize>) -> impl Iterator<Item = usize> {
        debug_assert!(range.start.is_multiple_of(64));
        let words = self.0[range.start / 64..range.end.div_ceil(64)].iter();
        let all = words.enumerate().flat_map(move |(k, word)| {
            let mut left = !word;
            std::iter::from_fn(move || {
                let bit = (left != 0).then(|| left.trailing_zeros())?;
                left &= left - 1;
                Some(range.start + k * 64 + bit as usize)
            })
        });
        all.take_while(move |index| *index < range.end)
    }

    /// Adds an element. False if it was in the set already.
    pub(crate) fn insert(&mut self, index: usize) -> bool {
        let (word, bit) = (&mut self.0[index / 64], 1u64 << (index % 64));
        let free = *word & bit == 0;
        *word |= bit;
        free
    }

    /// Adds `count` consecutive elements, at most 64. If any is in the set already, adds none and returns the first
    /// such.
    pub(crate) fn insert_run(&mut self, first: usize, count: u32) -> Option<usize> {
        let (word, shift) = (first / 64, first as u32 % 64);
        let mask = u64::MAX.checked_shr(64 - count).unwrap_or(0);
        let (low, high) = (mask << shift, if shift + count > 64 { mask >> (64 - shift) } else { 0 });
        let taken = self.0[word] & low;
        if taken != 0 {
            return Some(word * 64 + taken.trailing_zeros() as usize);
        }
        if high != 0 {
            let taken = self.0[word + 1] & high;
            if taken != 0 {
                return Some((word + 1) * 64 + taken.trailing_zeros() as usize);
            }
            self.0[word + 1] |= high;
        }
        self.0[word] |= low;
        None
    }
}

/// The result of a walk.
pub(crate) struct Walked {
    /// Slots of descriptors and far pointers.
    pub(crate) claimed: Bits,
    /// Whether every pointer could be followed.
    pub(crate) complete: bool,
}

/// Follows every pointer of the image once.
///
/// Time is linear in the number of descriptors, as no slot is entered twice; memory is one bit per slot. No path is
/// longer than 23 levels.
pub(crate) fn walk(octree: &Octree, visitor: &mut impl Visitor) -> Walked {
    let (slots, parts) = (octree.slots(), octree.parts());
    let mut walk = Walk { octree, slots, parts, visitor, claimed: Bits::new(slots.len()), complete: true };
    for (index, object) in octree.objects().iter().enumerate() {
        if walk.object(index, object).is_break() {
            walk.complete = false;
            break;
        }
    }
    Walked { claimed: walk.claimed, complete: walk.complete }
}

struct Walk<'a, V> {
    octree: &'a Octree,
    /// Slots and parts of the octree.
    slots: &'a [u64],
    parts: &'a [BlockParts],
    visitor: &'a mut V,
    claimed: Bits,
    complete: bool,
}

impl<V: Visitor> Walk<'_, V> {
    /// Reports that the pointers from `slot` on cannot be followed.
    #[cold]
    fn fail(&mut self, rule: &'static str, slot: u64, what: String) -> ControlFlow<()> {
        self.complete = false;
        self.note(rule, slot, what)
    }

    /// Reports a finding that does not prevent the walk from continuing.
    #[cold]
    fn note(&mut self, rule: &'static str, slot: u64, what: String) -> ControlFlow<()> {
        self.visitor.broken(Broken::new(rule, self.octree.offset(slot * 8), format!("slot {slot}: {what}")))
    }

    fn object(&mut self, index: usize, object: &ObjectEntry) -> ControlFlow<()> {
        let is_root = |b: &&BlockEntry| {
            b.object as usize == index
                && b.parent == NO_PARENT
                && b.image_offset / 8 + u64::from(FIRST_SLOT) == object.root_slot
        };
        if self.octree.blocks().get(object.root_block as usize).filter(is_root).is_none() {
            let what = format!(
                "it is the root slot of object {index}, but not the first descriptor of root block {}",
                object.root_block
            );
            return self.fail(ids::OBJECT_ROOT, object.root_slot.min(self.slots.len() as u64), what);
        }
        let (first, block) = (object.root_slot as u32, object.root_block);
        if !self.claim(first, 1, block)? {
            return ControlFlow::Continue(());
        }
        // The root is handled as child 0 of a voxel that does not exist.
        let mut stack = vec![Siblings { first, block, level: 1, mask: 1, parent: [0; 3] }];
        while let Some(siblings) = stack.pop() {
            let Siblings { level, parent, .. } = siblings;
            let size = 1u32 << (24 - level);
            let mut left = siblings.mask;
            let mut slot = siblings.first + ones(left);
            // In reverse order, so that the subtree of the first sibling, which follows in memory, is on top of the
            // stack.
            while left != 0 {
                let child = left.ilog2();
                left ^= 1 << child;
                slot -= 1;
                let position = std::array::from_fn(|axis| parent[axis] + (child >> axis & 1) * size);
                let step = Step { slot, block: siblings.block, level, position };
                let Some(mask) = self.masks(index, object, &step)? else { continue };
                let Some((first, block)) = self.children(&step, mask)? else { continue };
                if block != step.block {
                    self.visitor.enter(&step, block)?;
                }
                stack.push(Siblings { first, block, level: level + 1, mask, parent: position });
            }
        }
        ControlFlow::Continue(())
    }

    /// Checks the masks and contours of one descriptor; returns its non-leaf mask if it has children to follow.
    fn masks(&mut self, index: usize, object: &ObjectEntry, step: &Step) -> ControlFlow<(), Option<u8>> {
        let none = ControlFlow::Continue(None);
        let at = u64::from(step.slot);
        let descriptor = ChildDescriptor(self.slots[step.slot as usize]);
        let (valid, leaf, contours) = (descriptor.valid_mask(), descriptor.leaf_mask(), descriptor.contour_mask());
        if leaf & !valid != 0 || valid == 0 {
            self.fail(ids::CHILD_LEAF_MASK, at, format!("valid mask {valid:08b} and leaf mask {leaf:08b} do not fit"))?;
            return none;
        }
        if step.level > object.levels {
            self.fail(
                ids::CHILD_DEPTH,
                at,
                format!("its voxels are at level {}, the object has {} levels", step.level, object.levels),
            )?;
            return none;
        }
        self.visitor.descriptor(index as u32, step, descriptor);
        if contours & !valid != 0 {
            self.fail(
                ids::CONTOUR_MASK,
                at,
                format!("contour mask {contours:08b} is no subset of valid mask {valid:08b}"),
            )?;
        } else if contours != 0 {
            let parts = &self.parts[step.block as usize];
            let first = step.slot as usize * 2 + descriptor.contour_ptr() as usize;
            let end = first + ones(contours) as usize;
            if first < parts.contour_words || end > parts.contour_words + parts.contour_count as usize {
                let what = format!("contour pointer {} leads out of the contour pool", descriptor.contour_ptr());
                self.fail(ids::CONTOUR_RANGE, at, what)?;
            } else {
                self.visitor.contours(step, first, ones(contours))?;
            }
        } else if descriptor.contour_ptr() != 0 {
            self.note(ids::CONTOUR_NONE, at, format!("contour pointer {} without contours", descriptor.contour_ptr()))?;
        }
        let nonleaf = valid & !leaf;
        if nonleaf == 0 {
            if descriptor.child_ptr() != 0 || descriptor.far() {
                self.note(ids::CHILD_NONE, at, "it has a child pointer, but no child with a descriptor".into())?;
            }
            return none;
        }
        ControlFlow::Continue(Some(nonleaf))
    }

    /// Claims the descriptors of the children in mask `nonleaf`. Returns slot and block of the first, if they can be
    /// followed.
    fn children(&mut self, step: &Step, nonleaf: u8) -> ControlFlow<(), Option<(u32, u32)>> {
        let none = ControlFlow::Continue(None);
        let at = u64::from(step.slot);
        let count = ones(nonleaf);
        let descriptor = ChildDescriptor(self.slots[step.slot as usize]);
        let Some((first, block)) = self.first_child(step, descriptor)? else { return none };
        let parts = &self.parts[block as usize];
        if u64::from(first) + u64::from(count) > u64::from(parts.start + parts.array_slots) {
            self.fail(
                ids::CHILD_RANGE,
                at,
                format!("{count} children from slot {first} on leave the descriptor array"),
            )?;
            return none;
        }
        if first % 2 != 0 {
            self.note(ids::CHILD_PAGE, first.into(), "siblings start at an odd slot".into())?;
        }
        if !self.claim(first, count, block)? {
            return none;
        }
        ControlFlow::Continue(Some((first, block)))
    }

    /// Slot and block of the first child. The slot is within the descriptor array of the block.
    fn first_child(&mut self, step: &Step, descriptor: ChildDescriptor) -> ControlFlow<(), Option<(u32, u32)>> {
        let none = ControlFlow::Continue(None);
        let at = u64::from(step.slot);
        let parts = &self.parts[step.block as usize];
        let array_end = u64::from(parts.start + parts.array_slots);
        let near = at + u64::from(descriptor.child_ptr());
        if descriptor.child_ptr() == 0 || near >= array_end {
            let rule = if descriptor.far() { ids::CHILD_FAR } else { ids::CHILD_RANGE };
            let what = format!("child pointer {} is zero or leads out of the descriptor array", descriptor.child_ptr());
            self.fail(rule, at, what)?;
            return none;
        }
        if !descriptor.far() {
            return ControlFlow::Continue(Some((near as u32, step.block)));
        }
        if !self.claim(near as u32, 1, step.block)? {
            return none;
        }
        let distance = self.slots[near as usize];
        if distance == 0 || distance > u64::from(u32::MAX) {
            self.fail(ids::CHILD_FAR, near, format!("far pointer {distance:#x} is zero or has more than 32 bits"))?;
            return none;
        }
        self.visitor.far_pointer(near as u32);
        let target = at + distance;
        if target < array_end {
            return ControlFlow::Continue(Some((target as u32, step.block)));
        }
        let blocks = self.octree.blocks();
        let found = blocks.partition_point(|b| b.image_offset / 8 <= target).wrapping_sub(1);
        if found == step.block as usize || target >= self.slots.len() as u64 {
            self.fail(
                ids::CHILD_RANGE,
                near,
                format!("far pointer to slot {target}, which is in no descriptor array"),
            )?;
            return none;
        }
        let (start, parent) = (blocks[found].image_offset / 8, blocks[found].parent);
        if target != start + u64::from(FIRST_SLOT) || parent != step.block {
            let what = format!(
                "far pointer from block {} to slot {} of block {found}, expected slot {FIRST_SLOT} of a child block",
                step.block,
                target - start
            );
            self.fail(ids::CHILD_BLOCK, near, what)?;
            return none;
        }
        ControlFlow::Continue(Some((target as u32, found as u32)))
    }

    /// Marks `count` slots of a descriptor array as used. They must be unused, in one page, and not the page header,
    /// whose value is checked too. False if they cannot be used.
    fn claim(&mut self, first: u32, count: u32, block: u32) -> ControlFlow<(), bool> {
        let in_page = first % PAGE_SLOTS;
        if in_page == 0 || in_page + count > PAGE_SLOTS {
            self.fail(ids::CHILD_PAGE, first.into(), format!("{count} slots include a page header"))?;
            return ControlFlow::Continue(false);
        }
        let page = first - in_page;
        let header = self.slots[page as usize];
        let parts = &self.parts[block as usize];
        if header != u64::from(parts.start + parts.array_slots - page) {
            self.note(
                ids::PAGE_HEADER,
                page.into(),
                format!("page header {header:#x} is not the distance to the info section"),
            )?;
        }
        if let Some(slot) = self.claimed.insert_run(first as usize, count) {
            self.fail(ids::CHILD_ONCE, slot as u64, "two pointers lead to it".into())?;
            return ControlFlow::Continue(false);
        }
        ControlFlow::Continue(true)
    }
}

/// Keeps the first finding, and the object whose far pointer was met first.
#[derive(Default)]
struct First {
    finding: Option<Broken>,
    object: u32,
    far: Option<u32>,
}

impl Visitor for First {
    fn broken(&mut self, finding: Broken) -> ControlFlow<()> {
        self.finding = Some(finding);
        ControlFlow::Break(())
    }

    fn descriptor(&mut self, object: u32, _step: &Step, _descriptor: ChildDescriptor) {
        self.object = object;
    }

    fn far_pointer(&mut self, _slot: u32) {
        self.far.get_or_insert(self.object);
    }
}

impl Octree {
    /// Whether every pointer that a traversal can follow is valid, and far pointers are not denied: casters leave out what
    /// follows them if all objects say that they have none. Checked at the first call; the result is kept.
    ///
    /// # Errors
    /// The first rule found broken.
    pub fn sound(&self) -> Result<(), Broken> {
        self.sound.get_or_init(|| first_broken(self)).clone()
    }
}

/// Fails with the first broken rule of pointers and masks, if any.
fn first_broken(octree: &Octree) -> Result<(), Broken> {
    let mut first = First::default();
    walk(octree, &mut first);
    if let Some(finding) = first.finding {
        return Err(finding);
    }
    match first.far {
        Some(object) if !octree.needs().far_pointers => {
            let at = octree.origin.map_or(0, |origin| origin.objects) + u64::from(object) * OBJECT_BYTES;
            Err(Broken::new(
                ids::OBJECT_COUNTS,
                at + 168,
                format!("object {object} has far pointers, its entry says 0"),
            ))
        }
        _ => Ok(()),
    }
}
