//! `esvo bench format`: the time that the file format takes on one core to store an octree, to validate it, to read one
//! block of a large file, and on one and two cores to compare the checksums of its blocks.
//!
//! Octrees are built from a procedural mesh, so that results can be compared. The large file consists of copies of one of
//! them as objects; it is written to a temporary folder and removed afterwards. Files are in the page cache when they are
//! read: this measures the program, not the disk.

mod measure;
mod output;
mod source;
mod tables;

use std::path::PathBuf;

use esvo_format::FormatError;
use serde::{Deserialize, Serialize};

use crate::output::to_json;
use crate::system::machine::Machine;
use crate::timing::Spread;
use crate::{BenchError, Progress};

pub use output::write_format_record;
pub use tables::{to_markdown, to_text};

/// Version of the record.
pub const SCHEMA: u32 = 1;

/// What [`run_format_bench`] measures.
#[derive(Clone, Debug)]
pub struct FormatBenchOptions {
    /// Size of the large file in bytes.
    pub large_bytes: u64,
    /// Levels of the octree with all attributes; the octree of descriptors alone has one more level.
    pub levels: u32,
    /// Largest descriptor array of a block in slots, as in [`AssembleOptions`](esvo_format::AssembleOptions).
    pub block_slots: u32,
    /// Minimum time for each figure in seconds; each figure has at least five runs.
    pub seconds: f64,
    /// Files to measure instead of octrees of a procedural mesh. The large file consists of copies of the first.
    pub files: Vec<PathBuf>,
}

impl Default for FormatBenchOptions {
    /// A thousand megabytes, 9 levels, blocks of up to 128 KiB of descriptors, two seconds per figure.
    fn default() -> Self {
        Self { large_bytes: 1_000_000_000, levels: 9, block_slots: 1 << 14, seconds: 2.0, files: Vec::new() }
    }
}

/// The record of a run.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct FormatReport {
    /// [`SCHEMA`].
    pub schema: u32,
    /// The machine and the software.
    pub machine: Machine,
    /// The octrees.
    pub octrees: Vec<OctreeRow>,
    /// The first octree, stored uncompressed and at several Zstandard levels.
    pub storage: Vec<StorageRow>,
    /// Validation of the octrees' files and of the large one.
    pub validation: Vec<ValidationRow>,
    /// The large file.
    pub large: LargeFile,
    /// Seconds of the whole run.
    pub seconds: f64,
}

impl FormatReport {
    /// The record as indented JSON, with every sample as it was taken.
    pub fn to_json(&self) -> String {
        to_json(self)
    }
}

/// An octree that was measured.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct OctreeRow {
    /// Its name in tables.
    pub name: String,
    /// Its source: the mesh and the settings of the builder, or the file.
    pub source: String,
    /// Deepest level.
    pub levels: u32,
    /// Voxels, without roots.
    pub voxels: u64,
    /// Child descriptors.
    pub descriptors: u64,
    /// Contours.
    pub contours: u64,
    /// Blocks.
    pub blocks: u64,
    /// Size of the image in bytes.
    pub image_bytes: u64,
}

/// The first octree at one level of compression.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct StorageRow {
    /// Zstandard level, or `None` for uncompressed blocks.
    pub zstd: Option<i32>,
    /// Whether blocks are stored in parts by level, as streams of fields (spec 4.3, 4.4). Absent in records of before: they are not.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub parts: bool,
    /// Size of the file in bytes.
    pub file_bytes: u64,
    /// Bytes of the file divided by voxels.
    pub bytes_per_voxel: f64,
    /// Writing the file to memory.
    pub write: Timed,
    /// Reading every block from memory: checksum, decompression, info section.
    pub read: Timed,
}

/// Validation of one file against every rule, checksums included; or opening it and comparing the checksums alone.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct ValidationRow {
    /// Name of the octree, or `large file`, followed by what is checked and the number of threads if that is not everything on
    /// one thread.
    pub name: String,
    /// Size of the file in bytes.
    pub file_bytes: u64,
    /// The runs.
    pub time: Timed,
}

/// The large file.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct LargeFile {
    /// Its size in bytes.
    pub file_bytes: u64,
    /// Objects: copies of the first octree.
    pub objects: u64,
    /// Blocks.
    pub blocks: u64,
    /// Ways to read a part of it.
    pub access: Vec<AccessRow>,
}

/// One way to read a part of the large file.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct AccessRow {
    /// What is done.
    pub what: String,
    /// The runs.
    pub time: Timed,
    /// Bytes that the reader requests; `None` if the file is mapped.
    pub bytes: Option<u64>,
    /// Number of reads; `None` if the file is mapped.
    pub reads: Option<u64>,
    /// Number of different pages of 4096 bytes that the reads touch. For a mapped file: the pages that the system has mapped,
    /// including neighbours that it maps too; `None` if the system does not say.
    pub pages: Option<u64>,
}

/// Times of all runs of one measurement.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct Timed {
    /// Seconds, in the order of the runs.
    pub seconds: Vec<f64>,
}

impl Timed {
    /// The shortest run in seconds.
    pub fn best(&self) -> f64 {
        self.seconds.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// The median in seconds; NaN without runs.
    pub fn median(&self) -> f64 {
        Spread::of(&self.seconds).map_or(f64::NAN, |spread| spread.median)
    }
}

/// Measures the file format.
///
/// # Errors
/// Options out of range; a file that cannot be read or breaks the specification; the system's, if the large file cannot be
/// written.
pub fn run_format_bench(options: &FormatBenchOptions, progress: &Progress) -> Result<FormatReport, BenchError> {
    let bad = |what: String| Err(BenchError::Format(FormatError::Limit(what)));
    if !(1 << 20..=32 << 30).contains(&options.large_bytes) {
        return bad(format!("the large file would have {} bytes, expected 1 MiB to 32 GiB", options.large_bytes));
    }
    if !(2..=14).contains(&options.levels) {
        return bad(format!("the octree would have {} levels, expected 2 to 14", options.levels));
    }
    if !(options.seconds >= 0.0 && options.seconds <= 3600.0) {
        return bad(format!("each figure would take {} seconds, expected 0 to 3600", options.seconds));
    }
    let octrees = source::octrees(options, progress)?;
    // Figures are per core.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let pool = pool.map_err(|e| BenchError::Format(FormatError::Limit(e.to_string())))?;
    pool.install(|| measure::all(options, &octrees, progress))
}
