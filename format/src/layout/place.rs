//! The slots of the descriptors and far pointers of one block (spec section 5).

use crate::descriptor::MAX_NEAR_POINTER;
use crate::file::{FIRST_SLOT, PAGE_SLOTS};
use crate::layout::plan::{Plan, upper_bound};
use crate::{FormatError, Tree};

/// The place of a descriptor's children.
#[derive(Clone, Copy)]
pub(crate) enum Children {
    None,
    /// First child at this slot of the block.
    Near(u32),
    /// Far pointer at the first slot, first child at the second.
    Far(u32, u32),
    /// Far pointer at this slot, children in this other block.
    Block(u32, u32),
}

/// A node and its slot.
pub(crate) struct Placed {
    pub(crate) node: usize,
    pub(crate) slot: u32,
    pub(crate) children: Children,
}

/// Walks the nodes of one block and assigns slots to them.
pub(crate) struct Placer<'a> {
    tree: &'a Tree,
    sizes: &'a [u32],
    plan: &'a Plan,
    near_limit: u32,
    pub(crate) cursor: u32,
    pub(crate) placed: Vec<Placed>,
    pub(crate) far_pointers: u64,
}

impl<'a> Placer<'a> {
    pub(crate) fn new(tree: &'a Tree, sizes: &'a [u32], plan: &'a Plan, near_limit: u32) -> Self {
        Self { tree, sizes, plan, near_limit, cursor: FIRST_SLOT, placed: Vec::new(), far_pointers: 0 }
    }

    /// The block with the children of this node, if it is another one.
    fn block_of(&self, node: usize) -> Option<u32> {
        if self.plan.cuts.is_empty() { None } else { self.plan.cuts.get(&node).copied() }
    }

    /// Places the children of `above` (or only the root), then the descendants of each of them. Returns the first slot.
    pub(crate) fn place(&mut self, above: Option<usize>) -> Result<u32, FormatError> {
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
        // A descriptor needs a far pointer if the descendants of the siblings before it may push its children too far
        // away.
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
                return Err(FormatError::Limit(format!(
                    "node {node} at slot {first} is too far from its children for a child pointer"
                )));
            }
            self.placed[start + i].children = children;
        }
        Ok(first)
    }
}
