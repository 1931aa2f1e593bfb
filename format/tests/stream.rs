//! Loading parts of a file: the bytes read, the resulting octrees, and refused files.

mod common;

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{Cursor, Error, ErrorKind};

use common::patch;
use common::samples::samples;
use common::{Colors, Rng, Shape, bytes_of, shapes};
use esvo_format::file::{HEADER_BYTES, NO_PARENT, TAG_META};
use esvo_format::{
    AssembleOptions, FormatError, Octree, OpenOptions, RangeRead, Region, SeekSource, StreamReader, assemble, ids,
    stats, stream_stats, validate,
};
use glam::{DMat4, DVec3};
use proptest::prelude::*;

fn shape() -> impl Strategy<Value = Shape> {
    shapes(2..=9, 40..=256, 1500)
}

/// An octree with dozens of blocks.
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
    let octree =
        assemble(&shape.tree(), DMat4::IDENTITY, &AssembleOptions { block_slots: 200, near_limit: 50 }).unwrap();
    assert!(octree.blocks().len() > 40, "{} blocks", octree.blocks().len());
    octree
}

/// One octree with the objects of both.
fn together(a: &Octree, b: &Octree) -> Octree {
    let mut objects = a.objects().to_vec();
    let mut blocks = a.blocks().to_vec();
    let mut image = a.slots().to_vec();
    let (first_block, first_object) = (blocks.len() as u32, objects.len() as u32);
    let offset = image.len() as u64 * 8;
    image.extend_from_slice(b.slots());
    for (block, parts) in b.blocks().iter().zip(b.parts()) {
        let mut block = *block;
        block.object += first_object;
        block.parent = if block.parent == NO_PARENT { NO_PARENT } else { block.parent + first_block };
        block.image_offset += offset;
        image[(offset / 8) as usize + (parts.start + parts.array_slots) as usize] += u64::from(first_block);
        blocks.push(block);
    }
    for object in b.objects() {
        let mut object = *object;
        object.root_block += first_block;
        object.root_slot += offset / 8;
        objects.push(object);
    }
    Octree::from_parts(objects, blocks, image).unwrap()
}

/// A random set of blocks with their ancestors.
fn some_blocks(octree: &Octree, rng: &mut Rng, chance: u32) -> Vec<u32> {
    let mut chosen = vec![false; octree.blocks().len()];
    for (index, block) in octree.blocks().iter().enumerate() {
        let parent = block.parent == NO_PARENT || chosen[block.parent as usize];
        chosen[index] = parent && (index == 0 || rng.chance(chance));
    }
    (0..chosen.len() as u32).filter(|index| chosen[*index as usize]).collect()
}

/// Walks a part and the whole octree in parallel. Every voxel of the part must be in the whole with the same contour,
/// colour and normal, and have a descriptor in the whole if it has one in the part. Only voxels whose children are in
/// missing blocks may be leaves instead. Returns the number of descriptors of the part.
fn compare(part: &Octree, part_object: usize, whole: &Octree, object: usize, loaded: &[u32]) -> u64 {
    let loaded: BTreeSet<u32> = loaded.iter().copied().collect();
    let mut stack = vec![(part.objects()[part_object].root_slot as u32, whole.objects()[object].root_slot as u32)];
    let mut count = 0;
    while let Some((a, b)) = stack.pop() {
        count += 1;
        let (ours, theirs) = (part.descriptor(a), whole.descriptor(b));
        assert_eq!(ours.valid_mask(), theirs.valid_mask());
        let there = theirs.nonleaf_mask() == 0 || loaded.contains(&whole.block_of(whole.first_child(b)));
        assert_eq!(ours.leaf_mask(), if there { theirs.leaf_mask() } else { theirs.valid_mask() });
        for child in 0..8 {
            assert_eq!(part.contour(a, child), whole.contour(b, child));
            if theirs.valid_mask() >> child & 1 != 0 {
                assert_eq!(part.color(a, child), whole.color(b, child));
                assert_eq!(part.normal(a, child), whole.normal(b, child));
            }
            if let Some(slot) = part.child(a, child) {
                stack.push((slot, whole.child(b, child).expect("the whole has what its part has")));
            }
        }
    }
    count
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn parts_are_parts_and_all_blocks_are_the_whole(
        shape in shape(), block_slots in 64u32..1000, near_limit in 1u32..600, seed: u64, chance in 0u32..256,
    ) {
        let octree = assemble(&shape.tree(), DMat4::IDENTITY, &AssembleOptions { block_slots, near_limit }).unwrap();
        let bytes = bytes_of(&octree);
        let reader = StreamReader::open(&bytes).unwrap();
        let all: Vec<u32> = (0..octree.blocks().len() as u32).collect();
        let whole = reader.partial(&all).unwrap();
        prop_assert!(whole.slots() == octree.slots());
        prop_assert_eq!(whole.objects(), octree.objects());
        prop_assert_eq!(bytes_of(&whole), bytes.clone());
        prop_assert_eq!(stream_stats(&reader).unwrap(), stats(&octree));

        let chosen = some_blocks(&octree, &mut Rng(seed), chance);
        let part = reader.partial(&chosen).unwrap();
        let report = validate(&part);
        prop_assert!(report.findings.is_empty(), "{report}");
        prop_assert_eq!(part.blocks().len(), chosen.len());
        prop_assert_eq!(compare(&part, 0, &octree, 0, &chosen), part.objects()[0].descriptors);
        // A part can be written and read like any octree.
        let again = Octree::from_bytes(&bytes_of(&part)).unwrap();
        prop_assert!(validate(&again).findings.is_empty() && again.slots() == part.slots());
    }
}

/// All voxels: lower corner in units of 2^-23, level.
fn voxels(octree: &Octree, object: usize) -> BTreeSet<([u32; 3], u32)> {
    let mut found = BTreeSet::new();
    let mut stack = vec![(octree.objects()[object].root_slot as u32, [0u32; 3], 1u32)];
    while let Some((slot, position, level)) = stack.pop() {
        for child in 0..8u8 {
            if octree.descriptor(slot).valid_mask() >> child & 1 != 0 {
                let corner = std::array::from_fn(|k| position[k] + (u32::from(child >> k & 1) << (23 - level)));
                found.insert((corner, level));
                if let Some(slot) = octree.child(slot, child) {
                    stack.push((slot, corner, level + 1));
                }
            }
        }
    }
    found
}

#[test]
fn the_blocks_for_a_region_show_it_down_to_the_level() {
    let octree = many_blocks();
    let bytes = bytes_of(&octree);
    let reader = StreamReader::open(&bytes).unwrap();
    let all = voxels(&octree, 0);
    let corner = Region { low: DVec3::ZERO, high: DVec3::splat(0.2) };
    let point = Region { low: DVec3::new(0.7, 0.3, 0.6), high: DVec3::new(0.7, 0.3, 0.6) };
    let mut sizes = Vec::new();
    for region in [Region::ALL, corner, point, Region::cube([1 << 22, 0, 1 << 22], 21)] {
        for level in 0..=9 {
            let blocks = reader.blocks_for(0, &region, level);
            assert_eq!(blocks[0], 0);
            let shown = voxels(&reader.partial(&blocks).unwrap(), 0);
            assert!(shown.is_subset(&all));
            let wanted = all.iter().filter(|(corner, l)| *l <= level && Region::cube(*corner, 23 - l).meets(&region));
            for voxel in wanted {
                assert!(shown.contains(voxel), "{voxel:?} of {region:?} down to {level}");
            }
            sizes.push(blocks.len());
        }
    }
    assert_eq!(sizes[9], octree.blocks().len(), "all of it is every block");
    assert_eq!(sizes[0], 1, "level 0 is the root, its block shows it");
    assert!(sizes[19] < sizes[9] / 2 && sizes[29] < sizes[9] / 2, "{sizes:?}");
    assert!(reader.blocks_for(1, &Region::ALL, 23).is_empty(), "there is no object 1");
    let outside = Region { low: DVec3::splat(1.5), high: DVec3::splat(2.0) };
    assert_eq!(reader.blocks_for(0, &outside, 23), [0]);
    let nowhere = Region { low: DVec3::NAN, high: DVec3::ONE };
    assert_eq!(reader.blocks_for(0, &nowhere, 23), [0]);
}

#[test]
fn every_object_is_there_or_not() {
    let (a, b) = (many_blocks(), samples().remove(3).1);
    let octree = together(&a, &b);
    assert!(validate(&octree).findings.is_empty(), "{}", validate(&octree));
    let bytes = bytes_of(&octree);
    let reader = StreamReader::open(&bytes).unwrap();
    let first = reader.blocks_for(0, &Region::ALL, 5);
    let second = reader.blocks_for(1, &Region::ALL, 23);
    assert_eq!(second.len(), b.blocks().len());
    // The second object alone equals the original octree.
    let alone = reader.partial(&second).unwrap();
    assert!(alone.slots() == b.slots() && alone.objects() == b.objects());
    let both = [&second[..1], &first[..]].concat();
    let part = reader.partial(&both).unwrap();
    assert!(validate(&part).findings.is_empty(), "{}", validate(&part));
    for object in 0..2 {
        assert_eq!(compare(&part, object, &octree, object, &both), part.objects()[object].descriptors);
    }
    let all: Vec<u32> = (0..octree.blocks().len() as u32).collect();
    assert!(reader.partial(&all).unwrap().slots() == octree.slots());
}

#[test]
fn opening_reads_tables_and_nothing_else() {
    let octree = many_blocks();
    let bytes = bytes_of(&octree);
    let (data, _) = patch::File(bytes.clone()).section(b"BLKS");
    let reader = StreamReader::open(&bytes).unwrap();
    assert_eq!((reader.objects(), reader.blocks().len()), (octree.objects(), octree.blocks().len()));
    assert_eq!((reader.bytes_read(), reader.reads()), (8192, 1), "tables of {data} bytes");
    let block = reader.read_block(7).unwrap();
    assert_eq!((reader.bytes_read(), reader.reads()), (8192 + reader.blocks()[7].stored_size, 2));
    assert_eq!(block.index(), 7);
    let entry = octree.blocks()[7];
    assert_eq!(block.slots(), &octree.slots()[(entry.image_offset / 8) as usize..][..(entry.image_size / 8) as usize]);
    assert_eq!(block.parts().array_slots, octree.parts()[7].array_slots);
    assert_eq!(block.parts().start, 0);
    // Only the bytes that are read are checked; the rest may be wrong or missing.
    let mut damaged = bytes.clone();
    damaged[data + 100] ^= 1;
    let reader = StreamReader::open(&damaged).unwrap();
    assert!(reader.read_block(7).is_ok());
    let Err(FormatError::Broken(broken)) = reader.read_block(0) else { panic!("block 0 is damaged") };
    assert_eq!((broken.rule, broken.offset), (ids::BLOCK_CHECKSUM, data as u64));
}

#[test]
fn metadata_is_read_when_it_is_asked_for() {
    let octree = samples().pop().unwrap().1;
    let bytes = bytes_of(&octree);
    let reader = StreamReader::open(&bytes).unwrap();
    assert_eq!(reader.section(TAG_META).unwrap().unwrap(), octree.meta().as_bytes());
    assert_eq!(reader.section(*b"none").unwrap(), None);
    let mut damaged = bytes.clone();
    let (meta, _) = patch::File(bytes).section(b"META");
    damaged[meta] ^= 1;
    let reader = StreamReader::open(&damaged).unwrap();
    let Err(FormatError::Broken(broken)) = reader.section(TAG_META) else { panic!("damaged") };
    assert_eq!(broken.rule, ids::SECTION_CHECKSUM);
}

/// A source of unknown length, such as a store that serves ranges.
struct NoLength(Vec<u8>);

impl RangeRead for NoLength {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> std::io::Result<()> {
        self.0.read_at(offset, buf)
    }
}

#[test]
fn any_source_gives_the_same() {
    let octree = many_blocks();
    let bytes = bytes_of(&octree);
    let blocks: Vec<u32> = (0..octree.blocks().len() as u32).collect();
    fn load(source: impl RangeRead, blocks: &[u32]) -> Octree {
        StreamReader::open(source).unwrap().partial(blocks).unwrap()
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.esvo");
    octree.write(&path).unwrap();
    let file = File::open(&path).unwrap();
    let loaded = [
        load(&bytes, &blocks),
        load(bytes.as_slice(), &blocks),
        load(&file, &blocks),
        load(Box::new(file), &blocks),
        load(SeekSource::new(Cursor::new(&bytes)), &blocks),
        load(SeekSource::new(File::open(&path).unwrap()), &blocks),
        load(NoLength(bytes.clone()), &blocks),
    ];
    for octree_of_source in loaded {
        assert!(octree_of_source.slots() == octree.slots());
    }
}

#[test]
fn what_is_not_there_is_an_error() {
    let octree = many_blocks();
    let bytes = bytes_of(&octree);
    for length in [0, 11, 63, 64, 200, 8192, bytes.len() - 1] {
        let Err(error) = StreamReader::open(&bytes[..length]) else { panic!("{length} bytes were opened") };
        let FormatError::Broken(broken) = error else { panic!("{error}") };
        assert_eq!(broken.rule, if length < HEADER_BYTES as usize { ids::IDENTIFIER } else { ids::FILE_LENGTH });
        // Without a known length, the end is found only by reading.
        let end = |error| match error {
            FormatError::Source { source, .. } => assert_eq!(source.kind(), ErrorKind::UnexpectedEof),
            other => panic!("{other}"),
        };
        match StreamReader::open(NoLength(bytes[..length].to_vec())) {
            Err(error) => end(error),
            Ok(reader) => {
                assert!(length >= 8192);
                end(reader.read_block(octree.blocks().len() as u32 - 1).unwrap_err());
            }
        }
    }
    let reader = StreamReader::open(&bytes).unwrap();
    let refused = |what: &str, result: Result<Octree, FormatError>| {
        let error = result.err().expect(what).to_string();
        assert!(error.contains(what), "{error}");
    };
    let child = octree.blocks().iter().position(|b| b.parent != NO_PARENT && b.parent != 0).unwrap() as u32;
    refused("its parent", reader.partial(&[0, child]));
    refused("no blocks", reader.partial(&[]));
    refused(&format!("no block 9999: the file has {}", octree.blocks().len()), reader.partial(&[0, 9999]));
    let block = reader.read_block(0).unwrap();
    refused("twice", reader.partial_of([&block, &block]));
    let large = StreamReader::open(&bytes).unwrap().read_block(octree.blocks().len() as u32 - 1).unwrap();
    let small_bytes = bytes_of(&samples()[0].1);
    let small = StreamReader::open(&small_bytes).unwrap();
    refused("does not belong to this file", small.partial_of([&large]));
    // Enough for three blocks.
    let limited =
        StreamReader::open_with(&bytes, &OpenOptions { memory_limit: 3 * 8192, ..OpenOptions::default() }).unwrap();
    assert!(limited.partial(&[0]).is_ok());
    refused("memory limit", limited.partial(&(0..9).collect::<Vec<_>>()));
    let blocks: Vec<_> = (0..9).map(|index| limited.read_block(index).unwrap()).collect();
    refused("memory limit", limited.partial_of(&blocks));
}

#[test]
fn a_source_that_fails_says_where() {
    struct Failing(Vec<u8>);
    impl RangeRead for Failing {
        fn read_at(&self, offset: u64, buf: &mut [u8]) -> std::io::Result<()> {
            if offset >= 8192 { Err(Error::other("the line is dead")) } else { self.0.read_at(offset, buf) }
        }
    }
    let octree = many_blocks();
    let reader = StreamReader::open(Failing(bytes_of(&octree))).unwrap();
    let error = reader.read_block(1).unwrap_err().to_string();
    let at = reader.blocks()[1].file_offset;
    assert_eq!(error, format!("cannot read at byte {at}: the line is dead"));
}

/// Invalid files with correct checksums: every part is refused or sound.
#[test]
fn parts_of_damaged_files_are_refused_or_sound() {
    let mut rng = Rng(3);
    let (mut refused, mut made) = (0, 0);
    for (_, octree) in samples().into_iter().chain([("many", many_blocks())]) {
        let bytes = bytes_of(&octree);
        for _ in 0..400 {
            let mut file = patch::File(bytes.clone());
            for _ in 0..=rng.below(3) {
                let block = rng.below(file.blocks() as u64) as usize;
                let start = file.u64(file.block(block) + 40) as usize;
                let byte = match rng.below(4) {
                    0 => file.block(block) + rng.below(72) as usize,
                    1 => file.object(0) + 128 + rng.below(64) as usize,
                    _ => start + rng.below(256) as usize,
                };
                if let Some(byte) = file.0.get_mut(byte) {
                    *byte ^= 1 << rng.below(8);
                }
            }
            file.seal();
            let Ok(reader) = StreamReader::open(&file.0) else {
                refused += 1;
                continue;
            };
            let chosen = some_blocks(&octree, &mut rng, 128);
            match reader.partial(&chosen) {
                Ok(part) => {
                    made += 1;
                    assert_eq!(part.sound(), Ok(()));
                    voxels(&part, 0);
                }
                Err(_) => refused += 1,
            }
        }
    }
    assert!(refused > 500 && made > 100, "{refused} refused, {made} made");
}
