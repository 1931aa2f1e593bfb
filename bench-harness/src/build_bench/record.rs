//! The record of `esvo bench build`: `build.json`. Everything that its tables say is computed from it.

use serde::{Deserialize, Serialize};

use super::limit::{Limit, Stopped};
use super::plan::{BuildMatrix, Contours};
use super::saved::SavedLevels;
use crate::build_summary::{BuildSeconds, BuildSummary};
use crate::error::depth::DepthError;
use crate::paper_bench::matrix::LeftOut;
use crate::paper_bench::report::NamedView;
use crate::scene::Scene;
use crate::system::machine::Machine;
use crate::text::MIB;
use crate::timing::Spread;

/// Version of the record's layout. Fields may be added without a new one.
pub const SCHEMA: u32 = 1;

/// The record of a run.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct BuildReport {
    /// [`SCHEMA`].
    pub schema: u32,
    /// What it ran on.
    pub machine: Machine,
    /// What was asked for.
    pub matrix: BuildMatrix,
    /// The scenes, in the order of the matrix.
    pub scenes: Vec<SceneBuilds>,
    /// What was not built, and why.
    pub left_out: Vec<LeftOut>,
    /// Seconds that the run took.
    pub seconds: f64,
    /// Whether the run came to its end; otherwise this is what was done when it was stopped.
    #[serde(default = "yes")]
    pub complete: bool,
}

/// Everything about one scene.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct SceneBuilds {
    /// As in the manifest, and in the paper's tables if it is one of the paper's.
    pub name: String,
    /// `real` or `stand-in`.
    pub mesh: String,
    /// Triangles of that mesh.
    pub triangles: u64,
    /// Whether the file is the one that the manifest names, or which generator made the mesh.
    pub identity: String,
    /// Credit to print beside tables.
    pub credit: String,
    /// Viewpoints that errors were measured from.
    pub views: Vec<NamedView>,
    /// Picture of each viewpoint.
    pub size: [u32; 2],
    /// What was built, in the order in which it was built first.
    pub rows: Vec<BuildRow>,
    /// How many levels contours save.
    pub saved: Vec<SavedLevels>,
    /// Where the ladders of levels end before they reach what was asked for.
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
    /// What came out of it, and what the first build took.
    pub build: BuildSummary,
    /// What every build took, the first one included.
    pub samples: Vec<BuildSample>,
    /// Distance from the triangles where rays end at leaves only.
    pub error: Option<DepthError>,
    /// Distance from the triangles where rays end at voxels of one pixel.
    pub error_at_pixel: Option<DepthError>,
}

/// What one build took.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub struct BuildSample {
    /// Phase by phase.
    pub seconds: BuildSeconds,
    /// Most memory that the process ever held, import included.
    pub peak_bytes: u64,
    /// 1-minute load of the machine before it, 0 where the system does not say: above 1 somebody else is at work.
    pub load: f64,
}

impl BuildRow {
    /// Median and quartiles over the builds of something.
    pub fn spread(&self, of: impl Fn(&BuildSample) -> f64) -> Spread {
        let values: Vec<f64> = self.samples.iter().map(of).collect();
        let none = Spread { median: f64::NAN, lower_quartile: f64::NAN, upper_quartile: f64::NAN };
        Spread::of(&values).unwrap_or(none)
    }

    /// Median seconds from the mesh in memory to the octree in its file.
    pub fn seconds(&self) -> f64 {
        self.spread(|s| s.seconds.build).median
    }

    /// Size of the image in MiB.
    pub fn mib(&self) -> f64 {
        self.build.image_bytes as f64 / MIB
    }

    /// Most memory of any of the builds, in MiB.
    pub fn peak_mib(&self) -> f64 {
        self.samples.iter().map(|s| s.peak_bytes).max().unwrap_or(0) as f64 / MIB
    }

    /// Bytes of the image over all voxels.
    pub fn bytes_per_voxel(&self) -> f64 {
        self.build.image_bytes as f64 / self.build.voxels.max(1) as f64
    }
}

impl SceneBuilds {
    /// Of a scene of which nothing is built yet, its pictures being of this size.
    pub(crate) fn new(scene: &Scene, size: [u32; 2]) -> Self {
        Self {
            name: scene.name.clone(),
            mesh: scene.variant.to_string(),
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

    /// What ended the ladder of a kind at or below this level.
    pub fn stopped(&self, contours: Contours, levels: u32) -> Option<&Stopped> {
        self.stopped.iter().find(|s| s.contours == contours && s.levels <= levels)
    }

    /// The octree of a kind and level.
    pub fn row(&self, contours: Contours, levels: u32) -> Option<&BuildRow> {
        self.rows.iter().find(|r| r.contours == contours && r.levels == levels)
    }

    /// `real mesh` or `stand-in`.
    pub fn mesh_title(&self) -> &'static str {
        if self.mesh == "real" { "real mesh" } else { "stand-in" }
    }
}

impl BuildReport {
    /// Ladders that a failed build ended, with their scenes.
    pub fn failures(&self) -> impl Iterator<Item = (&SceneBuilds, &Stopped)> {
        let failed = |s: &&Stopped| s.limit == Limit::Failed;
        self.scenes.iter().flat_map(move |scene| scene.stopped.iter().filter(failed).map(move |s| (scene, s)))
    }

    /// The record as JSON, indented.
    pub fn to_json(&self) -> String {
        let mut json = serde_json::to_string_pretty(self).expect("a report has text keys only");
        json.push('\n');
        json
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
        let sample = BuildSample { seconds: build.seconds, peak_bytes: build.peak_bytes, load: 0.0 };
        BuildRow { levels, contours, build, samples: vec![sample], error: None, error_at_pixel: None }
    }
}
