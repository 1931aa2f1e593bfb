//! Compressed blocks: round trips, rewriting, determinism, damage, false claims about sizes.
#![cfg(feature = "zstd")]

mod common;

use common::patch::File;
use common::samples::samples;
use common::{Colors, Rng, Shape, bytes_of, compare};
use esvo_format::file::{CODEC_RAW, CODEC_ZSTD, FEATURE_COMPRESSED};
use esvo_format::{
    AssembleOptions, FormatError, Octree, OpenOptions, StreamReader, WriteOptions, assemble, ids, stats, validate,
    validate_bytes, validate_bytes_with, validate_file,
};
use glam::DMat4;
use proptest::prelude::*;

fn compressed(octree: &Octree, level: i32) -> Vec<u8> {
    let mut bytes = Vec::new();
    octree
        .write_to_with(&mut bytes, &WriteOptions { compress: Some(level), ..WriteOptions::default() })
        .expect("a level that there is");
    bytes
}

/// One colour and few contours, as random ones cannot be compressed.
fn shape(seed: u64, nodes: usize) -> Shape {
    Shape { seed, levels: 9, valid: 110, leaf: 20, contour: 5, colors: Colors::One, normals: false, nodes }
}

/// An octree of blocks of many sizes, some of them of one page.
fn mixed() -> Octree {
    let octree = assemble(
        &shape(4, 40_000).tree(),
        DMat4::from_scale(glam::DVec3::splat(2.0)),
        &AssembleOptions { block_slots: 8000, near_limit: 4000 },
    );
    let mut octree = octree.unwrap();
    octree.set_meta(r#"{"title":"mixed"}"#.into());
    octree
}

/// The file of [`mixed`], which has blocks of both codecs.
fn mixed_file() -> (Octree, File) {
    let octree = mixed();
    let file = File(compressed(&octree, 3));
    let codecs: Vec<u32> = (0..file.blocks()).map(|index| file.u32(file.block(index) + 56)).collect();
    assert!(codecs.contains(&CODEC_RAW) && codecs.iter().filter(|c| **c == CODEC_ZSTD).count() > 3, "{codecs:?}");
    (octree, file)
}

/// A compressed block of the file: index, offset, stored size.
fn frame(file: &File) -> (usize, usize, usize) {
    let index = (0..file.blocks()).find(|index| file.u32(file.block(*index) + 56) == CODEC_ZSTD).unwrap();
    (index, file.u64(file.block(index) + 40) as usize, file.u64(file.block(index) + 48) as usize)
}

/// The result of opening and of validating the bytes, which must agree.
fn broken(bytes: &[u8]) -> (&'static str, u64) {
    let Err(FormatError::Broken(broken)) = Octree::from_bytes(bytes) else { panic!("opened") };
    let report = validate_bytes(bytes).unwrap();
    assert_eq!(report.findings.len(), 1, "{report}");
    assert_eq!(report.findings[0].broken, broken);
    (broken.rule, broken.offset)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn octrees_come_back_from_compressed_files(
        seed: u64, levels in 1u32..=9, block_slots in 64u32..9000, contour in 0u32..256, normals: bool, level in 1i32..=19,
    ) {
        let tree = Shape { levels, contour, normals, ..shape(seed, 3000) }.tree();
        let octree =
            assemble(&tree, DMat4::IDENTITY, &AssembleOptions { block_slots, ..AssembleOptions::default() }).unwrap();
        let bytes = compressed(&octree, level);
        prop_assert!(bytes.len() <= bytes_of(&octree).len());
        let report = validate_bytes(&bytes).unwrap();
        prop_assert!(report.findings.is_empty(), "{report}");
        let read = Octree::from_bytes(&bytes).unwrap();
        prop_assert!(read.slots() == octree.slots());
        compare(&tree, &read);
        prop_assert_eq!(stats(&read), stats(&octree));
        // Writing it again gives the same bytes when compressed, and those of the original octree when uncompressed.
        prop_assert!(compressed(&read, level) == bytes);
        prop_assert!(bytes_of(&read) == bytes_of(&octree));
        // Also block by block.
        let all: Vec<u32> = (0..octree.blocks().len() as u32).collect();
        let streamed = StreamReader::open(&bytes).unwrap().partial(&all).unwrap();
        prop_assert!(streamed.slots() == octree.slots());
    }
}

#[test]
fn a_compressed_file_says_so_and_is_smaller() {
    let (octree, file) = mixed_file();
    assert_eq!(file.u64(16), FEATURE_COMPRESSED);
    let raw = bytes_of(&octree);
    assert!(file.0.len() < raw.len() * 9 / 10, "{} of {} bytes", file.0.len(), raw.len());
    assert_eq!(File(raw.clone()).u64(16), 0);
    // If compression saves no page, blocks stay uncompressed, and the file can be mapped.
    for (name, octree) in samples() {
        assert!(octree.blocks().iter().all(|block| block.image_size == 8192), "{name}");
        assert_eq!(compressed(&octree, 19), bytes_of(&octree), "{name}");
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.esvo");
    octree.write_with(&path, &WriteOptions { compress: Some(3), ..WriteOptions::default() }).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), file.0);
    let opened = Octree::open(&path).unwrap();
    assert!(opened.slots() == octree.slots());
    assert_eq!(opened.meta(), octree.meta());
    assert!(validate_file(&path).unwrap().findings.is_empty() && validate(&opened).findings.is_empty());
}

#[test]
fn levels_that_there_are_not_are_refused_and_nothing_is_left() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.esvo");
    for level in [i32::MIN, -1, 0, 23, 99] {
        let error = mixed()
            .write_with(&path, &WriteOptions { compress: Some(level), ..WriteOptions::default() })
            .unwrap_err()
            .to_string();
        assert!(error.contains(&format!("compression level is {level}, expected 1 to 22")), "{error}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}

#[test]
fn the_same_bytes_whatever_the_threads() {
    let octree = mixed();
    let (raw, packed) = (bytes_of(&octree), compressed(&octree, 9));
    for threads in [1, 2, 7] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            assert!(bytes_of(&octree) == raw);
            assert!(compressed(&octree, 9) == packed);
            assert!(bytes_of(&Octree::from_bytes(&packed).unwrap()) == raw);
            let options = AssembleOptions { block_slots: 8000, near_limit: 4000 };
            let again = assemble(&shape(4, 40_000).tree(), DMat4::IDENTITY, &options).unwrap();
            assert!(again.slots() == octree.slots());
        });
    }
}

/// A file with unknown sections: one with a checksum, one flagged as having its own checksums, an empty one.
fn with_unknown(octree: &Octree) -> Vec<u8> {
    let mut file = File(bytes_of(octree));
    assert_eq!(file.sections(), 4);
    let (entry, data) = (file.entry(b"META"), file.entry(b"BLKS"));
    assert_eq!(data, entry + 32);
    // The metadata becomes two sections; the tables and everything after them move by two directory entries.
    let (meta, length) = file.section(b"META");
    let first_page = file.0[..8192].to_vec();
    let directory_end = data + 32;
    file.0[directory_end + 64..8192].copy_from_slice(&first_page[directory_end..8192 - 64]);
    for entry in (64..data).step_by(32) {
        let offset = file.u64(entry + 8) + 64;
        file.set_u64(entry + 8, offset);
    }
    file.0.copy_within(data..directory_end, data + 64);
    let sections = [
        (b"abcd", 0, meta + 64, 8),
        (b"wxyz", 2, meta + 72, length - 8),
        (b"none", 0, meta + 64 + length.next_multiple_of(8), 0),
    ];
    for (k, (tag, flags, offset, length)) in sections.into_iter().enumerate() {
        let entry = entry + 32 * k;
        file.0[entry..entry + 4].copy_from_slice(tag);
        file.set_u32(entry + 4, flags);
        file.set_u64(entry + 8, offset as u64);
        file.set_u64(entry + 16, length as u64);
    }
    file.set_u32(48, 6);
    file.seal();
    file.0
}

#[test]
fn unknown_sections_survive_every_rewrite() {
    let octree = mixed();
    let bytes = with_unknown(&octree);
    assert!(validate_bytes(&bytes).unwrap().findings.is_empty(), "{}", validate_bytes(&bytes).unwrap());
    let read = Octree::from_bytes(&bytes).unwrap();
    let kept: Vec<_> = read.unknown_sections().iter().map(|s| (s.tag, s.flags, s.bytes.len())).collect();
    let length = octree.meta().len();
    assert_eq!(kept, [(*b"abcd", 0, 8), (*b"wxyz", 2, length - 8), (*b"none", 0, 0)]);
    assert_eq!(bytes_of(&read), bytes, "raw to raw");
    let packed = compressed(&read, 3);
    assert!(packed.len() < bytes.len());
    let unpacked = Octree::from_bytes(&packed).unwrap();
    assert_eq!(unpacked.unknown_sections(), read.unknown_sections());
    assert_eq!(compressed(&unpacked, 3), packed, "compressed to compressed");
    assert_eq!(bytes_of(&unpacked), bytes, "compressed to raw");
    let reader = StreamReader::open(&packed).unwrap();
    assert_eq!(reader.section(*b"wxyz").unwrap().unwrap(), read.unknown_sections()[1].bytes);
}

#[test]
fn every_flipped_bit_of_a_stored_block_is_reported() {
    let (_, file) = mixed_file();
    let mut rng = Rng(5);
    let mut damaged = file.0.clone();
    for _ in 0..300 {
        let index = rng.below(file.blocks() as u64) as usize;
        let (start, size) = (file.u64(file.block(index) + 40), file.u64(file.block(index) + 48));
        let (byte, bit) = ((start + rng.below(size)) as usize, rng.below(8));
        damaged[byte] ^= 1 << bit;
        assert_eq!(broken(&damaged), (ids::BLOCK_CHECKSUM, start));
        let reader = StreamReader::open(&damaged).unwrap();
        let Err(FormatError::Broken(broken)) = reader.read_block(index as u32) else { panic!("read") };
        assert_eq!((broken.rule, broken.offset), (ids::BLOCK_CHECKSUM, start));
        damaged[byte] ^= 1 << bit;
    }
    // After a frame there are zeros up to the next page.
    let (_, start, size) = frame(&file);
    damaged[start + size] = 1;
    let report = validate_bytes(&damaged).unwrap();
    assert_eq!(report.findings.len(), 1, "{report}");
    assert_eq!((report.findings[0].broken.rule, report.findings[0].broken.offset), ("D009", (start + size) as u64));
}

#[test]
fn of_several_damaged_blocks_the_first_is_named() {
    let (_, file) = mixed_file();
    let mut damaged = file.0.clone();
    for index in [2, 5, 6] {
        damaged[file.u64(file.block(index) + 40) as usize + 9] ^= 4;
    }
    for _ in 0..20 {
        assert_eq!(broken(&damaged).1, file.u64(file.block(2) + 40));
    }
}

/// Replaces a frame by other stored bytes, and corrects all checksums.
fn replace(file: &File, bytes: &[u8]) -> Vec<u8> {
    let (index, start, size) = frame(file);
    assert!(bytes.len() <= size.next_multiple_of(8192), "{} bytes for {size}", bytes.len());
    let mut file = file.clone();
    file.0[start..start + size].fill(0);
    file.0[start..start + bytes.len()].copy_from_slice(bytes);
    let at = file.block(index) + 48;
    file.set_u64(at, bytes.len() as u64);
    file.seal();
    file.0
}

#[test]
fn a_frame_is_one_and_holds_the_image_exactly() {
    let (octree, file) = mixed_file();
    let (index, start, size) = frame(&file);
    let entry = octree.blocks()[index];
    let image: &[u8] = bytemuck::cast_slice(octree.slots());
    let image = &image[entry.image_offset as usize..][..entry.image_size as usize];
    let pack = |bytes: &[u8]| zstd::bulk::compress(bytes, 19).unwrap();
    assert!(Octree::from_bytes(&replace(&file, &pack(image))).is_ok(), "another level is as good");
    let stored = &file.0[start..start + size];
    let skippable = [&0x184D_2A50u32.to_le_bytes()[..], &4u32.to_le_bytes(), b"skip"].concat();
    let longer = [image, &[0]].concat();
    let halves = [pack(&image[..100]), pack(&image[100..])].concat();
    // A frame without content size that decompresses to 100 MB of zeros.
    let mut bomb = zstd::Encoder::new(Vec::new(), 1).unwrap();
    for _ in 0..100 {
        std::io::Write::write_all(&mut bomb, &vec![0u8; 1_000_000]).unwrap();
    }
    let bomb = bomb.finish().unwrap();
    for (what, bytes) in [
        ("shorter", &pack(&image[1..])[..]),
        ("longer", &pack(&longer)),
        ("nothing", &[]),
        ("an empty frame", &pack(&[])),
        ("two frames", &halves),
        ("a frame to skip before", &[&skippable, stored].concat()),
        ("a frame to skip behind", &[&pack(image)[..], &skippable].concat()),
        ("only a frame to skip", &skippable),
        ("cut", &stored[..size - 1]),
        ("something behind", &[&pack(image)[..], &[0; 9]].concat()),
        ("no frame", &[7; 3000]),
        ("a bomb", &bomb),
    ] {
        let bytes = replace(&file, bytes);
        assert_eq!(broken(&bytes).0, ids::BLOCK_CODEC, "{what}");
        let error = StreamReader::open(&bytes).and_then(|reader| reader.read_block(index as u32)).unwrap_err();
        assert!(error.to_string().contains("B005"), "{what}: {error}");
    }
}

#[test]
fn damage_under_right_checksums_is_survived() {
    let (_, file) = mixed_file();
    let mut rng = Rng(17);
    let mut found = 0;
    for _ in 0..400 {
        let mut file = file.clone();
        for _ in 0..=rng.below(3) {
            let block = rng.below(file.blocks() as u64) as usize;
            let start = file.u64(file.block(block) + 40) as usize;
            let byte = match rng.below(3) {
                0 => file.block(block) + rng.below(72) as usize,
                _ => start + rng.below(300) as usize,
            };
            if let Some(byte) = file.0.get_mut(byte) {
                *byte ^= 1 << rng.below(8);
            }
        }
        file.seal();
        let options = OpenOptions { memory_limit: 1 << 24, ..OpenOptions::default() };
        match validate_bytes_with(&file.0, &options) {
            Ok(report) => found += u32::from(!report.is_ok()),
            Err(FormatError::Limit(_)) => found += 1,
            Err(other) => panic!("{other}"),
        }
        if let Ok(octree) = Octree::from_bytes_with(&file.0, &options) {
            let _ = octree.sound();
            stats(&octree);
        }
    }
    assert!(found > 350, "only {found} of the changes were noticed");
}

#[test]
fn claims_cost_no_memory() {
    let (octree, file) = mixed_file();
    let image: u64 = octree.blocks().iter().map(|b| b.image_size).sum();
    let refused = |limit, bytes: &[u8]| match Octree::from_bytes_with(
        bytes,
        &OpenOptions { memory_limit: limit, ..OpenOptions::default() },
    ) {
        Err(FormatError::Limit(what)) => assert!(what.contains(&image.to_string()), "{what}"),
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("opened within {limit}"),
    };
    refused(image - 1, &file.0);
    refused(0, &file.0);
    assert!(Octree::from_bytes_with(&file.0, &OpenOptions { memory_limit: image, ..OpenOptions::default() }).is_ok());
    assert!(matches!(
        validate_bytes_with(&file.0, &OpenOptions { memory_limit: image - 1, ..OpenOptions::default() }),
        Err(FormatError::Limit(_))
    ));
    // The last block claims to decompress from some thousand bytes to 16 GiB.
    let mut claim = file.clone();
    let last = claim.blocks() - 1;
    let at = claim.block(last);
    claim.set_u64(at + 32, 16 << 30);
    claim.set_u32(at + 56, CODEC_ZSTD);
    claim.set_u64(at + 48, 5000);
    claim.seal();
    let unlimited = OpenOptions { memory_limit: u64::MAX, ..OpenOptions::default() };
    let Err(FormatError::Broken(broken)) = Octree::from_bytes_with(&claim.0, &unlimited) else { panic!("opened") };
    assert_eq!(broken.rule, ids::BLOCK_CODEC);
    // A size that no block can have.
    claim.set_u64(at + 32, u64::MAX - 8191);
    claim.seal();
    let Err(FormatError::Broken(broken)) = Octree::from_bytes_with(&claim.0, &unlimited) else { panic!("opened") };
    assert!([ids::BLOCK_LIMIT, ids::BLOCK_CODEC].contains(&broken.rule), "{broken}");
}

#[test]
fn tables_of_compressed_files_are_checked() {
    let (_, file) = mixed_file();
    let (index, start, _) = frame(&file);
    let other = (0..file.blocks()).find(|i| *i != index).unwrap();
    type Change = fn(&mut File, usize, usize, usize);
    let cases: [(&str, Change); 7] = [
        ("B005", |f, _, _, _| f.set_u64(16, 0)),
        ("B005", |f, at, _, _| f.set_u32(at + 56, 2)),
        ("B005", |f, at, _, _| f.set_u32(at + 56, CODEC_RAW)),
        ("B004", |f, at, _, _| {
            let offset = f.u64(at + 40) + 8;
            f.set_u64(at + 40, offset);
        }),
        ("B004", |f, at, _, other| {
            let offset = f.u64(other + 40);
            f.set_u64(at + 40, offset);
        }),
        ("B004", |f, at, _, _| f.set_u64(at + 40, u64::MAX - 8191)),
        ("B004", |f, at, _, _| f.set_u64(at + 48, u64::MAX)),
    ];
    for (number, (rule, change)) in cases.into_iter().enumerate() {
        let mut changed = file.clone();
        let (at, other) = (changed.block(index), changed.block(other));
        change(&mut changed, at, start, other);
        changed.seal();
        assert_eq!(broken(&changed.0).0, rule, "case {number}");
    }
}

/// Findings in an uncompressed block of such a file have their offset in the file.
#[test]
fn findings_in_a_mixed_file_say_where() {
    let (_, mut file) = mixed_file();
    let raw = (0..file.blocks()).find(|index| file.u32(file.block(*index) + 56) == CODEC_RAW).unwrap();
    let start = file.u64(file.block(raw) + 40) as usize;
    file.0[start + 8] = 1;
    file.seal();
    let report = validate_bytes(&file.0).unwrap();
    assert_eq!(report.findings.len(), 1, "{report}");
    assert_eq!((report.findings[0].broken.rule, report.findings[0].broken.offset), ("P006", start as u64 + 8));
}
