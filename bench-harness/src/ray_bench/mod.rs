//! `esvo bench rays`: lists of rays through [`Caster::cast_rays`](esvo_core::Caster::cast_rays) on every engine, compared with
//! the reference caster, and their rates next to a picture's.

mod measure;
mod output;
mod sets;
pub(crate) mod tables;

use std::path::PathBuf;

use esvo_core::Device;
use esvo_engines::EngineId;
use serde::{Deserialize, Serialize};

use crate::calibration::{CalibrationRecord, GuardSamples};
use crate::output::to_json;
use crate::paper_bench::check::Agreement;
use crate::system::machine::Machine;
use crate::timing::Spread;

pub use measure::run_ray_bench;
pub use output::write_ray_record;
pub use tables::{to_markdown, to_text};

/// Version of the record.
pub const SCHEMA: u32 = 1;

/// What [`run_ray_bench`] measures.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct RayBenchOptions {
    /// Name of the scene.
    pub scene: String,
    /// Levels of its octree, which has contours.
    pub levels: u32,
    /// Size of the picture, whose hits shadow rays start from.
    pub size: [u32; 2],
    /// Rays of the long list of incoherent rays.
    pub rays: usize,
    /// Time for the measurements in seconds. Three rounds are made at least.
    pub seconds: f64,
    /// The engines.
    pub engines: Vec<EngineId>,
    /// Threads of the CPU caster; `None`: one per core.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub threads: Option<usize>,
    /// The folder that is searched first for real meshes. Not in records.
    #[serde(skip)]
    pub scenes_dir: Option<PathBuf>,
}

impl Default for RayBenchOptions {
    /// SIBENIK at 10 levels, a million rays, a picture of 512x384, one minute, all engines.
    fn default() -> Self {
        Self {
            scene: "sibenik".into(),
            levels: 10,
            size: [512, 384],
            rays: 1_000_000,
            seconds: 60.0,
            engines: EngineId::all(),
            threads: None,
            scenes_dir: None,
        }
    }
}

/// The record of a run.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct RayReport {
    /// [`SCHEMA`].
    pub schema: u32,
    /// The machine and the software.
    pub machine: Machine,
    /// What was asked for; `None` in records that do not say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub options: Option<RayBenchOptions>,
    /// The scene, as in [`Scene::name`](crate::scene::Scene::name).
    pub scene: String,
    /// Whether its mesh is the one that the manifest names.
    pub identity: String,
    /// Credit of the mesh.
    pub credit: String,
    /// Levels of the octree.
    pub levels: u32,
    /// Its voxels, without the root.
    pub voxels: u64,
    /// Name of the picture's viewpoint.
    pub view: String,
    /// Size of the picture.
    pub size: [u32; 2],
    /// SHA-256 of the octree's image in hexadecimal digits; empty in records that have none.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub image_sha256: String,
    /// The calibration casts; `None` in records that have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<CalibrationRecord>,
    /// What is cast. The picture is the first.
    pub sets: Vec<SetRow>,
    /// The engines.
    pub engines: Vec<EngineRow>,
    /// Seconds of the whole run.
    pub seconds: f64,
}

impl RayReport {
    /// The record as indented JSON, with every sample as it was taken.
    pub fn to_json(&self) -> String {
        to_json(self)
    }

    /// Whether every engine that was opened gave the reference's hits, as far as it must.
    pub fn passed(&self) -> bool {
        let good = |row: &EngineRow| row.device.is_none() || row.error.is_none() && row.cells.iter().all(Cell::passed);
        self.engines.iter().all(good)
    }
}

/// A set of rays.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct SetRow {
    /// Its name in tables.
    pub name: String,
    /// Number of rays.
    pub rays: u64,
    /// Calls of the caster for all of them: 1, or one for each ray.
    pub calls: u64,
    /// Rays that hit with the reference caster.
    pub hits: u64,
}

/// One engine.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct EngineRow {
    /// Its name; `scalar` for the CPU engine without the fastest instructions.
    pub name: String,
    /// What it runs on; `None` if it could not be opened.
    pub device: Option<Device>,
    /// Why it was not measured.
    pub error: Option<String>,
    /// For each set, what was found; empty after an error.
    pub cells: Vec<Cell>,
}

/// One engine and one set of rays.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct Cell {
    /// The comparison with the reference caster. `t` is in lengths of the ray's direction.
    pub agreement: Agreement,
    /// Seconds from the call to the last hit in memory, in the order of the rounds.
    pub seconds: Vec<f64>,
    /// Calibration casts and processor times; empty in records that have none.
    #[serde(default, skip_serializing_if = "GuardSamples::is_empty")]
    pub guard: GuardSamples,
}

impl Cell {
    fn passed(&self) -> bool {
        self.agreement.passed()
    }

    /// Millions of rays per second: median and quartiles over the rounds.
    pub fn mrays(&self, rays: u64) -> Option<Spread> {
        Spread::of(&self.seconds.iter().map(|seconds| rays as f64 / seconds / 1e6).collect::<Vec<_>>())
    }
}
