//! `esvo bench voxelize`: every method of voxelization on a GPU against the exact set of voxels, with what is missing, what is extra,
//! and how long it takes.

#[cfg(feature = "wgpu")]
mod measure;
mod output;
#[cfg(feature = "wgpu")]
mod pictures;
pub(crate) mod plot;
#[cfg(feature = "wgpu")]
mod rate;
#[cfg(feature = "wgpu")]
mod sheet;
#[cfg(feature = "wgpu")]
mod surface;
pub(crate) mod tables;

use std::path::PathBuf;

use esvo_core::Device;
use serde::{Deserialize, Serialize};

use crate::matrix_parts::LeftOut;
use crate::output::{NamedPicture, to_json};
use crate::system::machine::Machine;

#[cfg(feature = "wgpu")]
pub use measure::{resume_voxel_bench, run_voxel_bench, unavailable};
pub use output::write_voxel_record;
pub use plot::{curve_to_svg, to_svg};
#[cfg(feature = "wgpu")]
pub use surface::{GpuVoxels, voxelize_mesh};
pub use tables::{to_markdown, to_text};

/// What a program without the feature `wgpu` says.
#[cfg(not(feature = "wgpu"))]
const NOT_BUILT_IN: &str = "this program was built without the feature wgpu, which voxelizes on a GPU";

/// Says that this program has no voxelizer.
///
/// # Errors
/// Always: the feature `wgpu` is off.
#[cfg(not(feature = "wgpu"))]
pub fn run_voxel_bench(
    options: &VoxelBenchOptions,
    progress: &crate::Progress,
) -> Result<VoxelOutcome, crate::BenchError> {
    resume_voxel_bench(options, &crate::journal::Journal::none(), progress)
}

/// Says that this program has no voxelizer.
///
/// # Errors
/// Always: the feature `wgpu` is off.
#[cfg(not(feature = "wgpu"))]
pub fn resume_voxel_bench(
    _: &VoxelBenchOptions,
    _: &crate::journal::Journal,
    _: &crate::Progress,
) -> Result<VoxelOutcome, crate::BenchError> {
    Err(crate::BenchError::option("voxelization", NOT_BUILT_IN))
}

/// Why nothing can be voxelized here: the feature `wgpu` is off.
#[cfg(not(feature = "wgpu"))]
pub fn unavailable(_: &VoxelBenchOptions) -> Option<String> {
    Some(NOT_BUILT_IN.into())
}

/// The deepest level of a grid: 4096 voxels along its edge.
pub const MAX_LEVEL: u32 = 12;
#[cfg(feature = "wgpu")]
const _: () = assert!(MAX_LEVEL == esvo_raster::MAX_LEVEL);

/// Version of the record.
pub const SCHEMA: u32 = 1;

/// A scene and the grids that it is voxelized into.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct SceneGrids {
    /// Name of the scene.
    pub name: String,
    /// Levels of the grids, ascending, each 1 to 12: 2^level voxels along the edge.
    pub levels: Vec<u32>,
}

/// What is measured.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct VoxelBenchOptions {
    /// The scenes.
    pub scenes: Vec<SceneGrids>,
    /// Names or letters of methods; empty: all.
    pub methods: Vec<String>,
    /// How often each method is timed, at least 1.
    pub rounds: u32,
    /// Part of the name of the device; `None`: the best.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
    /// Whether pictures are made.
    pub pictures: bool,
    /// Seconds of the whole run, about: finer grids of a scene are left out that would not end in time, by the time that the grid before
    /// them took. The first grid of a scene is always measured. `None`: no limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_limit_seconds: Option<f64>,
    /// Grids that were left out of the plan, which the record names as well.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left_out: Vec<LeftOut>,
    /// The folder that is searched first for real meshes. Not in records.
    #[serde(skip)]
    pub scenes_dir: Option<PathBuf>,
}

impl Default for VoxelBenchOptions {
    /// SIBENIK and CONFERENCE at 256, 512 and 1024 voxels, HAIRBALL at 256 and 512; three rounds; with pictures.
    fn default() -> Self {
        let scene = |name: &str, levels: &[u32]| SceneGrids { name: name.into(), levels: levels.to_vec() };
        Self {
            scenes: vec![scene("sibenik", &[8, 9, 10]), scene("conference", &[8, 9, 10]), scene("hairball", &[8, 9])],
            methods: Vec::new(),
            rounds: 3,
            device: None,
            pictures: true,
            time_limit_seconds: None,
            left_out: Vec::new(),
            scenes_dir: None,
        }
    }
}

impl VoxelBenchOptions {
    /// Takes these scenes, with the grids that they have so far, or else those of the first scene.
    pub fn select_scenes(&mut self, names: &[String]) {
        let levels = self.scenes.first().map(|scene| scene.levels.clone()).unwrap_or_default();
        let of = |name: &String| {
            let known = self.scenes.iter().find(|scene| scene.name.eq_ignore_ascii_case(name));
            known.cloned().unwrap_or_else(|| SceneGrids { name: name.clone(), levels: levels.clone() })
        };
        self.scenes = names.iter().map(of).collect();
    }

    /// Voxelizes every scene into grids of these levels.
    pub fn set_levels(&mut self, levels: &[u32]) {
        let mut levels = levels.to_vec();
        levels.sort_unstable();
        levels.dedup();
        self.scenes.iter_mut().for_each(|scene| scene.levels.clone_from(&levels));
    }

    /// The options of a run that does what a record's did: without the grids that its time limit left out, which are named.
    pub fn of_record(report: &VoxelReport) -> Self {
        let mut again = Self { time_limit_seconds: None, ..report.options.clone() };
        for scene in &mut again.scenes {
            let late = |level: u32| {
                let what = grid_name(&scene.name.to_ascii_uppercase(), level);
                report.left_out.iter().find(|left| left.what == what)
            };
            let named: Vec<_> = scene.levels.iter().filter_map(|level| late(*level)).cloned().collect();
            scene.levels.retain(|level| late(*level).is_none());
            again.left_out.extend(named.into_iter().filter(|left| !report.options.left_out.contains(left)));
        }
        again
    }
}

/// What a grid that is left out is called; the scene's name in capitals.
fn grid_name(scene: &str, level: u32) -> String {
    format!("{scene} in a grid of {}^3", 1u64 << level)
}

/// The record of a run.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct VoxelReport {
    /// [`SCHEMA`].
    pub schema: u32,
    /// The machine and the software.
    pub machine: Machine,
    /// What was asked for.
    pub options: VoxelBenchOptions,
    /// The device.
    pub device: Device,
    /// Methods that the device lacks something for, scenes that are not there, grids that do not fit.
    pub left_out: Vec<LeftOut>,
    /// The scenes.
    pub scenes: Vec<SceneVoxels>,
    /// Missing voxels by the size of triangles, on a generated sheet.
    pub curve: Vec<CurvePoint>,
    /// Pictures beside the record, by what they show.
    pub pictures: Vec<PictureGroup>,
    /// Seconds of the whole run.
    pub seconds: f64,
}

/// Pictures of one thing, by several methods or in several ways.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct PictureGroup {
    /// What they show.
    pub what: String,
    /// Credit of the mesh.
    pub credit: String,
    /// Files beside the record, each named after its method at the end, or after what it shows.
    pub files: Vec<String>,
}

/// A scene.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct SceneVoxels {
    /// As in [`Scene::name`](crate::scene::Scene::name).
    pub name: String,
    /// Whether its mesh is the one that the manifest names.
    pub identity: String,
    /// Credit of the mesh.
    pub credit: String,
    /// Triangles with an area.
    pub triangles: u64,
    /// The grids.
    pub grids: Vec<Grid>,
}

/// A scene in one grid.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct Grid {
    /// 2^level voxels along the edge.
    pub level: u32,
    /// Voxels that the mesh meets.
    pub voxels: u64,
    /// Milliseconds in which the builder finds them on the processor, once for each round: a list of voxels.
    pub exact_ms: Vec<f64>,
    /// Milliseconds in which the builder makes a cubical octree without attributes on the processor, once.
    pub build_ms: f64,
    /// Mean edge of a triangle in voxels.
    pub mean_edge: f64,
    /// The methods.
    pub methods: Vec<MethodRow>,
}

/// A method on one grid.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct MethodRow {
    /// Its letter.
    pub letter: String,
    /// Its name.
    pub name: String,
    /// Whether it tests voxels, so that it may differ within the bound of single precision only.
    pub tested: bool,
    /// Voxels that it finds.
    pub voxels: u64,
    /// Missing voxels in a column of which it shades a pixel for a triangle that meets the voxel.
    pub cracks: u64,
    /// Other missing voxels: no pixel is shaded for any triangle that meets them.
    pub holes: u64,
    /// Voxels that no triangle meets.
    pub extra: u64,
    /// Missing and extra voxels of a method that tests which no test of a triangle puts within twice the bound of single precision.
    /// Must be 0.
    pub beyond_bound: u64,
    /// Pairs of triangle and voxel that the device left to the processor.
    pub undecided: u64,
    /// Fragments that were shaded.
    pub fragments: u64,
    /// Milliseconds on the device to find voxels, once for each round.
    pub voxelize_ms: Vec<f64>,
    /// Milliseconds on the device to list them, once for each round.
    pub compact_ms: Vec<f64>,
    /// Milliseconds on the processor to prepare triangles and to decide what the device left, once for each round.
    pub host_ms: Vec<f64>,
    /// Bytes on the device at once.
    pub bytes: u64,
    /// Tiles that were worked on.
    pub tiles: u32,
    /// Tiles of the grid.
    pub tiles_of_grid: u32,
}

impl MethodRow {
    /// Voxels that should be there and are not.
    pub fn missing(&self) -> u64 {
        self.cracks + self.holes
    }

    /// Whether it is as exact as it must be.
    pub fn passed(&self) -> bool {
        self.beyond_bound == 0 && (self.letter != "g" || self.missing() + self.extra == 0)
    }
}

/// Missing voxels of one method on a sheet of equal triangles.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct CurvePoint {
    /// Mean edge of a triangle in voxels.
    pub edge: f64,
    /// The method's letter.
    pub letter: String,
    /// Voxels that the sheet meets.
    pub voxels: u64,
    /// Of these, the missing ones.
    pub missing: u64,
    /// Of the missing ones, those that no pixel was shaded for.
    pub holes: u64,
}

impl VoxelReport {
    /// The record as indented JSON.
    pub fn to_json(&self) -> String {
        to_json(self)
    }

    /// Whether every method is as exact as it must be.
    pub fn passed(&self) -> bool {
        self.scenes.iter().flat_map(|scene| &scene.grids).flat_map(|grid| &grid.methods).all(MethodRow::passed)
    }
}

/// A record with its pictures.
#[derive(Clone, Debug)]
pub struct VoxelOutcome {
    /// The record.
    pub report: VoxelReport,
    /// Pictures like the document's.
    pub pictures: Vec<NamedPicture>,
}
