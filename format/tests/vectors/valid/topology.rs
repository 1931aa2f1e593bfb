//! Descriptors, child pointers, pages and blocks.

use super::super::writer::{Block, Plan};
use super::attributes::{noise, used_pairs};
use super::{Add, one};

/// A root with one leaf voxel, in an array of this number of slots.
pub(crate) fn smallest(slots: usize) -> Block {
    let mut block = Block::new(slots);
    block.leaves(2, 1 << 5);
    block
}

/// Children `first..` of the descriptor at `slot`, one for each of its voxels with a descriptor, all leaves.
pub(super) fn leaf_children(block: &mut Block, masks: &[u8], slot: usize, first: usize) {
    block.near(slot, first);
    for (k, mask) in masks.iter().enumerate() {
        block.leaves(first + k, *mask);
    }
}

/// Three levels: the root's voxels 1 (two non-leaf children) and 6 (none), 3 a leaf.
pub(crate) fn branching(slots: usize) -> Block {
    let mut block = Block::new(slots);
    block.node(2, 0b0100_1010, 0b0000_1000).near(2, 4);
    block.node(4, 0b1001_0001, 0b0001_0000).near(4, 6);
    block.leaves(5, 0b1111_0000);
    block.leaves(6, 0b0000_0001).leaves(7, 0b1000_0100);
    block
}

pub(super) fn topology(add: &mut Add<'_>) {
    add("single_voxel", "one leaf voxel in the smallest array", one(1, smallest(4)));
    let mut block = Block::new(4);
    block.leaves(2, 0xff);
    add("eight_leaves", "every child slot of the root is a leaf voxel", one(1, block));
    let mut block = Block::new(12);
    block.node(2, 0xff, 0);
    leaf_children(&mut block, &[0x01, 0x82, 0xc4, 0xe8, 0x1f, 0x3f, 0x7f, 0xff], 2, 4);
    add("eight_nodes", "every child slot of the root has a descriptor", one(2, block));
    let mut block = Block::new(10);
    block.node(2, 0b1010_0110, 0b1000_0010);
    leaf_children(&mut block, &[0x80, 0x01], 2, 4);
    add(
        "mixed_children",
        "empty slots, leaf voxels and voxels with descriptors side by side; unused slots",
        one(2, block),
    );
    add("three_levels", "siblings with and without children", one(3, branching(8)));
    let mut gaps = Block::new(40);
    gaps.node(2, 0b0100_1010, 0b0000_1000).near(2, 12);
    gaps.node(12, 0b1001_0001, 0b0001_0000).near(12, 36).leaves(13, 0b1111_0000);
    gaps.leaves(36, 0b0000_0001).leaves(37, 0b1000_0100);
    add("gaps", "unused slots before, between and after groups", one(3, gaps));
    add(
        "far_pointer",
        "a far pointer directly after its group",
        one(2, {
            let mut block = Block::new(8);
            block.node(2, 1, 0).far(2, 3, 4).leaves(4, 0xaa);
            block
        }),
    );
    add(
        "far_pointers_apart",
        "far pointers before and after what they lead to, away from their groups",
        one(3, {
            let mut block = Block::new(24);
            block.node(2, 0x11, 0).far(2, 9, 4);
            block.node(4, 0x80, 0).far(4, 21, 12).node(5, 0x02, 0).far(5, 7, 14);
            block.leaves(12, 0xf0).leaves(14, 0x0f);
            block
        }),
    );
    add("levels_23", "a voxel at the deepest level, by child pointers", one(23, chain(0..23, false)));
    add("levels_23_far", "a voxel at the deepest level, every step by a far pointer", one(23, chain(0..23, true)));
}

/// One non-leaf voxel in each level of `levels` but the last, a leaf beside it where the level is even.
pub(super) fn chain(levels: std::ops::Range<usize>, far: bool) -> Block {
    let mut block = Block::new(2 + 2 * levels.len());
    for (k, level) in levels.clone().enumerate() {
        let (slot, path, beside) =
            (2 + 2 * k, 1 << chain_slot(level), if level.is_multiple_of(2) { 1 << ((level + 3) % 8) } else { 0 });
        if level == 22 {
            block.leaves(slot, path | beside);
            continue;
        }
        block.node(slot, path | beside, beside);
        match (level + 1 == levels.end, far) {
            (true, _) => {}
            (_, true) => {
                block.far(slot, slot + 1, slot + 2);
            }
            _ => {
                block.near(slot, slot + 2);
            }
        }
    }
    block
}

pub(super) fn chain_slot(level: usize) -> usize {
    (level * 5 + 2) % 8
}

/// The cube of the voxel that the chain goes through at this level.
fn chain_cube(level: usize) -> ([u32; 3], u32) {
    let mut position = [0; 3];
    for l in 0..level {
        for (axis, x) in position.iter_mut().enumerate() {
            *x += ((chain_slot(l) >> axis & 1) as u32) << (22 - l);
        }
    }
    (position, 23 - level as u32)
}

pub(super) fn pages(add: &mut Add<'_>) {
    const NAMES: [&str; 8] = ["1", "2", "3", "4", "5", "6", "7", "8"];
    for n in 1..=8usize {
        // A group of n in the last slots of a page that it fits into; the next group in the first slots of the next page.
        let mut block = Block::new(1030);
        let start = (1024 - n) / 2 * 2;
        block.node(2, 1 << 3, 0).near(2, 4);
        block.node(4, (0xffu32 << (8 - n)) as u8, 0).near(4, start);
        for k in 0..n {
            if k + 1 < n {
                block.leaves(start + k, 1 << k);
            } else {
                block.node(start + k, 0x90, 0x80).near(start + k, 1026).leaves(1026, 0x24);
            }
        }
        if n % 2 == 0 {
            block.attachment(1, noise(515 * 8, &used_pairs(&[2, 4, 1026], start, n), 8, n as u64));
        }
        add(
            &format!("page_end_group_{}", NAMES[n - 1]),
            "siblings at the end of a page, a child of the last one after the next page header",
            one(4, block),
        );
    }
    let mut block = Block::new(1030);
    block.node(2, 1, 0).near(2, 4).node(4, 1, 0).near(4, 1022);
    block.node(1022, 1, 0).far(1022, 1023, 1026).leaves(1026, 1);
    add("page_end_far_pointer", "a far pointer in the last slot of a page", one(4, block));
    let mut block = Block::new(1030);
    block.node(2, 1, 0).near(2, 1020);
    block.node(1020, 1, 0).far(1020, 1025, 1028).leaves(1028, 1);
    add("page_start_far_pointer", "a far pointer directly after a page header", one(3, block));
    let mut block = Block::new(2050);
    block.node(2, 1, 0).near(2, 2048 - 2).leaves(2046, 1);
    add("page_three", "an array that reaches into a third page by its header and one slot", one(2, block));
    add("array_ends_with_page", "the info section starts a page", one(1, smallest(1024)));
    add("array_ends_after_page_header", "the last slot of the array is a page header", one(1, smallest(1025)));
    let mut block = smallest(1022);
    block.contour(2, 1 << 5, &[0x1234_5678]);
    block.attachment(3, vec![9, 8, 7, 0, 0, 0, 0, 0]).attachment(0x8001, b"lies in the second page".to_vec());
    add(
        "info_across_pages",
        "the info section lies across a page boundary, in the descriptor array's page and the next",
        one(1, block),
    );
    let mut block = smallest(5);
    block.attachment(1, noise(24, &[1], 8, 5)).attachment(2, noise(48, &[1], 16, 6));
    add("array_odd", "an array of an odd number of slots: pairs are rounded up", one(1, block));
}

pub(super) fn blocks(add: &mut Add<'_>) {
    let mut root = Block::new(6);
    root.node(2, 0x10, 0).near(2, 4).node(4, 0x03, 0).link(4, 5, 1);
    let mut below = Block::below(8, 0, ([0, 0, 1 << 22], 22));
    below.leaves(2, 0x81).node(3, 0x03, 0x01).near(3, 4).leaves(4, 0xff);
    add("two_blocks", "the children of a voxel are in another block", Plan::new(4, vec![root, below]));
    let mut root = Block::new(8);
    root.node(2, 0x81, 0).near(2, 4).node(4, 0x18, 0x08).link(4, 6, 1).node(5, 0x40, 0).link(5, 7, 2);
    let mut first = Block::below(4, 0, ([0; 3], 22));
    first.leaves(2, 0x42);
    let mut second = Block::below(6, 0, ([1 << 22; 3], 22));
    second.leaves(2, 0x99);
    add("three_blocks", "two blocks below one, from siblings", Plan::new(3, vec![root, first, second]));
    let mut top = chain(0..8, false);
    top.link(16, 17, 1);
    let mut middle = chain(8..16, false);
    (middle.parent, middle.cube) = (0, chain_cube(7));
    middle.link(16, 17, 2);
    let mut bottom = chain(16..23, false);
    (bottom.parent, bottom.cube) = (1, chain_cube(15));
    let about = "a voxel at the deepest level, in the third of three blocks below each other";
    add("levels_23_blocks", about, Plan::new(23, vec![top, middle, bottom]));
}
