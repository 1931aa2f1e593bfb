//! `esvo bench serve`: what pictures of octrees on a server take: bytes, requests and seconds, over a line that is as slow as it is
//! told to be.
//!
//! A server on the loopback device waits before each answer and sends so many bits in a second. Each figure is that of a reader that
//! knows nothing of the file before. The hits of what was read are compared with those of the whole file: `t`, the size of the
//! voxel, and the shaded picture must be the same in every bit. The negative control is an octree with one level less.

#[cfg(feature = "remote")]
mod measure;
mod output;
mod tables;

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::output::to_json;
use crate::system::machine::Machine;
use crate::{BenchError, Progress};

pub use output::write_serve_record;
pub use tables::{to_markdown, to_text};

/// Version of the record.
pub const SCHEMA: u32 = 1;

/// What [`run_serve_bench`] measures.
#[derive(Clone, Debug)]
pub struct ServeBenchOptions {
    /// The files: octrees, each stored in one way.
    pub files: Vec<PathBuf>,
    /// Scene of the manifest whose camera is taken; `None`: one that sees all from outside.
    pub scene: Option<String>,
    /// Number of the camera, from 1.
    pub view: usize,
    /// Folder of the meshes, which say which cameras there are.
    pub scenes_dir: Option<PathBuf>,
    /// Size of the pictures.
    pub size: [u32; 2],
    /// Sizes in pixels of the voxels at which rays end; 0: at leaves only.
    pub pixels: Vec<f32>,
    /// Deepest level of the coarse octree that is read for a first picture of the whole.
    pub coarse_level: u32,
    /// Time before each answer in milliseconds.
    pub delay_ms: u64,
    /// Bits of bodies in a second, in millions.
    pub mbit: f64,
    /// Pictures that take more seconds by the size of what they need are not read. For files without parts.
    pub longest_seconds: f64,
}

/// The record of a run.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct ServeReport {
    /// [`SCHEMA`].
    pub schema: u32,
    /// The machine and the software.
    pub machine: Machine,
    /// Time before each answer in milliseconds.
    pub delay_ms: u64,
    /// Bits of bodies in a second, in millions.
    pub mbit: f64,
    /// The camera: scene and viewpoint.
    pub camera: String,
    /// Size of the pictures.
    pub size: [u32; 2],
    /// The files.
    pub served: Vec<ServedFile>,
    /// Seconds of the whole run.
    pub seconds: f64,
}

impl ServeReport {
    /// The record as indented JSON.
    pub fn to_json(&self) -> String {
        to_json(self)
    }

    /// Whether every picture is that of the whole file, and a negative control was seen to differ.
    pub fn passed(&self) -> bool {
        let rows = || self.served.iter().flat_map(|file| &file.rows);
        let right = rows().all(|row| row.different.unwrap_or(0) == 0);
        right && rows().any(|row| row.control.is_some_and(|pixels| pixels > 0))
    }
}

/// A file that was served.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct ServedFile {
    /// Its name, without its folder.
    pub name: String,
    /// How it is stored: `raw`, `Zstandard`, `parts by level`.
    pub stored: String,
    /// Its length in bytes.
    pub file_bytes: u64,
    /// Length of its head in bytes; 0 without an index.
    pub head_bytes: u64,
    /// Deepest level.
    pub levels: u32,
    /// Voxels, without roots.
    pub voxels: u64,
    /// What was read of it.
    pub rows: Vec<ServeRow>,
}

/// What one picture takes.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct ServeRow {
    /// What is read: `opened`, `coarse, level 5`, `64 px`, `leaves`.
    pub what: String,
    /// Bytes of bodies from the address to the octree; of a picture that was not read, those that it needs.
    pub bytes: u64,
    /// Requests; `None`: it was not read.
    pub requests: Option<u64>,
    /// Seconds from the address to an octree that can be cast; `None`: it was not read, as it would take too long.
    pub seconds: Option<f64>,
    /// Bytes of the octree in memory.
    pub octree_bytes: Option<u64>,
    /// Pixels whose hit or colour is not that of the whole file; `None`: there is no such picture.
    pub different: Option<u64>,
    /// The same with one level less.
    pub control: Option<u64>,
}

/// Serves files and measures what pictures take.
///
/// # Errors
/// A program that is built without the feature `remote`; a file that cannot be read; options out of range.
pub fn run_serve_bench(options: &ServeBenchOptions, progress: &Progress) -> Result<ServeReport, BenchError> {
    if options.files.is_empty() || options.size.contains(&0) || options.mbit.is_nan() || options.mbit <= 0.0 {
        return Err(BenchError::option("FILE", "there must be a file, a size and bits in a second above 0"));
    }
    #[cfg(feature = "remote")]
    return measure::all(options, progress);
    #[cfg(not(feature = "remote"))]
    {
        progress.finish();
        let what = "this program was built without files on servers; build it with them: cargo build --release --features remote";
        Err(BenchError::option("esvo bench serve", what))
    }
}
