//! Files with an index, read page by page without their tables.
#![cfg(feature = "zstd")]

mod common;

use common::{Colors, Shape};
use esvo_format::{
    AssembleOptions, FormatError, IndexReader, Octree, Region, StreamReader, WriteOptions, assemble, file, validate,
    validate_bytes,
};
use glam::{DMat4, DVec3};

/// A file with parts of many blocks, whose index has several pages.
fn many_blocks() -> (Octree, Vec<u8>) {
    let shape = Shape {
        seed: 11,
        levels: 9,
        valid: 90,
        leaf: 20,
        contour: 60,
        colors: Colors::One,
        normals: false,
        nodes: 60_000,
    };
    let octree = assemble(&shape.tree(), DMat4::IDENTITY, &AssembleOptions { block_slots: 64, near_limit: 50 });
    let octree = octree.expect("a tree");
    let mut bytes = Vec::new();
    octree.write_to_with(&mut bytes, &WriteOptions { compress: Some(1), parts: true, hash: false }).expect("memory");
    (octree, bytes)
}

fn corner(edge: f64) -> Region {
    Region { low: DVec3::ZERO, high: DVec3::splat(edge) }
}

#[test]
fn the_index_gives_what_the_tables_give() {
    let (octree, bytes) = many_blocks();
    let report = validate_bytes(&bytes).expect("no limit");
    assert!(report.findings.is_empty(), "{report}");
    let tables = StreamReader::open(&bytes).expect("our own file");
    let pages = tables.sections().iter().find(|section| section.tag == file::TAG_PAGES).map_or(0, |s| s.length);
    assert!(pages > 16 << 10, "{} blocks, {pages} bytes of pages", octree.blocks().len());
    for (region, level) in [(Region::ALL, 3), (Region::ALL, 9), (corner(0.2), 9), (corner(0.2), 5), (corner(-1.0), 9)] {
        let mut reader = IndexReader::open(&bytes).expect("a file with an index");
        let part = reader.octree(0, &region, level).expect("our own file");
        assert!(validate(&part).findings.is_empty(), "{}", validate(&part));
        let expected = tables.partial_parts(&tables.parts_for(0, &region, level)).expect("closed");
        assert!(part.slots() == expected.slots(), "level {level}");
        assert_eq!(part.objects(), expected.objects());
    }
}

#[test]
fn a_coarse_picture_takes_two_requests() {
    let (octree, bytes) = many_blocks();
    let mut reader = IndexReader::open(&bytes).expect("a file with an index");
    assert_eq!(reader.reads(), 1, "the head");
    let (blocks, _) = reader.known();
    assert!(blocks < octree.blocks().len() / 2, "{blocks} blocks in the root page");
    let part = reader.octree(0, &Region::ALL, 2).expect("our own file");
    assert_eq!(part.objects()[0].levels, 2);
    assert!(reader.reads() <= 2, "{} requests", reader.reads());
    assert!(reader.bytes_read() < 150_000, "{} bytes", reader.bytes_read());
    // More of it needs pages, once.
    reader.octree(0, &corner(0.1), 9).expect("our own file");
    let reads = reader.reads();
    reader.octree(0, &corner(0.1), 2).expect("our own file");
    assert!(reader.reads() <= reads + 1, "no page is read again");
}

/// Deep in a corner, shallow elsewhere.
fn two_depths(_: usize, cube: &Region) -> u32 {
    if cube.meets(&corner(0.6)) { 9 } else { 3 }
}

#[test]
fn depths_by_cube_give_the_same_with_and_without_the_tables() {
    let (octree, bytes) = many_blocks();
    let tables = StreamReader::open(&bytes).expect("our own file");
    let wanted = tables.parts_by(two_depths);
    assert!(!wanted.is_empty() && wanted.len() < tables.parts().len());
    let expected = tables.partial_parts(&wanted).expect("closed");
    let mut reader = IndexReader::open(&bytes).expect("a file with an index");
    assert!(!reader.needs_tables());
    let part = reader.octree_by(two_depths).expect("our own file");
    assert!(part.slots() == expected.slots() && part.objects() == expected.objects());
    assert!(validate(&part).findings.is_empty());
    // Another depth gives another octree.
    assert!(reader.octree_by(|_, _| 2).expect("our own file").slots() != part.slots());
    // What has been read is not read again.
    let before = (reader.reads(), reader.bytes_read());
    assert!(reader.octree_by(two_depths).expect("our own file").slots() == part.slots());
    assert_eq!((reader.reads(), reader.bytes_read()), before);
    assert!(reader.octree_by(|_, _| 9).expect("our own file").slots() == octree.slots());
    assert!(reader.reads() > before.0);
    // Nothing is wanted: the root is there.
    let least = IndexReader::open(&bytes).and_then(|mut reader| reader.octree_by(|_, _| 0)).expect("our own file");
    assert_eq!(least.objects().len(), 1);

    // A file without parts: by blocks, and those that lie together in one read.
    let mut plain = Vec::new();
    octree.write_to(&mut plain).expect("memory");
    let blocks = StreamReader::open(&plain).expect("our own file");
    let chosen = blocks.blocks_by(two_depths);
    assert!(chosen.len() > 10 && chosen.len() < octree.blocks().len(), "{} of {}", chosen.len(), octree.blocks().len());
    assert_eq!(blocks.blocks_by(|_, _| 9), blocks.blocks_for(0, &Region::ALL, 9));
    let reads = blocks.reads();
    let read = blocks.read_blocks(&chosen).expect("our own file");
    assert!(blocks.reads() - reads < chosen.len() as u64 / 4, "{} reads", blocks.reads() - reads);
    assert_eq!(read.iter().map(|block| block.index()).collect::<Vec<_>>(), chosen);
    assert_eq!(read[3], blocks.read_block(chosen[3]).expect("our own file"));
    assert!(blocks.read_blocks(&[0, u32::MAX]).is_err());
}

#[test]
fn files_without_an_index_are_refused() {
    let (octree, _) = many_blocks();
    let mut bytes = Vec::new();
    octree.write_to(&mut bytes).expect("memory");
    assert!(matches!(IndexReader::open(&bytes), Err(FormatError::Limit(what)) if what.contains("no index")));
}

#[test]
fn damage_of_the_head_of_pages_and_of_parts_is_found() {
    let (_, bytes) = many_blocks();
    let whole = StreamReader::open(&bytes).expect("our own file");
    let pages = whole.sections().iter().find(|section| section.tag == file::TAG_PAGES).expect("pages");
    let head = whole.header().head as usize;
    let last = whole.parts().len() - 1;
    let part = whole.blocks()[whole.parts()[last].block as usize].file_offset as usize;
    let places =
        [70, head - 1, head - 100, pages.offset as usize + 50, (pages.offset + pages.length) as usize - 1, part + 20];
    for at in places {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x10;
        let result = IndexReader::open(&damaged).and_then(|mut reader| reader.octree(0, &Region::ALL, 9));
        assert!(matches!(result, Err(FormatError::Broken(_))), "byte {at}");
        assert!(!validate_bytes(&damaged).expect("no limit").is_ok(), "byte {at}");
    }
}
