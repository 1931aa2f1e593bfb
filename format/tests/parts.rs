//! Blocks stored in parts: round trips, parts by level as octrees, damage.
#![cfg(feature = "zstd")]

mod common;

use std::collections::{BTreeMap, BTreeSet};

use common::samples::samples;
use common::{Colors, Rng, Shape, bytes_of, shapes};
use esvo_format::file::{CODEC_FIELDS, FEATURE_COMPRESSED, FEATURE_PARTS, LAST_LEVEL};
use esvo_format::{
    AssembleOptions, BlockStore, FormatError, Octree, Region, StreamReader, WriteOptions, assemble, pack, validate,
    validate_bytes, validate_bytes_with,
};
use glam::{DMat4, DVec3};
use proptest::prelude::*;

const PARTS: WriteOptions = WriteOptions { compress: None, parts: true };

fn in_parts(octree: &Octree) -> Vec<u8> {
    let mut bytes = Vec::new();
    octree.write_to_with(&mut bytes, &PARTS).expect("writing to memory does not fail");
    bytes
}

fn shape() -> impl Strategy<Value = Shape> {
    shapes(1..=9, 40..=256, 3000)
}

fn options() -> impl Strategy<Value = AssembleOptions> {
    (prop_oneof![Just(64u32), 100u32..3000, Just(1 << 20)], prop_oneof![1u32..100, Just(32767)])
        .prop_map(|(block_slots, near_limit)| AssembleOptions { block_slots, near_limit })
}

/// An octree of dozens of blocks, with contours, colours and normals.
fn many_blocks() -> Octree {
    let shape = Shape {
        seed: 4,
        levels: 8,
        valid: 90,
        leaf: 20,
        contour: 90,
        colors: Colors::Many,
        normals: true,
        nodes: 4000,
    };
    let octree = assemble(&shape.tree(), DMat4::IDENTITY, &AssembleOptions { block_slots: 400, near_limit: 50 });
    let octree = octree.expect("a tree");
    assert!(octree.blocks().len() > 3, "{} blocks", octree.blocks().len());
    octree
}

/// Writes in parts, reads, compares everything, validates, and writes without parts.
fn check_round_trip(octree: &Octree) -> Result<Vec<u8>, TestCaseError> {
    let bytes = in_parts(octree);
    let report = validate_bytes(&bytes).expect("no limit");
    prop_assert!(report.findings.is_empty(), "{report}");
    let back = Octree::from_bytes(&bytes).expect("our own file");
    prop_assert!(back.slots() == octree.slots());
    prop_assert_eq!(back.objects(), octree.objects());
    prop_assert_eq!(back.meta(), octree.meta());
    prop_assert!(bytes_of(&back) == bytes_of(octree), "the file without parts is as before");
    prop_assert!(in_parts(&back) == bytes, "the same octree gives the same bytes");
    Ok(bytes)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn nothing_is_lost(shape in shape(), options in options()) {
        let octree = assemble(&shape.tree(), DMat4::IDENTITY, &options).expect("a tree");
        let bytes = check_round_trip(&octree)?;
        let reader = StreamReader::open(&bytes).expect("our own file");
        prop_assert!(reader.blocks().iter().all(|block| block.codec == CODEC_FIELDS));
        let all: Vec<u32> = (0..reader.parts().len() as u32).collect();
        prop_assert!(reader.partial_parts(&all).expect("all parts").slots() == octree.slots());
        let blocks: Vec<u32> = (0..octree.blocks().len() as u32).collect();
        prop_assert!(reader.partial(&blocks).expect("all blocks").slots() == octree.slots());
    }

    #[test]
    fn parts_that_are_closed_upwards_are_an_octree(shape in shape(), options in options(), seed in any::<u64>()) {
        let octree = assemble(&shape.tree(), DMat4::IDENTITY, &options).expect("a tree");
        let bytes = in_parts(&octree);
        let reader = StreamReader::open(&bytes).expect("our own file");
        let mut rng = Rng(seed);
        let chance = 60 + rng.below(190) as u32;
        // Of each block a few parts from the first on; blocks whose parents are not there are taken out again.
        let mut chosen = Vec::new();
        let mut there = vec![false; reader.blocks().len()];
        let mut own: BTreeMap<u32, Vec<(u8, u32)>> = BTreeMap::new();
        for (index, part) in reader.parts().iter().enumerate() {
            own.entry(part.block).or_default().push((part.first_level, index as u32));
        }
        for (block, mut parts) in own {
            parts.sort_unstable();
            let parent = reader.blocks()[block as usize].parent;
            let root = parent == u32::MAX;
            if !root && !there[parent as usize] {
                continue;
            }
            let count = parts.iter().take_while(|_| rng.chance(chance)).count().max(usize::from(root));
            there[block as usize] = count > 0;
            chosen.extend(parts[..count].iter().map(|part| part.1));
        }
        let part = reader.partial_parts(&chosen).expect("closed");
        prop_assert!(validate(&part).findings.is_empty(), "{}", validate(&part));
        let (whole, cut) = (voxels(&octree), voxels(&part));
        for (path, voxel) in &cut {
            let other = &whole[path];
            prop_assert_eq!(&voxel.1, &other.1, "values of {}", path);
            prop_assert!(voxel.0 || !other.0, "{} is a leaf only in the whole", path);
        }
    }
}

/// Every voxel by its path: whether it is a leaf, and its values.
fn voxels(octree: &Octree) -> BTreeMap<String, (bool, String)> {
    let mut found = BTreeMap::new();
    for (number, object) in octree.objects().iter().enumerate() {
        let mut stack = vec![(object.root_slot as u32, format!("{number}:"))];
        while let Some((slot, path)) = stack.pop() {
            for child in (0..8).filter(|child| octree.descriptor(slot).valid_mask() >> child & 1 != 0) {
                let below = octree.child(slot, child);
                let values = format!(
                    "{:?} {:?} {:?} {:?} {:?}",
                    octree.contour(slot, child),
                    octree.color(slot, child),
                    octree.normal(slot, child),
                    octree.ambient(slot, child),
                    octree.corners(slot, child)
                );
                let path = format!("{path}{child}");
                found.insert(path.clone(), (below.is_none(), values));
                stack.extend(below.map(|below| (below, path)));
            }
        }
    }
    found
}

#[test]
fn levels_are_those_asked_for() {
    let octree = many_blocks();
    let bytes = in_parts(&octree);
    let reader = StreamReader::open(&bytes).expect("our own file");
    let whole = voxels(&octree);
    let mut sizes = BTreeSet::new();
    for level in 1..=octree.objects()[0].levels {
        let parts = reader.parts_for(0, &Region::ALL, level);
        let octree = reader.partial_parts(&parts).expect("closed");
        assert!(validate(&octree).findings.is_empty(), "{}", validate(&octree));
        let found = voxels(&octree);
        for path in whole.keys().filter(|path| path.len() - 2 <= level as usize) {
            assert!(found.contains_key(path), "{path} is missing at level {level}");
        }
        assert!(found.iter().all(|(path, voxel)| voxel.1 == whole[path].1));
        sizes.insert(parts.iter().map(|part| u64::from(reader.parts()[*part as usize].size)).sum::<u64>());
    }
    assert!(sizes.len() > 3, "{sizes:?}");
    let (first, last) = (sizes.first(), sizes.last());
    assert!(first.is_some_and(|first| first * 20 < *last.expect("some")), "{sizes:?}");
    // The whole of a level lies together.
    let reads = reader.reads();
    reader.partial_parts(&reader.parts_for(0, &Region::ALL, 5)).expect("closed");
    assert_eq!(reader.reads() - reads, 1, "one range");
    // A corner takes less.
    let corner = Region { low: DVec3::ZERO, high: DVec3::splat(0.2) };
    assert!(reader.parts_for(0, &corner, 8).len() < reader.parts().len() / 2);
}

#[test]
fn samples_of_every_kind_come_back() {
    for (name, octree) in samples() {
        let bytes = check_round_trip(&octree).unwrap_or_else(|error| panic!("{name}: {error}"));
        let reader = StreamReader::open(&bytes).expect("our own file");
        // Streams do not know components.
        let in_fields = name != "components";
        assert!(reader.blocks().iter().all(|block| (block.codec == CODEC_FIELDS) == in_fields), "{name}");
        let features = if in_fields { FEATURE_COMPRESSED | FEATURE_PARTS } else { FEATURE_PARTS };
        assert_eq!(reader.header().required_features, features, "{name}");
        let level = reader.parts_for(0, &Region::ALL, 1);
        assert!(validate(&reader.partial_parts(&level).expect("closed")).is_ok(), "{name}");
    }
}

#[test]
fn what_the_codec_does_not_know_is_stored_whole() {
    // An odd array, which the layout never has.
    let sample = samples().swap_remove(0).1;
    let mut image = sample.slots().to_vec();
    let (array, info) = (image[0] as usize, 4);
    image.copy_within(array..array + info, array + 1);
    image[array] = 0;
    image[0] += 1;
    let words: &mut [u32] = bytemuck::cast_slice_mut(&mut image);
    words[2 * (array + 1) + 1] += 1;
    words[2 * (array + 1) + 2] += 1;
    let octree = Octree::from_parts(sample.objects().to_vec(), sample.blocks().to_vec(), image).expect("valid");
    assert!(validate(&octree).findings.is_empty(), "{}", validate(&octree));
    let bytes = check_round_trip(&octree).expect("round trip");
    let reader = StreamReader::open(&bytes).expect("our own file");
    assert_ne!(reader.blocks()[0].codec, CODEC_FIELDS);
    assert_eq!(reader.parts()[0].last_level, LAST_LEVEL);
    assert!(reader.partial_parts(&[0]).expect("one part").slots() == octree.slots());
}

#[test]
fn a_store_writes_the_same_file() {
    let shape =
        Shape { seed: 9, levels: 7, valid: 90, leaf: 20, contour: 90, colors: Colors::Many, normals: true, nodes: 500 };
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("parts.esvo");
    let store = BlockStore::in_memory();
    let root = store.put(pack(&shape.tree(), None, &AssembleOptions::default()).expect("a tree")).expect("room");
    store.write(root, DMat4::IDENTITY, "{}", &path, &PARTS).expect("written");
    let written = std::fs::read(&path).expect("a file");
    let mut octree = store.octree(root, DMat4::IDENTITY).expect("an octree");
    octree.set_meta("{}".into());
    assert!(written == in_parts(&octree));
    assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 1, "no temporary file is left");
}

#[test]
fn every_bit_that_flips_is_noticed() {
    for (name, octree) in samples().into_iter().filter(|(name, _)| matches!(*name, "blocks" | "everything")) {
        let mut bytes = in_parts(&octree);
        assert!(validate_bytes(&bytes).expect("no limit").findings.is_empty());
        for bit in 0..bytes.len() * 8 {
            // The minor version and the optional features may be anything, but the header has a checksum.
            bytes[bit / 8] ^= 1 << (bit % 8);
            let refused = validate_bytes(&bytes).map_or(true, |report| !report.is_ok());
            assert!(refused, "{name}: bit {bit}");
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
    }
}

#[test]
fn sets_that_are_not_closed_are_refused() {
    let bytes = in_parts(&many_blocks());
    let reader = StreamReader::open(&bytes).expect("our own file");
    let later = |(index, part): &(usize, &esvo_format::file::PartEntry)| {
        reader.parts()[..*index].iter().any(|other| other.block == part.block)
    };
    let second = reader.parts().iter().enumerate().find(later).expect("a second part of a block").0;
    let refused = |parts: &[u32], what: &str| {
        let error = reader.partial_parts(parts).err().map(|error| error.to_string()).unwrap_or_default();
        assert!(error.contains(what), "{parts:?}: {error}");
    };
    refused(&[second as u32], "not the first ones");
    refused(&[], "no blocks");
    refused(&[u32::MAX], "there is no part");
    let part = reader.read_parts(&[0]).expect("a part");
    assert!(reader.octree_of_parts([&part[0], &part[0]]).is_err(), "twice");
    let limit = esvo_format::OpenOptions { memory_limit: 1000, ..esvo_format::OpenOptions::default() };
    assert!(matches!(validate_bytes_with(&bytes, &limit), Err(FormatError::Limit(_))));
}
