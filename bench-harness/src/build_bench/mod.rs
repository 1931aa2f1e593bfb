//! `esvo bench build`: how long building takes, in how much memory, how large the octrees are and how far from the
//! triangles, beside the paper and its authors' builder.
//!
//! Every octree is built by a process of its own ([`BuildSummary`](crate::build_summary::BuildSummary) is what it reports).

mod accuracy;
mod child;
mod limit;
mod peers;
mod plan;
mod record;
mod saved;
mod tables;

use std::path::{Path, PathBuf};

use esvo_scenes::{SceneEntry, SceneManifest, SceneVariant};

use crate::paper_bench::matrix::LeftOut;
use crate::scene::{self, Scene};
use crate::system::clock::Clock;
use crate::system::machine::Machine;
use crate::system::scratch::Scratch;
use crate::text::GB;
use crate::{BenchError, Progress};
use accuracy::{Errors, Truth};
use child::{Ended, Job};

pub use limit::{Limit, Stopped};
pub use plan::{BuildMatrix, Contours};
pub use record::{BuildReport, BuildRow, BuildSample, SCHEMA, SceneBuilds};
pub use saved::{Measure, SavedLevels};
pub use tables::{to_markdown, to_text};

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

/// Builds everything that the matrix names and its limits allow, and hands the report to `save` whenever a row is done, so
/// that a run which is stopped leaves what it has. A build that fails is recorded ([`BuildReport::failures`]) and ends its
/// ladder of levels; the others go on.
///
/// # Errors
/// A scene that does not exist, a mesh that cannot be used, builds that give other octrees the second time, what `save` says.
pub fn run(
    options: &Options,
    progress: &Progress,
    save: &mut dyn FnMut(&BuildReport) -> Result<(), BenchError>,
) -> Result<BuildReport, BenchError> {
    let matrix = &options.matrix;
    matrix.validate().map_err(|what| BenchError::Matrix { file: matrix.name.clone(), what })?;
    let manifest = SceneManifest::builtin().map_err(|e| BenchError::scene("manifest", e))?;
    // All names first: a wrong one must not be found after an hour.
    let entries = (matrix.scenes.iter())
        .map(|wanted| Ok((scene::buildable(&manifest, &wanted.name)?, &wanted.levels[..])))
        .collect::<Result<Vec<_>, BenchError>>()?;
    let scratch = Scratch::new()?;
    let report = BuildReport {
        schema: SCHEMA,
        machine: Machine::detect(),
        matrix: matrix.clone(),
        scenes: Vec::new(),
        left_out: matrix.left_out.clone(),
        seconds: 0.0,
        complete: false,
    };
    let clock = Clock::start(matrix.time_limit_seconds);
    let mut runner = Runner { options, progress, clock, file: scratch.file("octree.esvo"), report, save };
    for (entry, levels) in entries {
        runner.scene(entry, levels)?;
    }
    for round in 1..matrix.repeats {
        runner.round(round)?;
    }
    runner.report.complete = true;
    runner.save()?;
    Ok(runner.report)
}

struct Runner<'a> {
    options: &'a Options,
    progress: &'a Progress,
    clock: Clock,
    /// The octree that is being built or looked at.
    file: PathBuf,
    report: BuildReport,
    save: &'a mut dyn FnMut(&BuildReport) -> Result<(), BenchError>,
}

impl Runner<'_> {
    fn save(&mut self) -> Result<(), BenchError> {
        self.report.seconds = self.clock.elapsed();
        (self.save)(&self.report)
    }

    /// Builds a scene level by level, and measures the errors.
    fn scene(&mut self, entry: &SceneEntry, levels: &[u32]) -> Result<(), BenchError> {
        let matrix = &self.options.matrix;
        let scenes_dir = self.options.scenes_dir.as_deref();
        if entry.stand_in.is_none() && esvo_scenes::find_scene_file(entry, scenes_dir).is_none() {
            let reason = "its mesh is not here, and there is no stand-in; --scenes-dir says where it is".into();
            self.report.left_out.push(LeftOut { what: entry.name.clone(), reason });
            return self.save();
        }
        self.progress.say(format!("{}: reading the mesh", entry.name));
        let scene = Scene::load(entry, scenes_dir, matrix.views)?;
        let size = matrix.picture_size(scene.views.len());
        self.report.scenes.push(SceneBuilds::new(&scene, size));
        let mut ladder = Ladder { stand_in: scene.variant == SceneVariant::StandIn, truth: Truth::new(scene, size) };
        let mut kinds = matrix.contours.clone();
        for (index, &level) in levels.iter().enumerate() {
            for kind in kinds.clone() {
                if let Some((limit, why)) = self.step(&mut ladder, level, kind)? {
                    kinds.retain(|k| *k != kind);
                    self.stop(kind, &levels[index..], limit, why);
                }
                self.save()?;
            }
        }
        Ok(())
    }

    /// The scene that is at work.
    fn builds(&mut self) -> &mut SceneBuilds {
        self.report.scenes.last_mut().expect("a scene is at work")
    }

    /// Builds one octree of the scene and measures its errors, or says why there is none.
    fn step(&mut self, ladder: &mut Ladder, level: u32, kind: Contours) -> Result<Option<(Limit, String)>, BenchError> {
        let matrix = &self.options.matrix;
        let left = self.clock.left();
        let builds = self.builds();
        let name = builds.name.clone();
        if let Some(refused) = limit::refusal(&builds.rows, kind, matrix, left) {
            return Ok(Some(refused));
        }
        let load = load();
        let ended = self.build(&name, ladder.stand_in, level, kind, &format!("at {level} levels"));
        let build = match ended? {
            Ended::Stopped(limit, why) => {
                self.remove();
                return Ok(Some((limit, why)));
            }
            Ended::Done(build) => build,
        };
        self.progress.say(format!("{name}: error at {level} levels, {}", kind.title()));
        let errors = ladder.truth.errors(&self.file, level);
        self.remove();
        let sample = BuildSample { seconds: build.seconds, peak_bytes: build.peak_bytes, load };
        let (errors, failed) = match errors {
            Ok(Errors { leaves, pixel }) => ([Some(leaves), Some(pixel)], None),
            Err(e) => ([None, None], Some((Limit::Failed, format!("casting it: {e}")))),
        };
        let [error, error_at_pixel] = errors;
        let row =
            BuildRow { levels: level, contours: kind, build: *build, samples: vec![sample], error, error_at_pixel };
        let builds = self.builds();
        builds.rows.push(row);
        builds.saved = saved::saved(&builds.rows);
        Ok(failed)
    }

    /// Builds once more what was built and did not take too long.
    fn round(&mut self, round: usize) -> Result<(), BenchError> {
        let all: Vec<(usize, usize)> = (self.report.scenes.iter().enumerate())
            .flat_map(|(s, scene)| (0..scene.rows.len()).map(move |r| (s, r)))
            .collect();
        for (s, r) in all {
            let scene = &self.report.scenes[s];
            let row = &scene.rows[r];
            let (name, stand_in, levels, kind) = (scene.name.clone(), scene.mesh != "real", row.levels, row.contours);
            let seconds = &row.samples[0].seconds;
            let all = seconds.import + seconds.build;
            if all > self.options.matrix.repeat_below_seconds || all > self.clock.left() {
                continue;
            }
            let load = load();
            let what = format!("at {levels} levels, round {}", round + 1);
            let ended = self.build(&name, stand_in, levels, kind, &what);
            self.remove();
            let Ended::Done(build) = ended? else { continue };
            let row = &mut self.report.scenes[s].rows[r];
            if (build.voxels, build.image_bytes) != (row.build.voxels, row.build.image_bytes) {
                let what = format!(
                    "{levels} levels, {}: {} voxels in {} bytes the first time, {} in {} the next: building must give \
                     the same whatever the threads do",
                    kind.title(),
                    row.build.voxels,
                    row.build.image_bytes,
                    build.voxels,
                    build.image_bytes
                );
                return Err(BenchError::scene(&name, what));
            }
            row.samples.push(BuildSample { seconds: build.seconds, peak_bytes: build.peak_bytes, load });
            self.save()?;
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
        let left = self.clock.left().max(1.0);
        let job = Job {
            program: &self.options.program,
            scenes_dir: self.options.scenes_dir.as_deref(),
            scene,
            stand_in,
            levels,
            contours,
            output: &self.file,
            memory: matrix.memory_gb * GB,
            disk: matrix.disk_gb * GB,
            seconds: matrix.build_limit_seconds.min(left),
            seconds_of: if left < matrix.build_limit_seconds { Limit::Run } else { Limit::Build },
        };
        job.run()
    }

    /// Ends the ladder of a kind: `levels` are those that are not there.
    fn stop(&mut self, kind: Contours, levels: &[u32], limit: Limit, why: String) {
        let Some(&first) = levels.first() else { return };
        let builds = self.builds();
        let all: Vec<_> = levels.iter().map(u32::to_string).collect();
        let what = format!("{}, {}, at {} levels", builds.name, kind.title(), all.join(", "));
        let reason = if levels.len() > 1 { format!("at {first} levels: {why}") } else { why.clone() };
        builds.stopped.push(Stopped { contours: kind, levels: first, limit, why });
        self.report.left_out.push(LeftOut { what, reason });
    }

    /// The next build starts with an empty disk; that a stopped one left nothing to remove is as well.
    fn remove(&self) {
        let _ = std::fs::remove_file(&self.file);
    }
}

/// What stays while the levels of a scene are built.
struct Ladder {
    stand_in: bool,
    truth: Truth,
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
