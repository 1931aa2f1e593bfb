//! The result of one build: `esvo build --json` prints it, and `esvo bench build` reads it from its child processes.

use std::path::Path;

use esvo_builder::{BuildSettings, Mesh};
use esvo_format::Stats;
use serde::{Deserialize, Serialize};

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
    /// The octree's file.
    pub output: String,
    /// The settings of the builder.
    pub settings: BuildSettings,
    /// Times by phase.
    pub seconds: BuildSeconds,
    /// Most memory that the process held up to the end of the import, in bytes; 0 if the system does not say.
    pub import_peak_bytes: u64,
    /// Most memory that the process ever held, in bytes; 0 if the system does not say.
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
    /// Bytes of the image by kind. Their sum is `image_bytes`.
    pub kinds: Vec<KindBytes>,
    /// Warnings of the importer.
    pub warnings: Vec<String>,
}

/// Seconds of a build, phase by phase.
#[derive(Clone, Copy, PartialEq, Debug, Default, Serialize, Deserialize)]
pub struct BuildSeconds {
    /// Reading the file to a mesh in memory, or generating the mesh.
    pub import: f64,
    /// From the mesh in memory to the complete file: what tables compare.
    pub build: f64,
    /// Part of `build`: placing the mesh, finding boundaries and other work before the first voxel.
    pub prepare: f64,
    /// Part of `build`: finding voxels, contours and attributes, and encoding them in blocks.
    pub voxelize: f64,
    /// Part of `build`: ordering the blocks and writing the file.
    pub write: f64,
}

/// Bytes of one kind.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct KindBytes {
    /// Name of the kind.
    pub kind: String,
    /// Number of bytes.
    pub bytes: u64,
}

impl BuildSummary {
    /// The summary of a build that was written to `output`.
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
