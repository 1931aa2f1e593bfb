//! From a tree to the image: blocks, pages, pairs, far pointers (paper section 3.1; spec sections 4 to 8).

use std::collections::{HashMap, VecDeque};

use glam::DMat4;
use rayon::prelude::*;

use crate::descriptor::MAX_NEAR_POINTER;
use crate::file::{BlockEntry, FIRST_SLOT, NO_PARENT, ObjectEntry, PAGE_BYTES};
use crate::layout::Layout;
use crate::{FormatError, Octree, Tree};

/// How a tree is cut into blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AssembleOptions {
    /// Largest descriptor array of a block in slots, 64 to 2^20. Small values force many blocks.
    pub block_slots: u32,
    /// Largest distance in slots that may use the 15-bit child pointer, 1 to 32767. Small values force far pointers.
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
        if !(64..=1 << 20).contains(&self.block_slots) || !(1..=MAX_NEAR_POINTER).contains(&self.near_limit) {
            return Err(FormatError::Limit(format!("block_slots 64..=1048576 and near_limit 1..=32767, not {self:?}")));
        }
        Ok(())
    }
}

/// Lays the tree out as the only object of an octree.
///
/// # Errors
/// A tree that is empty, not well-formed or deeper than 23 levels, a transform that cannot be inverted, options out of
/// range, more than 2^32 slots.
pub fn assemble(tree: &Tree, octree_to_mesh: DMat4, options: &AssembleOptions) -> Result<Octree, FormatError> {
    options.check()?;
    tree.check()?;
    if !tree.outside.is_empty() {
        return Err(FormatError::Limit(
            "parts of the tree are in blocks of their own: pack the rest as one too".into(),
        ));
    }
    let levels = tree.levels();
    if levels > 23 {
        return Err(FormatError::Limit(format!("{levels} levels: an octree has at most 23")));
    }
    let sizes = subtree_slots(tree);
    let plan = Plan::new(tree, &sizes, options);
    let layouts: Vec<Layout> = (0..plan.blocks.len())
        .into_par_iter()
        .map(|block| Layout::new(tree, &sizes, &plan, block, options.near_limit))
        .collect::<Result<_, _>>()?;

    let mut blocks = Vec::with_capacity(layouts.len());
    let mut image_offset = 0u64;
    for (planned, layout) in plan.blocks.iter().zip(&layouts) {
        let image_size = layout.parts.total_bytes.next_multiple_of(PAGE_BYTES);
        blocks.push(BlockEntry::in_memory(
            planned.parent,
            (planned.cube_position, planned.cube_scale),
            image_offset,
            image_size,
        ));
        image_offset += image_size;
    }
    if image_offset / 8 > u64::from(u32::MAX) {
        return Err(FormatError::Limit(format!("{image_offset} bytes: an image has at most 2^32 slots of 8 bytes")));
    }
    let mut image = vec![0u64; (image_offset / 8) as usize];
    let mut rest = &mut image[..];
    let mut slices = Vec::with_capacity(blocks.len());
    for block in &blocks {
        let (head, tail) = rest.split_at_mut((block.image_size / 8) as usize);
        slices.push(head);
        rest = tail;
    }
    slices.into_par_iter().zip(&layouts).enumerate().for_each(|(index, (slice, layout))| {
        let start = |block: u32| blocks[block as usize].image_offset / 8;
        layout.encode(tree, index as u32, slice, |_, slot, block| {
            (start(block) + u64::from(FIRST_SLOT)) - (start(index as u32) + u64::from(slot))
        });
    });
    let object = ObjectEntry {
        octree_to_mesh: octree_to_mesh.to_cols_array(),
        root_block: 0,
        levels,
        root_slot: u64::from(FIRST_SLOT),
        descriptors: tree.nodes.len() as u64,
        leaf_voxels: tree.nodes.iter().map(|node| u64::from(node.leaf.count_ones())).sum(),
        contours: tree.contours.len() as u64,
        far_pointers: layouts.iter().map(|layout| layout.far_pointers).sum(),
        reserved: [0; 4],
    };
    Octree::from_parts(vec![object], blocks, image)
}

/// For every node, the slots that the groups below it take, page headers and far pointers not counted.
pub(crate) fn subtree_slots(tree: &Tree) -> Vec<u32> {
    let mut sizes = vec![0u32; tree.nodes.len()];
    for index in (0..tree.nodes.len()).rev() {
        let children = if tree.nodes[index].detached { 0 } else { tree.nodes[index].nonleaf().count_ones() };
        let group = children.next_multiple_of(2);
        // Saturated sizes are far beyond what the image can hold; that is refused once its length is known.
        sizes[index] = tree.children(index).fold(group, |sum, (_, child)| sum.saturating_add(sizes[child]));
    }
    sizes
}

/// An upper bound for the same with everything counted: up to 18 slots of every 1024 go to a page header and to a
/// group that did not fit. A far pointer takes siblings with more than about `near_limit` slots below them; such a
/// group and its ancestors hold at most 22 times 8 far pointers.
pub(crate) fn upper_bound(size: u32, near_limit: u32) -> u32 {
    let far = u64::from(size).min(u64::from(size) * 256 / u64::from(near_limit));
    let size = u64::from(size) + far;
    (size + size / 32 + 64).min(u64::from(u32::MAX)) as u32
}

pub(crate) struct PlannedBlock {
    /// The node whose descendants the block holds; `None`: the root itself and its descendants.
    pub(crate) above: Option<usize>,
    pub(crate) parent: u32,
    pub(crate) cube_position: [u32; 3],
    pub(crate) cube_scale: u32,
}

/// Which nodes have their children in another block, and in which.
pub(crate) struct Plan {
    pub(crate) blocks: Vec<PlannedBlock>,
    pub(crate) cuts: HashMap<usize, u32>,
}

/// A cube: lower corner in units of 2^-23 of the root, and scale.
type Cube = ([u32; 3], u32);

fn child_cube((position, scale): Cube, slot: u8) -> Cube {
    let size = 1 << (scale - 1);
    (std::array::from_fn(|axis| position[axis] + if slot >> axis & 1 != 0 { size } else { 0 }), scale - 1)
}

impl Plan {
    fn new(tree: &Tree, sizes: &[u32], options: &AssembleOptions) -> Self {
        let root: Cube = ([0; 3], 23);
        let first = PlannedBlock { above: None, parent: NO_PARENT, cube_position: root.0, cube_scale: root.1 };
        let mut plan = Self { blocks: vec![first], cuts: HashMap::new() };
        let bound = |index: usize| upper_bound(sizes[index], options.near_limit);
        if bound(0) <= options.block_slots {
            return plan;
        }
        // Breadth first over blocks, so that coarse blocks come first; depth first over the nodes of one block.
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
                        used += bound; // Too small to deserve a block of its own.
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
