//! The valid vectors: every feature alone, then together.

use esvo_format::{AssembleOptions, assemble};
use glam::{DMat4, DVec3};

use super::common::samples::samples;
use super::common::{Colors, Rng, Shape, bytes_of};
use super::writer::{Block, Codec, Extra, IDENTITY, Order, Plan};

/// A vector: name, what it is for, the bytes of the file, the image.
pub(crate) struct Vector {
    pub(crate) name: String,
    pub(crate) about: &'static str,
    pub(crate) bytes: Vec<u8>,
    pub(crate) image: Vec<u8>,
    /// Whether the library writes the same bytes: for what is laid out as it does that.
    pub(crate) canonical: bool,
}

/// All of them.
pub(crate) fn vectors() -> Vec<Vector> {
    let mut list = Vec::new();
    let mut add = |name: &str, about: &'static str, plan: Plan| {
        let (bytes, image) = plan.write();
        let canonical = plan.order == Order::Usual
            && plan.minor == 0
            && plan.optional_features == 0
            && plan.flags == 1
            && plan.blocks.iter().all(|b| b.codec == Codec::Raw)
            && plan.extra.iter().all(|e| e.tag != *b"META" || e.flags == 0);
        list.push(Vector { name: name.into(), about, bytes, image, canonical });
    };
    topology(&mut add);
    pages(&mut add);
    blocks(&mut add);
    contours(&mut add);
    attributes(&mut add);
    values(&mut add);
    objects(&mut add);
    container(&mut add);
    compressed(&mut add);
    // What the library writes.
    for (name, octree) in samples() {
        let name = format!("written_{name}");
        list.push(written(name, "written by the library: an octree of three levels", &octree));
    }
    for seed in 0..6 {
        list.push(random(seed));
    }
    list
}

type Add<'a> = dyn FnMut(&str, &'static str, Plan) + 'a;

fn written(name: String, about: &'static str, octree: &esvo_format::Octree) -> Vector {
    let image: &[u8] = bytemuck::cast_slice(octree.slots());
    Vector { name, about, bytes: bytes_of(octree), image: image.to_vec(), canonical: true }
}

fn random(seed: u64) -> Vector {
    let shape = Shape {
        seed: 100 + seed,
        levels: [3, 5, 9, 14, 20, 23][seed as usize],
        valid: [128, 64, 24, 12, 8, 4][seed as usize],
        leaf: 100,
        contour: [0, 255, 128, 60, 200, 128][seed as usize],
        colors: [Colors::Many, Colors::None, Colors::Many, Colors::One, Colors::Many, Colors::Many][seed as usize],
        normals: seed % 3 != 1,
        nodes: 40,
    };
    let near_limit = if seed.is_multiple_of(2) { 32767 } else { 8 };
    let transform = DMat4::from_translation(DVec3::splat(seed as f64)) * DMat4::from_scale(DVec3::splat(0.5));
    let octree = assemble(&shape.tree(), transform, &AssembleOptions { near_limit, ..AssembleOptions::default() });
    written(format!("random_{seed}"), "written by the library: noise", &octree.expect("a small tree"))
}

fn one(levels: u32, block: Block) -> Plan {
    Plan::new(levels, vec![block])
}

/// The root with one leaf voxel, in an array of so many slots.
fn smallest(slots: usize) -> Block {
    let mut block = Block::new(slots);
    block.leaves(2, 1 << 5);
    block
}

/// Children `first..` of the descriptor at `slot`, one for each of its voxels with a descriptor, all leaves.
fn leaf_children(block: &mut Block, masks: &[u8], slot: usize, first: usize) {
    block.near(slot, first);
    for (k, mask) in masks.iter().enumerate() {
        block.leaves(first + k, *mask);
    }
}

/// Three levels: the root's voxels 1 (two non-leaf children) and 6 (none), 3 a leaf.
fn branching(slots: usize) -> Block {
    let mut block = Block::new(slots);
    block.node(2, 0b0100_1010, 0b0000_1000).near(2, 4);
    block.node(4, 0b1001_0001, 0b0001_0000).near(4, 6);
    block.leaves(5, 0b1111_0000);
    block.leaves(6, 0b0000_0001).leaves(7, 0b1000_0100);
    block
}

fn topology(add: &mut Add<'_>) {
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
    add("gaps", "unused slots before, between and behind groups", one(3, gaps));
    add(
        "far_pointer",
        "a far pointer right behind its group",
        one(2, {
            let mut block = Block::new(8);
            block.node(2, 1, 0).far(2, 3, 4).leaves(4, 0xaa);
            block
        }),
    );
    add(
        "far_pointers_apart",
        "far pointers in front of and behind what they lead to, away from their groups",
        one(3, {
            let mut block = Block::new(24);
            block.node(2, 0x11, 0).far(2, 9, 4);
            block.node(4, 0x80, 0).far(4, 21, 12).node(5, 0x02, 0).far(5, 7, 14);
            block.leaves(12, 0xf0).leaves(14, 0x0f);
            block
        }),
    );
    add("levels_23", "a voxel at the deepest level, by child pointers", one(23, chain(0..23, false)));
    add("levels_23_far", "the same, every step a far pointer", one(23, chain(0..23, true)));
}

/// One non-leaf voxel in each level of `levels` but the last, a leaf beside it where the level is even.
fn chain(levels: std::ops::Range<usize>, far: bool) -> Block {
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

fn chain_slot(level: usize) -> usize {
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

fn pages(add: &mut Add<'_>) {
    const NAMES: [&str; 8] = ["1", "2", "3", "4", "5", "6", "7", "8"];
    for n in 1..=8usize {
        // A group of n as late as a page takes it, the next one as early as the next page does.
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
            "a group at the end of a page, its child behind the next page header",
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
    add("page_start_far_pointer", "a far pointer right behind a page header", one(3, block));
    let mut block = Block::new(2050);
    block.node(2, 1, 0).near(2, 2048 - 2).leaves(2046, 1);
    add("page_three", "an array that reaches into a third page by its header and one slot", one(2, block));
    add("array_ends_with_page", "the info section starts a page", one(1, smallest(1024)));
    add("array_ends_behind_page_header", "the last slot of the array is a page header", one(1, smallest(1025)));
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

/// The pairs of these slots and of a group.
fn used_pairs(slots: &[usize], start: usize, n: usize) -> Vec<usize> {
    slots.iter().copied().chain(start..start + n).map(|slot| slot / 2).collect()
}

/// Attribute blocks of `unit` bytes: noise for these pairs, zero for the others.
fn noise(size: usize, pairs: &[usize], unit: usize, seed: u64) -> Vec<u8> {
    let mut bytes = vec![0; size];
    for pair in pairs {
        let mut rng = Rng(seed * 1000 + *pair as u64);
        bytes[pair * unit..(pair + 1) * unit].fill_with(|| rng.bits() as u8);
    }
    bytes
}

/// Attribute blocks for every pair of a block that has a descriptor, given one slot of each.
fn with_noise(block: &mut Block, kind: u32, slots: &[usize]) {
    let unit = if kind == 2 { 16 } else { 8 };
    let pairs: Vec<usize> = slots.iter().map(|slot| slot / 2).collect();
    let size = block.slots().div_ceil(2) * unit;
    block.attachment(kind, noise(size, &pairs, unit, u64::from(kind)));
}

fn blocks(add: &mut Add<'_>) {
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
    let about = "a voxel at the deepest level in a block below a block below the root's";
    add("levels_23_blocks", about, Plan::new(23, vec![top, middle, bottom]));
}

fn contours(add: &mut Add<'_>) {
    let mut block = smallest(4);
    block.contour(2, 1 << 5, &[0x0de1_ec10]);
    add("contour", "one contour", one(1, block));
    let mut block = Block::new(4);
    block.leaves(2, 0xff).contour(
        2,
        0xff,
        &[1, 0xffff_ffff, 0x0002_0820, 0xfffd_f7df, 0x0100_0001, 0xfe00_0020, 0x00fc_0800, 0x0001_f000],
    );
    add(
        "contours_extreme",
        "largest and smallest thickness, position and normal, and fields that are fractions only",
        one(1, block),
    );
    let mut block = branching(8);
    block.contour(2, 0b0100_0010, &[0x0de1_ec10, 0x1be9_f008]).contour(4, 0b0001_0000, &[0x2c29_f3d0]);
    block.contour(5, 0b1010_0000, &[0x3c15_ec04, 0x4e21_effc]).contour(7, 0b1000_0100, &[0x5e01_edf8, 0x6c09_f20c]);
    let several = block.clone();
    add("contours", "contours of leaves and of voxels with descriptors; others have none", one(3, block));
    let mut block = several.clone();
    (block.pool_gap, block.pool_reversed) = (11, true);
    add(
        "contour_pool_apart",
        "a gap before the contour pool, the values not in the order of the descriptors",
        one(3, block),
    );
    let mut block = smallest(4);
    block.pool_gap = 7;
    add("contour_pool_empty", "an empty contour pool that is not right behind the attachment directory", one(1, block));
}

fn attributes(add: &mut Add<'_>) {
    let all = [2, 4, 6];
    let with = |kinds: &[u32]| {
        let mut block = branching(8);
        for kind in kinds {
            with_noise(&mut block, *kind, &all);
        }
        block
    };
    add("colors", "colour blocks", one(3, with(&[1])));
    add("normals", "normal blocks", one(3, with(&[2])));
    add("colors_and_normals", "colour blocks and normal blocks", one(3, with(&[1, 2])));
    add("normals_and_colors", "the same in the other order", one(3, with(&[2, 1])));
    let mut block = with(&[]);
    block.attachment(3, vec![200, 100, 50, 0, 0, 0, 0, 0]);
    add("constant_color", "one colour for every voxel of the block", one(3, block));
    let mut block = with(&[2]);
    block.attachment(3, vec![255, 0, 1, 0, 0, 0, 0, 0]);
    add("constant_color_and_normals", "a constant colour and normal blocks", one(3, block));
    let mut block = Block::new(8);
    block.node(2, 0xff, 0xf0);
    leaf_children(&mut block, &[0xff; 4], 2, 4);
    // References: black and white, equal, the first the smaller, the first the greater.
    let words = [0u32, 0, 0xffff_0000, 0xe4e4_1b1b, 0x0821_0821, 0xe4e4_e4e4, 0x1234_fedc, 0x1b1b_1b1b];
    block.attachment(1, words.iter().flat_map(|w| w.to_le_bytes()).collect());
    add(
        "colors_extreme",
        "every index, references of either order, equal, and at the ends of the range",
        one(2, block.clone()),
    );
    block.attachments.clear();
    let words: [u32; 16] = [
        0,
        0,
        0,
        0,
        0x8000_0000,
        0xe4e4_e4e4,
        0x7fff_8001,
        0x1b1b_1b1b,
        0x2fff_dfff,
        0x0f0f_5a5a,
        0x123f_edcf,
        0xffff_0000,
        0xf000_2001,
        0x1234_5678,
        0x8888_7770,
        0x9abc_def0,
    ];
    block.attachment(2, words.iter().flat_map(|w| w.to_le_bytes()).collect());
    add("normals_extreme", "every main axis with the unused one, both signs, exponents 0 and 15", one(2, block));
    let mut block = smallest(4);
    block.attachment(0x8000, b"a vendor".to_vec());
    add("vendor_attachment", "an attachment of the vendor range", one(1, block));
    let mut block = with(&[2]);
    block.attachment_gap = 16;
    block.attachment(0xffff, vec![1, 2, 3]).attachment(0x9000, Vec::new());
    with_noise(&mut block, 1, &all);
    block.contour(5, 0b1010_0000, &[0x3c15_ec04, 0x4e21_effc]);
    block.pool_gap = 3;
    add(
        "vendor_attachments_between",
        "vendor attachments of 3 and of no bytes between others, gaps before each, contours",
        one(3, block),
    );
    let mut block = smallest(4);
    for k in 0..64u32 {
        block.attachment(0x8000 + 511 * k, vec![k as u8; k as usize]);
    }
    add("attachments_64", "as many attachments as a block can have", one(1, block));
    let slots: Vec<usize> = (1..=23).map(|k| 2 * k).collect();
    let mut block = chain(0..23, true);
    for level in [0, 7, 21, 22] {
        let slot = 2 + 2 * level;
        block.contour(slot, 1 << chain_slot(level), &[0x1be9_f008 + level as u32]);
    }
    with_noise(&mut block, 1, &slots);
    with_noise(&mut block, 2, &slots);
    add("levels_23_everything", "23 levels, far pointers, contours, colours and normals", one(23, block));
}

/// Plain values: for each slot with a descriptor, the mask and as many values as it takes; the entries of `order` are
/// the places of their values.
fn plain(block: &Block, entries: &[(usize, u8, &[u32])], order: &[usize]) -> Vec<u8> {
    let mut words = vec![0u32; block.slots()];
    for &k in order {
        let (slot, mask, values) = entries[k];
        words[slot] = (words.len() as u32) << 8 | u32::from(mask);
        words.extend(values);
    }
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// The same with all values of the three-level octree on their own, noise.
fn plain_noise(block: &Block, seed: u64) -> Vec<u8> {
    let mut rng = Rng(seed);
    let masks = [(2, 0b0100_1010u8), (4, 0b1001_0001), (5, 0b1111_0000), (6, 1), (7, 0b1000_0100)];
    let values: Vec<Vec<u32>> =
        masks.iter().map(|(_, mask)| (0..mask.count_ones()).map(|_| rng.bits() as u32).collect()).collect();
    let entries: Vec<(usize, u8, &[u32])> =
        masks.iter().zip(&values).map(|((slot, mask), values)| (*slot, *mask, &values[..])).collect();
    plain(block, &entries, &[0, 1, 2, 3, 4])
}

/// Corners: for each slot with a descriptor, the mask, and noise as values.
fn corners(block: &Block, entries: &[(usize, u32)], seed: u64) -> Vec<u8> {
    let mut rng = Rng(seed);
    let mut words = vec![0u32; 2 * block.slots()];
    for &(slot, mask) in entries {
        let count = (mask & 0x7ff_ffff).count_ones() + if mask >> 27 != 0 { 8 } else { 0 };
        if count > 0 {
            (words[2 * slot], words[2 * slot + 1]) = (mask, words.len() as u32);
        }
        for _ in 0..count {
            // Every fourth corner has no value.
            let color = rng.bits() as u32;
            words.extend([if rng.chance(64) { color & 0xff_ffff } else { color | 0xff00_0000 }, rng.bits() as u32]);
        }
    }
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

fn values(add: &mut Add<'_>) {
    let all = [2, 4, 6];
    let mut block = branching(8);
    with_noise(&mut block, 4, &all);
    add("ambient", "ambient occlusion blocks", one(3, block));
    let mut block = Block::new(8);
    block.node(2, 0xff, 0xf0);
    leaf_children(&mut block, &[0xff; 4], 2, 4);
    let longs = [0u64, 0x1af_58d1_af58_ffff, 0xffff_ffff_ffff_00ff, 0x5397_7053_9770_ff00];
    block.attachment(4, longs.iter().flat_map(|word| word.to_le_bytes()).collect());
    add("ambient_extreme", "every weight; references at the ends of the range, in either order", one(2, block));
    let mut block = branching(8);
    let bytes = plain_noise(&block, 5);
    block.attachment(5, bytes);
    add("plain_colors", "plain colours, one for each voxel", one(3, block));
    let mut block = branching(8);
    let bytes = plain_noise(&block, 6);
    block.attachment(6, bytes);
    add("plain_normals", "plain normals, one for each voxel", one(3, block));
    let mut block = branching(8);
    let entries: [(usize, u8, &[u32]); 5] = [
        (2, 0b0100_0000, &[0xff11_2233, 0x0044_5566]),
        (4, 0, &[0x8000_0000]),
        (5, 0b1111_0000, &[1, 2, 3, 4]),
        (6, 0, &[0xffff_ffff]),
        (7, 0b0000_0100, &[5, 6]),
    ];
    let bytes = plain(&block, &entries, &[3, 0, 4, 1, 2]);
    block.attachment(5, bytes);
    let bytes = plain(&block, &entries, &[4, 3, 2, 1, 0]);
    block.attachment(6, bytes);
    add("plain_shared", "values that voxels share, and values not in the order of the descriptors", one(3, block));
    let mut block = branching(8);
    let bytes = plain_noise(&block, 7);
    block.attachment(6, bytes).attachment(3, vec![9, 8, 7, 0, 0, 0, 0, 0]);
    with_noise(&mut block, 4, &all);
    add("plain_normals_constant_color", "plain normals beside a constant colour and ambient occlusion", one(3, block));
    let mut block = branching(8);
    with_noise(&mut block, 2, &all);
    let bytes = plain_noise(&block, 8);
    block.attachment(5, bytes);
    add("plain_colors_normal_blocks", "plain colours beside normal blocks", one(3, block));
    let mut block = smallest(5);
    let bytes = plain(&block, &[(2, 1 << 5, &[0x1234_5678])], &[0]);
    block.attachment(5, bytes.clone()).attachment(6, bytes).attachment(4, noise(24, &[1], 8, 5));
    add("plain_array_odd", "plain values and ambient occlusion in an array of an odd number of slots", one(1, block));
    let whole = (1u32 << 27) - 1;
    let mut block = branching(8);
    let bytes = corners(&block, &[(2, whole), (4, whole), (5, whole), (6, whole), (7, whole)], 1);
    block.attachment(7, bytes);
    add("corners", "colours and normals at all corners", one(3, block));
    let mut block = branching(8);
    // Of slot 4 the corners of child 0 only; of slot 5 none; of slots 6 and 7 those of the voxel.
    let masks = [(2, whole), (4, 0x361b), (5, 0), (6, 1 << 27), (7, 1 << 27 | 0x07ff_e000)];
    let bytes = corners(&block, &masks, 2);
    block.attachment(7, bytes);
    with_noise(&mut block, 4, &all);
    add("corners_some", "corners of some voxels, of the voxel above, and none", one(3, block));
    let mut block = smallest(4);
    let bytes = [0, 0, 0, 0, whole, 8, 0, 0].into_iter().chain([0x00ff_ffff, 0x1234_5678].repeat(27));
    block.attachment(7, bytes.flat_map(u32::to_le_bytes).collect());
    add("corners_without_values", "corners that all count for nothing", one(1, block));
}

fn objects(add: &mut Add<'_>) {
    // Rotated, mirrored and scaled; moved far away.
    let turned = [0., 2., 0., 0., -3., 0., 0., 0., 0., 0., -0.5, 0., 10., 20., 30., 1.];
    let mut moved = IDENTITY;
    (moved[0], moved[5], moved[10], moved[12]) = (1e-3, 1e-3, 1e-3, -1e6);
    let mut second = branching(8);
    second.object = 1;
    second.contour(4, 0b0001_0000, &[0x2c29_f3d0]);
    let mut plan = Plan::new(1, vec![smallest(4), second]);
    plan.objects = vec![(1, turned), (3, moved)];
    add("two_objects", "two objects with transforms of their own, only one with a contour", plan);
    let mut first = branching(8);
    first.object = 1;
    let mut root = Block::new(4);
    root.node(2, 0x10, 0).link(2, 3, 2);
    let mut below = Block::below(4, 1, ([0; 3], 23));
    below.leaves(2, 0x3c).contour(2, 0x20, &[0x0de1_ec10]);
    let mut plan = Plan::new(2, vec![first, root, below]);
    plan.objects = vec![(2, IDENTITY), (3, turned)];
    add("two_objects_three_blocks", "the second object's block comes first, the first object has two", plan);
}

fn extra(tag: &[u8; 4], flags: u32, bytes: &[u8]) -> Extra {
    Extra { tag: *tag, flags, bytes: bytes.to_vec() }
}

fn container(add: &mut Add<'_>) {
    let with = |extras: Vec<Extra>| Plan { extra: extras, ..one(1, smallest(4)) };
    add("unknown_section", "a section that no version knows", with(vec![extra(b"note", 0, b"to be passed over")]));
    add(
        "unknown_sections",
        "several: one of no bytes, one with checksums of its own, one with a tag that is no text",
        with(vec![extra(b"none", 0, b""), extra(b"crcs", 2, &[0xff; 33]), extra(&[0x00, 0x80, 0xff, 0x0a], 0, &[1])]),
    );
    add("meta", "metadata", with(vec![extra(b"META", 0, br#"{"title":"A voxel","license":"CC0-1.0"}"#)]));
    let text = "{\"title\":\"\\u0041 Würfel – 立方体\",\"own\":{\"deep\":[1,2.5,null,true]}}";
    add(
        "meta_unicode",
        "metadata beyond ASCII, with members that the specification does not name",
        with(vec![extra(b"META", 0, text.as_bytes()), extra(b"note", 0, b"and an unknown section")]),
    );
    add("minor_version", "a later minor version", Plan { minor: 7, ..one(1, smallest(4)) });
    add(
        "optional_features",
        "optional feature bits that nobody knows",
        Plan { optional_features: 1 << 40 | 5, ..one(1, smallest(4)) },
    );
    add("not_required", "the sections are not flagged as required", Plan { flags: 0, ..one(1, smallest(4)) });
    let mut plan = one(3, branching(8));
    plan.order = Order::DataFirst;
    plan.extra = vec![extra(b"META", 0, b"{}"), extra(b"note", 0, b"odd")];
    add("sections_reversed", "block data first, tables behind it, the directory last", plan);
}

fn compressed(add: &mut Add<'_>) {
    let zstd = |mut block: Block| {
        block.codec = Codec::Zstd;
        block
    };
    let mut block = branching(8);
    with_noise(&mut block, 1, &[2, 4, 6]);
    block.contour(5, 0b1010_0000, &[0x3c15_ec04, 0x4e21_effc]);
    add("compressed", "a block as a Zstandard frame", one(3, zstd(block)));
    let pair = |first: Codec, second: Codec| {
        let mut root = Block::new(4);
        root.node(2, 0x10, 0).link(2, 3, 1);
        let mut below = Block::below(8, 0, ([0; 3], 23));
        below.node(2, 0x03, 0x01).near(2, 4).leaves(4, 0xff);
        (root.codec, below.codec) = (first, second);
        Plan::new(3, vec![root, below])
    };
    add("compressed_mixed", "a compressed block below one that is stored as it is", pair(Codec::Raw, Codec::Zstd));
    let mut plan = pair(Codec::Zstd, Codec::Zstd);
    plan.stored_reversed = true;
    add("compressed_reversed", "compressed blocks stored in another order than that of the table", plan);
    let mut block = Block::new(32772);
    block.node(2, 1, 0).near(2, 4).node(4, 0xc0, 0x80).near(4, 4 + 32766);
    block.leaves(32770, 3);
    add("compressed_child_pointer", "the longest child pointer but one, over 32 page headers", one(3, zstd(block)));
    let mut block = Block::new(32774);
    block.node(2, 3, 0).near(2, 4).node(4, 1, 0).node(5, 1, 0).near(5, 5 + 32767);
    block.far(4, 6, 32770).leaves(32770, 3).leaves(32772, 5);
    add(
        "compressed_far_pointer",
        "the longest child pointer, and a far pointer over nearly as much",
        one(3, zstd(block)),
    );
    let mut block = Block::new(40010);
    block.node(2, 3, 0).near(2, 4).node(4, 1, 0).node(5, 1, 0).far(4, 6, 40000).far(5, 7, 40002);
    block.leaves(40000, 3).leaves(40002, 5).contour(2, 1, &[0x0de1_ec10]).contour(40002, 1, &[0x1be9_f008]);
    add(
        "compressed_beyond_child_pointers",
        "far pointers where child pointers do not reach, contours far away",
        one(3, zstd(block)),
    );
}
