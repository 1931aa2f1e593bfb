//! Reads one corner of a large octree without reading the file: the tables, then the blocks that the corner needs.
//!
//! `cargo run -p esvo-examples --example stream_region -- FILE.esvo`; without a file, one is written to a temporary
//! folder first. Any source of bytes works in place of the file: see `esvo_format::RangeRead`.

use std::error::Error;
use std::fs::File;
use std::path::{Path, PathBuf};

use esvo_builder::{BuildSettings, Mesh, build};
use esvo_format::{AssembleOptions, Region, StreamReader};
use glam::DVec3;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let path = match std::env::args().nth(1) {
        Some(file) => PathBuf::from(file),
        None => sheet(folder.path())?,
    };
    let size = std::fs::metadata(&path)?.len();

    // Reads header, directory and tables, and checks them.
    let reader = StreamReader::open(File::open(&path)?)?;
    println!("{size} bytes in the file, {} read for the tables", reader.bytes_read());

    // Octree space: the root cube is [0, 1]³. Level 0 is the root.
    let corner = Region { low: DVec3::ZERO, high: DVec3::new(0.2, 0.2, 1.0) };
    for level in [3, 6, 9] {
        let blocks = reader.blocks_for(0, &corner, level);
        // Where a block is not read, its parent voxel becomes a leaf: a part is an octree like any other.
        let part = reader.partial(&blocks)?;
        part.sound()?;
        let object = &part.objects()[0];
        println!(
            "level {level}: {} of {} blocks, {} leaf voxels",
            blocks.len(),
            reader.blocks().len(),
            object.leaf_voxels
        );
    }
    println!("{} bytes read in {} reads", reader.bytes_read(), reader.reads());
    Ok(())
}

/// Writes an octree of a wavy sheet in many small blocks.
fn sheet(folder: &Path) -> Result<PathBuf, Box<dyn Error>> {
    let n = 64u32;
    let at = |i: u32| f64::from(i) / f64::from(n);
    let height = |x: f64, y: f64| 0.1 * (7.0 * x).sin() * (9.0 * y).cos();
    let grid = |i: u32| (i % (n + 1), i / (n + 1));
    let positions = (0..(n + 1) * (n + 1)).map(grid).map(|(x, y)| [at(x), at(y), height(at(x), at(y))]).collect();
    let quad = |i: u32| [[i, i + 1, i + n + 2], [i, i + n + 2, i + n + 1]];
    let triangles = (0..n * (n + 1)).filter(|i| i % (n + 1) < n).flat_map(quad).collect();
    let mesh = Mesh::from_triangles(positions, triangles)?;
    let assemble = AssembleOptions { block_slots: 4096, ..AssembleOptions::default() };
    let built = build(&mesh, &BuildSettings { levels: 9, assemble, ..BuildSettings::default() }, &|_| {})?;
    let path = folder.join("sheet.esvo");
    built.octree.write(&path)?;
    Ok(path)
}
