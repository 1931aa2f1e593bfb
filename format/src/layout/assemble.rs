//! From a tree to the image: blocks, pages, pairs, far pointers (paper section 3.1; spec sections 4 to 8).

use glam::DMat4;
use rayon::prelude::*;

use crate::file::{BlockEntry, FIRST_SLOT, ObjectEntry, PAGE_BYTES};
use crate::layout::block::Layout;
use crate::layout::plan::{Plan, subtree_slots};
use crate::{AssembleOptions, FormatError, Octree, Tree};

/// Lays out the tree as the only object of an octree.
///
/// # Errors
/// A tree that is empty, not well-formed or deeper than 23 levels; a transform that is not finite, affine and
/// invertible; options out of range; more than 2^32 slots.
pub fn assemble(tree: &Tree, octree_to_mesh: DMat4, options: &AssembleOptions) -> Result<Octree, FormatError> {
    options.check()?;
    tree.check()?;
    if !tree.outside.is_empty() {
        return Err(FormatError::Limit(
            "the tree has detached subtrees, expected none: use `pack` and a `BlockStore`".into(),
        ));
    }
    let levels = tree.levels();
    if levels > 23 {
        return Err(FormatError::Limit(format!("the tree has {levels} levels, expected at most 23")));
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
        return Err(FormatError::Limit(format!(
            "the image has {image_offset} bytes, expected less than 2^32 slots of 8 bytes"
        )));
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
