//! `esvo bench stability`: hard rays through hard octrees and hard meshes on every engine, and what must hold.
//!
//! Rays and octrees are those of [`esvo_core::testing::directed`]: each ray is made from a number, so that `--replay` casts it again
//! alone. The hits of the reference caster are judged by [`esvo_core::testing::oracle`], which derives how far off they may be. All other
//! engines must find what the reference finds, in every bit; on a GPU, whose language lets it round otherwise, what differs is judged by
//! the oracle too.

mod controls;
mod data;
mod engines;
mod meshes;
mod output;
mod pictures;
mod replay;
pub(crate) mod tables;

use esvo_core::Device;
use esvo_engines::EngineId;
use serde::{Deserialize, Serialize};

use crate::output::to_json;
use crate::system::machine::Machine;

pub use data::run_stability_bench;
pub use output::write_stability_record;
pub use replay::{Case, replay};
pub use tables::{to_markdown, to_text};

/// Version of the record.
pub const SCHEMA: u32 = 1;

/// What [`run_stability_bench`] tests.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct StabilityOptions {
    /// Rays for each engine that runs on the processor, over all octrees and kinds.
    pub rays: u64,
    /// Rays for each GPU engine.
    pub gpu_rays: u64,
    /// Rays for each of the hard meshes.
    pub mesh_rays: u64,
    /// Number of the first ray of each kind.
    pub seed: u64,
    /// The engines. The CPU caster is tested with each instruction set that the processor has.
    pub engines: Vec<EngineId>,
}

impl Default for StabilityOptions {
    /// Half a million rays, 200,000 on GPUs, all engines.
    fn default() -> Self {
        Self { rays: 500_000, gpu_rays: 200_000, mesh_rays: 2000, seed: 0, engines: EngineId::all() }
    }
}

/// The record of a run.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct StabilityReport {
    /// [`SCHEMA`].
    pub schema: u32,
    /// The machine and the software.
    pub machine: Machine,
    /// What was asked for; `None` in records that do not say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub options: Option<StabilityOptions>,
    /// Number of the first ray of each kind.
    pub seed: u64,
    /// The octrees.
    pub sets: Vec<SetRow>,
    /// The reference caster against the oracle, for each octree and kind of rays.
    pub cells: Vec<Cell>,
    /// The same octree mirrored and with its axes exchanged.
    pub symmetries: Vec<SymmetryRow>,
    /// Rays from within a closed shell.
    pub leaks: Leaks,
    /// The engines against the reference caster.
    pub engines: Vec<EngineRow>,
    /// Octrees of hard meshes against their triangles.
    pub meshes: Vec<MeshRow>,
    /// Mistakes that were made on purpose.
    pub controls: Vec<Control>,
    /// Seconds of the whole run.
    pub seconds: f64,
}

impl StabilityReport {
    /// The record as indented JSON.
    pub fn to_json(&self) -> String {
        to_json(self)
    }

    /// Whether nothing failed, and every mistake that was made on purpose was caught.
    pub fn passed(&self) -> bool {
        self.failures() == 0 && !self.cells.is_empty() && self.controls.iter().all(|control| control.caught > 0)
    }

    /// Cases that failed, of all kinds.
    pub fn failures(&self) -> u64 {
        self.cells.iter().map(|cell| cell.failures).sum::<u64>()
            + self.symmetries.iter().map(|row| row.failures).sum::<u64>()
            + self.leaks.misses
            + self.engines.iter().map(EngineRow::failures).sum::<u64>()
            + self.meshes.iter().map(|row| row.holes + row.beside).sum::<u64>()
    }
}

/// An octree.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct SetRow {
    /// Its name in cases.
    pub name: String,
    /// What is hard about it.
    pub about: String,
    /// Level of its deepest voxels.
    pub levels: u32,
    /// Its voxels, without the root.
    pub voxels: u64,
    /// Iterations that no ray can exceed.
    pub most_iterations: u64,
}

/// Rays of one kind through one octree, by the reference caster.
#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
pub struct Cell {
    /// The octree.
    pub set: String,
    /// The kind of the rays.
    pub kind: String,
    /// Whether contours clip voxels.
    pub contours: bool,
    /// Rays.
    pub cases: u64,
    /// Those that hit.
    pub hits: u64,
    /// Those whose hit is wrong.
    pub failures: u64,
    /// Largest error of `t` over its bound, of hits that are right.
    pub worst: f64,
    /// The case with that error; after a failure, the first that failed.
    pub worst_case: Option<String>,
    /// What is wrong with the first that failed.
    pub failure: Option<String>,
    /// Most iterations that a ray took.
    pub iterations: u64,
}

/// An octree after symmetries of the cube.
#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
pub struct SymmetryRow {
    /// The octree.
    pub set: String,
    /// Rays and symmetries.
    pub cases: u64,
    /// Those that end at another voxel, which the oracle allows: rounding decides between voxels whose spans begin together within
    /// the bounds.
    pub ties: u64,
    /// Those that end at another voxel otherwise.
    pub failures: u64,
}

/// Rays from within a closed shell to its corners and edges.
#[derive(Clone, Copy, PartialEq, Debug, Default, Serialize, Deserialize)]
pub struct Leaks {
    /// Rays.
    pub cases: u64,
    /// Those that miss. None may.
    pub misses: u64,
}

/// One engine against the reference caster.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct EngineRow {
    /// Its name, with the instruction set of the CPU caster.
    pub name: String,
    /// What it runs on; `None` if it could not be opened.
    pub device: Option<Device>,
    /// Why it was not tested, or not to the end.
    pub error: Option<String>,
    /// Rays of lists.
    pub rays: u64,
    /// Rays of pictures.
    pub pixels: u64,
    /// Rays that end at another voxel or another `t`.
    pub different: u64,
    /// Those of them that are wrong: all, where every bit must be the same.
    pub wrong: u64,
    /// The first that is wrong.
    pub first: Option<String>,
}

impl EngineRow {
    fn failures(&self) -> u64 {
        // A device that is not there is no failure; one that stops working is.
        self.wrong + u64::from(self.device.is_some() && self.error.is_some())
    }
}

/// A hard mesh and its octree.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct MeshRow {
    /// Its name.
    pub name: String,
    /// What is hard about it.
    pub about: String,
    /// Levels of the octree.
    pub levels: u32,
    /// Whether it has contours.
    pub contours: bool,
    /// Rays that hit the mesh.
    pub rays: u64,
    /// Those that do not hit the octree, or more than a hundredth of a voxel and the bound behind.
    pub holes: u64,
    /// Rays that hit the octree farther than a voxel's diagonal from all triangles.
    pub beside: u64,
    /// Largest distance of a hit from the triangles, in diagonals of the voxel.
    pub worst: f64,
}

/// A mistake made on purpose.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct Control {
    /// The mistake.
    pub what: String,
    /// What must catch it: `oracle` or `engines`.
    pub by: String,
    /// Rays with the mistake.
    pub cases: u64,
    /// Rays that were found wrong.
    pub caught: u64,
}
