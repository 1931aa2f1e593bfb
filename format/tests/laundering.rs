//! Nothing that writes an octree takes a damaged one: damage would get right checksums.
//!
//! Flips single bytes and pairs of bytes of files of every kind, and gives each file to everything that writes.

mod common;

use std::collections::BTreeMap;

use common::patch::File;
use common::samples::samples;
use common::{Colors, Rng, Shape, bytes_of};
use esvo_format::{
    AssembleOptions, Broken, FormatError, Octree, OpenOptions, Report, StreamReader, WriteOptions, assemble, diff, ids,
    oct, validate_bytes,
};
use glam::DMat4;

/// Damaged files in all.
const FLIPS: usize = 500;

fn packed(octree: &Octree) -> Vec<u8> {
    let mut bytes = Vec::new();
    octree
        .write_to_with(&mut bytes, &WriteOptions { compress: Some(3), ..WriteOptions::default() })
        .expect("writing to memory does not fail");
    bytes
}

/// Name and bytes of each file: small ones of every kind, larger ones, and compressed ones.
fn files() -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<(String, Vec<u8>)> = Vec::new();
    for (name, octree) in samples() {
        files.push((name.into(), bytes_of(&octree)));
    }
    for (name, contour, colors, block_slots) in [
        ("large cubes", 0, Colors::None, 1 << 20),
        ("large contours", 200, Colors::Many, 1 << 20),
        ("many blocks", 128, Colors::Many, 64),
        ("one colour", 0, Colors::One, 512),
    ] {
        let shape =
            Shape { seed: 3, levels: 6, valid: 130, leaf: 40, contour, colors, normals: contour > 0, nodes: 1200 };
        let options = AssembleOptions { block_slots, near_limit: 32767 };
        let octree = assemble(&shape.tree(), DMat4::IDENTITY, &options).expect("a well-formed tree");
        files.push((name.into(), bytes_of(&octree)));
        files.push((format!("{name}, compressed"), packed(&octree)));
        let lit = octree.with_ambient_occlusion(|slot, child| (slot * 31) as u8 ^ child).expect("room for it");
        files.push((format!("{name}, ambient"), bytes_of(&lit)));
    }
    files
}

/// The files, each damaged several times, and where.
fn damaged() -> impl Iterator<Item = (String, Vec<u8>, Vec<u8>, Vec<usize>)> {
    let files = files();
    let mut rng = Rng(0xda3a6e);
    (0..FLIPS).map(move |flip| {
        let (name, whole) = &files[flip % files.len()];
        let mut bytes = whole.clone();
        let places: Vec<usize> = (0..=flip / files.len() % 2)
            .map(|_| {
                // A quarter in what is before the blocks, which is mostly shorter than they are; a quarter anywhere; half at
                // a byte that is not zero, as most of a small file is padding. The last such bytes are values of voxels.
                let (kind, place) = (rng.below(4), rng.below(whole.len() as u64) as usize);
                let value = match kind {
                    0 => return place % 1024,
                    1 => None,
                    2 => whole[place..].iter().position(|byte| *byte != 0).map(|ahead| place + ahead),
                    _ => whole[..whole.len() - place / 4].iter().rposition(|byte| *byte != 0),
                };
                value.unwrap_or(place)
            })
            .collect();
        for &place in &places {
            bytes[place] ^= 1 + rng.below(255) as u8;
        }
        // Two flips may cancel out.
        if bytes == *whole {
            bytes[places[0]] ^= 1;
        }
        (format!("{name}, flip {flip} at {places:?}"), whole.clone(), bytes, places)
    })
}

/// The rule of an error, which must be one that the validator finds.
#[track_caller]
fn rule<T>(what: &str, report: &Report, result: Result<T, FormatError>) -> &'static str {
    let Err(error) = result else { panic!("{what}: succeeded") };
    let FormatError::Broken(broken) = error else { panic!("{what}: {error}") };
    found(what, report, &broken)
}

#[track_caller]
fn found(what: &str, report: &Report, broken: &Broken) -> &'static str {
    assert!(report.findings.iter().any(|f| !f.warning && f.broken == *broken), "{what}: {broken} is not in\n{report}");
    broken.rule
}

#[test]
fn nothing_writes_a_damaged_octree() {
    let folder = tempfile::tempdir().expect("a folder");
    let (input, output) = (folder.path().join("in.esvo"), folder.path().join("out.esvo"));
    let mut rules: BTreeMap<&str, usize> = BTreeMap::new();
    for (what, whole, bytes, _) in damaged() {
        let report = validate_bytes(&bytes).unwrap_or_else(|e| panic!("{what}: {e}"));
        assert!(!report.is_ok(), "{what}: no rule covers it");
        std::fs::write(&input, &bytes).expect("writes");
        // Mapped, and in memory.
        let octrees = match (Octree::open(&input), Octree::from_bytes(&bytes)) {
            (Ok(mapped), Ok(copied)) => [mapped, copied],
            (mapped, copied) => {
                let first = rule(&what, &report, mapped);
                assert_eq!(first, rule(&what, &report, copied), "{what}");
                *rules.entry(first).or_default() += 1;
                continue;
            }
        };
        for octree in &octrees {
            let intact = octree.intact().expect_err(&what);
            *rules.entry(found(&what, &report, &intact)).or_default() += 1;
            let first = rule(&what, &report, octree.verified().map_err(FormatError::from));
            assert_eq!(first, intact.rule, "{what}");
            let mut out = Vec::new();
            let error = octree.write_to(&mut out).expect_err(&what);
            let inner = error.get_ref().and_then(|e| e.downcast_ref::<Broken>()).expect("a broken rule");
            assert!(*inner == intact && out.is_empty(), "{what}: {inner}");
            for options in [WriteOptions::default(), WriteOptions { compress: Some(1), ..WriteOptions::default() }] {
                assert_eq!(rule(&what, &report, octree.write_with(&output, &options)), first, "{what}");
            }
            assert_eq!(rule(&what, &report, oct::write(octree, &output)), first, "{what}");
            assert_eq!(rule(&what, &report, oct::write_to(octree, &mut out)), first, "{what}");
            assert_eq!(rule(&what, &report, octree.with_ambient_occlusion(|_, _| 9)), first, "{what}");
            assert_eq!(rule(&what, &report, diff::diff(octree, octree, 1)), first, "{what}");
            assert!(out.is_empty() && !output.exists(), "{what}: something was written");
        }
        // A reader of blocks fetches no gaps. It finds all other damage.
        let reader = StreamReader::open(&bytes).expect("the tables are right");
        let all: Vec<u32> = (0..reader.blocks().len() as u32).collect();
        match reader.partial(&all) {
            Ok(part) => {
                assert_eq!(octrees[0].intact().expect_err(&what).rule, ids::FILE_GAPS, "{what}");
                let right = Octree::from_bytes(&whole).expect("our own bytes");
                assert!(part.slots() == right.slots() && part.objects() == right.objects(), "{what}");
            }
            Err(error) => assert_eq!(rule::<()>(&what, &report, Err(error)), ids::BLOCK_CHECKSUM, "{what}"),
        }
    }
    println!("{rules:?}");
    assert!(rules[ids::BLOCK_CHECKSUM] > 300 && rules[ids::FILE_GAPS] > 20 && rules.len() > 5, "{rules:?}");
}

/// The test above can fail: a writer that does not verify gives damage right checksums, and the validator finds nothing.
#[test]
fn without_verification_damage_is_laundered() {
    let mut laundered = 0;
    for (what, whole, bytes, _) in damaged() {
        let Ok(octree) = Octree::from_bytes(&bytes) else { continue };
        let parts = (octree.objects().to_vec(), octree.blocks().to_vec(), octree.slots().to_vec());
        let Ok(copy) = Octree::from_parts(parts.0, parts.1, parts.2) else { continue };
        let clean = validate_bytes(&bytes_of(&copy)).expect("within all limits").is_ok();
        let right = Octree::from_bytes(&whole).expect("our own bytes");
        laundered += usize::from(clean && copy.slots() != right.slots());
        assert!(octree.verified().is_err(), "{what}");
    }
    println!("{laundered} of {FLIPS} files");
    assert!(laundered > 50, "only {laundered}");
}

#[test]
fn broken_rules_under_right_checksums_are_not_written_again() {
    // A zero at the place of the first contour: its normal is zero, which breaks K004.
    let (_, octree) = samples().swap_remove(1);
    let mut file = File(bytes_of(&octree));
    let pool = file.pool(0);
    file.set_u32(pool, 0);
    file.seal();
    let octree = Octree::from_bytes(&file.0).expect("opens");
    assert!(octree.intact().is_ok() && octree.sound().is_ok());
    assert_eq!(octree.verified().expect_err("a zero normal").rule, ids::CONTOUR_NORMAL);
    assert!(octree.write_to(&mut Vec::new()).is_err());
    // Neither as a part.
    let part = StreamReader::open(&file.0).and_then(|reader| reader.partial(&[0])).expect("its pointers are right");
    assert_eq!(part.verified().expect_err("a zero normal").rule, ids::CONTOUR_NORMAL);
    assert!(part.write_to(&mut Vec::new()).is_err());
}

#[test]
fn checksums_can_be_left_out_for_reading_but_not_for_writing() {
    let (_, octree) = samples().swap_remove(4);
    let mut bytes = bytes_of(&octree);
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    let options = OpenOptions { verify: false, ..OpenOptions::default() };
    let octree = Octree::from_bytes_with(&bytes, &options).expect("opens");
    assert!(octree.intact().is_ok());
    assert_eq!(octree.check_block(0).map_err(|e| e.to_string()).expect_err("damaged").matches("B006").count(), 1);
    assert!(octree.check_block(1).is_err_and(|e| e.to_string().contains("no block 1")));
    assert!(octree.write_to(&mut Vec::new()).is_err());
    // Metadata that was replaced is checked anew.
    let mut right = Octree::from_bytes(&bytes_of(&samples().swap_remove(4).1)).expect("our own bytes");
    assert!(right.verified().is_ok());
    right.set_meta("no JSON".into());
    assert_eq!(right.verified().expect_err("no JSON").rule, ids::META_JSON);
    right.set_meta("{}".into());
    assert!(right.verified().is_ok() && right.write_to(&mut Vec::new()).is_ok());
}
