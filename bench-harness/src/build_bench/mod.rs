//! `esvo bench build`: time and memory of building, size of the octrees and their error against the triangles, compared with
//! the paper and with its authors' builder.
//!
//! Every octree is built in a process of its own, which reports a [`BuildSummary`].

mod accuracy;
mod beside;
mod child;
mod limit;
mod output;
mod parts;
mod peers;
mod plan;
mod record;
mod saved;
mod tables;

use std::path::{Path, PathBuf};
use std::time::Instant;

use esvo_scenes::{SceneEntry, SceneVariant};

use crate::build_summary::BuildSummary;
use crate::journal::Journal;
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
use parts::{RoundPart, StepPart, part_name};

pub use output::write_build_record;
pub use parts::build_journal;
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
    resume_build_bench(options, &Journal::none(), progress, save)
}

/// Like [`run_build_bench`]. Builds that are in the journal, which [`build_journal`] opens, are not made again; those that are made are
/// kept there. Not kept are builds that failed, and what the time limit of the run left out: a resumed run tries them, and has the whole
/// limit for that.
///
/// # Errors
/// Those of [`run_build_bench`], and the journal's; the mesh of a scene is not the one of the run that was stopped.
pub fn resume_build_bench(
    options: &BuildBenchOptions,
    journal: &Journal,
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
    let mut runner =
        BuildRun { options, progress, journal, clock, scratch: &scratch, entries: Vec::new(), report, save };
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
    journal: &'a Journal,
    clock: Clock,
    scratch: &'a Scratch,
    /// Names in the manifest of the report's scenes.
    entries: Vec<String>,
    report: BuildReport,
    save: &'a mut dyn FnMut(&BuildReport) -> Result<(), BenchError>,
}

impl BuildRun<'_> {
    fn save(&mut self) -> Result<(), BenchError> {
        self.report.seconds = self.journal.found_seconds() + self.clock.elapsed();
        (self.save)(&self.report)
    }

    /// Builds a scene level by level, and measures the errors.
    fn scene(&mut self, entry: &SceneEntry, levels: &[u32]) -> Result<(), BenchError> {
        let matrix = &self.options.matrix;
        let source = SceneSource::find(entry, self.options.scenes_dir.as_deref(), false)?;
        if let Some(reason) = source.absent() {
            self.report.left_out.push(LeftOut { what: entry.name.clone(), reason });
            return self.save();
        }
        let mut ladder = Ladder { entry, stand_in: source.variant() == SceneVariant::StandIn, truth: None };
        let part = part_name(&entry.name, None);
        let builds = match self.journal.find::<SceneBuilds>(&part)? {
            Some(builds) => {
                parts::check_identity(&entry.name, &builds, &source)?;
                builds
            }
            None => {
                let start = Instant::now();
                let scene = self.load(entry)?;
                let size = matrix.picture_size(scene.views.len());
                let builds = SceneBuilds::new(&scene, size);
                ladder.truth = Some(SceneTruth::new(scene, size));
                self.journal.keep(&part, start, &builds)?;
                builds
            }
        };
        self.report.scenes.push(builds);
        self.entries.push(entry.name.clone());
        let mut kinds = matrix.contours.clone();
        for (index, &level) in levels.iter().enumerate() {
            for kind in kinds.clone() {
                let part = part_name(&entry.name, Some((level, kind, 0)));
                let found = self.journal.find::<StepPart>(&part)?;
                let is_new = found.is_none();
                let step = match found {
                    Some(step) => step,
                    None => {
                        let start = Instant::now();
                        let step = self.step(&mut ladder, level, kind)?;
                        if step.is_final() {
                            self.journal.keep(&part, start, &step)?;
                        }
                        step
                    }
                };
                self.report.left_out.extend(step.left_out);
                let builds = self.builds();
                if let Some(row) = step.row {
                    builds.rows.push(row);
                    builds.saved = saved::saved(&builds.rows);
                }
                if let Some((limit, why)) = step.stopped {
                    kinds.retain(|k| *k != kind);
                    self.stop(kind, &levels[index..], limit, why);
                }
                if is_new {
                    self.save()?;
                }
            }
        }
        Ok(())
    }

    fn load(&self, entry: &SceneEntry) -> Result<Scene, BenchError> {
        self.progress.say(format!("{}: reading the mesh", entry.name));
        Scene::load(entry, self.options.scenes_dir.as_deref(), self.options.matrix.views)
    }

    /// The record of the current scene.
    fn builds(&mut self) -> &mut SceneBuilds {
        self.report.scenes.last_mut().expect("a scene is at work")
    }

    /// Builds one octree of the scene and measures its errors.
    fn step(&mut self, ladder: &mut Ladder, level: u32, kind: Contours) -> Result<StepPart, BenchError> {
        let matrix = &self.options.matrix;
        let left = self.clock.left();
        let builds = self.builds();
        let name = builds.name.clone();
        if let Some(refused) = limit::refusal(&builds.rows, kind, matrix, left) {
            return Ok(StepPart::stopped(refused));
        }
        let load = proc::load();
        let octree = OctreeOf { scene: self.report.scenes.len() - 1, stand_in: ladder.stand_in, levels: level, kind };
        let file = self.scratch.file(OURS);
        let (build, cpu_seconds) = match self.build(octree, &format!("at {level} levels"))? {
            Ended::Stopped(limit, why) => {
                remove(&file);
                return Ok(StepPart::stopped((limit, why)));
            }
            Ended::Done { report, cpu_seconds } => (report, cpu_seconds),
        };
        let (mut beside, mut left_out) = (None, Vec::new());
        self.build_beside(octree, "the first time", &mut beside, &mut left_out)?;
        let truth = match &mut ladder.truth {
            Some(truth) => truth,
            None => {
                let size = self.builds().size;
                ladder.truth.insert(SceneTruth::new(self.load(ladder.entry)?, size))
            }
        };
        self.progress.say(format!("{name}: error at {level} levels, {}", kind.title()));
        let errors = truth.errors(&file, level);
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
        let stopped = match errors {
            Ok(Errors { leaves, pixel }) => {
                (row.error, row.attributes) = (Some(leaves.depth), Some(leaves.attributes));
                (row.error_at_pixel, row.attributes_at_pixel) = (Some(pixel.depth), Some(pixel.attributes));
                row.flip_at_pixel = pixel.flip;
                None
            }
            Err(e) => Some((Limit::Failed, format!("casting it: {e}"))),
        };
        Ok(StepPart { row: Some(row), stopped, left_out })
    }

    /// Repeats the builds that did not take too long.
    fn round(&mut self, round: usize) -> Result<(), BenchError> {
        let all: Vec<(usize, usize)> = (self.report.scenes.iter().enumerate())
            .flat_map(|(s, scene)| (0..scene.rows.len()).map(move |r| (s, r)))
            .collect();
        for (s, r) in all {
            let row = &self.report.scenes[s].rows[r];
            if !row.is_repeated(&self.options.matrix) {
                continue;
            }
            let part = part_name(&self.entries[s], Some((row.levels, row.contours, round)));
            let found = self.journal.find::<RoundPart>(&part)?;
            let is_new = found.is_none();
            let repeated = match found {
                Some(repeated) => repeated,
                None => {
                    let start = Instant::now();
                    let Some(repeated) = self.repeat(s, r, round)? else { continue };
                    self.journal.keep(&part, start, &repeated)?;
                    repeated
                }
            };
            self.report.left_out.extend(repeated.left_out);
            let row = &mut self.report.scenes[s].rows[r];
            row.samples.push(repeated.sample);
            if let Some(beside) = repeated.beside {
                row.beside = Some(beside);
            }
            if is_new {
                self.save()?;
            }
        }
        Ok(())
    }

    /// Builds an octree again. `None`: there is no time for it, or the build failed.
    fn repeat(&mut self, s: usize, r: usize, round: usize) -> Result<Option<RoundPart>, BenchError> {
        let scene = &self.report.scenes[s];
        let row = &scene.rows[r];
        let (levels, kind, first) = (row.levels, row.contours, (row.build.voxels, row.build.image_bytes));
        if row.first_seconds() > self.clock.left() {
            return Ok(None);
        }
        let octree = OctreeOf { scene: s, stand_in: scene.mesh == SceneVariant::StandIn, levels, kind };
        let what = format!("round {}", round + 1);
        // Builds of the two programs are pairs. Every second round begins with the other one.
        let paired = row.beside.as_ref().is_some_and(|beside| beside.samples.len() == row.samples.len());
        let (mut beside, mut left_out) = (row.beside.clone().filter(|_| paired), Vec::new());
        let other_first = round % 2 == 1;
        if paired && other_first {
            self.build_beside(octree, &what, &mut beside, &mut left_out)?;
        }
        let load = proc::load();
        let ended = self.build(octree, &format!("at {levels} levels, {what}"));
        remove(&self.scratch.file(OURS));
        let Ended::Done { report: build, cpu_seconds } = ended? else {
            self.report.left_out.extend(left_out);
            return Ok(None);
        };
        if paired && !other_first {
            self.build_beside(octree, &what, &mut beside, &mut left_out)?;
        }
        if (build.voxels, build.image_bytes) != first {
            let what = format!(
                "{levels} levels, {}: the first build gave {} voxels in {} bytes, a repeated one {} in {}: building must \
                 not depend on the timing of threads",
                kind.title(),
                first.0,
                first.1,
                build.voxels,
                build.image_bytes
            );
            return Err(BenchError::scene(&self.report.scenes[s].name, what));
        }
        let sample = BuildSample { seconds: build.seconds, peak_bytes: build.peak_bytes, cpu_seconds, load };
        Ok(Some(RoundPart { sample, beside, left_out }))
    }

    /// Builds an octree in the file [`OURS`].
    fn build(&self, octree: OctreeOf, what: &str) -> Result<Ended<BuildSummary>, BenchError> {
        let name = &self.report.scenes[octree.scene].name;
        self.progress.say(format!("{name}: building {}, {what}", octree.kind.title()));
        self.job(octree, &self.options.program, &self.scratch.file(OURS)).run()
    }

    /// Builds an octree by the other program, if there is one, and adds the build to `builds`, or why there is none to `left_out`.
    fn build_beside(
        &self,
        octree: OctreeOf,
        what: &str,
        builds: &mut Option<BesideBuilds>,
        left_out: &mut Vec<LeftOut>,
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
                left_out.push(LeftOut { what, reason });
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
struct Ladder<'a> {
    entry: &'a SceneEntry,
    stand_in: bool,
    /// `None` until an octree is measured: a resumed run may have measured all of them before.
    truth: Option<SceneTruth>,
}
