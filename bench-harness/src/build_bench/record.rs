//! The record of `esvo bench build`, `<matrix>.json`: plain data. All tables are computed from it.

use esvo_scenes::SceneVariant;
use serde::{Deserialize, Serialize};

use super::plan::{BuildMatrix, Contours};
use crate::build_summary::{BuildSeconds, BuildSummary};
use crate::error::attributes::AttributeError;
use crate::error::depth::{DepthError, Summary};
use crate::matrix_parts::LeftOut;
use crate::output::to_json;
use crate::scene::{NamedView, Scene};
use crate::system::machine::Machine;
use crate::timing::Spread;
use crate::units::MIB;

/// Version of the record's layout. Fields may be added without a new one.
pub const SCHEMA: u32 = 1;

/// The record of a run.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct BuildReport {
    /// [`SCHEMA`].
    pub schema: u32,
    /// The machine and the software.
    pub machine: Machine,
    /// The matrix.
    pub matrix: BuildMatrix,
    /// The scenes, in the order of the matrix.
    pub scenes: Vec<SceneBuilds>,
    /// What was not built, and why.
    pub left_out: Vec<LeftOut>,
    /// Seconds that the run took.
    pub seconds: f64,
    /// Whether the run was completed. False: it was stopped, and this is what it had measured.
    #[serde(default = "yes")]
    pub complete: bool,
    /// The program that built each octree beside this one, if one was given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beside: Option<OtherProgram>,
}

/// Another esvo program, which builds the same octrees in the same rounds.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct OtherProgram {
    /// The commit of its source, as its `--version` names it; `unknown` if it does not.
    pub commit: String,
}

/// Everything about one scene.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct SceneBuilds {
    /// Name in the manifest, and in the paper's tables if it is one of the paper's scenes; followed by what the mesh is if it is
    /// not the listed one.
    pub name: String,
    /// Which of the scene's meshes was measured.
    pub mesh: SceneVariant,
    /// Triangles of that mesh.
    pub triangles: u64,
    /// Whether the file is the one that the manifest names, or which generator made the mesh.
    pub identity: String,
    /// Credit to print with tables.
    pub credit: String,
    /// Viewpoints that errors were measured from.
    pub views: Vec<NamedView>,
    /// Size of the picture of each viewpoint.
    pub size: [u32; 2],
    /// The octrees, in the order of their first builds.
    pub rows: Vec<BuildRow>,
    /// How many levels contours save.
    pub saved: Vec<SavedLevels>,
    /// Kinds of octrees whose deeper levels were not built.
    #[serde(default)]
    pub stopped: Vec<Stopped>,
}

fn yes() -> bool {
    true
}

/// One octree.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct BuildRow {
    /// Deepest level.
    pub levels: u32,
    /// With contours or without.
    pub contours: Contours,
    /// The result and the first build.
    pub build: BuildSummary,
    /// All builds, including the first.
    pub samples: Vec<BuildSample>,
    /// Distance from the triangles when rays end at leaves only.
    pub error: Option<DepthError>,
    /// Distance from the triangles when rays end at voxels of one pixel.
    pub error_at_pixel: Option<DepthError>,
    /// Colours and normals against those of the triangles when rays end at leaves only. Older records lack it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub attributes: Option<AttributeError>,
    /// The same when rays end at voxels of one pixel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub attributes_at_pixel: Option<AttributeError>,
    /// FLIP of the picture whose rays end at voxels of one pixel beside that of the triangles: mean over the pixels and viewpoints, 0 to 1.
    /// Older records lack it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flip_at_pixel: Option<f64>,
    /// The same octree by [`BuildReport::beside`]; `None` if there is no such program, or if it did not build this octree.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beside: Option<BesideBuilds>,
}

/// The builds of an octree by another program, each beside the build of the same number in [`BuildRow::samples`].
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct BesideBuilds {
    /// Voxels of its octree, without the root.
    pub voxels: u64,
    /// Bytes of its image.
    pub image_bytes: u64,
    /// All its builds.
    pub samples: Vec<BuildSample>,
}

/// Time and memory of one build.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub struct BuildSample {
    /// Seconds by phase.
    pub seconds: BuildSeconds,
    /// Most memory that the process ever held, import included.
    pub peak_bytes: u64,
    /// Processor time of the whole process, user and system, in seconds: import, build and writing. `None` if the system does not tell;
    /// older records lack it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cpu_seconds: Option<f64>,
    /// Load of the machine over the minute before the build, 0 if the system does not say. Above 1: other programs were running.
    pub load: f64,
}

/// From which level on a scene has no octrees of a kind, and why.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct Stopped {
    /// The kind.
    pub contours: Contours,
    /// The first level without an octree.
    pub levels: u32,
    /// The limit that was exceeded.
    pub limit: Limit,
    /// The reason in words, with figures.
    pub why: String,
}

/// Why no deeper level is built.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Limit {
    /// A build needs too much memory.
    Memory,
    /// The file needs too much disk.
    Disk,
    /// A build takes too long.
    Build,
    /// The run takes too long.
    Run,
    /// The build failed.
    Failed,
}

/// How many levels the contours of one octree save.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub struct SavedLevels {
    /// Which percentile of the error is equal.
    #[serde(default)]
    pub measure: Measure,
    /// Deepest level of the octree with contours.
    pub levels: u32,
    /// That percentile of its error in mesh units, with rays that end at leaves only.
    pub error: f64,
    /// Bytes of its image.
    pub bytes: f64,
    /// Deepest level of the cubical octree with that error.
    pub cubical_levels: f64,
    /// Bytes of its image.
    pub cubical_bytes: f64,
    /// Whether that octree is deeper or shallower than all cubical octrees that were built, so that it is extrapolated.
    pub extrapolated: bool,
}

/// Which percentile of the error over the rays is compared.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Measure {
    /// 50 %: the error on flat and gently curved surfaces.
    #[default]
    Median,
    /// 90 %.
    P90,
    /// 99 %: the error at edges and silhouettes.
    P99,
}

impl Measure {
    /// Every measure.
    pub const ALL: [Self; 3] = [Self::Median, Self::P90, Self::P99];

    /// The percentile of a set of errors.
    pub(crate) fn of(self, errors: &Summary) -> f64 {
        match self {
            Self::Median => errors.median,
            Self::P90 => errors.p90,
            Self::P99 => errors.p99,
        }
    }
}

impl BuildRow {
    /// Median and quartiles of a value over all builds.
    pub fn spread(&self, of: impl Fn(&BuildSample) -> f64) -> Spread {
        let values: Vec<f64> = self.samples.iter().map(of).collect();
        let none = Spread { median: f64::NAN, lower_quartile: f64::NAN, upper_quartile: f64::NAN };
        Spread::of(&values).unwrap_or(none)
    }

    /// Seconds of the first build, import included.
    pub(crate) fn first_seconds(&self) -> f64 {
        self.build.seconds.import + self.build.seconds.build
    }

    /// Whether the octree is built again: its first build did not take too long.
    pub(crate) fn is_repeated(&self, matrix: &BuildMatrix) -> bool {
        self.first_seconds() <= matrix.repeat_below_seconds
    }

    /// Median seconds from the mesh in memory to the octree in its file.
    pub fn seconds(&self) -> f64 {
        self.spread(|s| s.seconds.build).median
    }

    /// Median and quartiles of the processor time of the whole process in seconds; `None` if a build has none.
    pub fn cpu_seconds(&self) -> Option<Spread> {
        Spread::of(&self.samples.iter().map(|s| s.cpu_seconds).collect::<Option<Vec<_>>>()?)
    }

    /// Processor time of the other program divided by that of this one: median over the rounds in which both built the octree.
    pub fn cpu_ratio_beside(&self) -> Option<f64> {
        let pairs = self.samples.iter().zip(&self.beside.as_ref()?.samples);
        let ratios: Vec<f64> = pairs.filter_map(|(ours, other)| Some(other.cpu_seconds? / ours.cpu_seconds?)).collect();
        Spread::of(&ratios).map(|ratio| ratio.median)
    }

    /// Size of the image in MiB.
    pub fn mib(&self) -> f64 {
        self.build.image_bytes as f64 / MIB
    }

    /// Peak memory, the highest of all builds, in MiB.
    pub fn peak_mib(&self) -> f64 {
        self.samples.iter().map(|s| s.peak_bytes).max().unwrap_or(0) as f64 / MIB
    }

    /// Bytes of the image over all voxels.
    pub fn bytes_per_voxel(&self) -> f64 {
        self.build.image_bytes as f64 / self.build.voxels.max(1) as f64
    }
}

impl SceneBuilds {
    /// A scene without octrees yet. `size` is the size of its pictures.
    pub(crate) fn new(scene: &Scene, size: [u32; 2]) -> Self {
        Self {
            name: scene.name.clone(),
            mesh: scene.variant,
            triangles: scene.mesh.triangle_count() as u64,
            identity: scene.identity.clone(),
            credit: scene.credit.clone(),
            views: scene.views.clone(),
            size,
            rows: Vec::new(),
            saved: Vec::new(),
            stopped: Vec::new(),
        }
    }

    /// Why the octree of a kind at this level was not built: the limit that applied at this level or a coarser one.
    pub fn stopped(&self, contours: Contours, levels: u32) -> Option<&Stopped> {
        self.stopped.iter().find(|s| s.contours == contours && s.levels <= levels)
    }

    /// The octree of a kind and level.
    pub fn row(&self, contours: Contours, levels: u32) -> Option<&BuildRow> {
        self.rows.iter().find(|r| r.contours == contours && r.levels == levels)
    }
}

impl BuildReport {
    /// Failed builds, with their scenes.
    pub fn failures(&self) -> impl Iterator<Item = (&SceneBuilds, &Stopped)> {
        let failed = |s: &&Stopped| s.limit == Limit::Failed;
        self.scenes.iter().flat_map(move |scene| scene.stopped.iter().filter(failed).map(move |s| (scene, s)))
    }

    /// Whether a resumed run would build something: the time limit of the run left out an octree or a repeated build, or a build failed.
    pub fn is_unfinished(&self) -> bool {
        let stopped = |s: &Stopped| matches!(s.limit, Limit::Run | Limit::Failed);
        let repeats = |row: &BuildRow| row.is_repeated(&self.matrix) && row.samples.len() < self.matrix.repeats;
        !self.complete
            || self.scenes.iter().any(|scene| scene.stopped.iter().any(stopped) || scene.rows.iter().any(repeats))
    }

    /// The record as JSON, indented.
    pub fn to_json(&self) -> String {
        to_json(self)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use esvo_builder::BuildSettings;

    use super::*;

    /// An octree that took `seconds`, with a file of `file` and a peak of `peak` GB.
    pub(crate) fn row(levels: u32, contours: Contours, [seconds, file, peak]: [f64; 3]) -> BuildRow {
        let build = BuildSummary {
            schema: 1,
            source: "made up".into(),
            triangles: 1_000_000,
            output: "octree.esvo".into(),
            settings: BuildSettings::default(),
            seconds: BuildSeconds { build: seconds, ..BuildSeconds::default() },
            import_peak_bytes: 0,
            peak_bytes: (peak * 1e9) as u64,
            descriptors: 1 << levels,
            voxels: 1 << (2 * levels),
            leaves: 1,
            contours: 0,
            far_pointers: 0,
            blocks: 1,
            image_bytes: (file * 1e9) as u64,
            file_bytes: (file * 1e9) as u64,
            kinds: Vec::new(),
            warnings: Vec::new(),
        };
        let cpu_seconds = Some(2.0 * seconds);
        let sample = BuildSample { seconds: build.seconds, peak_bytes: build.peak_bytes, cpu_seconds, load: 0.0 };
        BuildRow {
            levels,
            contours,
            build,
            samples: vec![sample],
            error: None,
            error_at_pixel: None,
            attributes: None,
            attributes_at_pixel: None,
            flip_at_pixel: None,
            beside: None,
        }
    }
}
