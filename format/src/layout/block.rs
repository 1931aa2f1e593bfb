//! The bytes of one block (spec sections 4.2 and 5).

use crate::file::{ATTACHMENT_BYTES, FIRST_SLOT, INFO_BYTES, InfoSection, PAGE_SLOTS, to_bytes};
use crate::layout::attachments::{Attached, Content, Described, place};
use crate::layout::place::{Children, Placed, Placer};
use crate::layout::plan::Plan;
use crate::{ChildDescriptor, FormatError, MAX_CONTOUR_POINTER, Tree};

/// Byte offsets of the parts of a block from its start.
pub(crate) struct Parts {
    pub(crate) info: u64,
    pub(crate) contours: u64,
    pub(crate) total_bytes: u64,
}

/// The layout of one block: every descriptor with its slot, and the places of the other parts.
pub(crate) struct Layout {
    pub(crate) placed: Vec<Placed>,
    pub(crate) array_slots: u32,
    pub(crate) contour_count: u32,
    pub(crate) far_pointers: u64,
    pub(crate) attachments: Vec<Attached>,
    pub(crate) parts: Parts,
}

impl Layout {
    pub(crate) fn new(
        tree: &Tree,
        sizes: &[u32],
        plan: &Plan,
        block: usize,
        near_limit: u32,
    ) -> Result<Self, FormatError> {
        let mut placer = Placer::new(tree, sizes, plan, near_limit);
        placer.place(plan.blocks[block].above)?;
        let Placer { placed, cursor: array_slots, far_pointers, .. } = placer;
        let contour_count = placed.iter().map(|p| tree.nodes[p.node].contours.count_ones()).sum();
        let contents = Content::of_block(tree, &placed, array_slots)?;
        let info = u64::from(array_slots) * 8;
        let contours = info + INFO_BYTES + ATTACHMENT_BYTES * contents.len() as u64;
        let (attachments, total_bytes) = place(contents, contours + u64::from(contour_count) * 4);
        let parts = Parts { info, contours, total_bytes };
        check_contour_pointers(tree, &placed, contours / 4, contour_count)?;
        Ok(Self { placed, array_slots, contour_count, far_pointers, attachments, parts })
    }

    /// Writes the block to its part of the image, which must be zero. `far(pointer, descriptor, block)` returns the
    /// distance from the descriptor at slot `descriptor` to the first descriptor of another block, which is stored in
    /// the far pointer at slot `pointer`.
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
        let described = Described { placed: &self.placed, array_slots: self.array_slots };
        described.encode(tree, &self.attachments, self.parts.info, rest_words);
    }

    fn encode_info(&self, index: u32, words: &mut [u32]) {
        let mut bytes = to_bytes(&InfoSection {
            block: index,
            array_slots: self.array_slots,
            first_descriptor: self.array_slots - FIRST_SLOT,
            contour_offset: ((self.parts.contours - self.parts.info) / 4) as u32,
            contour_count: self.contour_count,
            attachment_count: self.attachments.len() as u32,
            reserved: 0,
        });
        for attached in &self.attachments {
            bytes.extend(to_bytes(&attached.entry(self.parts.info)));
        }
        bytemuck::cast_slice_mut::<u32, u8>(words)[..bytes.len()].copy_from_slice(&bytes);
    }
}

/// Checks that every descriptor reaches its contours. `pool` is the first word of the contour pool in the block.
fn check_contour_pointers(tree: &Tree, placed: &[Placed], pool: u64, contours: u32) -> Result<(), FormatError> {
    let limit = u64::from(MAX_CONTOUR_POINTER);
    if pool + u64::from(contours) <= limit {
        return Ok(()); // No distance in the block is larger.
    }
    let mut contour = pool;
    for placed in placed {
        let count = tree.nodes[placed.node].contours.count_ones();
        let distance = contour - u64::from(placed.slot) * 2;
        if count > 0 && distance > limit {
            return Err(FormatError::Limit(format!(
                "the contours of slot {} of the block are {distance} words away, expected at most {limit}: split it",
                placed.slot
            )));
        }
        contour += u64::from(count);
    }
    Ok(())
}
