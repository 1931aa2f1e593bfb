//! What the format costs on one core: storing an octree, validating it, and opening a large file to read one block of
//! it.
//!
//! Octrees are built from a procedural mesh, so that everybody measures the same; the large file is made of copies of
//! one of them as objects, in a temporary folder that is removed afterwards. Files are in the page cache when they are
//! read: what is measured is the program, not the disk.

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

/// What is measured.
#[derive(Clone, Debug)]
pub struct FormatBenchOptions {
    /// Size of the large file in bytes.
    pub large_bytes: u64,
    /// Levels of the octree with everything; that of descriptors alone has one more.
    pub levels: u32,
    /// Largest descriptor array of a block in slots, as in [`AssembleOptions`](esvo_format::AssembleOptions).
    pub block_slots: u32,
    /// Least time for each figure in seconds; at least five runs are made in any case.
    pub seconds: f64,
    /// Files to measure instead of octrees of a procedural mesh. The large file is made of the first.
    pub files: Vec<PathBuf>,
}

impl Default for FormatBenchOptions {
    /// A thousand megabytes, 9 levels, blocks of up to 128 KiB of descriptors, two seconds per figure.
    fn default() -> Self {
        Self { large_bytes: 1_000_000_000, levels: 9, block_slots: 1 << 14, seconds: 2.0, files: Vec::new() }
    }
}

/// Everything that was measured.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct FormatReport {
    /// [`SCHEMA`].
    pub schema: u32,
    /// The machine and the software.
    pub machine: Machine,
    /// The octrees.
    pub octrees: Vec<OctreeRow>,
    /// The first octree, stored in every way.
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
    /// What rows call it.
    pub name: String,
    /// Where it comes from: the mesh and the options of the builder, or the file.
    pub source: String,
    /// Deepest level.
    pub levels: u32,
    /// Voxels but the roots.
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

/// The first octree stored in one way.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct StorageRow {
    /// Zstandard level, or `None` for blocks as they are.
    pub zstd: Option<i32>,
    /// Size of the file in bytes.
    pub file_bytes: u64,
    /// Bytes of the file by voxels.
    pub bytes_per_voxel: f64,
    /// Writing the file to memory.
    pub write: Timed,
    /// Reading every block from memory: checksum, decompression, info section.
    pub read: Timed,
}

/// Validation of one file against every rule, checksums included.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct ValidationRow {
    /// Name of the octree, or `large file`.
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
    /// Ways to get at a part of it.
    pub access: Vec<AccessRow>,
}

/// One way to get at a part of the large file.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct AccessRow {
    /// What is done.
    pub what: String,
    /// The runs.
    pub time: Timed,
    /// Bytes that are asked for; `None` if the file is mapped.
    pub bytes: Option<u64>,
    /// Reads that ask for them; `None` if the file is mapped.
    pub reads: Option<u64>,
    /// Different pages of 4096 bytes that these reads touch; of a mapped file the pages that the system has mapped, with
    /// the neighbours that it maps unasked. `None` where the system does not say.
    pub pages: Option<u64>,
}

/// Seconds of every run.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct Timed {
    /// In the order of the runs.
    pub seconds: Vec<f64>,
}

impl Timed {
    /// The shortest run in seconds.
    pub fn best(&self) -> f64 {
        self.seconds.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// The run in the middle in seconds; NaN without runs.
    pub fn median(&self) -> f64 {
        Spread::of(&self.seconds).map_or(f64::NAN, |spread| spread.median)
    }
}

/// Measures.
///
/// # Errors
/// FormatBenchOptions out of range; a file that cannot be read or breaks the specification; the system's, when the large file cannot
/// be written.
pub fn run_format_bench(options: &FormatBenchOptions, progress: &Progress) -> Result<FormatReport, BenchError> {
    let bad = |what: String| Err(BenchError::Format(FormatError::Limit(what)));
    if !(1 << 20..=32 << 30).contains(&options.large_bytes) {
        return bad(format!("a large file of {} bytes: 1 MiB to 32 GiB", options.large_bytes));
    }
    if !(2..=14).contains(&options.levels) {
        return bad(format!("{} levels: 2 to 14", options.levels));
    }
    if !(options.seconds >= 0.0 && options.seconds <= 3600.0) {
        return bad(format!("{} seconds for each figure: 0 to 3600", options.seconds));
    }
    let octrees = source::octrees(options, progress)?;
    // Figures are per core.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let pool = pool.map_err(|e| BenchError::Format(FormatError::Limit(e.to_string())))?;
    pool.install(|| measure::all(options, &octrees, progress))
}
