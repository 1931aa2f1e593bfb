//! A file of 32 GiB of image, sparse on disk: what a reader fetches of it does not grow with the file.
//!
//! The coarse blocks are real. Below them hang blocks that only tables and index know; their bytes are a hole in the file.

use std::fs::File;
use std::io::{Seek, SeekFrom, Write};

use glam::{DMat4, DVec3};

use crate::file::extras::Extras;
use crate::file::write_parts::{PartsFile, Waiting};
use crate::file::*;
use crate::parts::block::{StoredPart, encode_block, first_level};
use crate::{AssembleOptions, IndexReader, Octree, Region, Tree, Voxel, assemble};

/// Levels of the octree whose bytes are there.
const LEVELS: u32 = 8;

/// The voxels of a sphere's surface.
fn shell(tree: &mut Tree, low: [i64; 3], level: u32) {
    let edge = 1i64 << (LEVELS - level - 1);
    let radius = (1i64 << LEVELS) * 9 / 20;
    let corner = |child: usize| [0, 1, 2].map(|axis| low[axis] + ((child >> axis & 1) as i64) * edge);
    let meets = |cube: [i64; 3]| {
        let middle = 1i64 << (LEVELS - 1);
        let (mut near, mut far) = (0, 0);
        for axis in 0..3 {
            let (a, b) = ((cube[axis] - middle).abs(), (cube[axis] + edge - middle).abs());
            far += a.max(b).pow(2);
            near += a.min(b).pow(2);
        }
        near <= radius.pow(2) && radius.pow(2) <= far
    };
    let leaf = level + 1 == LEVELS;
    let color = |child: usize| Some([(child * 30) as u8, (low[0] & 255) as u8, (low[1] & 255) as u8]);
    let children: [Option<Voxel>; 8] = std::array::from_fn(|child| {
        meets(corner(child)).then(|| Voxel { leaf, color: color(child), ..Voxel::default() })
    });
    let node = tree.open(&children);
    if !leaf {
        (0..8).filter(|child| children[*child].is_some()).for_each(|child| shell(tree, corner(child), level + 1));
    }
    tree.close(node);
}

/// A file of `count` blocks, about 160 KiB of image each, and the octree whose bytes are in it.
fn sparse(count: u32, mut file: &File) -> Octree {
    let mut tree = Tree::default();
    shell(&mut tree, [0; 3], 0);
    // Blocks of few slots, so that many have blocks below them.
    let options = AssembleOptions { block_slots: 2048, ..AssembleOptions::default() };
    let octree = assemble(&tree, DMat4::IDENTITY, &options).expect("a tree");
    let mut blocks = octree.blocks().to_vec();
    let real = blocks.len() as u32;
    assert!(real > 20 && blocks.iter().all(|block| block.cube_scale > 14), "{real} blocks");
    let stored: Vec<(u32, Vec<StoredPart>)> = (0..real)
        .map(|index| {
            let block = &blocks[index as usize];
            let slots = &octree.slots()[(block.image_offset / 8) as usize..][..(block.image_size / 8) as usize];
            encode_block(&blocks, index, slots, &octree.parts[index as usize].within(), 3).expect("memory")
        })
        .collect();
    let mut waiting = Vec::new();
    for (codec, parts) in &stored {
        waiting.extend(parts.iter().map(|part| Waiting { entry: part.entry, codec: *codec, crc: part.crc() }));
    }
    let bytes: Vec<&[u8]> = stored.iter().flat_map(|(_, parts)| parts.iter().map(|part| &part.bytes[..])).collect();
    for index in real..count {
        // As wide as the octree: each real block that is no root has as many below it.
        let parent = 1 + (index - real) / (count - real).div_ceil(real - 1);
        let above = blocks[parent as usize];
        let place = index.wrapping_mul(2_654_435_761);
        let scale = above.cube_scale - 5;
        let position = [0, 1, 2].map(|axis| above.cube_position[axis] + ((place >> (8 * axis) & 31) << scale));
        let last = blocks[index as usize - 1];
        let block =
            BlockEntry::in_memory(parent, (position, scale), last.image_offset + last.image_size, 20 * PAGE_BYTES);
        let first = first_level(&block);
        waiting.extend((first..(first + 8).min(LAST_LEVEL + 1)).map(|level| {
            let size = 60 + (place >> 7) % (240 << (level - first));
            let entry = PartEntry { block: index, size, first_level: level, last_level: level, reserved: 0 };
            Waiting { entry, codec: CODEC_FIELDS, crc: [0; 4] }
        }));
        blocks.push(block);
    }
    let frame = PartsFile { objects: octree.objects(), blocks, extras: Extras::default() };
    let laid = frame.lay_out(&waiting).expect("memory");
    file.write_all(&laid.head).expect("room on the disk");
    let mut at = laid.head.len() as u64;
    for part in laid.order {
        if let Some(bytes) = bytes.get(part as usize) {
            file.seek(SeekFrom::Start(at)).and_then(|_| file.write_all(bytes)).expect("room on the disk");
        }
        at = (at + u64::from(waiting[part as usize].entry.size)).next_multiple_of(8);
    }
    file.seek(SeekFrom::Start(at)).and_then(|_| file.write_all(&laid.tail)).expect("room on the disk");
    octree
}

/// What it takes to read an object down to a level: reads, bytes, and the octree.
fn take(file: &File, region: &Region, level: u32) -> (u64, u64, Octree) {
    let mut reader = IndexReader::open(file).expect("our own file");
    let octree = reader.octree(0, region, level).expect("the coarse bytes are there");
    (reader.reads(), reader.bytes_read(), octree)
}

fn measure(count: u32) {
    let file = tempfile::tempfile().expect("a temporary file");
    let whole = sparse(count, &file);
    let length = file.metadata().expect("it is open").len();
    println!("{count} blocks, a file of {length} bytes; head of {} bytes", {
        IndexReader::open(&file).expect("our own file").bytes_read()
    });
    for level in [3, 5, LEVELS - 1] {
        let (reads, bytes, octree) = take(&file, &Region::ALL, level);
        println!("level {level}, all of it: {reads} requests, {bytes} bytes");
        // A part has levels of at least 16 descriptors.
        let levels = octree.objects()[0].levels;
        assert!(levels >= level, "{levels} levels");
        if level <= 5 {
            assert!(reads <= 2 && bytes <= 150_000, "level {level}: {reads} requests, {bytes} bytes");
        }
    }
    let corner = Region { low: DVec3::splat(0.0), high: DVec3::splat(0.3) };
    let (reads, bytes, octree) = take(&file, &corner, LEVELS - 1);
    println!("level {}, a corner: {reads} requests, {bytes} bytes", LEVELS - 1);
    assert!(octree.objects()[0].leaf_voxels < whole.objects()[0].leaf_voxels / 2);
    assert!(bytes < 1 << 20, "{bytes} bytes for a corner");
    // Bytes that are a hole are noticed.
    let mut reader = IndexReader::open(&file).expect("our own file");
    let error = reader.octree(0, &corner, LEVELS + 8).err().expect("these parts are zeros");
    assert!(error.to_string().contains("S00"), "{error}");
    // The tables alone have more than all that was read.
    let tables = u64::from(count) * BLOCK_BYTES;
    assert!(bytes < tables, "{bytes} bytes, tables of {tables}");
}

#[test]
fn a_coarse_picture_of_many_blocks_takes_two_requests() {
    measure(20_000);
}

#[test]
#[ignore = "takes a second and a gigabyte; `cargo test --release -p esvo-format large -- --ignored --nocapture` prints the figures"]
fn a_coarse_picture_of_32_gib_takes_two_requests() {
    measure(205_000);
}
