//! `esvo bench build`: how long building takes, in how much memory, how large the octrees are and how far from the
//! triangles, beside the paper and its authors' builder.
//!
//! Every octree is built by a process of its own ([`BuildSummary`](crate::build_summary::BuildSummary) is what it reports).

mod accuracy;
mod child;
mod peers;
mod plan;
mod record;
mod saved;
mod tables;

use std::path::{Path, PathBuf};

use esvo_scenes::{SceneManifest, SceneVariant};

use crate::clock::{Clock, predict};
use crate::machine::Machine;
use crate::matrix::LeftOut;
use crate::scene::{self, Scene};
use crate::text::GB;
use crate::{BenchError, Progress};
use accuracy::Truth;
use child::{Ended, Job};

pub use plan::{BuildMatrix, Contours};
pub use record::{BuildReport, BuildRow, BuildSample, SCHEMA, SceneBuilds};
pub use saved::SavedLevels;
pub use tables::{to_markdown, to_text};

/// Growth from one level to the next where only one level is known.
const GROWTH: f64 = 4.2;

/// What a run is told.
#[derive(Clone, Debug)]
pub struct Options {
    /// What is built.
    pub matrix: BuildMatrix,
    /// Where real meshes are looked for first.
    pub scenes_dir: Option<PathBuf>,
    /// The program whose `build` is run: the `esvo` that is running.
    pub program: PathBuf,
}

/// Builds everything that the matrix names and its limits allow.
///
/// # Errors
/// A scene that does not exist, a mesh that cannot be used, a build that fails other than at a limit.
pub fn run(options: &Options, progress: &Progress) -> Result<BuildReport, BenchError> {
    let matrix = &options.matrix;
    matrix.validate().map_err(|what| BenchError::Matrix { file: matrix.name.clone(), what })?;
    let manifest = SceneManifest::builtin().map_err(|e| BenchError::scene("manifest", e))?;
    let scratch = tempfile::Builder::new().prefix("esvo-bench-").tempdir();
    let scratch = scratch.map_err(|e| BenchError::io(&std::env::temp_dir(), e))?;
    let clock = Clock::start(matrix.time_limit_seconds);
    let mut runner =
        Runner { options, progress, clock, file: scratch.path().join("octree.esvo"), left_out: Vec::new() };
    runner.left_out.clone_from(&matrix.left_out);
    let machine = Machine::detect();
    let mut scenes = Vec::new();
    for wanted in &matrix.scenes {
        let entry = scene::entry(&manifest, &wanted.name)?;
        progress.say(format!("{}: reading the mesh", entry.name));
        let scene = Scene::load(entry, options.scenes_dir.as_deref(), matrix.views)?;
        scenes.push(runner.first_round(scene, &wanted.levels)?);
    }
    for round in 1..matrix.repeats {
        runner.round(round, &mut scenes)?;
    }
    for scene in &mut scenes {
        scene.saved = saved::saved(&scene.rows);
    }
    let Runner { left_out, clock, .. } = runner;
    Ok(BuildReport { schema: SCHEMA, machine, matrix: matrix.clone(), scenes, left_out, seconds: clock.elapsed() })
}

struct Runner<'a> {
    options: &'a Options,
    progress: &'a Progress,
    clock: Clock,
    /// The octree that is being built or looked at.
    file: PathBuf,
    left_out: Vec<LeftOut>,
}

impl Runner<'_> {
    /// Builds a scene level by level, and measures the errors.
    fn first_round(&mut self, scene: Scene, levels: &[u32]) -> Result<SceneBuilds, BenchError> {
        let size = self.options.matrix.picture_size(scene.views.len());
        let mut builds = SceneBuilds {
            name: scene.name.clone(),
            mesh: scene.variant.to_string(),
            triangles: scene.mesh.triangle_count() as u64,
            identity: scene.identity.clone(),
            credit: scene.credit.clone(),
            views: scene.views.clone(),
            size,
            rows: Vec::new(),
            saved: Vec::new(),
        };
        let stand_in = scene.variant == SceneVariant::StandIn;
        let mut truth = Truth::new(scene, size)?;
        let mut kinds = self.options.matrix.contours.clone();
        for (index, &level) in levels.iter().enumerate() {
            for kind in kinds.clone() {
                let refused = match self.refusal(&builds, kind) {
                    Some(why) => Some((why, true)),
                    None => {
                        let load = load();
                        match self.build(&builds.name, stand_in, level, kind, &format!("at {level} levels"))? {
                            Ended::Stopped(why) => Some((why, false)),
                            Ended::Done(build) => {
                                let name = &builds.name;
                                self.progress.say(format!("{name}: error at {level} levels, {}", kind.title()));
                                let errors = truth.errors(&self.file)?;
                                let sample = BuildSample { seconds: build.seconds, peak_bytes: build.peak_bytes, load };
                                builds.rows.push(BuildRow {
                                    levels: level,
                                    contours: kind,
                                    build: *build,
                                    samples: vec![sample],
                                    error: Some(errors.leaves),
                                    error_at_pixel: Some(errors.pixel),
                                });
                                None
                            }
                        }
                    }
                };
                self.remove();
                if let Some((why, expected)) = refused {
                    kinds.retain(|k| *k != kind);
                    self.leave_out(&builds.name, kind, &levels[index..], &why, expected);
                }
            }
        }
        Ok(builds)
    }

    /// Builds once more what was built and did not take too long.
    fn round(&mut self, round: usize, scenes: &mut [SceneBuilds]) -> Result<(), BenchError> {
        for scene in scenes {
            let stand_in = scene.mesh != "real";
            for row in &mut scene.rows {
                let seconds = &row.samples[0].seconds;
                let all = seconds.import + seconds.build;
                if all > self.options.matrix.repeat_below_seconds || all > self.clock.left() {
                    continue;
                }
                let load = load();
                let what = format!("at {} levels, round {}", row.levels, round + 1);
                let ended = self.build(&scene.name, stand_in, row.levels, row.contours, &what);
                self.remove();
                let Ended::Done(build) = ended? else { continue };
                if (build.voxels, build.image_bytes) != (row.build.voxels, row.build.image_bytes) {
                    let what = format!(
                        "{} levels, {}: {} voxels in {} bytes the first time, {} in {} the next: building must give the \
                         same whatever the threads do",
                        row.levels,
                        row.contours.title(),
                        row.build.voxels,
                        row.build.image_bytes,
                        build.voxels,
                        build.image_bytes
                    );
                    return Err(BenchError::scene(&scene.name, what));
                }
                row.samples.push(BuildSample { seconds: build.seconds, peak_bytes: build.peak_bytes, load });
            }
        }
        Ok(())
    }

    fn build(
        &self,
        scene: &str,
        stand_in: bool,
        levels: u32,
        contours: Contours,
        what: &str,
    ) -> Result<Ended, BenchError> {
        self.progress.say(format!("{scene}: building {}, {what}", contours.title()));
        let matrix = &self.options.matrix;
        let job = Job {
            program: &self.options.program,
            scenes_dir: self.options.scenes_dir.as_deref(),
            scene,
            stand_in,
            levels,
            contours,
            output: &self.file,
            memory: matrix.memory_gb * GB,
            seconds: matrix.build_limit_seconds.min(self.clock.left().max(1.0)),
        };
        job.run()
    }

    /// Why the next level of a kind is not built, from what the levels before it took.
    fn refusal(&self, scene: &SceneBuilds, kind: Contours) -> Option<String> {
        let matrix = &self.options.matrix;
        let expected = |of: fn(&BuildRow) -> f64| {
            let before: Vec<f64> = scene.rows.iter().filter(|r| r.contours == kind).map(of).collect();
            predict(&before, GROWTH)
        };
        let left = self.clock.left();
        if left <= 0.0 {
            return Some("the time limit has come".into());
        }
        // The mesh is held at every level; what comes on top of it grows.
        let import = scene.rows.first().map_or(0, |r| r.build.import_peak_bytes) as f64;
        let above = |r: &BuildRow| r.build.peak_bytes.saturating_sub(r.build.import_peak_bytes) as f64;
        let memory = import + expected(above)?;
        if memory > matrix.memory_gb * GB {
            let limit = matrix.memory_gb;
            return Some(format!("would take about {:.1} GB of memory, and the limit is {limit}", memory / GB));
        }
        let disk = expected(|r| r.build.file_bytes as f64)?;
        if disk > matrix.disk_gb * GB {
            return Some(format!("would take about {:.1} GB of disk, and the limit is {}", disk / GB, matrix.disk_gb));
        }
        let seconds = expected(|r| r.build.seconds.import + r.build.seconds.build)?;
        if seconds > matrix.build_limit_seconds {
            let limit = matrix.build_limit_seconds;
            return Some(format!("would take about {seconds:.0} s, and the limit of one build is {limit:.0} s"));
        }
        (seconds > left).then(|| format!("would take about {seconds:.0} s, and the time limit leaves {left:.0} s"))
    }

    fn leave_out(&mut self, scene: &str, kind: Contours, levels: &[u32], why: &str, expected: bool) {
        let all: Vec<_> = levels.iter().map(u32::to_string).collect();
        let reason = match (expected, levels) {
            (_, [_]) => why.to_string(),
            (true, [first, ..]) => format!("{first} levels {why}"),
            (false, [first, ..]) => format!("{first} levels: {why}"),
            (_, []) => return,
        };
        self.left_out
            .push(LeftOut { what: format!("{scene}, {}, at {} levels", kind.title(), all.join(", ")), reason });
    }

    /// The next build starts with an empty disk; that a stopped one left nothing to remove is as well.
    fn remove(&self) {
        let _ = std::fs::remove_file(&self.file);
    }
}

/// 1-minute load of the machine, or 0 where the system does not say.
fn load() -> f64 {
    let text = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    text.split_whitespace().next().and_then(|s| s.parse().ok()).unwrap_or(0.0)
}

/// Writes `build.json` and `build.md` to the folder, which is made, and returns their paths.
///
/// # Errors
/// The system's.
pub fn write(report: &BuildReport, folder: &Path) -> Result<[PathBuf; 2], BenchError> {
    std::fs::create_dir_all(folder).map_err(|e| BenchError::io(folder, e))?;
    let put = |name: &str, text: String| {
        let path = folder.join(name);
        let written = esvo_format::write_atomically(&path, |out| out.write_all(text.as_bytes()));
        written.map_err(|e| BenchError::io(&path, e)).map(|()| path)
    };
    let name = &report.matrix.name;
    Ok([put(&format!("{name}.json"), report.to_json())?, put(&format!("{name}.md"), to_markdown(report))?])
}
