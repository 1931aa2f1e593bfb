//! Contours, and attachments of every type.

use super::super::common::Rng;
use super::super::writer::Block;
use super::topology::{branching, chain, chain_slot, leaf_children, smallest};
use super::{Add, one};

pub(super) fn contours(add: &mut Add<'_>) {
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
    add(
        "contour_pool_empty",
        "an empty contour pool that is not directly after the attachment directory",
        one(1, block),
    );
}

/// The pairs of these slots and of a group.
pub(super) fn used_pairs(slots: &[usize], start: usize, n: usize) -> Vec<usize> {
    slots.iter().copied().chain(start..start + n).map(|slot| slot / 2).collect()
}

/// Attribute blocks of `unit` bytes: noise for these pairs, zero for the others.
pub(super) fn noise(size: usize, pairs: &[usize], unit: usize, seed: u64) -> Vec<u8> {
    let mut bytes = vec![0; size];
    for pair in pairs {
        let mut rng = Rng(seed * 1000 + *pair as u64);
        bytes[pair * unit..(pair + 1) * unit].fill_with(|| rng.bits() as u8);
    }
    bytes
}

/// Attribute blocks for every pair of a block that has a descriptor, given one slot of each.
pub(super) fn with_noise(block: &mut Block, kind: u32, slots: &[usize]) {
    let unit = if kind == 2 { 16 } else { 8 };
    let pairs: Vec<usize> = slots.iter().map(|slot| slot / 2).collect();
    let size = block.slots().div_ceil(2) * unit;
    block.attachment(kind, noise(size, &pairs, unit, u64::from(kind)));
}

pub(super) fn attributes(add: &mut Add<'_>) {
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
    add("normals_and_colors", "normal blocks and colour blocks, in this order", one(3, with(&[2, 1])));
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

/// Empty attachments at the edges of others, and directions that cancel out.
pub(super) fn edges(add: &mut Add<'_>) {
    let mut block = smallest(4);
    block.attachment(0x8000, Vec::new()).attachment(0x8001, vec![1; 16]).attachment(0x8002, Vec::new());
    add("vendor_attachments_empty", "attachments of no bytes where another starts and where it ends", one(1, block));
    // All eight corners of child 5 of the root, those with x = 0 the opposite of those with x = 1.
    let mut block = smallest(4);
    let lattice = [10, 11, 13, 14, 19, 20, 22, 23];
    let mask = lattice.iter().fold(0u32, |mask, bit| mask | 1 << bit);
    let mut words = vec![0u32; 8];
    (words[4], words[5]) = (mask, 8);
    for k in 0..8u32 {
        // Raw normals: u and v, or their negatives with the sign bit.
        let (u, v) = (0x0fab << 14, 0x0123);
        let opposite = 1 << 31 | (0u32.wrapping_sub(u | v) & 0x1fff_ffff);
        words.extend([0xff00_0000 | (k * 0x20_1008), if k % 2 == 0 { u | v } else { opposite }]);
    }
    block.attachment(7, words.iter().flat_map(|word| word.to_le_bytes()).collect());
    add("corners_opposite", "normals at corners that cancel out in the centre of the voxel", one(1, block));
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

/// Plain values of the three-level octree: noise, one for each voxel.
pub(super) fn plain_noise(block: &Block, seed: u64) -> Vec<u8> {
    let mut rng = Rng(seed);
    let masks = [(2, 0b0100_1010u8), (4, 0b1001_0001), (5, 0b1111_0000), (6, 1), (7, 0b1000_0100)];
    let values: Vec<Vec<u32>> =
        masks.iter().map(|(_, mask)| (0..mask.count_ones()).map(|_| rng.bits() as u32).collect()).collect();
    let entries: Vec<(usize, u8, &[u32])> =
        masks.iter().zip(&values).map(|((slot, mask), values)| (*slot, *mask, &values[..])).collect();
    plain(block, &entries, &[0, 1, 2, 3, 4])
}

/// Corners: for each slot with a descriptor, the mask, and noise as values.
pub(super) fn corners(block: &Block, entries: &[(usize, u32)], seed: u64) -> Vec<u8> {
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

pub(super) fn values(add: &mut Add<'_>) {
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
    add(
        "plain_normals_constant_color",
        "plain normals together with a constant colour and ambient occlusion",
        one(3, block),
    );
    let mut block = branching(8);
    with_noise(&mut block, 2, &all);
    let bytes = plain_noise(&block, 8);
    block.attachment(5, bytes);
    add("plain_colors_normal_blocks", "plain colours together with normal blocks", one(3, block));
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
    add("corners_some", "corners of some voxels, of the parent voxel, and none", one(3, block));
    let mut block = smallest(4);
    let bytes = [0, 0, 0, 0, whole, 8, 0, 0].into_iter().chain([0x00ff_ffff, 0x1234_5678].repeat(27));
    block.attachment(7, bytes.flat_map(u32::to_le_bytes).collect());
    add("corners_without_values", "corners whose values all have alpha 0", one(1, block));
}
