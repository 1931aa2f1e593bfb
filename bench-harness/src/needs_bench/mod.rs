//! `esvo bench needs`: what it costs to keep code for features that a scene does not need.
//!
//! An octree without contours is cast by code with and without clipping by contours, one without far pointers with and without
//! code that follows them, and rays that end at leaves with and without the test whether a voxel is small. GPU kernels have a stack
//! of as many frames as the octree has levels, or of all that an octree can have.

mod measure;
mod output;
pub(crate) mod tables;

use std::path::PathBuf;

use esvo_core::Device;
use esvo_engines::{EngineId, InstructionSet, LeaveOut};
use serde::{Deserialize, Serialize};

use crate::calibration::{CalibrationRecord, GuardSamples};
use crate::matrix_parts::LeftOut;
use crate::output::to_json;
use crate::paper_bench::check::Agreement;
use crate::system::machine::Machine;
use crate::timing::Spread;

pub use measure::{resume_needs_bench, run_needs_bench};
pub use output::write_needs_record;
pub use tables::{to_markdown, to_text};

/// Version of the record.
pub const SCHEMA: u32 = 1;

/// What [`run_needs_bench`] measures.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct NeedsBenchOptions {
    /// Names of the scenes; empty: all of the manifest that are built as they are, which leaves out SIBENIK-D, displaced at each
    /// level, and SIBENIK-PLAIN, whose textures are dropped.
    pub scenes: Vec<String>,
    /// Levels of their octrees. Small octrees have no far pointers.
    pub levels: Vec<u32>,
    /// Size of the pictures.
    pub size: [u32; 2],
    /// Viewpoints of each scene.
    pub views: usize,
    /// Rounds.
    pub rounds: usize,
    /// The engines: the CPU caster, by one ray at a time and by its fastest instructions, and GPU casters.
    pub engines: Vec<EngineId>,
    /// Threads of the CPU caster; `None`: one per core.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub threads: Option<usize>,
    /// The folder that is searched first for real meshes. Not in records.
    #[serde(skip)]
    pub scenes_dir: Option<PathBuf>,
}

impl Default for NeedsBenchOptions {
    /// SIBENIK and CONFERENCE at 7 and 10 levels, four views of 512x384, five rounds, on the CPU.
    fn default() -> Self {
        Self {
            scenes: vec!["sibenik".into(), "conference".into()],
            levels: vec![7, 10],
            size: [512, 384],
            views: 4,
            rounds: 5,
            engines: vec![EngineId::Cpu],
            threads: None,
            scenes_dir: None,
        }
    }
}

/// The record of a run.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct NeedsReport {
    /// [`SCHEMA`].
    pub schema: u32,
    /// The machine and the software.
    pub machine: Machine,
    /// What was asked for; `None` in records that do not say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub options: Option<NeedsBenchOptions>,
    /// Size of the pictures.
    pub size: [u32; 2],
    /// Scene, credit and identity of the meshes, as in [`Scene`](crate::scene::Scene).
    pub credits: Vec<[String; 3]>,
    /// The calibration casts; `None` in records that have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<CalibrationRecord>,
    /// The instruction sets of the CPU engine, and the GPU engines.
    pub engines: Vec<EngineRow>,
    /// What was cast.
    pub cases: Vec<Case>,
    /// What was not measured, and why.
    #[serde(default)]
    pub left_out: Vec<LeftOut>,
    /// Seconds of the whole run.
    pub seconds: f64,
}

impl NeedsReport {
    /// The record as indented JSON, with every sample as it was taken.
    pub fn to_json(&self) -> String {
        to_json(self)
    }

    /// Whether all hits are the reference's.
    pub fn passed(&self) -> bool {
        self.cases.iter().flat_map(|case| &case.cells).all(|cell| cell.agreement.passed())
    }
}

/// One instruction set, or one GPU engine.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct EngineRow {
    /// Its name, as in [`InstructionSet::name`](esvo_engines::InstructionSet::name) or [`EngineId::name`].
    pub name: String,
    /// The processor and the instructions, or the GPU.
    pub device: Device,
}

/// An octree, and where rays end in it.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct Case {
    /// The scene, as in [`Scene::name`](crate::scene::Scene::name).
    pub scene: String,
    /// Levels of the octree.
    pub levels: u32,
    /// Size of its file in bytes.
    pub file_bytes: u64,
    /// Bytes of the octree's image, with its attachments.
    pub image_bytes: u64,
    /// SHA-256 of the octree's image in hexadecimal digits; empty in records that have none.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub image_sha256: String,
    /// Bytes of the image without attachments, which is what is uploaded. 0 in older records.
    #[serde(default)]
    pub upload_bytes: u64,
    /// What is in these bytes although no caster reads it for this octree.
    #[serde(default)]
    pub unread: Unread,
    /// What octree and rays need.
    pub needs: Needed,
    /// Rays of a round.
    pub rays: u64,
    /// For each engine, in their order: each of [`Variant::ALL`] for which it has code of its own.
    pub cells: Vec<Cell>,
}

/// Bytes of an upload that no caster reads.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub struct Unread {
    /// Of an octree without contours, the half of each descriptor that is about contours.
    pub contour_halves: u64,
    /// Page headers and info sections, which lead to attachments.
    pub headers: u64,
    /// Unused slots, which keep siblings in pairs and within a page.
    pub gaps: u64,
}

/// What octree and rays need of the code.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Needed {
    /// The octree has contours.
    pub contours: bool,
    /// The octree has far pointers.
    pub far_pointers: bool,
    /// Rays end at voxels of one pixel, and not at leaves only.
    pub sizes: bool,
}

/// What is left out, if it is not needed.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Variant {
    /// Nothing: the code contains all.
    Everything,
    /// Clipping by contours.
    Contours,
    /// Following far pointers.
    FarPointers,
    /// The test for small voxels.
    Sizes,
    /// Frames of the stack for levels that the octree does not have.
    Frames,
    /// All four.
    All,
}

impl Variant {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Everything, Self::Contours, Self::FarPointers, Self::Sizes, Self::Frames, Self::All];

    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Everything => "everything is in",
            Self::Contours => "no contours",
            Self::FarPointers => "no far pointers",
            Self::Sizes => "no test of sizes",
            Self::Frames => "no spare frames",
            Self::All => "only what is needed",
        }
    }

    /// What the caster is told.
    pub fn leave_out(self) -> LeaveOut {
        LeaveOut {
            contours: matches!(self, Self::Contours | Self::All),
            far_pointers: matches!(self, Self::FarPointers | Self::All),
            sizes: matches!(self, Self::Sizes | Self::All),
            frames: matches!(self, Self::Frames | Self::All),
        }
    }

    /// Whether it leaves out something that is not needed.
    fn differs(self, needed: Needed) -> bool {
        let left = self.leave_out();
        let spare_frames = self == Self::Frames;
        spare_frames
            || left.contours && !needed.contours
            || left.far_pointers && !needed.far_pointers
            || left.sizes && !needed.sizes
    }

    /// Whether this engine has other code for it. Of the CPU's, packets leave out contours only: see [`LeaveOut`].
    fn is_left_out_by(self, set: Option<InstructionSet>) -> bool {
        match set {
            None => true,
            Some(InstructionSet::Scalar) => self != Self::Frames,
            Some(_) => matches!(self, Self::Everything | Self::Contours),
        }
    }
}

/// One engine, one case and one variant.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct Cell {
    /// Index of the engine.
    pub engine: usize,
    /// What was left out.
    pub variant: Variant,
    /// The comparison with the reference caster.
    pub agreement: Agreement,
    /// Seconds of all views, in the order of the rounds.
    pub seconds: Vec<f64>,
    /// Calibration casts and processor times; empty in records that have none.
    #[serde(default, skip_serializing_if = "GuardSamples::is_empty")]
    pub guard: GuardSamples,
}

impl Cell {
    /// Milliseconds for all views: median and quartiles over the rounds.
    pub fn milliseconds(&self) -> Option<Spread> {
        Spread::of(&self.seconds.iter().map(|seconds| seconds * 1e3).collect::<Vec<_>>())
    }
}
