//! Component attachments: every format, both forms, every type.

use super::super::common::Rng;
use super::super::writer::Block;
use super::attributes::{noise, with_noise};
use super::topology::{branching, smallest};
use super::{Add, one};

/// The numbers of the formats.
pub(crate) const U8: u8 = 1;
pub(crate) const UNORM8: u8 = 2;
pub(crate) const U16: u8 = 3;
pub(crate) const UNORM16: u8 = 4;
pub(crate) const F16: u8 = 5;
pub(crate) const U32: u8 = 6;
pub(crate) const F32: u8 = 7;
pub(crate) const RGB9E5: u8 = 8;

/// An attachment with entries: for each slot with values, the mask and the words of the values it takes.
pub(crate) fn entries(block: &Block, (n, format): (u8, u8), entries: &[(usize, u8, &[u32])]) -> Vec<u8> {
    let mut words = vec![u32::from_le_bytes([n, format, 0, 0]), 0];
    words.resize(2 + block.slots(), 0);
    for (slot, mask, values) in entries {
        words[2 + slot] = (words.len() as u32) << 8 | u32::from(*mask);
        words.extend(*values);
    }
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// An attachment of one value for all voxels.
pub(crate) fn constant((n, format): (u8, u8), value: &[u32]) -> Vec<u8> {
    let head = [u32::from_le_bytes([n, format, 1, 0]), 0];
    head.iter().chain(value).flat_map(|word| word.to_le_bytes()).collect()
}

/// Words of a value of noise, all of whose numbers are finite and none of which is negative.
fn value(rng: &mut Rng, (n, format): (u8, u8)) -> Vec<u32> {
    let bits = match format {
        U8 | UNORM8 => 8,
        U16 | UNORM16 | F16 => 16,
        RGB9E5 => return vec![rng.bits() as u32],
        _ => 32,
    };
    let mut words = vec![0u32; (usize::from(n) * bits).div_ceil(32)];
    for k in 0..usize::from(n) {
        let number = match format {
            F16 => rng.below(0x7c00) as u32,
            F32 => rng.below(0x7f80_0000) as u32,
            _ => (rng.bits() as u32) >> (32 - bits),
        };
        words[k * bits / 32] |= number << (k * bits % 32);
    }
    words
}

pub(super) fn components(add: &mut Add<'_>) {
    let all = [2, 4, 6];
    // Emission of a leaf, of a voxel with a descriptor and, shared, of two others; the rest has none.
    let mut block = branching(8);
    let bytes = entries(
        &block,
        (3, RGB9E5),
        &[(2, 0b0100_0000, &[0x8002_0100, 0]), (5, 0b0010_0000, &[0x7fff_ffff, 0xf800_0001]), (7, 0, &[0xffff_ffff])],
    );
    block.attachment(8, bytes);
    add("emission", "emission of some voxels; others share a value, or have none", one(3, block));
    let mut block = branching(8);
    with_noise(&mut block, 1, &all);
    with_noise(&mut block, 2, &all);
    block.attachment(9, constant((2, UNORM8), &[0xff33]));
    block.attachment(10, constant((1, UNORM8), &[0x80]));
    block.attachment(11, constant((1, U16), &[0xffff]));
    add("components_constant", "roughness and metalness, opacity and material of all voxels of a block", one(3, block));
    let mut block = branching(8);
    let ids =
        [(2, 0b0000_0010, &[7u32, 0][..]), (4, 0, &[7]), (5, 0b1111_0000, &[1, 2, 3, 0x1_0000]), (6, 1, &[u32::MAX])];
    let bytes = entries(&block, (1, U32), &ids);
    block.attachment(11, bytes).attachment(10, constant((1, UNORM16), &[0xfffe]));
    let bytes = entries(&block, (2, UNORM16), &[(7, 0b0000_0100, &[0x1234_ffff, 0])]);
    block.attachment(9, bytes).attachment(4, noise(32, &[1, 2, 3], 8, 4));
    add(
        "components_some",
        "materials with a shared default, and other types in any order; values of 16 and 32 bits",
        one(3, block),
    );
    // Formats that types 8 to 11 can have as well.
    let mut block = branching(8);
    let bytes = entries(&block, (3, F16), &[(2, 0, &[0x3c00_0001, 0x7bff])]);
    block.attachment(8, bytes).attachment(11, constant((1, U8), &[200]));
    add("components_other_formats", "emission as f16, materials of a byte", one(3, block));
    // Every format, with noise for each voxel, in two blocks of 14 types.
    let numbers = [U8, UNORM8, U16, UNORM16, F16, U32, F32];
    let formats: Vec<(u8, u8)> =
        numbers.iter().flat_map(|number| (1..=4).map(|n| (n, *number))).chain([(3, RGB9E5)]).collect();
    for (name, formats) in [("components_formats_1", &formats[..14]), ("components_formats_2", &formats[14..])] {
        let mut block = branching(8);
        for (k, format) in formats.iter().enumerate() {
            let mut rng = Rng(1000 + k as u64);
            // Slot, value mask, number of values.
            let masks = [(2, 0b0100_1010u8, 3), (4, 0b1001_0001, 3), (5, 0, 1), (6, 1, 1), (7, 0b0000_0100, 2)];
            let words: Vec<Vec<u32>> = (masks.iter())
                .map(|(.., count)| (0..*count).flat_map(|_| value(&mut rng, *format)).collect())
                .collect();
            let list: Vec<(usize, u8, &[u32])> =
                masks.iter().zip(&words).map(|((slot, mask, _), words)| (*slot, *mask, &words[..])).collect();
            let bytes = entries(&block, *format, &list);
            block.attachment(16 + k as u32, bytes);
        }
        add(name, "components of every format and number in types whose meaning the metadata give", one(3, block));
    }
    // Numbers at the ends of their ranges, in an array of an odd number of slots.
    let mut block = smallest(5);
    let bytes = entries(&block, (4, F32), &[(2, 1 << 5, &[0x7f7f_ffff, 1, 0x8000_0000, 0xff7f_ffff])]);
    block.attachment(31, bytes);
    let bytes = entries(&block, (4, F16), &[(2, 0, &[0x0001_7bff, 0xfbff_8000])]);
    block.attachment(30, bytes);
    let bytes = entries(&block, (3, RGB9E5), &[(2, 0, &[0xf803_fe00])]);
    block.attachment(8, bytes).attachment(29, constant((4, U32), &[0, u32::MAX, 1, 1 << 31]));
    add("components_extreme", "largest, smallest and negative numbers; values of four words", one(1, block));
}
