//! `esvo bench build`: time and memory of building, size of the octrees and their error against the triangles, compared with
//! the paper and with its authors' builder.
//!
//! Every octree is built in a process of its own, which reports a [`BuildSummary`].

mod accuracy;
mod beside;
mod child;
mod limit;
mod output;
mod peers;
mod plan;
mod record;
mod saved;
mod tables;

use std::path::{Path, PathBuf};

use esvo_scenes::{SceneEntry, SceneVariant};

use crate::build_summary::BuildSummary;
use crate::matrix_parts::LeftOut;
use crate::scene::{self, Scene, SceneSource};
use crate::system::clock::Clock;
use crate::system::machine::Machine;
use crate::system::proc;
use crate::system::scratch::Scratch;
use crate::units::GB;
use crate::{BenchError, Progress};
use accuracy::{Errors, SceneTruth};
use beside::OtherSummary;
use child::{BuildJob, Ended};

pub use output::write_build_record;
pub use plan::{BuildMatrix, Contours};
pub use record::{
    BesideBuilds, BuildReport, BuildRow, BuildSample, Limit, Measure, OtherProgram, SCHEMA, SavedLevels, SceneBuilds,
    Stopped,
};
pub use tables::{to_markdown, to_text};

/// What [`run_build_bench`] measures.
#[derive(Clone, Debug)]
pub struct BuildBenchOptions {
    /// Scenes, levels and limits.
    pub matrix: BuildMatrix,
    /// The folder that is searched first for real meshes.
    pub scenes_dir: Option<PathBuf>,
    /// The manifest of the scenes; `None`: the one of the paper's scenes.
    pub manifest: Option<PathBuf>,
    /// The program whose `build` command is run: usually the `esvo` that is running.
    pub program: PathBuf,
    /// Another esvo program, of an earlier version for instance, that builds each octree in the same rounds.
    pub beside: Option<PathBuf>,
}

/// Builds all octrees of the matrix that its limits allow. Passes the report to `save` after every octree, so that a run that
/// is stopped leaves a record. A failed build is recorded ([`BuildReport::failures`]) and ends the levels of its octree; the
/// run continues with the others.
///
/// # Errors
/// A scene that does not exist, a mesh that cannot be used, a repeated build with a different result, another program that cannot be
/// started, an error of `save`.
pub fn run_build_bench(
    options: &BuildBenchOptions,
    progress: &Progress,
    save: &mut dyn FnMut(&BuildReport) -> Result<(), BenchError>,
) -> Result<BuildReport, BenchError> {
    let matrix = &options.matrix;
    matrix.validate().map_err(|what| BenchError::Matrix { file: matrix.name.clone(), what })?;
    let manifest = scene::manifest(options.manifest.as_deref())?;
    // Check all names first: an unknown scene must not end the run after an hour.
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
        beside: options.beside.as_deref().map(beside::identify).transpose()?,
    };
    let clock = Clock::start(matrix.time_limit_seconds);
    let mut runner = BuildRun { options, progress, clock, scratch: &scratch, entries: Vec::new(), report, save };
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

struct BuildRun<'a> {
    options: &'a BuildBenchOptions,
    progress: &'a Progress,
    clock: Clock,
    scratch: &'a Scratch,
    /// Names in the manifest of the report's scenes.
    entries: Vec<String>,
    report: BuildReport,
    save: &'a mut dyn FnMut(&BuildReport) -> Result<(), BenchError>,
}

impl BuildRun<'_> {
    fn save(&mut self) -> Result<(), BenchError> {
        self.report.seconds = self.clock.elapsed();
        (self.save)(&self.report)
    }

    /// Builds a scene level by level, and measures the errors.
    fn scene(&mut self, entry: &SceneEntry, levels: &[u32]) -> Result<(), BenchError> {
        let matrix = &self.options.matrix;
        let scenes_dir = self.options.scenes_dir.as_deref();
        if let Some(reason) = SceneSource::find(entry, scenes_dir, false)?.absent() {
            self.report.left_out.push(LeftOut { what: entry.name.clone(), reason });
            return self.save();
        }
        self.progress.say(format!("{}: reading the mesh", entry.name));
        let scene = Scene::load(entry, scenes_dir, matrix.views)?;
        let size = matrix.picture_size(scene.views.len());
        self.report.scenes.push(SceneBuilds::new(&scene, size));
        self.entries.push(entry.name.clone());
        let mut ladder =
            Ladder { stand_in: scene.variant == SceneVariant::StandIn, truth: SceneTruth::new(scene, size) };
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

    /// The record of the current scene.
    fn builds(&mut self) -> &mut SceneBuilds {
        self.report.scenes.last_mut().expect("a scene is at work")
    }

    /// Builds one octree of the scene and measures its errors. `Some`: why the octree does not exist or could not be cast.
    fn step(&mut self, ladder: &mut Ladder, level: u32, kind: Contours) -> Result<Option<(Limit, String)>, BenchError> {
        let matrix = &self.options.matrix;
        let left = self.clock.left();
        let builds = self.builds();
        let name = builds.name.clone();
        if let Some(refused) = limit::refusal(&builds.rows, kind, matrix, left) {
            return Ok(Some(refused));
        }
        let load = proc::load();
        let octree = OctreeOf { scene: self.report.scenes.len() - 1, stand_in: ladder.stand_in, levels: level, kind };
        let file = self.scratch.file(OURS);
        let (build, cpu_seconds) = match self.build(octree, &format!("at {level} levels"))? {
            Ended::Stopped(limit, why) => {
                remove(&file);
                return Ok(Some((limit, why)));
            }
            Ended::Done { report, cpu_seconds } => (report, cpu_seconds),
        };
        let mut beside = None;
        self.build_beside(octree, "the first time", &mut beside)?;
        self.progress.say(format!("{name}: error at {level} levels, {}", kind.title()));
        let errors = ladder.truth.errors(&file, level);
        remove(&file);
        let sample = BuildSample { seconds: build.seconds, peak_bytes: build.peak_bytes, cpu_seconds, load };
        let mut row = BuildRow {
            levels: level,
            contours: kind,
            build: *build,
            samples: vec![sample],
            error: None,
            error_at_pixel: None,
            attributes: None,
            attributes_at_pixel: None,
            flip_at_pixel: None,
            beside,
        };
        let failed = match errors {
            Ok(Errors { leaves, pixel }) => {
                (row.error, row.attributes) = (Some(leaves.depth), Some(leaves.attributes));
                (row.error_at_pixel, row.attributes_at_pixel) = (Some(pixel.depth), Some(pixel.attributes));
                row.flip_at_pixel = pixel.flip;
                None
            }
            Err(e) => Some((Limit::Failed, format!("casting it: {e}"))),
        };
        let builds = self.builds();
        builds.rows.push(row);
        builds.saved = saved::saved(&builds.rows);
        Ok(failed)
    }

    /// Repeats the builds that did not take too long.
    fn round(&mut self, round: usize) -> Result<(), BenchError> {
        let all: Vec<(usize, usize)> = (self.report.scenes.iter().enumerate())
            .flat_map(|(s, scene)| (0..scene.rows.len()).map(move |r| (s, r)))
            .collect();
        for (s, r) in all {
            let scene = &self.report.scenes[s];
            let row = &scene.rows[r];
            let (name, stand_in, levels, kind) =
                (scene.name.clone(), scene.mesh == SceneVariant::StandIn, row.levels, row.contours);
            let seconds = &row.samples[0].seconds;
            let all = seconds.import + seconds.build;
            if all > self.options.matrix.repeat_below_seconds || all > self.clock.left() {
                continue;
            }
            let octree = OctreeOf { scene: s, stand_in, levels, kind };
            let what = format!("round {}", round + 1);
            // Builds of the two programs are pairs. Every second round begins with the other one.
            let paired = row.beside.as_ref().is_some_and(|beside| beside.samples.len() == row.samples.len());
            let mut beside = row.beside.clone().filter(|_| paired);
            let other_first = round % 2 == 1;
            if paired && other_first {
                self.build_beside(octree, &what, &mut beside)?;
            }
            let load = proc::load();
            let ended = self.build(octree, &format!("at {levels} levels, {what}"));
            remove(&self.scratch.file(OURS));
            let Ended::Done { report: build, cpu_seconds } = ended? else { continue };
            if paired && !other_first {
                self.build_beside(octree, &what, &mut beside)?;
            }
            let row = &mut self.report.scenes[s].rows[r];
            if (build.voxels, build.image_bytes) != (row.build.voxels, row.build.image_bytes) {
                let what = format!(
                    "{levels} levels, {}: the first build gave {} voxels in {} bytes, a repeated one {} in {}: building must \
                     not depend on the timing of threads",
                    kind.title(),
                    row.build.voxels,
                    row.build.image_bytes,
                    build.voxels,
                    build.image_bytes
                );
                return Err(BenchError::scene(&name, what));
            }
            row.samples.push(BuildSample { seconds: build.seconds, peak_bytes: build.peak_bytes, cpu_seconds, load });
            if paired {
                row.beside = beside;
            }
            self.save()?;
        }
        Ok(())
    }

    /// Builds an octree in the file [`OURS`].
    fn build(&self, octree: OctreeOf, what: &str) -> Result<Ended<BuildSummary>, BenchError> {
        let name = &self.report.scenes[octree.scene].name;
        self.progress.say(format!("{name}: building {}, {what}", octree.kind.title()));
        self.job(octree, &self.options.program, &self.scratch.file(OURS)).run()
    }

    /// Builds an octree by the other program, if there is one, and adds the build to `builds`. Why it does not build it is recorded once.
    fn build_beside(
        &mut self,
        octree: OctreeOf,
        what: &str,
        builds: &mut Option<BesideBuilds>,
    ) -> Result<(), BenchError> {
        let Some(program) = &self.options.beside else { return Ok(()) };
        let name = &self.report.scenes[octree.scene].name;
        let kind = octree.kind.title();
        self.progress.say(format!("{name}: building {kind} by the other program, {what}"));
        let file = self.scratch.file("beside.esvo");
        let load = proc::load();
        let ended = self.job(octree, program, &file).run_as::<OtherSummary>();
        remove(&file);
        match ended? {
            Ended::Done { report, cpu_seconds } => beside::add(builds, &report, cpu_seconds, load),
            Ended::Stopped(_, reason) => {
                let what = format!("{name}, {kind}, at {} levels, by the other program, {what}", octree.levels);
                self.report.left_out.push(LeftOut { what, reason });
            }
        }
        Ok(())
    }

    fn job<'j>(&'j self, octree: OctreeOf, program: &'j Path, output: &'j Path) -> BuildJob<'j> {
        let matrix = &self.options.matrix;
        let left = self.clock.left().max(1.0);
        BuildJob {
            program,
            scenes_dir: self.options.scenes_dir.as_deref(),
            manifest: self.options.manifest.as_deref(),
            scene: &self.entries[octree.scene],
            stand_in: octree.stand_in,
            levels: octree.levels,
            contours: octree.kind,
            output,
            memory: matrix.memory_gb * GB,
            disk: matrix.disk_gb * GB,
            seconds: matrix.build_limit_seconds.min(left),
            seconds_of: if left < matrix.build_limit_seconds { Limit::Run } else { Limit::Build },
        }
    }

    /// Records that the octrees of a kind end before `levels`.
    fn stop(&mut self, kind: Contours, levels: &[u32], limit: Limit, why: String) {
        let Some(&first) = levels.first() else { return };
        let builds = self.builds();
        let all: Vec<_> = levels.iter().map(u32::to_string).collect();
        let what = format!("{}, {}, at {} levels", builds.name, kind.title(), all.join(", "));
        let reason = if levels.len() > 1 { format!("at {first} levels: {why}") } else { why.clone() };
        builds.stopped.push(Stopped { contours: kind, levels: first, limit, why });
        self.report.left_out.push(LeftOut { what, reason });
    }
}

/// Name of the file of the octree that is being built or measured.
const OURS: &str = "octree.esvo";

/// Removes an octree's file. A stopped build may have left none, so errors are ignored.
fn remove(file: &Path) {
    let _ = std::fs::remove_file(file);
}

/// An octree of a scene, which is given by its index in the report.
#[derive(Clone, Copy)]
struct OctreeOf {
    scene: usize,
    stand_in: bool,
    levels: u32,
    kind: Contours,
}

/// Data that is kept while the levels of a scene are built.
struct Ladder {
    stand_in: bool,
    truth: SceneTruth,
}
