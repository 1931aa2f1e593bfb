//! Where the descriptors and far pointers of one block lie, and their bytes (spec sections 4.2 and 5).

use crate::descriptor::MAX_NEAR_POINTER;
use crate::file::{ATTACHMENT_BYTES, FIRST_SLOT, INFO_BYTES, PAGE_SLOTS};
use crate::layout::attachments::{Attached, Content, place};
use crate::layout::plan::{Plan, upper_bound};
use crate::{ChildDescriptor, FormatError, Tree};

/// Where a descriptor's children are.
#[derive(Clone, Copy)]
enum Children {
    None,
    /// First child at this slot of the block.
    Near(u32),
    /// Far pointer at the first slot, first child at the second.
    Far(u32, u32),
    /// Far pointer at the slot, children in the other block.
    Block(u32, u32),
}

pub(crate) struct Placed {
    pub(crate) node: usize,
    pub(crate) slot: u32,
    children: Children,
}

/// Byte offsets of the parts of a block from its start.
pub(crate) struct Parts {
    pub(crate) info: u64,
    pub(crate) contours: u64,
    pub(crate) total_bytes: u64,
}

/// One block, every descriptor with its slot.
pub(crate) struct Layout {
    pub(crate) placed: Vec<Placed>,
    pub(crate) array_slots: u32,
    pub(crate) contour_count: u32,
    pub(crate) far_pointers: u64,
    pub(crate) attachments: Vec<Attached>,
    pub(crate) parts: Parts,
}

/// Walks the nodes of one block and gives them slots.
struct Placer<'a> {
    tree: &'a Tree,
    sizes: &'a [u32],
    plan: &'a Plan,
    near_limit: u32,
    cursor: u32,
    placed: Vec<Placed>,
    far_pointers: u64,
}

impl Placer<'_> {
    /// The block that has the children of this node, if it is not this one.
    fn block_of(&self, node: usize) -> Option<u32> {
        if self.plan.cuts.is_empty() { None } else { self.plan.cuts.get(&node).copied() }
    }

    /// Places the children of `above` (or the root alone), then what is below each of them. Returns the first slot.
    fn place(&mut self, above: Option<usize>) -> Result<u32, FormatError> {
        let (mut group, mut far) = ([0usize; 8], [false; 8]);
        let mut count = 0;
        match above {
            Some(index) => {
                for (_, child) in self.tree.children(index) {
                    group[count] = child;
                    count += 1;
                }
            }
            None => count = 1,
        }
        let group = &group[..count];
        // A descriptor needs a far pointer if what its elder siblings have below them may push its children too far.
        let mut ahead = 16u32.saturating_sub(count as u32);
        for (far, &node) in far.iter_mut().zip(group) {
            *far = self.block_of(node).is_some() || self.sizes[node] != 0 && ahead.saturating_add(64) > self.near_limit;
            ahead = ahead.saturating_add(upper_bound(self.sizes[node], self.near_limit));
        }
        let far_count = far.iter().filter(|&&f| f).count() as u32;
        let needed = group.len() as u32 + far_count;
        let in_page = self.cursor % PAGE_SLOTS;
        if in_page == 0 || in_page + needed > PAGE_SLOTS {
            self.cursor = self.cursor.next_multiple_of(PAGE_SLOTS) + FIRST_SLOT;
        }
        let first = self.cursor;
        let mut far_slot = first + group.len() as u32;
        self.cursor = (first + needed).next_multiple_of(2);
        self.far_pointers += u64::from(far_count);
        let start = self.placed.len();
        self.placed.extend((first..).zip(group).map(|(slot, &node)| Placed { node, slot, children: Children::None }));
        for (i, &node) in group.iter().enumerate() {
            let children = if let Some(block) = self.block_of(node) {
                Children::Block(far_slot, block)
            } else if self.sizes[node] == 0 {
                continue;
            } else {
                let target = self.place(Some(node))?;
                if far[i] { Children::Far(far_slot, target) } else { Children::Near(target) }
            };
            far_slot += u32::from(far[i]);
            if let Children::Near(target) = children
                && target - (first + i as u32) > MAX_NEAR_POINTER
            {
                return Err(FormatError::Limit(format!("node {node} at slot {first} is too far from its children")));
            }
            self.placed[start + i].children = children;
        }
        Ok(first)
    }
}

impl Layout {
    pub(crate) fn new(
        tree: &Tree,
        sizes: &[u32],
        plan: &Plan,
        block: usize,
        near_limit: u32,
    ) -> Result<Self, FormatError> {
        let mut placer =
            Placer { tree, sizes, plan, near_limit, cursor: FIRST_SLOT, placed: Vec::new(), far_pointers: 0 };
        placer.place(plan.blocks[block].above)?;
        let Placer { placed, cursor: array_slots, far_pointers, .. } = placer;
        let contour_count = placed.iter().map(|p| tree.nodes[p.node].contours.count_ones()).sum();
        let contents = Content::of_block(tree, &placed, array_slots)?;
        let info = u64::from(array_slots) * 8;
        let contours = info + INFO_BYTES + ATTACHMENT_BYTES * contents.len() as u64;
        let (attachments, total_bytes) = place(contents, contours + u64::from(contour_count) * 4);
        let parts = Parts { info, contours, total_bytes };
        Ok(Self { placed, array_slots, contour_count, far_pointers, attachments, parts })
    }

    /// Writes the block into its part of the image, which is zero. `far` gives the distance from the descriptor at a
    /// slot of this block to the first descriptor of another block, for the far pointer at another slot: `far(pointer,
    /// descriptor, block)`.
    pub(crate) fn encode(&self, tree: &Tree, index: u32, image: &mut [u64], mut far: impl FnMut(u32, u32, u32) -> u64) {
        let info_slot = self.array_slots;
        for page in (0..info_slot).step_by(PAGE_SLOTS as usize) {
            image[page as usize] = u64::from(info_slot - page);
        }
        let (array, rest) = image.split_at_mut(info_slot as usize);
        let rest_words: &mut [u32] = bytemuck::cast_slice_mut(rest);
        let pool = ((self.parts.contours - self.parts.info) / 4) as usize;
        let mut contour = 0u32;
        for placed in &self.placed {
            let node = &tree.nodes[placed.node];
            let (child_ptr, far) = match placed.children {
                Children::None => (0, false),
                Children::Near(target) => (target - placed.slot, false),
                Children::Far(pointer, target) => {
                    array[pointer as usize] = u64::from(target - placed.slot);
                    (pointer - placed.slot, true)
                }
                Children::Block(pointer, block) => {
                    array[pointer as usize] = far(pointer, placed.slot, block);
                    (pointer - placed.slot, true)
                }
            };
            let contour_ptr =
                if node.contours != 0 { info_slot * 2 + pool as u32 + contour - placed.slot * 2 } else { 0 };
            let count = node.contours.count_ones();
            let values = &tree.contours[node.first_contour as usize..][..count as usize];
            rest_words[pool + contour as usize..][..values.len()].copy_from_slice(bytemuck::cast_slice(values));
            contour += count;
            array[placed.slot as usize] =
                ChildDescriptor::new(node.valid, node.leaf, child_ptr, far, node.contours, contour_ptr).0;
        }
        self.encode_info(index, rest_words);
        self.encode_attributes(tree, rest_words);
    }
}
