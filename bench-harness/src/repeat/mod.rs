//! `esvo bench --repeat`: runs what a record says again, and says where the results differ.
//!
//! - `mod.rs`: from a record to a second one. `differences.rs`: comparing what does not depend on time. `tables.rs`: what is printed.
//!
//! A record of `esvo bench`, `esvo bench sweep`, `stability`, `rays`, `needs`, `voxelize` or `shadow` says what was asked for: scenes, viewpoints, levels,
//! engines, seeds, rounds. A second run on the same sources finds the same octrees, hits and errors in every digit; times it does not, and
//! [`compare`](crate::compare) judges them.

mod differences;
mod tables;

use std::path::{Path, PathBuf};

use crate::compare::{CompareReport, DEFAULT_THRESHOLD, compare, read_run};
use crate::journal::Journal;
use crate::needs_bench::{resume_needs_bench, write_needs_record};
use crate::paper_bench::{PaperBenchOptions, resume_paper_bench, write_paper_record};
use crate::ray_bench::{run_ray_bench, write_ray_record};
use crate::records::{Record, read_record};
use crate::scene::NamedView;
use crate::shadow_bench::{run_shadow_bench, write_shadow_record};
use crate::stability_bench::{run_stability_bench, write_stability_record};
use crate::sweep_bench::{Cache, SweepBenchOptions, resume_sweep_bench, write_sweep_record};
use crate::voxel_bench::{VoxelBenchOptions, resume_voxel_bench, write_voxel_record};
use crate::{BenchError, Progress};

pub use differences::Difference;
pub use tables::to_text;

/// Where what a record does not say comes from, and where the second record goes.
#[derive(Clone, Debug)]
pub struct RepeatOptions {
    /// The folder that is searched first for real meshes.
    pub scenes_dir: Option<PathBuf>,
    /// The manifest of the scenes; `None`: the one of the paper's scenes.
    pub manifest: Option<PathBuf>,
    /// Where octrees and exact answers of former sweeps are.
    pub cache: Cache,
    /// The folder of records.
    pub results: PathBuf,
    /// Name of the machine's folder; `None`: made from the processor's.
    pub machine: Option<String>,
    /// Goes on with the parts of a run that was stopped.
    pub resume: bool,
}

/// What a second run found.
#[derive(Clone, PartialEq, Debug)]
pub struct RepeatReport {
    /// The command of the record.
    pub command: &'static str,
    /// The first record's file.
    pub first: PathBuf,
    /// The second record's folder.
    pub folder: PathBuf,
    /// Machine and software where they differ: the likely cause of what follows.
    pub software: Vec<Difference>,
    /// Results that differ, whatever the time they took.
    pub differences: Vec<Difference>,
    /// The times; `None` for records without.
    pub times: Option<CompareReport>,
    /// Whether the answers of all engines were right in the second run.
    pub right: bool,
}

impl RepeatReport {
    /// Whether the second run found what the first did, and all answers were right.
    pub fn passed(&self) -> bool {
        self.right && self.differences.is_empty()
    }
}

/// Runs what a record says, writes a second record, and compares the two.
///
/// # Errors
/// A file that is no record, or one that does not say what was asked for; what the benchmark says.
pub fn repeat(path: &Path, options: &RepeatOptions, progress: &Progress) -> Result<RepeatReport, BenchError> {
    let bad = |what: String| BenchError::Matrix { file: path.display().to_string(), what };
    let first = read_record(path)?.ok_or_else(|| {
        bad("expected report.json of esvo bench, or of esvo bench sweep, stability, rays, needs, voxelize or shadow".into())
    })?;
    let silent = || bad("does not say what was asked for: it is of an older version of this program".into());
    let command = first.command();
    let threads = |recorded: Option<usize>| recorded.filter(|threads| *threads != first.machine().threads);
    let (results, machine) = (options.results.as_path(), options.machine.as_deref());
    let journal = |kind: &str, settings: &serde_json::Value| {
        Journal::open(results, machine, &format!("-repeat{kind}"), settings, options.resume)
    };
    let (second, folder, right) = match &first {
        Record::Paper(report) => {
            let again = PaperBenchOptions {
                matrix: report.matrix.clone(),
                scenes_dir: options.scenes_dir.clone(),
                manifest: options.manifest.clone(),
                threads: threads(report.calibration.as_ref().map(|calibration| calibration.threads)),
                slowed: report.slowed.clone(),
                views: report.scenes.iter().map(|scene| (scene.name.clone(), scene.views.clone())).collect(),
            };
            let journal = journal("", &value(&(&report.matrix, &again.views))?)?;
            let outcome = resume_paper_bench(&again, &journal, progress)?;
            let folder = write_paper_record(&outcome, results, machine)?;
            journal.remove()?;
            let right = outcome.report.passed();
            (Record::Paper(Box::new(outcome.report)), folder, right)
        }
        Record::Sweep(report) => {
            let mut plan = report.plan.clone();
            if let Some(scene) = report.scenes.iter().find(|scene| scene.views.is_empty()) {
                return Err(bad(format!("scene {} has no viewpoints", scene.name)));
            }
            plan.views = report.scenes.iter().map(|scene| scene.views.len()).max().unwrap_or(plan.views);
            let again = SweepBenchOptions {
                plan,
                scenes_dir: options.scenes_dir.clone(),
                manifest: options.manifest.clone(),
                threads: threads(report.calibration.as_ref().map(|calibration| calibration.threads)),
                all_on_software: report.all_on_software,
                cache: options.cache.clone(),
                views: report.scenes.iter().map(|scene| (scene.name.clone(), scene.views.clone())).collect(),
            };
            let journal = journal("-sweep", &value(&(&again.plan, &again.views))?)?;
            let report = resume_sweep_bench(&again, &journal, progress)?;
            let folder = write_sweep_record(&report, results, machine)?;
            journal.remove()?;
            let right = report.passed();
            (Record::Sweep(Box::new(report)), folder, right)
        }
        Record::Needs(report) => {
            let mut again = report.options.clone().ok_or_else(silent)?;
            again.scenes_dir.clone_from(&options.scenes_dir);
            let journal = journal("-needs", &value(&again)?)?;
            let report = resume_needs_bench(&again, &journal, progress)?;
            let folder = write_needs_record(&report, results, machine)?;
            journal.remove()?;
            let right = report.passed();
            (Record::Needs(Box::new(report)), folder, right)
        }
        Record::Rays(report) => {
            let mut again = report.options.clone().ok_or_else(silent)?;
            again.scenes_dir.clone_from(&options.scenes_dir);
            let report = run_ray_bench(&again, progress)?;
            let folder = write_ray_record(&report, results, machine)?;
            let right = report.passed();
            (Record::Rays(Box::new(report)), folder, right)
        }
        Record::Stability(report) => {
            let again = report.options.clone().ok_or_else(silent)?;
            let report = run_stability_bench(&again, progress)?;
            let folder = write_stability_record(&report, results, machine)?;
            let right = report.passed();
            (Record::Stability(Box::new(report)), folder, right)
        }
        Record::Voxelize(report) => {
            let again =
                VoxelBenchOptions { scenes_dir: options.scenes_dir.clone(), ..VoxelBenchOptions::of_record(report) };
            let journal = journal("-voxelize", &value(&again)?)?;
            let outcome = resume_voxel_bench(&again, &journal, progress)?;
            let folder = write_voxel_record(&outcome, results, machine)?;
            journal.remove()?;
            let right = outcome.report.passed();
            (Record::Voxelize(Box::new(outcome.report)), folder, right)
        }
        Record::Shadow(report) => {
            let mut again = report.options.clone();
            again.scenes_dir.clone_from(&options.scenes_dir);
            let outcome = run_shadow_bench(&again, progress)?;
            let folder = write_shadow_record(&outcome, results, machine)?;
            let right = outcome.report.passed();
            (Record::Shadow(Box::new(outcome.report)), folder, right)
        }
        Record::Build(_) => return Err(bad("is of esvo bench build, which --repeat cannot run".into())),
    };
    let times = match &first {
        Record::Stability(_) | Record::Voxelize(_) | Record::Shadow(_) => None,
        _ => {
            let again = folder.join("report.json");
            let (before, after) = (read_run(path)?, read_run(&again)?);
            let names = [path, &again].map(|path| path.display().to_string());
            Some(compare(&before, &after, [&names[0], &names[1]], DEFAULT_THRESHOLD))
        }
    };
    let software = differences::software(first.machine(), second.machine());
    let differences = differences::results(&json(&first)?, &json(&second)?);
    Ok(RepeatReport { command, first: path.to_owned(), folder, software, differences, times, right })
}

/// Viewpoints of scenes by their names in records, as far as they replace the manifest's.
pub(crate) fn replace_views(views: &[(String, Vec<NamedView>)], name: &str, of_scene: &mut Vec<NamedView>) {
    if let Some((_, views)) = views.iter().find(|(scene, views)| scene == name && !views.is_empty()) {
        of_scene.clone_from(views);
    }
}

fn value(settings: &impl serde::Serialize) -> Result<serde_json::Value, BenchError> {
    serde_json::to_value(settings).map_err(|e| BenchError::scene("record", e))
}

/// A record as JSON.
fn json(record: &Record) -> Result<serde_json::Value, BenchError> {
    match record {
        Record::Paper(report) => value(report),
        Record::Build(report) => value(report),
        Record::Sweep(report) => value(report),
        Record::Stability(report) => value(report),
        Record::Rays(report) => value(report),
        Record::Needs(report) => value(report),
        Record::Voxelize(report) => value(report),
        Record::Shadow(report) => value(report),
    }
}
