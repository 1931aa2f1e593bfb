//! Ways to break a file whose blocks are stored in parts.

use std::path::Path;

use super::breaks::Broken;
use super::patch::File;

/// The vector with this name, as it is kept for the tests.
fn vector(name: &str) -> File {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/vectors/parts").join(name).with_extension("esvo");
    File(std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display())))
}

/// Offset of entry `index` of the table of parts.
fn entry(file: &File, index: usize) -> usize {
    file.section(b"PART").0 + 12 * index
}

fn count(file: &File) -> usize {
    file.section(b"PART").1 / 12
}

/// Offset of each part.
fn places(file: &File) -> Vec<usize> {
    let mut at = file.section(b"BLKS").0;
    let next = |index| {
        let place = at;
        at = (at + file.u32(entry(file, index) + 4) as usize).next_multiple_of(8);
        place
    };
    (0..count(file)).map(next).collect()
}

/// Corrects all checksums. The table of parts must be intact.
pub(crate) fn seal_parts(file: &mut File) {
    let places = places(file);
    let mut own: Vec<(u32, u8, [u8; 4])> = Vec::new();
    for (index, &at) in places.iter().enumerate() {
        let entry = entry(file, index);
        let size = file.u32(entry + 4) as usize;
        let crc = crc32fast::hash(&file.0[at + 4..at + size]);
        file.set_u32(at, crc);
        own.push((file.u32(entry), file.0[entry + 8], crc.to_le_bytes()));
    }
    own.sort_unstable();
    for block in 0..file.blocks() {
        let crcs: Vec<u8> = own.iter().filter(|part| part.0 as usize == block).flat_map(|part| part.2).collect();
        let at = file.block(block) + 60;
        file.set_u32(at, crc32fast::hash(&crcs));
    }
    seal_tables(file);
}

fn seal_tables(file: &mut File) {
    file.seal_sections();
    file.seal_header();
}

/// The same parts in reverse order. The index is given another tag, as it would say otherwise.
fn reversed(file: &mut File) {
    let index = file.entry(b"INDX");
    file.0[index..index + 4].copy_from_slice(b"indx");
    file.set_u32(56, 0);
    let (start, length) = file.section(b"BLKS");
    let table = file.section(b"PART");
    let entries: Vec<Vec<u8>> = file.0[table.0..table.0 + table.1].chunks(12).rev().map(<[u8]>::to_vec).collect();
    let places = places(file);
    let bodies: Vec<Vec<u8>> = (0..entries.len())
        .rev()
        .map(|index| file.0[places[index]..][..file.u32(entry(file, index) + 4) as usize].to_vec())
        .collect();
    file.0[start..start + length].fill(0);
    file.0[table.0..table.0 + table.1].copy_from_slice(&entries.concat());
    let mut at = start;
    for (entry, body) in entries.iter().zip(&bodies) {
        file.0[at..at + body.len()].copy_from_slice(body);
        let block = u32::from_le_bytes(entry[..4].try_into().unwrap()) as usize;
        let (parent, level) = (file.u32(file.block(block) + 4), file.u32(file.block(block) + 20));
        if u32::from(entry[8]) == if parent == u32::MAX { 0 } else { 24 - level } {
            let field = file.block(block) + 40;
            file.set_u64(field, at as u64);
        }
        at = (at + body.len()).next_multiple_of(8);
    }
}

/// Replaces the root page of the index by a changed one, at the end of the file.
fn edit_index(file: &mut File, change: fn(&mut [u32; 3], &mut Vec<u8>)) {
    let (at, length) = file.section(b"INDX");
    let mut counts = [0, 4, 8].map(|k| file.u32(at + k));
    let mut columns = unpack(&file.0[at + 12..at + length]);
    change(&mut counts, &mut columns);
    file.0[at..at + length].fill(0);
    let new = file.0.len().next_multiple_of(8);
    file.0.resize(new, 0);
    file.0.extend(counts.iter().flat_map(|count| count.to_le_bytes()));
    // A frame of one block that is not compressed: no encoder makes another.
    file.0.extend([0x28, 0xb5, 0x2f, 0xfd, 0xa0]);
    file.0.extend((columns.len() as u32).to_le_bytes());
    file.0.extend(&((columns.len() as u32) << 3 | 1).to_le_bytes()[..3]);
    file.0.extend(columns);
    let (entry, length) = (file.entry(b"INDX"), file.0.len());
    file.set_u64(entry + 8, new as u64);
    file.set_u64(entry + 16, (length - new) as u64);
    file.set_u64(32, length as u64);
    file.set_u32(56, length as u32);
}

#[cfg(feature = "zstd")]
fn unpack(frame: &[u8]) -> Vec<u8> {
    zstd::bulk::decompress(frame, 1 << 16).expect("a frame of the library")
}

/// Files in parts cannot be read then.
#[cfg(not(feature = "zstd"))]
fn unpack(_: &[u8]) -> Vec<u8> {
    unreachable!("files in parts are not made")
}

/// A rule, the name of a vector, whether all checksums are corrected afterwards or only those of the tables, and the change.
type Case = (&'static str, &'static str, bool, fn(&mut File));

const CASES: &[Case] = &[
    ("S001", "parts_whole", false, |f| {
        let entry = f.entry(b"PART");
        f.0[entry..entry + 5].copy_from_slice(b"part\0");
    }),
    ("S001", "parts_blocks", false, |f| {
        let length = f.entry(b"PART") + 16;
        f.set_u64(length, f.u64(length) - 4);
    }),
    ("S001", "parts_blocks", false, |f| {
        let length = f.entry(b"PART") + 16;
        f.set_u64(length, 0);
    }),
    ("S002", "parts_blocks", false, |f| {
        let size = entry(f, 1) + 4;
        f.set_u32(size, f.u32(size) + 8);
    }),
    ("S002", "parts_blocks", false, |f| {
        let size = entry(f, 0) + 4;
        f.set_u32(size, 16);
    }),
    ("S002", "parts_blocks", false, |f| {
        let length = f.entry(b"BLKS") + 16;
        f.set_u64(length, f.u64(length) - 8);
    }),
    ("S003", "parts_blocks", false, |f| {
        let block = entry(f, 2);
        f.set_u32(block, 3);
    }),
    ("S003", "parts_blocks", false, |f| {
        let last = entry(f, 1) + 9;
        f.0[last] = 23;
    }),
    ("S003", "parts_levels", false, |f| {
        let own = |index| f.u32(entry(f, index));
        let second = (1..count(f)).find(|index| (0..*index).any(|before| own(before) == own(*index)));
        let second = second.expect("two parts of a block");
        let first = entry(f, second) + 8;
        f.0[first] += 1;
    }),
    ("S003", "parts_whole", false, |f| {
        let last = entry(f, 0) + 9;
        f.0[last] = 0;
    }),
    ("S004", "parts_blocks", false, |f| {
        let at = places(f)[1];
        f.0[at] ^= 1;
    }),
    ("S004", "parts_levels", false, |f| {
        let at = places(f)[2] + 20;
        f.0[at] ^= 4;
    }),
    ("S005", "parts_blocks", true, |f| {
        let at = places(f)[1] + 8;
        f.0[at] ^= 1;
    }),
    ("S005", "parts_blocks", true, |f| {
        let at = places(f)[0] + 14;
        f.0[at] = 1;
    }),
    ("S005", "parts_blocks", true, |f| {
        let at = places(f)[0] + 15;
        f.0[at] = 1;
    }),
    // The array has two slots more; a form that there is not; a part of more descriptors; a stream that is not whole.
    ("S006", "parts_blocks", true, |f| {
        let at = places(f)[0] + 16;
        f.0[at] += 2;
    }),
    ("S006", "parts_blocks", true, |f| {
        let at = places(f)[0];
        let form = form(f, at);
        f.0[form] = 3;
    }),
    ("S006", "parts_blocks", true, |f| {
        let at = places(f)[0];
        let count = form(f, at) - 4;
        f.0[count] += 1;
    }),
    ("S006", "parts_pages", true, |f| {
        let last = places(f)[count(f) - 1] + f.u32(entry(f, count(f) - 1) + 4) as usize - 1;
        f.0[last] ^= 1;
    }),
    ("S006", "parts_blocks", true, |f| {
        let at = places(f)[0] + 20;
        f.0[at] = 4;
    }),
    ("S007", "parts_blocks", false, |f| {
        let reserved = entry(f, 1) + 10;
        f.0[reserved] = 1;
    }),
    ("S008", "parts_blocks", false, |f| {
        let at = f.block(1) + 40;
        f.set_u64(at, f.u64(at) + 8);
    }),
    ("S008", "parts_blocks", false, |f| {
        let size = f.block(1) + 48;
        f.set_u64(size, f.u64(size) + 1);
    }),
    ("S009", "parts_levels", true, reversed),
    ("H006", "parts_blocks", false, |f| f.set_u32(56, f.u32(56) + 8)),
    ("H006", "parts_blocks", false, |f| f.set_u32(56, 0)),
    ("I001", "parts_blocks", false, |f| {
        let index = f.section(b"INDX").0;
        f.0[index] += 1;
    }),
    ("I001", "parts_blocks", false, |f| {
        let index = f.entry(b"INDX");
        f.0[index..index + 4].copy_from_slice(b"PAGE");
        f.set_u32(56, 0);
    }),
    ("I001", "parts_blocks", false, |f| {
        // A column that ends too early.
        edit_index(f, |_, columns| {
            columns.pop();
        });
    }),
    // A link to a page that there is not; a block with another image size; a part that is left out.
    ("I002", "parts_blocks", false, |f| {
        edit_index(f, |counts, columns| {
            counts[2] = 1;
            columns.extend([0; 4 * 9]);
        });
    }),
    ("I003", "parts_blocks", false, |f| {
        edit_index(f, |counts, columns| columns[4 * 8 * counts[0] as usize] += 1);
    }),
    ("I003", "parts_blocks", false, |f| {
        edit_index(f, |counts, columns| {
            let blocks = 4 * 9 * counts[0] as usize;
            let count = counts[1] as usize;
            // The last byte of each stream.
            for stream in (0..4 * 6).rev() {
                columns.remove(blocks + stream * count + count - 1);
            }
            counts[1] -= 1;
        });
    }),
    ("B005", "parts_blocks", false, |f| f.set_u64(16, 2)),
    ("B005", "parts_whole", false, |f| {
        let stored = f.block(0) + 48;
        f.set_u64(stored, 8192);
    }),
    ("B006", "parts_blocks", false, |f| {
        let crc = f.block(2) + 60;
        f.0[crc] ^= 1;
    }),
    ("D009", "parts_blocks", false, |f| {
        let index =
            (0..count(f)).find(|index| f.u32(entry(f, *index) + 4) % 8 != 0).expect("a part with room after it");
        let end = places(f)[index] + f.u32(entry(f, index) + 4) as usize;
        f.0[end] = 1;
    }),
];

/// Offset of the form of the part at `at`, the first one of its block, with one level.
fn form(file: &File, at: usize) -> usize {
    let attachments = usize::from(file.0[at + 20]);
    let levels = usize::from(file.0[at + 13] - file.0[at + 12]) + 1;
    let mut next = at + 21;
    for _ in 0..attachments {
        next += if file.0[next] == 3 { 10 } else { 2 };
    }
    next + 4 * levels
}

/// All broken files in parts.
pub(crate) fn broken_parts() -> Vec<Broken> {
    let make = |&(rule, sample, all, change): &Case| {
        let mut file = vector(sample);
        change(&mut file);
        if all {
            seal_parts(&mut file)
        } else {
            seal_tables(&mut file)
        }
        Broken { rule, sample, bytes: file.0 }
    };
    CASES.iter().map(make).collect()
}
