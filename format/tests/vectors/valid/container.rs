//! Objects, sections and compression.

use super::super::common::Rng;
use super::super::writer::{Block, Codec, Extra, IDENTITY, Order, Plan, zstd_frame};
use super::attributes::with_noise;
use super::topology::{branching, smallest};
use super::{Add, one};

pub(super) fn objects(add: &mut Add<'_>) {
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

pub(crate) fn extra(tag: &[u8; 4], flags: u32, bytes: &[u8]) -> Extra {
    Extra { tag: *tag, flags, bytes: bytes.to_vec() }
}

pub(super) fn container(add: &mut Add<'_>) {
    let with = |extras: Vec<Extra>| Plan { extra: extras, ..one(1, smallest(4)) };
    add(
        "unknown_section",
        "a section with a tag that is not registered",
        with(vec![extra(b"note", 0, b"to be passed over")]),
    );
    add(
        "unknown_sections",
        "several: one of no bytes, one with checksums of its own, one with a tag that is not ASCII",
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
        "unknown optional feature bits",
        Plan { optional_features: 1 << 40 | 5, ..one(1, smallest(4)) },
    );
    add("not_required", "the sections are not flagged as required", Plan { flags: 0, ..one(1, smallest(4)) });
    let mut plan = one(3, branching(8));
    plan.order = Order::DataFirst;
    plan.extra = vec![extra(b"META", 0, b"{}"), extra(b"note", 0, b"odd")];
    add("sections_reversed", "block data first, then the tables, the directory last", plan);
}

/// Metadata at the limits of what M001 allows.
pub(super) fn metadata(add: &mut Add<'_>) {
    let mut add = |name: &str, about: &'static str, text: &str| {
        add(name, about, Plan { extra: vec![extra(b"META", 0, text.as_bytes())], ..one(1, smallest(4)) });
    };
    add("meta_empty", "metadata without members", "{}");
    add("meta_white_space", "metadata between white space of every kind", " \t\r\n{ \"title\" :\n\t\"A voxel\"\r} \n");
    add(
        "meta_escapes",
        "every escape, a surrogate pair, and characters that need none",
        r#"{"\u0074itle":"\"\\\/\b\f\n\r\t\u20AC\uD834\uDD1E","":"\uFFFF𝄞"}"#,
    );
    add(
        "meta_numbers",
        "the greatest number that binary64 holds, one that rounds to it, and one that rounds to zero",
        r#"{"numbers":[1.7976931348623157e308,1.797693134862315807e308,-0,0.5E+1,1e-999,9007199254740993]}"#,
    );
    let nested = format!(r#"{{"a":{}{}}}"#, "[".repeat(63), "]".repeat(63));
    add("meta_nested", "arrays nested as deep as they may be", &nested);
    add(
        "meta_names",
        "the same name in different objects, and names that differ in case or form",
        r#"{"a":{"a":[{"a":1},{"a":2}]},"A":0,"\u00e9":1,"e\u0301":2}"#,
    );
}

pub(super) fn compressed(add: &mut Add<'_>) {
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

/// Levels that the octree of [`entropy_coded`] has.
pub(crate) const ENTROPY_LEVELS: u32 = 4;

/// A block that compresses well, and two frames of it with entropy coding, the second with a content checksum. Zstandard
/// 1.5 made the frames at level 19; they are committed because other versions of it make other frames.
pub(crate) fn entropy_coded() -> (Block, Vec<u8>, Vec<u8>) {
    let mut rng = Rng(19);
    let mut block = Block::new(590);
    block.node(2, 0xff, 0).near(2, 4);
    let mut leaf_masks = || [0x0f, 0xf0, 0x33, 0xcc, 0x55, 0xaa, 0x11, 0xff][(rng.bits() & rng.bits() & 7) as usize];
    for k in 0..8 {
        block.node(4 + k, 0xff, 0).near(4 + k, 12 + 8 * k);
        for child in 12 + 8 * k..20 + 8 * k {
            let first = 76 + 8 * (child - 12);
            block.node(child, 0xff, 0).near(child, first);
            for slot in first..first + 8 {
                block.leaves(slot, leaf_masks());
            }
        }
    }
    // Every descriptor with leaves gives its first one a contour; few differ.
    for slot in 76..588 {
        let first = block.valid(slot) & block.valid(slot).wrapping_neg();
        block.contour(slot, first, &[0x0de1_ec10 + ((slot as u32 % 3) << 18)]);
    }
    // A colour for every descriptor, of bytes in which most bits are 0: the encoder takes a Huffman code for them.
    let mut words = vec![0u32; block.slots()];
    for slot in (2..588).filter(|slot| block.valid(*slot) != 0) {
        words[slot] = (words.len() as u32) << 8;
        words.push((rng.bits() & rng.bits() & rng.bits()) as u32);
    }
    block.attachment(5, words.iter().flat_map(|word| word.to_le_bytes()).collect());
    (block, include_bytes!("../frames/plain.zst").to_vec(), include_bytes!("../frames/checksum.zst").to_vec())
}

/// Frames that an encoder may leave out and a decoder must read.
pub(super) fn frames(add: &mut Add<'_>) {
    let (block, plain, checksum) = entropy_coded();
    add("compressed_entropy", "a frame with entropy coding", one(ENTROPY_LEVELS, block.framed(plain)));
    add(
        "compressed_checksum",
        "a frame with entropy coding and a content checksum",
        one(ENTROPY_LEVELS, block.framed(checksum)),
    );
    let block = branching(8);
    let frame = zstd_frame(&block.image(0, &[0]), false);
    add("compressed_without_size", "a frame without content size", one(3, block.framed(frame)));
    let mut plan = one(3, branching(8));
    plan.blocks[0].codec = Codec::Zstd;
    plan.spare = (8192, 8);
    add("compressed_room", "room before and after the only block of the block data", plan);
}
