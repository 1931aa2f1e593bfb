//! How a tree is cut into blocks (paper section 3.1).

use std::collections::{HashMap, VecDeque};

use crate::descriptor::MAX_NEAR_POINTER;
use crate::file::NO_PARENT;
use crate::{FormatError, Tree};

/// How a tree is cut into blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AssembleOptions {
    /// Largest descriptor array of a block in slots, 64 to 2^20. Small values give many blocks.
    pub block_slots: u32,
    /// Largest distance in slots for which the 15-bit child pointer is used, 1 to 32767. Small values give many far
    /// pointers.
    pub near_limit: u32,
}

impl Default for AssembleOptions {
    /// Blocks of up to 8 MiB of descriptors, the full reach of the child pointer.
    fn default() -> Self {
        Self { block_slots: 1 << 20, near_limit: MAX_NEAR_POINTER }
    }
}

impl AssembleOptions {
    pub(crate) fn check(&self) -> Result<(), FormatError> {
        for (name, value, range) in
            [("block_slots", self.block_slots, 64..=1 << 20), ("near_limit", self.near_limit, 1..=MAX_NEAR_POINTER)]
        {
            if !range.contains(&value) {
                let what = format!("{name} is {value}, expected {} to {}", range.start(), range.end());
                return Err(FormatError::Limit(what));
            }
        }
        Ok(())
    }
}

/// For every node, the slots of its descendants in groups of siblings, without page headers and far pointers.
pub(crate) fn subtree_slots(tree: &Tree) -> Vec<u32> {
    let mut sizes = vec![0u32; tree.nodes.len()];
    for index in (0..tree.nodes.len()).rev() {
        let children = if tree.nodes[index].detached { 0 } else { tree.nodes[index].nonleaf().count_ones() };
        let group = children.next_multiple_of(2);
        // Saturated sizes exceed the largest image, which is refused later.
        sizes[index] = tree.children(index).fold(group, |sum, (_, child)| sum.saturating_add(sizes[child]));
    }
    sizes
}

/// An upper bound of the slots of a subtree, including page headers and far pointers. Of every 1024 slots, up to 18 are
/// lost to a page header and a group that does not fit into the page. A far pointer is only needed by siblings with
/// more than about `near_limit` slots below them; such a group and its ancestors have at most 22 * 8 far pointers.
pub(crate) fn upper_bound(size: u32, near_limit: u32) -> u32 {
    let far = u64::from(size).min(u64::from(size) * 256 / u64::from(near_limit));
    let size = u64::from(size) + far;
    (size + size / 32 + 64).min(u64::from(u32::MAX)) as u32
}

/// A block of a plan.
pub(crate) struct PlannedBlock {
    /// The node whose descendants are in the block. `None`: the root and its descendants.
    pub(crate) above: Option<usize>,
    pub(crate) parent: u32,
    pub(crate) cube_position: [u32; 3],
    pub(crate) cube_scale: u32,
}

/// How a tree is cut into blocks.
pub(crate) struct Plan {
    pub(crate) blocks: Vec<PlannedBlock>,
    /// The nodes whose children are in another block, with that block.
    pub(crate) cuts: HashMap<usize, u32>,
}

/// A cube: lower corner in units of 2^-23 of the root, and scale.
type Cube = ([u32; 3], u32);

fn child_cube((position, scale): Cube, slot: u8) -> Cube {
    let size = 1 << (scale - 1);
    (std::array::from_fn(|axis| position[axis] + if slot >> axis & 1 != 0 { size } else { 0 }), scale - 1)
}

impl Plan {
    pub(crate) fn new(tree: &Tree, sizes: &[u32], options: &AssembleOptions) -> Self {
        let root: Cube = ([0; 3], 23);
        let first = PlannedBlock { above: None, parent: NO_PARENT, cube_position: root.0, cube_scale: root.1 };
        let mut plan = Self { blocks: vec![first], cuts: HashMap::new() };
        let bound = |index: usize| upper_bound(sizes[index], options.near_limit);
        if bound(0) <= options.block_slots {
            return plan;
        }
        // Breadth-first over blocks, so that coarse blocks come first; depth-first over the nodes of a block.
        let mut queue = VecDeque::from([(0usize, 0u32, root)]);
        while let Some((top, block, cube)) = queue.pop_front() {
            let mut used = 64;
            let mut stack = vec![(top, cube)];
            while let Some((index, cube)) = stack.pop() {
                for (slot, child) in tree.children(index) {
                    if sizes[child] == 0 {
                        continue;
                    }
                    let (bound, cube) = (bound(child), child_cube(cube, slot));
                    if bound <= options.block_slots / 8 && used + bound <= options.block_slots {
                        used += bound; // Too small for a block of its own.
                    } else if bound > options.block_slots && used + 32 <= options.block_slots {
                        used += 32;
                        stack.push((child, cube));
                    } else {
                        let new = plan.blocks.len() as u32;
                        plan.cuts.insert(child, new);
                        plan.blocks.push(PlannedBlock {
                            above: Some(child),
                            parent: block,
                            cube_position: cube.0,
                            cube_scale: cube.1,
                        });
                        if bound > options.block_slots {
                            queue.push_back((child, new, cube));
                        }
                    }
                }
            }
        }
        plan
    }
}
