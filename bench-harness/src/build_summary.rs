//! What one build took and what came out of it: `esvo build --json`, and what `esvo bench build` reads from its children.

use std::path::Path;

use esvo_builder::{BuildSettings, Mesh};
use esvo_format::Stats;
use serde::{Deserialize, Serialize};

use crate::paper_bench::report::KindBytes;

/// Version of the layout of a [`BuildSummary`]. Fields may be added without a new one.
pub const SCHEMA: u32 = 1;

/// One build, from the mesh's file to the octree's.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct BuildSummary {
    /// [`SCHEMA`].
    pub schema: u32,
    /// The mesh: a file's name, or which generator made it.
    pub source: String,
    /// Triangles of the mesh, those without area included.
    pub triangles: u64,
    /// The file that was written.
    pub output: String,
    /// What was asked for.
    pub settings: BuildSettings,
    /// What it took.
    pub seconds: BuildSeconds,
    /// Most memory that the process held up to the end of the import, in bytes; 0 where the system does not say.
    pub import_peak_bytes: u64,
    /// Most memory that the process ever held, in bytes; 0 where the system does not say.
    pub peak_bytes: u64,
    /// Descriptors.
    pub descriptors: u64,
    /// All voxels, leaves and others; the root is not counted.
    pub voxels: u64,
    /// Voxels without children.
    pub leaves: u64,
    /// Contours.
    pub contours: u64,
    /// Far pointers.
    pub far_pointers: u64,
    /// Blocks.
    pub blocks: u64,
    /// Bytes of the image: what a caster needs in memory.
    pub image_bytes: u64,
    /// Bytes of the file.
    pub file_bytes: u64,
    /// Where the bytes of the image are; they add up to `image_bytes`.
    pub kinds: Vec<KindBytes>,
    /// What the importer had to say.
    pub warnings: Vec<String>,
}

/// Seconds of a build, phase by phase.
#[derive(Clone, Copy, PartialEq, Debug, Default, Serialize, Deserialize)]
pub struct BuildSeconds {
    /// From the file to the mesh in memory, or generating it.
    pub import: f64,
    /// From the mesh in memory to the complete file: what tables compare.
    pub build: f64,
    /// Of that: placing the mesh, finding boundaries and whatever else precedes voxels.
    pub prepare: f64,
    /// Of that: finding voxels, contours and attributes, and encoding them in blocks.
    pub voxelize: f64,
    /// Of that: ordering the blocks and writing the file.
    pub write: f64,
}

impl BuildSummary {
    /// Of a build that is done and written to `output`.
    pub fn new(
        source: &str,
        output: &Path,
        mesh: &Mesh,
        settings: &BuildSettings,
        seconds: BuildSeconds,
        (import_peak_bytes, peak_bytes): (u64, u64),
        stats: &Stats,
    ) -> Self {
        Self {
            schema: SCHEMA,
            source: source.into(),
            triangles: mesh.triangle_count() as u64,
            output: output.display().to_string(),
            settings: *settings,
            seconds,
            import_peak_bytes,
            peak_bytes,
            descriptors: stats.descriptors,
            voxels: stats.voxels,
            leaves: stats.leaf_voxels,
            contours: stats.contours,
            far_pointers: stats.far_pointers,
            blocks: stats.blocks,
            image_bytes: stats.image_bytes,
            file_bytes: std::fs::metadata(output).map_or(0, |m| m.len()),
            kinds: (stats.bytes.named().iter())
                .map(|(kind, bytes)| KindBytes { kind: kind.to_string(), bytes: *bytes })
                .collect(),
            warnings: mesh.warnings.clone(),
        }
    }
}

/// Most memory that this process has held so far, in bytes, or 0 where the system does not say.
pub fn peak_bytes() -> u64 {
    crate::system::clock::status_bytes("self", "VmHWM:").unwrap_or(0)
}
