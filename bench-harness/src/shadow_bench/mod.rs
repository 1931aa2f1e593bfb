//! `esvo bench shadow`: what a volume of one bit a voxel costs, and how wrong its shortcuts are.

mod answers;
#[cfg(feature = "wgpu")]
mod device;
#[cfg(not(feature = "wgpu"))]
#[path = "no_device.rs"]
mod device;
mod errors;
mod leaks;
mod models;
mod output;
mod picture_time;
mod pictures;
mod plot;
mod rates;
mod run;
mod stage;
pub(crate) mod tables;
mod world;

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::matrix_parts::LeftOut;
use crate::output::{NamedPicture, to_json};
use crate::system::machine::Machine;

pub use output::write_shadow_record;
pub use plot::to_svg;
pub use run::run_shadow_bench;
pub use tables::{to_markdown, to_text};

/// How [`RateRow::tracer`] begins where every voxel on a ray is looked at.
const WALK: &str = "every voxel";

/// Share of pixels that a device may have otherwise than the processor: sines and roots are rounded otherwise, and a few rays go elsewhere.
const MOST_DIFFERENT: f64 = 0.01;

/// Version of the record.
pub const SCHEMA: u32 = 1;

/// What is measured.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct ShadowOptions {
    /// The scenes, of the manifest. Each is taken to be 40 m long.
    pub scenes: Vec<String>,
    /// Edges of voxels in centimetres, each above 0.
    pub voxels_cm: Vec<f64>,
    /// Rays for each pixel, each at least 1.
    pub rays: Vec<u32>,
    /// Width and height of the pictures that errors are measured in. Those beside the record are 5/2 times as wide and 13/6 times as high.
    pub size: (u32, u32),
    /// Levels of the octrees that surfaces are seen with, 1 to 16.
    pub levels: u32,
    /// Rays for each pixel of the converged answer, at least 1.
    pub converged: u32,
    /// How often each time is measured, at least 1.
    pub rounds: u32,
    /// Rays that try to leave closed rooms.
    pub leak_rays: u64,
    /// Voxels along each axis of the world that objects move in.
    pub world: [u32; 3],
    /// Width and height of the picture of that world of which each pass is timed; 0, 0: none.
    #[serde(default)]
    pub picture: (u32, u32),
    /// Whether pictures are made.
    pub pictures: bool,
    /// The folder that is searched first for real meshes. Not in records.
    #[serde(skip)]
    pub scenes_dir: Option<PathBuf>,
}

impl Default for ShadowOptions {
    /// SIBENIK at 2.5 to 20 cm, 1 to 64 rays, pictures of 320x240; ten million rays against leaks; the document's world.
    fn default() -> Self {
        Self {
            scenes: vec!["sibenik".into()],
            voxels_cm: vec![2.5, 5.0, 10.0, 20.0],
            rays: vec![1, 4, 16, 64],
            size: (320, 240),
            levels: 11,
            converged: 256,
            rounds: 3,
            leak_rays: 10_000_000,
            world: [2000, 2000, 500],
            picture: (1920, 1080),
            pictures: true,
            scenes_dir: None,
        }
    }
}

/// The record of a run.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct ShadowReport {
    /// [`SCHEMA`].
    pub schema: u32,
    /// The machine and the software.
    pub machine: Machine,
    /// What was asked for.
    pub options: ShadowOptions,
    /// Scenes and devices that are not there.
    pub left_out: Vec<LeftOut>,
    /// The volume of a large world.
    pub world: WorldRow,
    /// Objects that move in it.
    pub moving: Vec<MovingRow>,
    /// What each pass of a picture of it takes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub picture: Option<PictureTime>,
    /// Rays that leave closed rooms.
    pub leaks: Vec<LeakRow>,
    /// The scenes.
    pub scenes: Vec<SceneShadows>,
    /// Pictures beside the record, by what they show.
    pub pictures: Vec<PictureNote>,
    /// Seconds of the whole run.
    pub seconds: f64,
}

/// Bytes and times of a world.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct WorldRow {
    /// Voxels along each axis.
    pub voxels: [u32; 3],
    /// Number of mips.
    pub mips: u32,
    /// Bytes of the base level and the mips.
    pub bytes: u64,
    /// Voxels that are set.
    pub set: u64,
    /// Bytes of the same world in bricks.
    pub brick_bytes: u64,
    /// Seconds to find the voxels of what is fixed.
    pub fill_seconds: f64,
    /// Seconds to make all bytes and mips from it.
    pub update_seconds: f64,
    /// Most bytes of memory that the program had in use until then; 0 if the system does not tell.
    pub peak_bytes: u64,
}

/// Objects of one size that move at once.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct MovingRow {
    /// Number of objects.
    pub objects: u32,
    /// Edge of the box around one, in voxels.
    pub edge: u32,
    /// Pictures that were measured.
    pub frames: u32,
    /// Mean milliseconds of a picture to find the voxels of all objects in their new poses.
    pub rasterize_ms: f64,
    /// Mean milliseconds to bring the volume up to date.
    pub update_ms: f64,
    /// Mean number of base cells that were made anew.
    pub cells: f64,
    /// Mean number of regions that have all changes.
    pub regions: f64,
    /// Mean bytes of these regions, mips included.
    pub region_bytes: f64,
    /// Mean milliseconds, over the first 20 pictures, 2 if the device is software, to send the regions to the device, until it has them. Absent without a device.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub send_ms: Option<f64>,
    /// The same if each object's regions are sent one by one. Absent without a device.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub single_send_ms: Option<f64>,
    /// Mean number of regions if each object's are sent one by one.
    pub single_regions: f64,
    /// Mean bytes of those.
    pub single_bytes: f64,
    /// Whether the volume was at the end bit for bit as one made from nothing.
    pub as_if_from_nothing: bool,
}

/// A picture with all effects, and what each pass takes.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct PictureTime {
    /// Width and height.
    pub size: (u32, u32),
    /// Number of lamps; each has soft shadows and shines in fog.
    pub lamps: u32,
    /// Rays of ambient occlusion for each pixel.
    pub occlusion_rays: u32,
    /// Rays to each lamp whose light comes there, for each pixel.
    pub lamp_rays: u32,
    /// Rays that are mirrored, for each pixel.
    pub reflection_rays: u32,
    /// Places in fog for each pixel; from each one ray to each lamp whose light comes there.
    pub fog_places: u32,
    /// On the processor and on a device.
    pub rows: Vec<PictureRow>,
}

/// A picture's passes as one device has them.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct PictureRow {
    /// The processor with its threads, or the device.
    pub tracer: String,
    /// The passes, in order.
    pub passes: Vec<PassRow>,
    /// Share of pixels whose light is not that of the processor, by more than a hundredth of white.
    pub different: f64,
}

/// A pass of a picture.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct PassRow {
    /// Its name.
    pub pass: String,
    /// Milliseconds, once for each round.
    pub ms: Vec<f64>,
}

/// Rays from inside of closed rooms to outside.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct LeakRow {
    /// Which neighbours of the inside are wall: faces, edges or corners.
    pub wall: String,
    /// Voxels from sample to sample; `None`: every voxel that the ray touches.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<f64>,
    /// Rays that were traced.
    pub rays: u64,
    /// Rays that met no wall.
    pub leaks: u64,
}

/// A scene.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct SceneShadows {
    /// As in [`Scene::name`](crate::scene::Scene::name).
    pub name: String,
    /// Whether its mesh is the one that the manifest names.
    pub identity: String,
    /// Credit of the mesh.
    pub credit: String,
    /// The viewpoint.
    pub view: String,
    /// Volumes of the scene.
    pub volumes: Vec<VolumeRow>,
    /// Rays a second.
    pub rates: Vec<RateRow>,
    /// Error and time of each effect.
    pub errors: Vec<ErrorRow>,
}

/// A volume of a scene.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct VolumeRow {
    /// Edge of a voxel in centimetres.
    pub voxel_cm: f64,
    /// Voxels along each axis.
    pub voxels: [u32; 3],
    /// Bytes with two mips.
    pub bytes: u64,
    /// Bytes in bricks.
    pub brick_bytes: u64,
    /// Seconds to find the voxels of the mesh.
    pub fill_seconds: f64,
}

/// Rays of one kind, traced in one way.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct RateRow {
    /// What the rays are of: ambient occlusion, shadow.
    pub kind: String,
    /// What traces them: every voxel, steps of a number of voxels, or an engine's octree caster.
    pub tracer: String,
    /// The coarsest cells, in voxels; 1: mips are not used. 0 for octree casters.
    pub coarsest: u32,
    /// Whether the first hit is found, and not only whether there is one.
    pub first: bool,
    /// Rays.
    pub rays: u64,
    /// Seconds on all cores, once for each round.
    pub seconds: Vec<f64>,
    /// Mean number of cells that the volume was asked for; 0 for octree casters.
    pub steps: f64,
    /// Rays with another answer than every voxel gives, blocked or not.
    pub different: u64,
}

/// An effect with one set of shortcuts.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct ErrorRow {
    /// The effect.
    pub effect: String,
    /// Edge of a voxel in centimetres; 0: the exact octree.
    pub voxel_cm: f64,
    /// Voxels from sample to sample; `None`: every voxel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step: Option<f64>,
    /// Rays for each pixel.
    pub rays: u32,
    /// Whether rays begin in the picture.
    pub screen: bool,
    /// Whether the result was smoothed.
    pub smoothed: bool,
    /// Milliseconds on all cores, once for each round.
    pub ms: Vec<f64>,
    /// Root of the mean squared error to the converged answer of the exact octree, in shares of 1.
    pub rmse: f64,
    /// The same to that of the triangles.
    pub rmse_triangles: f64,
    /// Mean FLIP to the converged answer of the exact octree.
    pub flip: f64,
}

/// A picture beside the record.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct PictureNote {
    /// What it shows.
    pub what: String,
    /// Its file.
    pub file: String,
}

impl ShadowOptions {
    /// Edge of the voxels that rays a second, and shortcuts other than the voxel's size, are measured with, in centimetres: 5, or else the first.
    pub(crate) fn base(&self) -> f64 {
        let first = self.voxels_cm.first().copied().unwrap_or(5.0);
        if self.voxels_cm.contains(&5.0) { 5.0 } else { first }
    }
}

impl ShadowReport {
    /// The record as indented JSON.
    pub fn to_json(&self) -> String {
        to_json(self)
    }

    /// Whether no ray that meets every voxel left a room, samples did, every volume was as if made from nothing, and every voxel gave the same answer
    /// whatever the mips and on a device, where the picture is the same, too.
    pub fn passed(&self) -> bool {
        let tight = self.leaks.iter().filter(|row| row.step.is_none()).all(|row| row.leaks == 0);
        let longest = self.leaks.iter().filter_map(|row| row.step).fold(0.0, f64::max);
        let control = self.leaks.iter().filter(|row| row.step == Some(longest)).all(|row| row.leaks > 0);
        let walks = self.scenes.iter().flat_map(|scene| &scene.rates).filter(|row| row.tracer.starts_with(WALK));
        let one_answer = walks.clone().count() > 0 && walks.clone().all(|row| row.different == 0);
        let one_picture =
            self.picture.iter().flat_map(|picture| &picture.rows).all(|row| row.different < MOST_DIFFERENT);
        // Without a scene no ray was timed.
        tight
            && control
            && one_picture
            && (one_answer || self.scenes.is_empty())
            && self.moving.iter().all(|row| row.as_if_from_nothing)
    }
}

/// A record with its pictures.
#[derive(Clone, Debug)]
pub struct ShadowOutcome {
    /// The record.
    pub report: ShadowReport,
    /// The pictures.
    pub pictures: Vec<NamedPicture>,
}
