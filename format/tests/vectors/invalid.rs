//! Invalid vectors made from files of the generator. They have what the library's samples lack: second pages, compressed
//! blocks, sections of 0 bytes. `common/breaks.rs` has the other invalid vectors.

use super::common::break_parts::broken_parts;
use super::common::breaks::{Broken, broken_files, change_low};
use super::common::patch::File;
use super::valid::components::{F16, F32, RGB9E5, U16, UNORM8, constant, entries};
use super::valid::topology::{branching, smallest};
use super::valid::{ENTROPY_LEVELS, entropy_coded, extra, one};
use super::writer::{Block, Codec, IDENTITY, Plan, zstd_frame};

/// Every invalid vector, in the order of their numbers.
pub(crate) fn broken_vectors() -> Vec<Broken> {
    let mut list = broken_files();
    let mut add = |rule: &'static str, bytes: Vec<u8>| list.push(Broken { rule, sample: "the generator", bytes });
    container(&mut add);
    pages(&mut add);
    frames(&mut add);
    list.extend(broken_parts());
    let mut add = |rule: &'static str, bytes: Vec<u8>| list.push(Broken { rule, sample: "the generator", bytes });
    components(&mut add);
    list
}

type Add<'a> = dyn FnMut(&'static str, Vec<u8>) + 'a;

/// The file of a plan, changed, with all checksums put right.
fn changed(plan: &Plan, change: impl FnOnce(&mut File)) -> Vec<u8> {
    let mut file = File(plan.write().0);
    change(&mut file);
    file.seal();
    file.0
}

fn container(add: &mut Add<'_>) {
    let with = |extras| Plan { extra: extras, ..one(1, smallest(4)) };
    // A section of 0 bytes inside the object table; a section of 8 bytes on the first bytes of the directory.
    add(
        "D003",
        changed(&with(vec![extra(b"none", 0, b"")]), |f| {
            let (entry, objects) = (f.entry(b"none"), f.section(b"OBJT").0);
            f.set_u64(entry + 8, objects as u64 + 8);
        }),
    );
    add(
        "D003",
        changed(&with(vec![extra(b"note", 2, &[0; 8])]), |f| {
            let entry = f.entry(b"note");
            f.set_u64(entry + 8, 64);
        }),
    );
    let twice = vec![extra(b"note", 0, b"once"), extra(b"note", 0, b"twice")];
    add("D006", changed(&with(twice), |_| ()));
    add(
        "D009",
        changed(&with(vec![extra(b"odd ", 0, b"3 b")]), |f| {
            let (at, length) = f.section(b"odd ");
            f.0[at + length] = 1;
        }),
    );
    // The parent of a block belongs to another object.
    let mut first = smallest(4);
    first.object = 1;
    let mut root = Block::new(4);
    root.node(2, 0x10, 0).link(2, 3, 2);
    let mut below = Block::below(4, 1, ([0; 3], 23));
    below.leaves(2, 0x3c);
    let mut plan = Plan::new(2, vec![first, root, below]);
    plan.objects.push((1, IDENTITY));
    add(
        "B007",
        changed(&plan, |f| {
            let parent = f.block(2) + 4;
            f.set_u32(parent, 0);
        }),
    );
    // An attachment of 0 bytes inside another.
    let mut block = smallest(4);
    block.attachment(0x8000, vec![1; 16]).attachment(0x8001, Vec::new());
    add(
        "A001",
        changed(&one(1, block), |f| {
            let (first, second) = (f.attachment(0, 0), f.attachment(0, 1));
            let inside = f.u32(first + 4) + 8;
            f.set_u32(second + 4, inside);
        }),
    );
}

fn pages(add: &mut Add<'_>) {
    // The only child of the root is in the first page, its child in the second.
    let two_pages = |mask: u8, first: usize| {
        let mut block = Block::new(1030);
        block.node(2, 1 << 3, 0).near(2, 4).node(4, mask, 0).near(4, first);
        block
    };
    let mut in_use = two_pages(1, 1026);
    in_use.leaves(1026, 0x24);
    for header in [7, 1 << 32 | 6, 0] {
        add("P001", changed(&one(3, in_use.clone()), |f| f.set_u64(f.slot(1024), header)));
    }
    add("P001", changed(&one(1, smallest(1030)), |f| f.set_u64(f.slot(1024), 5)));
    // The attachment directory leaves the block.
    add(
        "P002",
        changed(&one(1, smallest(1019)), |f| {
            let count = f.info(0) + 20;
            f.set_u32(count, 1);
        }),
    );
    // Three siblings, the third on the page header; one child on the page header; a far pointer on the page header.
    let mut straddling = two_pages(0b111, 1022);
    straddling.leaves(1022, 1).leaves(1023, 1);
    add("C003", changed(&one(3, straddling), |_| ()));
    add("C003", changed(&one(3, two_pages(1, 1024)), |_| ()));
    add("C003", changed(&one(3, two_pages(1, 1024)), |f| change_low(f, 4, |low| low | 1 << 16)));
    // A far pointer to slot 2 of a block whose parent is another block.
    let mut root = Block::new(4);
    root.node(2, 0x01, 0).link(2, 3, 1);
    let mut middle = Block::below(4, 0, ([0; 3], 23));
    middle.node(2, 0x01, 0).link(2, 3, 2);
    let mut bottom = Block::below(4, 1, ([0; 3], 22));
    bottom.leaves(2, 0x01);
    add("C008", changed(&Plan::new(3, vec![root, middle, bottom]), |f| f.set_u64(f.slot(3), 2048)));
}

/// Component attachments.
fn components(add: &mut Add<'_>) {
    // Materials of 16 bits: two own values and a shared one of the root's voxels, one of slot 4, none of the others.
    let good = entries(&branching(8), (1, U16), &[(2, 0b0000_1010, &[1, 2, 3]), (4, 0, &[4])]);
    let word = |at: usize, value: u32| {
        let mut bytes = good.clone();
        bytes[4 * at..4 * at + 4].copy_from_slice(&value.to_le_bytes());
        bytes
    };
    let with = |kind: u32, bytes: Vec<u8>| {
        let mut block = branching(8);
        block.attachment(kind, bytes);
        one(3, block)
    };
    let mut bad = |rule: &'static str, kind: u32, bytes: Vec<u8>| add(rule, changed(&with(kind, bytes), |_| ()));
    // No room for a head; a value that is cut; a constant with an entry.
    bad("A003", 11, good[..4].to_vec());
    bad("A003", 11, good[..good.len() - 2].to_vec());
    bad("A003", 11, constant((1, U16), &[1, 2]));
    bad("A003", 16, entries(&branching(8), (2, F32), &[(2, 0, &[1, 2, 3])]));
    // An entry of a slot without a descriptor.
    bad("A005", 11, word(2 + 3, 10 << 8));
    // A voxel that does not exist; values after the end, among the entries, in the head, without a distance.
    bad("A007", 11, word(2 + 2, 10 << 8 | 0b0001_1010));
    bad("A007", 11, word(2 + 4, 14 << 8));
    bad("A007", 11, word(2 + 4, 9 << 8));
    bad("A007", 11, word(2 + 4, 1 << 8));
    bad("A007", 11, word(2 + 4, 1));
    // A value of two descriptors; one of none.
    bad("A008", 11, word(2 + 4, 12 << 8));
    bad("A008", 11, word(2 + 4, 0));
    // Heads: no component, five, no format, one that is not known, a form that is not known, other bytes, formats of other types.
    for head in [0x0300, 0x0305, 0x0001, 0x0901, 0x2_0301, 0x100_0301, 0x0302, 0x0701] {
        bad("A009", 11, word(0, head));
    }
    bad("A009", 11, word(1, 1 << 31));
    bad("A009", 8, constant((3, UNORM8), &[0]));
    bad("A009", 9, constant((1, UNORM8), &[0]));
    bad("A009", 10, constant((1, F32), &[0]));
    bad("A009", 17, constant((4, RGB9E5), &[0]));
    // Infinite, not a number, negative light, a bit of no component.
    bad("A010", 16, constant((1, F32), &[0x7f80_0000]));
    bad("A010", 16, constant((2, F16), &[0x7c01_3c00]));
    bad("A010", 8, constant((3, F16), &[0x8001_0000, 0]));
    bad("A010", 11, constant((1, U16), &[1 << 16]));
    bad("A010", 11, word(12, 1 << 31));
}

/// Blocks stored with codec 1.
fn frames(add: &mut Add<'_>) {
    let block = branching(8);
    let image = block.image(0, &[0]);
    let whole = zstd_frame(&image, true);
    let plan = |frame: Vec<u8>| one(3, branching(8).framed(frame));
    // BLKS ends with the frame, before the next page; two blocks at one place; a byte after a frame is not zero.
    add(
        "B004",
        changed(&plan(whole.clone()), |f| {
            let entry = f.entry(b"BLKS");
            f.set_u64(entry + 16, whole.len() as u64);
        }),
    );
    let mut root = Block::new(4);
    root.node(2, 0x10, 0).link(2, 3, 1);
    let mut below = Block::below(4, 0, ([0; 3], 23));
    below.leaves(2, 0x0f);
    (root.codec, below.codec) = (Codec::Zstd, Codec::Zstd);
    add(
        "B004",
        changed(&Plan::new(2, vec![root, below]), |f| {
            let (first, second) = (f.u64(f.block(0) + 40), f.block(1) + 40);
            f.set_u64(second, first);
        }),
    );
    add(
        "D009",
        changed(&plan(whole.clone()), |f| {
            let end = f.slot(0) + whole.len();
            f.0[end] = 1;
        }),
    );
    let mut damaged = plan(whole.clone()).write().0;
    let last = File(damaged.clone()).slot(0) + whole.len() - 1;
    damaged[last] ^= 1;
    add("B006", damaged);
    add(
        "B005",
        changed(&plan(whole.clone()), |f| f.set_u64(16, 0)), // the feature bit is clear
    );
    // An image size that no frame of this length can have.
    add(
        "B005",
        changed(&plan(whole.clone()), |f| {
            let size = f.block(0) + 32;
            f.set_u64(size, 40_000 * 8192);
        }),
    );
    let edit = |change: fn(&mut Vec<u8>)| {
        let mut frame = whole.clone();
        change(&mut frame);
        frame
    };
    const SKIPPABLE: [u8; 12] = [0x50, 0x2a, 0x4d, 0x18, 4, 0, 0, 0, 1, 2, 3, 4];
    let mut bad = vec![
        edit(|frame| frame[0] ^= 1), // no frame
        edit(|frame| {
            frame.pop(); // cut
        }),
        edit(|frame| frame.push(0)), // more than the frame
        [&whole[..], &zstd_frame(&[], true)].concat(),
        [&SKIPPABLE[..], &whole].concat(),
        [&whole[..], &SKIPPABLE].concat(),
        edit(|frame| frame[5] ^= 1), // a wrong content size
        edit(|frame| frame[9] |= 6), // a block of the reserved type
        zstd_frame(&image[..image.len() - 8], true),
        zstd_frame(&[&image[..], &[0; 8]].concat(), true),
        zstd_frame(&image[..image.len() - 8], false),
        zstd_frame(&[&image[..], &[0; 8]].concat(), false),
    ];
    // A dictionary id, in one byte after the frame header descriptor.
    let mut with_dictionary = whole.clone();
    with_dictionary[4] |= 1;
    with_dictionary.insert(5, 77);
    bad.push(with_dictionary);
    for frame in bad {
        add("B005", changed(&plan(frame), |_| ()));
    }
    // A wrong content checksum; a frame with entropy coding that is cut in half.
    let (block, _, mut checked) = entropy_coded();
    *checked.last_mut().unwrap() ^= 1;
    add("B005", changed(&one(ENTROPY_LEVELS, block.framed(checked)), |_| ()));
    let (_, mut plain, _) = entropy_coded();
    plain.truncate(plain.len() / 2);
    add("B005", changed(&one(ENTROPY_LEVELS, block.framed(plain)), |_| ()));
}
