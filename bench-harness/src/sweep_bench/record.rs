//! The record of a sweep.

use esvo_engines::EngineId;
use esvo_scenes::SceneVariant;
use serde::{Deserialize, Serialize};

use super::plan::SweepPlan;
use crate::calibration::{CalibrationRecord, GuardSamples};
use crate::error::depth::Summary;
use crate::matrix_parts::LeftOut;
use crate::output::to_json;
use crate::paper_bench::check::Agreement;
use crate::paper_bench::report::DeviceRecord;
use crate::scene::NamedView;
use crate::system::machine::Machine;
use crate::timing::Spread;

/// Version of the record.
pub const SCHEMA: u32 = 1;

/// The record of a run.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct SweepReport {
    /// [`SCHEMA`].
    pub schema: u32,
    /// The machine and the software.
    pub machine: Machine,
    /// What was asked for.
    pub plan: SweepPlan,
    /// Whether Vulkan drivers that run on the processor cast all settings, and not a few only.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub all_on_software: bool,
    /// The engines that were opened.
    pub devices: Vec<DeviceRecord>,
    /// The calibration casts; `None` in records that have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<CalibrationRecord>,
    /// The scenes, in the order of the plan.
    pub scenes: Vec<SceneSweep>,
    /// What was not measured, and why.
    pub left_out: Vec<LeftOut>,
    /// Seconds of the whole run.
    pub seconds: f64,
}

/// A scene, its octrees, and every setting that was measured.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct SceneSweep {
    /// As in [`Scene::name`](crate::scene::Scene::name).
    pub name: String,
    /// Which of its meshes this is.
    pub mesh: SceneVariant,
    /// Whether the file is the one that the manifest names, or which generator made the mesh.
    pub identity: String,
    /// Credit line.
    pub credit: String,
    /// Whether pictures of the mesh may be published.
    pub publish: bool,
    /// SHA-256 of the mesh in memory, with materials and textures, and of the sources of the builder: the cache's name for it.
    pub mesh_sha256: String,
    /// Triangles of the mesh.
    pub triangles: u64,
    /// What the errors are measured against.
    pub exact: ExactKind,
    /// The viewpoints.
    pub views: Vec<NamedView>,
    /// The octrees.
    pub octrees: Vec<OctreeRow>,
    /// Every setting.
    pub cells: Vec<Cell>,
}

/// What the errors of a scene are measured against.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ExactKind {
    /// The triangles, cast in double precision.
    Triangles,
    /// The octree's own leaves, cast by the reference caster, as its triangles are not known: the error of the octree itself
    /// is not in the figures.
    Leaves,
}

/// An octree of a scene.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct OctreeRow {
    /// Its deepest level.
    pub levels: u32,
    /// Whether it was built with contours.
    pub contours: bool,
    /// SHA-256 of its image in memory, by which a file is recognised.
    pub image_sha256: String,
    /// Voxels without the root.
    pub voxels: u64,
    /// Bytes of the image in memory, colours and normals included.
    pub image_bytes: u64,
    /// Bytes of the uncompressed file.
    pub file_bytes: u64,
    /// Seconds of the build; `None` if the octree was in the cache or in a file.
    pub build_seconds: Option<f64>,
}

/// One engine and one setting.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct Cell {
    /// The engine.
    pub engine: EngineId,
    /// Index of the octree; `None`: the triangles themselves, cast on the processor in single precision.
    pub octree: Option<usize>,
    /// Whether voxels are clipped by contours.
    pub contours: bool,
    /// Whether the beam optimization is on.
    pub beam: bool,
    /// Rays end at voxels of this many pixels; 0: at leaves only, and for triangles.
    pub max_voxel_pixels: f32,
    /// Bytes that the engine holds for casting.
    pub memory_bytes: u64,
    /// Bytes on disk: of the uncompressed octree file; of triangles, of their vertices and indices with 4 bytes a number, without
    /// textures, as a plain file has them.
    pub disk_bytes: u64,
    /// The comparison with the reference caster; `None` for triangles, whose exact caster is what errors are measured against.
    pub agreement: Option<Agreement>,
    /// The error, over all views.
    pub error: CellError,
    /// Both passes of every frame in seconds: `seconds[round][view]`. Empty if the hits were wrong.
    pub seconds: Vec<Vec<f64>>,
    /// Calibration casts and processor times; empty in records that have none.
    #[serde(default, skip_serializing_if = "GuardSamples::is_empty")]
    pub guard: GuardSamples,
}

/// The error of a setting against the exact answer, over all views.
#[derive(Clone, Copy, PartialEq, Debug, Default, Serialize, Deserialize)]
pub struct CellError {
    /// Rays.
    pub rays: u64,
    /// Rays that hit with both. The summaries are taken over these.
    pub both_hit: u64,
    /// Rays that should hit and do not: holes.
    pub holes: u64,
    /// Rays that hit and should not.
    pub too_many: u64,
    /// Rays whose answer is no answer; above 0: the caster is broken.
    pub strange: u64,
    /// `(holes + too_many + strange) / rays`.
    pub disagreement: f64,
    /// Distance between the two hits along the ray in pixels: footprints of a pixel at the exact hit.
    pub pixels: Summary,
    /// The same in mesh units.
    pub scene: Summary,
    /// Angle between shading normals in degrees, 0 to 90.
    pub normal_degrees: Summary,
    /// Mean absolute difference of the encoded colour channels of the shaded pictures, 0 to 1; mean over the views.
    pub color: f64,
    /// Mean FLIP of the shaded pictures, 0 to 1; mean over the views.
    pub flip: f64,
}

/// Milliseconds per frame.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct FrameMs {
    /// The mean over the views of the least time of each: what the code takes when nothing else runs.
    pub least: f64,
    /// Median and quartiles over the rounds of the mean over the views.
    pub rounds: Spread,
}

impl SweepReport {
    /// The record as JSON, with every sample as it was taken.
    pub fn to_json(&self) -> String {
        to_json(self)
    }

    /// Whether all hits are the reference's, as far as they must be, and every answer is one.
    pub fn passed(&self) -> bool {
        self.failures().next().is_none()
    }

    /// The settings with wrong hits.
    pub fn failures(&self) -> impl Iterator<Item = (&SceneSweep, &Cell)> {
        let cells = self.scenes.iter().flat_map(|scene| scene.cells.iter().map(move |cell| (scene, cell)));
        cells.filter(|(_, cell)| !cell.passed())
    }

    /// Rays of a frame.
    pub fn pixels(&self) -> u64 {
        u64::from(self.plan.size[0]) * u64::from(self.plan.size[1])
    }
}

impl SceneSweep {
    /// Levels of the octree of a cell; `None` for triangles.
    pub fn levels(&self, cell: &Cell) -> Option<u32> {
        cell.octree.map(|octree| self.octrees[octree].levels)
    }

    /// A setting in words: `10 levels, contours, beam, 1 px`.
    pub fn setting(&self, cell: &Cell) -> String {
        let Some(levels) = self.levels(cell) else { return "triangles".into() };
        let kind = if cell.contours { "contours" } else { "cubical" };
        let beam = if cell.beam { ", beam" } else { "" };
        format!("{levels} levels, {kind}{beam}, {} px", cell.max_voxel_pixels)
    }
}

impl Cell {
    /// Whether the hits are the reference's, as far as they must be.
    pub fn passed(&self) -> bool {
        self.error.strange == 0 && self.agreement.is_none_or(|a| a.passed())
    }

    /// Milliseconds per frame; `None` if it was not timed.
    pub fn frame_ms(&self) -> Option<FrameMs> {
        let mean = |views: &Vec<f64>| 1e3 * views.iter().sum::<f64>() / views.len() as f64;
        let rounds: Vec<f64> = self.seconds.iter().filter(|views| !views.is_empty()).map(mean).collect();
        let views = self.seconds.first()?.len();
        let least = |view: usize| self.seconds.iter().filter_map(|v| v.get(view)).fold(f64::INFINITY, |a, b| a.min(*b));
        let least = 1e3 * (0..views).map(least).sum::<f64>() / views as f64;
        Some(FrameMs { least, rounds: Spread::of(&rounds)? })
    }

    /// The least milliseconds per frame, by which settings are compared.
    pub fn ms(&self) -> Option<f64> {
        self.frame_ms().map(|ms| ms.least)
    }
}
