//! The octrees that are measured, and the large file that is made of one.

use std::path::Path;

use esvo_builder::BuildSettings;
use esvo_format::file::NO_PARENT;
use esvo_format::{AssembleOptions, FormatError, Octree, stats};

use super::{FormatBenchOptions, OctreeRow};
use crate::{BenchError, Progress};

/// The mesh of the octrees: small to make, and with walls, columns and ornaments.
const MESH: &str = "sibenik";

/// An octree and its row of the record.
pub(super) struct Source {
    pub(super) octree: Octree,
    pub(super) row: OctreeRow,
}

impl Source {
    fn new(name: String, source: String, octree: Octree) -> Self {
        let counted = stats(&octree);
        let row = OctreeRow {
            name,
            source,
            levels: counted.levels,
            voxels: counted.voxels,
            descriptors: counted.descriptors,
            contours: counted.contours,
            blocks: counted.blocks,
            image_bytes: counted.image_bytes,
        };
        Self { octree, row }
    }
}

/// The octrees in the files of the options. Without files, two octrees of the procedural mesh: one with contours, colours and
/// normals, and one of descriptors alone, which takes longest to validate.
pub(super) fn octrees(options: &FormatBenchOptions, progress: &Progress) -> Result<Vec<Source>, BenchError> {
    if !options.files.is_empty() {
        return options.files.iter().map(|path| from_file(path)).collect();
    }
    let mesh = esvo_scenes::procedural(MESH).ok_or_else(|| BenchError::scene(MESH, "no generator has this name"))?;
    let build = |name: &str, extra: u32, all: bool| {
        let levels = options.levels + extra;
        progress.say(format!("building an octree of {levels} levels, {name}"));
        let build = BuildSettings {
            levels,
            contours: all,
            colors: all,
            normals: all,
            assemble: AssembleOptions { block_slots: options.block_slots, ..AssembleOptions::default() },
            ..BuildSettings::default()
        };
        let built = esvo_builder::build(&mesh, &build, &|_| {}).map_err(|e| BenchError::scene(MESH, e))?;
        let source = format!("procedural {MESH}, {levels} levels, blocks of at most {} slots", options.block_slots);
        Ok(Source::new(name.into(), source, built.octree))
    };
    Ok(vec![build("contours, colours, normals", 0, true)?, build("descriptors alone", 1, false)?])
}

fn from_file(path: &Path) -> Result<Source, BenchError> {
    let octree = Octree::open(path).map_err(|e| BenchError::file(path, e))?;
    // Its blocks are written again.
    octree.verified().map_err(|e| BenchError::file(path, e.into()))?;
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Ok(Source::new(name.clone(), name, octree))
}

/// An octree whose objects are copies of the given one, with an image of about `bytes` bytes; at least one object.
pub(super) fn copies(octree: &Octree, bytes: u64) -> Result<Octree, FormatError> {
    let one = octree.slots().len();
    let count = (bytes / 8 / one as u64).max(1);
    let mut image = Vec::with_capacity(one * count as usize);
    let (mut objects, mut blocks) = (Vec::new(), Vec::new());
    for _ in 0..count {
        let (start, first_block, first_object) = (image.len(), blocks.len() as u32, objects.len() as u32);
        image.extend_from_slice(octree.slots());
        for (block, parts) in octree.blocks().iter().zip(octree.parts()) {
            let mut block = *block;
            block.object += first_object;
            if block.parent != NO_PARENT {
                block.parent += first_block;
            }
            block.image_offset += start as u64 * 8;
            // The first field of the info section is the number of the block.
            image[start + (parts.start + parts.array_slots) as usize] += u64::from(first_block);
            blocks.push(block);
        }
        for object in octree.objects() {
            let mut object = *object;
            object.root_block += first_block;
            object.root_slot += start as u64;
            objects.push(object);
        }
    }
    Octree::from_parts(objects, blocks, image)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn copies_are_valid_and_about_as_large_as_asked_for() {
        let options = FormatBenchOptions { levels: 4, block_slots: 64, ..FormatBenchOptions::default() };
        let sources = octrees(&options, &Progress::hidden()).unwrap();
        assert_eq!(sources.len(), 2);
        assert!(sources[0].row.contours > 0 && sources[1].row.contours == 0);
        assert_eq!(sources[1].row.levels, 5);
        let one = sources[0].row.image_bytes;
        let many = copies(&sources[0].octree, 5 * one + 8).unwrap();
        assert_eq!((many.objects().len(), many.slots().len() as u64 * 8), (5, 5 * one));
        assert_eq!(many.blocks().len() as u64, 5 * sources[0].row.blocks);
        assert!(sources[0].row.blocks > 1);
        let report = esvo_format::validate(&many);
        assert!(report.is_ok(), "{report}");
    }
}
