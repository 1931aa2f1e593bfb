//! What a journal keeps of a run of `esvo bench build`: a part for each scene, for each octree, and for each repeated build.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::plan::{BuildMatrix, Contours};
use super::record::{BesideBuilds, BuildRow, BuildSample, Limit, SceneBuilds};
use super::{BuildBenchOptions, beside};
use crate::BenchError;
use crate::journal::Journal;
use crate::matrix_parts::LeftOut;
use crate::scene::{self, SceneSource};

/// The first build of an octree and its errors.
#[derive(Serialize, Deserialize)]
pub(super) struct StepPart {
    /// `None`: the octree was not built.
    pub(super) row: Option<BuildRow>,
    /// Why no deeper level of its kind is built.
    pub(super) stopped: Option<(Limit, String)>,
    /// What the other program did not build.
    pub(super) left_out: Vec<LeftOut>,
}

/// A repeated build.
#[derive(Serialize, Deserialize)]
pub(super) struct RoundPart {
    pub(super) sample: BuildSample,
    /// All builds by the other program, if it built the octree in this round, too.
    pub(super) beside: Option<BesideBuilds>,
    /// What the other program did not build.
    pub(super) left_out: Vec<LeftOut>,
}

impl StepPart {
    pub(super) fn stopped(stopped: (Limit, String)) -> Self {
        Self { row: None, stopped: Some(stopped), left_out: Vec::new() }
    }

    /// Whether trying again would give the same: neither did the build fail, nor did the time of the run end.
    pub(super) fn is_final(&self) -> bool {
        !matches!(self.stopped, Some((Limit::Failed | Limit::Run, _)))
    }
}

/// Name of the part of a scene, or of the build of an octree in a round.
pub(super) fn part_name(scene: &str, octree: Option<(u32, Contours, usize)>) -> String {
    match octree {
        None => scene.into(),
        Some((levels, kind, round)) => format!("{scene} {levels} {} {}", kind.title(), round + 1),
    }
}

/// Refuses to go on with another mesh than before.
pub(super) fn check_identity(name: &str, builds: &SceneBuilds, source: &SceneSource) -> Result<(), BenchError> {
    let now = source.identity();
    if builds.identity == now {
        return Ok(());
    }
    let what = format!("its mesh is another one than in the run that was stopped: {now}, not {}", builds.identity);
    Err(BenchError::scene(name, format!("{what}; without --resume, a new run begins")))
}

/// What the results depend on.
#[derive(Serialize)]
struct Settings {
    /// Without the time limit of the run: the run that is resumed may have more time.
    matrix: BuildMatrix,
    /// The scenes of a manifest of one's own.
    manifest: Option<String>,
    /// Commit of the other program.
    beside: Option<String>,
}

/// Opens the journal of a run whose record is written to `folder`: see [`Journal::open_in`].
///
/// # Errors
/// As there; another program or a manifest that cannot be used.
pub fn build_journal(options: &BuildBenchOptions, folder: &Path, resume: bool) -> Result<Journal, BenchError> {
    let manifest = options.manifest.as_deref().map(|file| scene::manifest(Some(file))).transpose()?;
    let settings = Settings {
        matrix: BuildMatrix { time_limit_seconds: None, ..options.matrix.clone() },
        manifest: manifest.map(|manifest| format!("{:?}", manifest.scenes)),
        beside: options.beside.as_deref().map(beside::identify).transpose()?.map(|program| program.commit),
    };
    Journal::open_in(folder, "-build", &settings, resume)
}
