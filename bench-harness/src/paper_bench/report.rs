//! The record of `esvo bench`, `report.json`: plain data. All tables are computed from it.

use esvo_core::DeviceKind;
use esvo_engines::EngineId;
use esvo_scenes::SceneVariant;
use serde::{Deserialize, Serialize};

use crate::BenchError;
use crate::build_summary::KindBytes;
use crate::calibration::CalibrationRecord;
use crate::error::depth::DepthError;
use crate::error::image::ImageError;
use crate::matrix_parts::LeftOut;
use crate::output::{NamedPicture, to_json};
use crate::paper_bench::check::Agreement;
use crate::paper_bench::matrix::{Matrix, Variant};
use crate::paper_bench::slowed::Slowed;
use crate::scene::NamedView;
use crate::system::machine::Machine;
use crate::timing::{Samples, Spread};
use crate::units::MIB;

/// Version of the record's layout. Fields may be added without a new one.
pub const SCHEMA: u32 = 1;

/// The record of a run.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct PaperReport {
    /// [`SCHEMA`].
    pub schema: u32,
    /// The machine and the software.
    pub machine: Machine,
    /// The matrix.
    pub matrix: Matrix,
    /// The device of each engine.
    pub devices: Vec<DeviceRecord>,
    /// The calibration casts; `None` in records that have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<CalibrationRecord>,
    /// Engines that were slowed on purpose. Such a record says nothing about the engine.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub slowed: Vec<Slowed>,
    /// The scenes, in the order of the matrix.
    pub scenes: Vec<SceneReport>,
    /// What was not measured, and why.
    pub left_out: Vec<LeftOut>,
    /// Seconds that the run took.
    pub seconds: f64,
}

/// The result of a run.
pub struct PaperOutcome {
    /// The record.
    pub report: PaperReport,
    /// The pictures that the record names.
    pub pictures: Vec<NamedPicture>,
}

/// The device of an engine.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct DeviceRecord {
    /// The engine.
    pub backend: EngineId,
    /// Name as the driver or the processor gives it.
    pub name: String,
    /// What kind of device it is.
    pub kind: DeviceKind,
    /// Driver and version, or instruction set and threads.
    pub detail: String,
}

impl DeviceRecord {
    /// The record of a device.
    pub fn new(backend: EngineId, device: &esvo_core::Device) -> Self {
        Self { backend, name: device.name.clone(), kind: device.kind, detail: device.detail.clone() }
    }

    /// Whether it is a Vulkan driver that runs on the processor.
    pub fn is_software(&self) -> bool {
        self.kind == DeviceKind::SoftwareGpu
    }
}

/// Everything about one scene.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct SceneReport {
    /// Name in the manifest, and in the paper's tables if it is one of the paper's scenes; followed by what the mesh is if it is
    /// not the listed one.
    pub name: String,
    /// Which of the scene's meshes was measured.
    pub mesh: SceneVariant,
    /// Triangles of that mesh.
    pub triangles: u64,
    /// Whether the file is the one that the manifest names, or which generator made the mesh.
    pub identity: String,
    /// SHA-256 of the mesh as it was loaded, before displacement, in hexadecimal digits; empty in records that have none.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub mesh_sha256: String,
    /// Credit to print with pictures and tables.
    pub credit: String,
    /// Whether pictures may be published.
    pub publish: bool,
    /// Viewpoints.
    pub views: Vec<NamedView>,
    /// Warnings of the importer.
    pub warnings: Vec<String>,
    /// Seconds to read or generate the mesh.
    pub mesh_seconds: f64,
    /// Rows of Table 1.
    pub builds: Vec<Table1Row>,
    /// Distance from the triangles.
    pub errors: Vec<ErrorRow>,
    /// Checks of the answers, made before timing.
    pub checks: Vec<CheckRow>,
    /// Cells of Table 2.
    pub times: Vec<TimeCell>,
    /// What the post-process filter takes on each engine.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub filters: Vec<FilterCell>,
    /// File names of the pictures.
    pub pictures: Vec<String>,
}

/// One octree: a cell of Table 1.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct Table1Row {
    /// Deepest level.
    pub levels: u32,
    /// Whether it was built with contours.
    pub contours: bool,
    /// Setting: allowed deviation of the shape, as a level.
    pub contour_error: f64,
    /// Setting: allowed deviation of a colour channel in steps of 1/256.
    pub color_error: f64,
    /// Setting: allowed deviation of a component of the unit normal.
    pub normal_error: f64,
    /// Seconds from the mesh in memory to the octree in memory.
    pub seconds: f64,
    /// SHA-256 of the image in hexadecimal digits; empty in records that have none.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub image_sha256: String,
    /// Bytes of the image: what a caster needs in memory.
    pub bytes: u64,
    /// All voxels, leaves and others.
    pub voxels: u64,
    /// Voxels without children.
    pub leaves: u64,
    /// Contours.
    pub contour_count: u64,
    /// Far pointers.
    pub far_pointers: u64,
    /// Blocks.
    pub blocks: u64,
    /// Bytes by kind. Their sum is `bytes`.
    pub kinds: Vec<KindBytes>,
    /// Triangles after displacement; `None` if the mesh is not displaced.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub displaced_triangles: Option<u64>,
}

impl Table1Row {
    /// Bytes over all voxels.
    pub fn bytes_per_voxel(&self) -> f64 {
        self.bytes as f64 / self.voxels.max(1) as f64
    }

    /// Size in MiB.
    pub fn mib(&self) -> f64 {
        self.bytes as f64 / MIB
    }
}

/// The error of a variant against the triangles.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct ErrorRow {
    /// What was cast.
    pub variant: Variant,
    /// Deepest level.
    pub levels: u32,
    /// Size of the picture.
    pub size: [u32; 2],
    /// Depth error of each view, in the order of [`SceneReport::views`].
    pub views: Vec<DepthError>,
    /// Image error of each view: the shaded picture against that of the triangles.
    #[serde(default)]
    pub pictures: Vec<ImageError>,
    /// Of each view, how many rays hit a voxel of each level, from level 0 on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub hit_levels: Vec<Vec<u64>>,
}

impl ErrorRow {
    /// Mean of a value over the views.
    pub fn mean(&self, of: impl Fn(&DepthError) -> f64) -> f64 {
        self.views.iter().map(of).sum::<f64>() / self.views.len().max(1) as f64
    }

    /// Mean level of the voxels that the rays of all views hit; `None` if it was not recorded or nothing was hit.
    pub fn mean_hit_level(&self) -> Option<f64> {
        let levels = self.hit_levels.iter().flat_map(|view| view.iter().enumerate());
        let (hits, sum) = levels.fold((0, 0), |(hits, sum), (level, count)| (hits + count, sum + level as u64 * count));
        (hits > 0).then(|| sum as f64 / hits as f64)
    }

    /// Mean FLIP over the views; `None` if no pictures were compared.
    pub fn flip(&self) -> Option<f64> {
        let sum = self.pictures.iter().map(|p| p.flip).sum::<f64>();
        (!self.pictures.is_empty()).then(|| sum / self.pictures.len() as f64)
    }
}

/// The check of one engine on one variant.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct CheckRow {
    /// The engine.
    pub backend: EngineId,
    /// What was cast.
    pub variant: Variant,
    /// Deepest level.
    pub levels: u32,
    /// Size of the picture.
    pub size: [u32; 2],
    /// Comparison with the reference caster; of triangles, with the exact caster.
    pub agreement: Agreement,
    /// Of triangles on a GPU: pixels that the processor decided.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub undecided: Option<u64>,
    /// The error of the caster, if it failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}

/// One cell of Table 2.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct TimeCell {
    /// The engine.
    pub backend: EngineId,
    /// What was cast.
    pub variant: Variant,
    /// Deepest level; 0 for triangles.
    pub levels: u32,
    /// Size of the picture.
    pub size: [u32; 2],
    /// Bytes of device memory that the octree or the triangles took.
    pub resident_bytes: u64,
    /// Raw times.
    pub samples: Samples,
    /// Millions of rays per second over the rounds.
    pub mrays: Option<Spread>,
}

/// What the post-process filter (paper, section 4.3) takes for the pictures of the octree with contours, cast with beam optimization.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct FilterCell {
    /// The engine.
    pub backend: EngineId,
    /// Deepest level.
    pub levels: u32,
    /// Size of the picture.
    pub size: [u32; 2],
    /// Share of the pixels whose voxel is larger than a pixel: the others keep their colour.
    pub blurred: f64,
    /// Seconds without copies: `seconds[round][view]`.
    pub seconds: Vec<Vec<f64>>,
}

impl FilterCell {
    /// Milliseconds per picture: median and quartiles over the rounds of the mean over the views.
    pub fn milliseconds(&self) -> Option<Spread> {
        let mean = |views: &Vec<f64>| 1e3 * views.iter().sum::<f64>() / views.len() as f64;
        Spread::of(&self.seconds.iter().filter(|views| !views.is_empty()).map(mean).collect::<Vec<_>>())
    }
}

impl PaperReport {
    /// Whether every check passed.
    pub fn passed(&self) -> bool {
        self.failures().next().is_none()
    }

    /// The checks that failed, with the names of their scenes.
    pub fn failures(&self) -> impl Iterator<Item = (&str, &CheckRow)> {
        self.scenes
            .iter()
            .flat_map(|s| s.checks.iter().filter(|c| !c.agreement.passed()).map(move |c| (s.name.as_str(), c)))
    }

    /// The record as JSON, indented.
    pub fn to_json(&self) -> String {
        to_json(self)
    }

    /// Reads a record.
    ///
    /// # Errors
    /// The text is not such a record, or its schema is unknown.
    pub fn from_json(text: &str) -> Result<Self, BenchError> {
        let bad = |what: String| BenchError::Matrix { file: "report".into(), what };
        let report: Self = serde_json::from_str(text).map_err(|e| bad(e.to_string()))?;
        if report.schema != SCHEMA {
            return Err(bad(format!("its schema is {}, and this program reads schema {SCHEMA}", report.schema)));
        }
        Ok(report)
    }
}

impl SceneReport {
    /// The check of a cell.
    pub fn check(&self, backend: EngineId, variant: Variant) -> Option<&CheckRow> {
        self.checks.iter().find(|c| c.backend == backend && c.variant == variant)
    }

    /// A cell of Table 2.
    pub fn time(&self, backend: EngineId, variant: Variant, size: [u32; 2]) -> Option<&TimeCell> {
        self.times.iter().find(|c| c.backend == backend && c.variant == variant && c.size == size)
    }

    /// What the filter takes.
    pub fn filter(&self, backend: EngineId, size: [u32; 2]) -> Option<&FilterCell> {
        self.filters.iter().find(|c| c.backend == backend && c.size == size)
    }

    /// A row of Table 1.
    pub fn build(&self, contours: bool, levels: u32) -> Option<&Table1Row> {
        self.builds.iter().find(|b| b.contours == contours && b.levels == levels)
    }
}
