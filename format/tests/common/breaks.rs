//! Ways to break a file, one rule at a time.

use esvo_format::{AssembleOptions, assemble};

use super::patch::File;
use super::samples::samples;
use super::{Colors, Shape, bytes_of};

/// A file that breaks one rule and no other.
pub(crate) struct Broken {
    /// Id of the rule.
    pub(crate) rule: &'static str,
    /// The sample that it was made from.
    pub(crate) sample: &'static str,
    pub(crate) bytes: Vec<u8>,
}

/// All broken files, in the order of the lists below.
pub(crate) fn broken_files() -> Vec<Broken> {
    let mut files = Vec::new();
    for (sealed, cases) in [(false, RAW), (true, SEALED)] {
        for &(rule, name, change) in cases {
            let mut file = sample(name);
            change(&mut file);
            match rule {
                _ if !sealed => {}
                // The tables cannot be located any more, so the checksums of blocks stay.
                "D006" | "O001" | "B001" => {
                    file.seal_sections();
                    file.seal_header();
                }
                "D008" => file.seal_header(),
                _ => file.seal(),
            }
            files.push(Broken { rule, sample: name, bytes: file.0 });
        }
    }
    let mut file = blocks_out_of_order();
    file.seal();
    files.push(Broken { rule: "B012", sample: "a tree of its own", bytes: file.0 });
    files
}

/// How to break a rule: its id, the name of the sample, the change.
type Case = (&'static str, &'static str, fn(&mut File));

/// Changes after which checksums are not corrected.
const RAW: &[Case] = &[
    ("H001", "contours", |f| f.0[0] = b'E'),
    ("H001", "contours", |f| f.0.truncate(63)),
    ("H004", "contours", |f| f.0.push(0)),
    ("H005", "contours", |f| f.0[60] ^= 1),
    ("H005", "contours", |f| f.0[24] ^= 1),
    ("D002", "contours", |f| f.0[64 + 24] ^= 1),
    ("D004", "everything", |f| {
        let meta = f.section(b"META").0;
        f.0[meta + 2] ^= 1;
    }),
    ("D004", "everything", |f| {
        // With the flag for its own checksums, the checksum of the section must be zero.
        let entry = f.entry(b"META");
        f.set_u32(entry + 4, 2);
        f.seal_header();
    }),
    ("B006", "contours", |f| {
        let crc = f.block(0) + 60;
        f.0[crc] ^= 1;
        f.seal_sections();
        f.seal_header();
    }),
    ("B006", "contours", |f| {
        // Either normal is valid by all other rules.
        let pool = f.pool(0);
        f.0[pool] ^= 0x40;
    }),
];

const SEALED: &[Case] = &[
    ("H002", "contours", |f| f.0[12] = 2),
    ("H003", "contours", |f| f.set_u64(16, 1 << 40)),
    ("H006", "contours", |f| f.set_u32(56, 1)),
    ("D001", "contours", |f| f.set_u64(40, 68)),
    ("D001", "contours", |f| f.set_u64(40, 1 << 50)),
    ("D001", "contours", |f| f.set_u64(40, 0)),
    ("D003", "everything", |f| set_entry(f, 8, 1 << 40)),
    ("D003", "everything", |f| {
        let (at, _) = f.section(b"META");
        set_entry(f, 8, at as u64 + 4);
    }),
    ("D003", "everything", |f| {
        let (at, _) = f.section(b"OBJT");
        set_entry(f, 8, at as u64);
    }),
    ("D005", "everything", |f| {
        let entry = f.entry(b"META");
        f.0[entry..entry + 5].copy_from_slice(b"NEW1\x01");
    }),
    ("D006", "everything", |f| {
        let entry = f.entry(b"META");
        f.0[entry..entry + 4].copy_from_slice(b"OBJT");
    }),
    ("D006", "everything", |f| {
        let entry = f.entry(b"BLKT");
        f.0[entry..entry + 5].copy_from_slice(b"NEW1\x00");
    }),
    ("S001", "everything", |f| {
        let entry = f.entry(b"META");
        f.0[entry..entry + 4].copy_from_slice(b"PART");
    }),
    ("I001", "everything", |f| {
        let entry = f.entry(b"META");
        f.0[entry..entry + 4].copy_from_slice(b"PAGE");
    }),
    ("D007", "everything", |f| {
        let entry = f.entry(b"META");
        f.set_u32(entry + 4, 4);
    }),
    ("D007", "everything", |f| {
        let entry = f.entry(b"META");
        f.set_u32(entry + 28, 1);
    }),
    ("D008", "contours", |f| {
        f.0.resize(1 << 16, 0);
        f.set_u64(32, 1 << 16);
        f.set_u32(48, 1025);
    }),
    ("D009", "contours", |f| {
        let data = f.slot(0);
        f.0[data - 1] = 1;
    }),
    ("M001", "everything", |f| {
        let meta = f.section(b"META").0;
        f.0[meta] = b'[';
    }),
    ("M001", "everything", |f| {
        let meta = f.section(b"META").0;
        f.0[meta + 4] = 0xff;
        f.0[meta + 1] = b' ';
    }),
    ("M001", "everything", |f| set_meta(f, b"")),
    ("M001", "everything", |f| set_meta(f, b"\xef\xbb\xbf{}")),
    ("M001", "everything", |f| set_meta(f, b"{\"title\":\"\xc3\x28\"}")),
    ("M001", "everything", |f| set_meta(f, b"{\"\xed\xa0\x80\":\"a surrogate in the name\"}")),
    ("M001", "everything", |f| set_meta(f, b"{\"title\":\"\xc0\xaf, overlong\"}")),
    ("M001", "everything", |f| set_meta(f, br#"{"title":"\ud83d"}"#)),
    ("M001", "everything", |f| set_meta(f, br#"{"title":"\udd1e\ud834"}"#)),
    ("M001", "everything", |f| set_meta(f, br#"{"x":1e999}"#)),
    ("M001", "everything", |f| set_meta(f, br#"{"x":-1.7976931348623159e308}"#)),
    ("M001", "everything", |f| set_meta(f, br#"{"x":NaN}"#)),
    ("M001", "everything", |f| set_meta(f, br#"{"x":010}"#)),
    ("M001", "everything", |f| {
        let nested = format!(r#"{{"x":{}{}}}"#, "[".repeat(64), "]".repeat(64));
        set_meta(f, nested.as_bytes());
    }),
    ("M001", "everything", |f| set_meta(f, br#"{"title":"one","title":"two"}"#)),
    ("M001", "everything", |f| set_meta(f, br#"{"x":[{"title":"one","\u0074itle":"two"}]}"#)),
    ("M001", "everything", |f| set_meta(f, b"{\"title\":\"two\nlines\"}")),
    ("M001", "everything", |f| set_meta(f, b"{}\0\0\0\0\0\0")),
    ("M001", "everything", |f| set_meta(f, br#"{"title":"a",}"#)),
    ("M002", "everything", |f| set_meta(f, br#"{"title":7}"#)),
    ("M002", "everything", |f| set_meta(f, br#"{"x":{"title":7},"created":null}"#)),
    ("O001", "contours", |f| {
        let entry = f.entry(b"OBJT");
        f.set_u64(entry + 16, 184);
        let object = f.object(0);
        f.0[object + 184..object + 192].fill(0);
    }),
    ("O001", "contours", |f| {
        let entry = f.entry(b"OBJT");
        f.set_u64(entry + 16, 0);
        let object = f.object(0);
        f.0[object..object + 192].fill(0);
    }),
    ("O002", "contours", |f| set_object(f, 136, 3)),
    ("O002", "contours", |f| set_object(f, 136, u64::MAX)),
    ("O003", "contours", |f| set_object_u32(f, 132, 4)),
    ("O003", "contours", |f| set_object_u32(f, 132, 24)),
    ("O003", "contours", |f| set_object_u32(f, 132, 0)),
    ("O004", "contours", |f| set_object(f, 0, f64::NAN.to_bits())),
    ("O004", "contours", |f| set_object(f, 40, 0)),
    ("O004", "contours", |f| set_object(f, 24, 1f64.to_bits())),
    ("O004", "contours", |f| set_scale(f, 1e200)), // the determinant is infinite
    ("O004", "contours", |f| set_scale(f, 1e-105)), // and not zero, but not normal
    ("O004", "contours", |f| set_object(f, 120, 2f64.to_bits())),
    ("O004", "contours", |f| set_object(f, 96, f64::INFINITY.to_bits())),
    ("O005", "contours", |f| set_object(f, 144, 7)),
    ("O005", "contours", |f| set_object(f, 152, 0)),
    ("O005", "contours", |f| set_object(f, 160, 9)),
    ("O005", "far_pointers", |f| set_object(f, 168, u64::MAX)),
    ("O006", "contours", |f| set_object(f, 184, 1 << 63)),
    ("B001", "blocks", |f| {
        let entry = f.entry(b"BLKT");
        f.set_u64(entry + 16, 3 * 72 - 8);
    }),
    ("B002", "blocks", |f| set_block(f, 1, 32, 4096)),
    ("B002", "blocks", |f| set_block(f, 1, 32, 0)),
    ("B002", "blocks", |f| set_block(f, 1, 24, 8200)),
    ("B003", "blocks", |f| set_block(f, 1, 24, 16384)),
    ("B003", "blocks", |f| {
        // A page of block data that belongs to no block.
        let length = f.0.len() + 8192;
        f.0.resize(length, 0);
        f.set_u64(32, length as u64);
        let entry = f.entry(b"BLKS");
        f.set_u64(entry + 16, 4 * 8192);
    }),
    ("B004", "blocks", |f| set_block(f, 2, 40, 8192)),
    ("B004", "blocks", |f| set_block(f, 2, 40, u64::MAX)),
    ("B005", "blocks", |f| set_block_u32(f, 1, 56, 9)),
    ("B005", "blocks", |f| set_block(f, 1, 48, 100)),
    ("B007", "blocks", |f| set_block_u32(f, 1, 4, 1)),
    ("B007", "blocks", |f| set_block_u32(f, 1, 4, u32::MAX)),
    ("B007", "blocks", |f| set_block_u32(f, 1, 0, 1)),
    ("B008", "blocks", |f| set_block_u32(f, 1, 8, 1 << 22)),
    ("B008", "blocks", |f| set_block_u32(f, 1, 20, 21)),
    ("B008", "blocks", |f| set_block_u32(f, 1, 20, 24)),
    ("B008", "blocks", |f| set_block_u32(f, 1, 8, 5)),
    ("B008", "blocks", |f| set_block_u32(f, 1, 12, 1 << 23)),
    ("B008", "contours", |f| set_block_u32(f, 0, 20, 22)), // a root block of another cube
    ("B008", "contours", |f| {
        set_block_u32(f, 0, 20, 22);
        set_block_u32(f, 0, 16, 1 << 22);
    }),
    ("B009", "blocks", |f| set_block(f, 1, 64, 1)),
    ("B010", "blocks", |f| {
        // Voxel 07 becomes a leaf, so no pointer leads to block 1 with a descriptor, four leaves and two contours; and
        // there is one far pointer less.
        let at = f.slot(4);
        let far = at + 8 * (f.u32(at) >> 17) as usize;
        f.set_u64(far, 0);
        let masks = f.u32(at) & 0xffff | 1 << 7;
        f.set_u32(at, masks);
        for (field, less) in [(144, 1), (152, 3), (160, 2), (168, 1)] {
            let count = f.u64(f.object(0) + field) - less;
            set_object(f, field, count);
        }
    }),
    ("P001", "contours", |f| set_slot(f, 0, 3)),
    ("P001", "contours", |f| set_slot(f, 0, 1 << 40)),
    ("P002", "contours", |f| add_info(f, 4, 1)),
    ("P002", "contours", |f| set_slot(f, 0, 1024)),
    ("P003", "contours", |f| add_info(f, 0, 1)),
    ("P004", "contours", |f| add_info(f, 8, 1)),
    ("P005", "contours", |f| add_info(f, 12, u32::MAX)),
    ("P005", "contours", |f| add_info(f, 16, 1 << 31)),
    ("P006", "contours", |f| set_slot(f, 1, 1)),
    ("P006", "contours", |f| set_slot(f, 7, 1 << 63)),
    ("P006", "contours", |f| set_slot(f, 1023, 1)),
    ("P006", "contours", |f| add_info(f, 24, 1)),
    ("C001", "contours", |f| change_low(f, 2, |low| low & !0xff00)),
    ("C001", "contours", |f| change_low(f, 6, |low| low | 1 << 3)),
    ("C002", "contours", |f| change_low(f, 2, |low| low & 0xffff)),
    ("C002", "contours", |f| change_low(f, 2, |low| low | 0x7fff << 17)),
    ("C002", "contours", |f| change_low(f, 5, |low| low & 0xffff | 4 << 17)), // the second child is after the array
    ("C002", "blocks", |f| set_far(f, 4, 1 << 31)),
    ("C002", "blocks", |f| set_far(f, 4, 9)),
    ("C003", "contours", |f| {
        // The only child of slot 4 moves from slot 6 to slot 7.
        let (from, to) = (f.slot(6), f.slot(7));
        let value = f.u64(from) - (2 << 40);
        f.set_u64(to, value);
        f.set_u64(from, 0);
        change_low(f, 4, |low| low + (1 << 17));
    }),
    ("C004", "blocks", |f| set_far(f, 4, 0)),
    ("C004", "blocks", |f| set_far(f, 4, 1 << 32 | 1022)),
    ("C004", "blocks", |f| change_low(f, 4, |low| low & 0x1_ffff)),
    ("C004", "blocks", |f| change_low(f, 4, |low| low | 0x7fff << 17)),
    ("C005", "contours", |f| change_low(f, 4, |low| low & 0x1_ffff | 4 << 17)),
    ("C006", "contours", |f| change_low(f, 6, |low| low | 1 << 17)),
    ("C006", "contours", |f| change_low(f, 6, |low| low | 1 << 16)),
    ("C007", "contours", |f| set_object_u32(f, 132, 2)),
    ("C008", "blocks", |f| set_far(f, 4, 1024)),
    ("K001", "contours", |f| change_high(f, 8, |high| high << 1 & 0xff | high & !0xff)),
    ("K002", "contours", |f| change_high(f, 8, |high| high + (100 << 8))),
    ("K002", "contours", |f| change_high(f, 8, |high| high & 0xff)),
    ("K003", "colors", |f| change_high(f, 8, |high| high + (1 << 8))),
    ("K004", "contours", |f| {
        let pool = f.pool(0);
        let word = f.u32(pool + 4) & !0x3ffff;
        f.set_u32(pool + 4, word);
    }),
    ("K005", "contours", |f| {
        let first = f.u32(f.slot(8) + 4) >> 8;
        change_high(f, 9, |high| high & 0xff);
        let high = f.u32(f.slot(9) + 4) | (first - 2) << 8;
        let at = f.slot(9) + 4;
        f.set_u32(at, high);
    }),
    ("A001", "colors", |f| add_attachment(f, 4, 4)),
    ("A001", "colors", |f| add_attachment(f, 4, 8160)),
    ("A001", "everything", |f| {
        // The normals start where the colours do.
        let (colors, normals) = (f.attachment(0, 0), f.attachment(0, 1));
        let offset = f.u32(colors + 4);
        f.set_u32(normals + 4, offset);
    }),
    ("A002", "colors", |f| add_attachment(f, 0, 99)),
    ("A002", "normals", |f| add_attachment(f, 0, 0xffff)),
    ("A003", "colors", |f| add_attachment(f, 8, 8)),
    ("A003", "normals", |f| add_attachment(f, 8, 8)),
    ("A003", "constant_color", |f| add_attachment(f, 8, 8)),
    ("A004", "contours", |f| add_info(f, 20, 65)),
    ("A005", "colors", |f| {
        let colors = f.info(0) + f.u32(f.attachment(0, 0) + 4) as usize;
        f.set_u32(colors + 4, 1);
    }),
    ("A005", "constant_color", |f| {
        let color = f.info(0) + f.u32(f.attachment(0, 0) + 4) as usize;
        f.0[color + 3] = 255;
    }),
    ("A002", "plain", |f| {
        // Plain normals become a second attachment of plain colours.
        let normals = f.attachment(0, 1);
        f.set_u32(normals, 5);
    }),
    ("A002", "colors", |f| add_attachment(f, 0, u32::MAX)), // type 0
    ("A003", "ambient", |f| add_attachment(f, 8, 8)),
    ("A003", "plain", |f| add_attachment(f, 8, 2)),
    ("A003", "corners", |f| {
        let size = f.attachment(0, 0) + 8;
        f.set_u64(size, 8);
    }),
    ("A005", "ambient", |f| {
        let values = f.info(0) + f.u32(f.attachment(0, 0) + 4) as usize;
        f.set_u32(values + 4, 1);
    }),
    ("A005", "plain", |f| set_entry_word(f, 0, 3, |_| 1)),
    ("A005", "corners", |f| set_entry_word(f, 0, 2 * 3 + 1, |_| 64)),
    ("A007", "plain", |f| set_entry_word(f, 0, 2, |entry| entry | 1 << 1)),
    ("A007", "plain", |f| set_entry_word(f, 1, 2, |entry| entry + (1 << 20))),
    ("A007", "plain", |f| set_entry_word(f, 0, 2, |entry| entry & 0xff)),
    ("A007", "corners", |f| set_entry_word(f, 0, 2 * 2, |mask| mask | 1 << 28)),
    ("A007", "corners", |f| set_entry_word(f, 0, 2 * 2 + 1, |first| first + (1 << 20))),
    ("A007", "corners", |f| set_entry_word(f, 0, 2 * 2, |_| 0)),
    ("A007", "corners", |f| set_entry_word(f, 0, 2 * 2 + 1, |first| first + 1)),
    ("A008", "plain", |f| set_entry_word(f, 0, 2, |entry| entry & !0xff)),
    ("A008", "plain", |f| set_entry_word(f, 1, 4, |entry| entry - (1 << 8))),
    ("A008", "corners", |f| {
        set_entry_word(f, 0, 2 * 2, |_| 0);
        set_entry_word(f, 0, 2 * 2 + 1, |_| 0);
    }),
    ("A009", "components", |f| set_entry_word(f, 1, 0, |head| head & !0xff)),
    ("A010", "components", |f| set_entry_word(f, 2, 2, |value| value | 1 << 16)),
    ("A006", "blocks", |f| {
        let at = f.attachment(1, 0);
        f.set_u32(at, 0x8000);
    }),
];

/// Sets a field of the directory entry of META.
fn set_entry(f: &mut File, field: usize, value: u64) {
    let entry = f.entry(b"META");
    f.set_u64(entry + field, value);
}

/// Puts other bytes in the place of the metadata, which is the last section before the block data.
fn set_meta(f: &mut File, text: &[u8]) {
    let (at, length) = f.section(b"META");
    f.0[at..at + length].fill(0);
    f.0[at..at + text.len()].copy_from_slice(text);
    assert!(at + text.len() <= f.section(b"BLKS").0);
    set_entry(f, 16, text.len() as u64);
}

/// Sets the scale of the transform of object 0.
fn set_scale(f: &mut File, scale: f64) {
    for element in [0, 5, 10] {
        set_object(f, 8 * element, scale.to_bits());
    }
}

fn set_object(f: &mut File, field: usize, value: u64) {
    let object = f.object(0);
    f.set_u64(object + field, value);
}

fn set_object_u32(f: &mut File, field: usize, value: u32) {
    let object = f.object(0);
    f.set_u32(object + field, value);
}

fn set_block(f: &mut File, index: usize, field: usize, value: u64) {
    let block = f.block(index);
    f.set_u64(block + field, value);
}

fn set_block_u32(f: &mut File, index: usize, field: usize, value: u32) {
    let block = f.block(index);
    f.set_u32(block + field, value);
}

pub(crate) fn set_slot(f: &mut File, slot: usize, value: u64) {
    let at = f.slot(slot);
    f.set_u64(at, value);
}

/// Changes a field of the info section of block 0.
fn add_info(f: &mut File, field: usize, value: u32) {
    let at = f.info(0) + field;
    let value = f.u32(at).wrapping_add(value);
    f.set_u32(at, value);
}

/// Changes a word of attachment `k` of block 0.
fn set_entry_word(f: &mut File, k: usize, word: usize, change: fn(u32) -> u32) {
    let at = f.info(0) + f.u32(f.attachment(0, k) + 4) as usize + 4 * word;
    let value = change(f.u32(at));
    f.set_u32(at, value);
}

/// Changes a field of the first attachment of block 0.
fn add_attachment(f: &mut File, field: usize, value: u32) {
    let at = f.attachment(0, 0) + field;
    let value = f.u32(at).wrapping_add(value);
    f.set_u32(at, value);
}

pub(crate) fn change_low(f: &mut File, slot: usize, change: fn(u32) -> u32) {
    let at = f.slot(slot);
    let value = change(f.u32(at));
    f.set_u32(at, value);
}

fn change_high(f: &mut File, slot: usize, change: fn(u32) -> u32) {
    let at = f.slot(slot) + 4;
    let value = change(f.u32(at));
    f.set_u32(at, value);
}

/// Sets the far pointer of the descriptor at `slot`.
fn set_far(f: &mut File, slot: usize, value: u64) {
    let at = f.slot(slot);
    let far = at + 8 * (f.u32(at) >> 17) as usize;
    f.set_u64(far, value);
}

pub(crate) fn sample(name: &str) -> File {
    File(bytes_of(&samples().into_iter().find(|(n, _)| *n == name).expect("a sample").1))
}

/// Two blocks with the same parent whose children are in the reverse order.
fn blocks_out_of_order() -> File {
    let shape =
        Shape { seed: 3, levels: 4, valid: 0, leaf: 0, contour: 0, colors: Colors::None, normals: false, nodes: 99 };
    let mut tree = esvo_format::Tree::default();
    let child = Some(esvo_format::Voxel::default());
    let root = tree.open(&[child, child, None, None, None, None, None, None]);
    tree.append(&shape.tree());
    tree.append(&shape.tree());
    tree.close(root);
    let options = AssembleOptions { block_slots: 64, near_limit: 32767 };
    let octree = assemble(&tree, glam::DMat4::IDENTITY, &options).unwrap();
    let parents: Vec<u32> = octree.blocks().iter().map(|b| b.parent).collect();
    assert_eq!(parents[3..5], [1, 2], "{parents:?}");
    let mut file = File(bytes_of(&octree));
    swap_blocks(&mut file, 3, 4);
    file
}

/// Swaps two blocks of one page each, and corrects the far pointers to and from them.
fn swap_blocks(f: &mut File, a: usize, b: usize) {
    let page = 8192;
    let (start_a, start_b) = (f.slot(1024 * a), f.slot(1024 * b));
    for i in 0..page {
        f.0.swap(start_a + i, start_b + i);
    }
    for i in 0..24 {
        let (a, b) = (f.block(a) + i, f.block(b) + i);
        f.0.swap(a, b);
    }
    for (block, index) in [(a, b), (b, a)] {
        let info = f.info(block);
        assert_eq!(f.u32(info), index as u32);
        f.set_u32(info, block as u32);
    }
    let pages = b as i64 - a as i64;
    for block in 0..f.blocks() {
        let parent = f.u32(f.block(block) + 4) as usize;
        for (was, is) in [(a, b), (b, a)] {
            if parent == was && block != a && block != b {
                let at = f.block(block) + 4;
                f.set_u32(at, is as u32);
            }
        }
    }
    // The descriptors with far pointers: in the blocks that refer to a and b, and in a and b.
    for block in 0..f.blocks() {
        let array = f.u32(f.slot(1024 * block)) as usize;
        for slot in 2..array {
            let at = f.slot(1024 * block + slot);
            if f.u32(at) >> 16 & 1 == 0 || f.u32(at) & 0xff00 == 0 {
                continue;
            }
            let far = at + 8 * (f.u32(at) >> 17) as usize;
            let from = if block == a {
                b
            } else if block == b {
                a
            } else {
                block
            };
            let target = (from * 1024 + slot) as i64 + f.u32(far) as i64;
            let moved = match target as usize / 1024 {
                t if t == a => pages,
                t if t == b => -pages,
                _ => 0,
            } * 1024;
            let distance = target + moved - (block * 1024 + slot) as i64;
            f.set_u32(far, distance as u32);
        }
    }
}
