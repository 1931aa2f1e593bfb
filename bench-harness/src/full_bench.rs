//! `esvo bench --full`: every report, one after the other, and a page of them all. A run that was stopped goes on where it was.

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::{Deserialize, Serialize};

use crate::journal::Journal;
use crate::needs_bench::{NeedsBenchOptions, resume_needs_bench, write_needs_record};
use crate::output::{write_folder, write_text};
use crate::page::{PageOptions, make_page, write_page};
use crate::paper_bench::{PaperBenchOptions, resume_paper_bench, write_paper_record};
use crate::ray_bench::{RayBenchOptions, run_ray_bench, write_ray_record};
use crate::scene;
use crate::stability_bench::{StabilityOptions, run_stability_bench, write_stability_record};
use crate::sweep_bench::{SweepBenchOptions, resume_sweep_bench, write_sweep_record};
use crate::system::machine::Machine;
use crate::text::{TextTable, short};
use crate::voxel_bench::{VoxelBenchOptions, resume_voxel_bench, unavailable, write_voxel_record};
use crate::{BenchError, Progress};

/// The reports of a full run, and where they go.
#[derive(Clone, Debug)]
pub struct FullOptions {
    /// Hard rays, octrees and meshes.
    pub stability: Option<StabilityOptions>,
    /// The paper's tables.
    pub tables: Option<PaperBenchOptions>,
    /// Error against run time.
    pub sweep: Option<SweepBenchOptions>,
    /// What code costs that a scene does not need.
    pub needs: Option<NeedsBenchOptions>,
    /// Lists of rays, a record for each.
    pub rays: Vec<RayBenchOptions>,
    /// Voxelization on a GPU; left out where there is none.
    pub voxelize: Option<VoxelBenchOptions>,
    /// The folder of records.
    pub results: PathBuf,
    /// Name of the machine's folder; `None`: made from the processor's.
    pub machine: Option<String>,
    /// Goes on with a run that was stopped.
    pub resume: bool,
}

/// A report that was made.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct FullPart {
    /// Its command.
    pub command: String,
    /// The folder of its record.
    pub folder: PathBuf,
    /// Whether all answers in it are right.
    pub right: bool,
    /// Seconds that it took.
    pub seconds: f64,
}

/// A full run.
#[derive(Clone, PartialEq, Debug)]
pub struct FullReport {
    /// The reports, in the order in which they were made.
    pub parts: Vec<FullPart>,
    /// Reports that could not be made, and why.
    pub failed: Vec<(String, String)>,
    /// Reports that need what this machine or program lacks, and what that is.
    pub left_out: Vec<(String, String)>,
    /// The folder with the page, `page.html`, and this list, `run.md`.
    pub folder: PathBuf,
    /// Parts that were found in the journal of the run that was stopped.
    pub found: usize,
}

impl FullReport {
    /// Whether every report was made and all answers are right.
    pub fn passed(&self) -> bool {
        self.failed.is_empty() && !self.parts.is_empty() && self.parts.iter().all(|part| part.right)
    }

    /// The list of the reports.
    pub fn table(&self) -> TextTable {
        let mut table = TextTable::new("Reports", 1, &["report", "seconds", "answers", "record"]);
        for part in &self.parts {
            let right = if part.right { "right" } else { "WRONG" };
            let folder = part.folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
            table.rows.push(vec![part.command.clone(), short(part.seconds), right.into(), folder]);
        }
        for (command, why) in &self.failed {
            table.rows.push(vec![command.clone(), "-".into(), "-".into(), why.clone()]);
        }
        for (command, why) in &self.left_out {
            table.rows.push(vec![command.clone(), "-".into(), "-".into(), format!("left out: {why}")]);
        }
        if !self.parts.is_empty() {
            let all: f64 = self.parts.iter().map(|part| part.seconds).sum();
            table.notes.push(format!("{} minutes in all.", short(all / 60.0)));
        }
        if self.found > 0 {
            table.notes.push(format!("The run was stopped, and resumed with {} of these finished.", self.found));
        }
        table
    }
}

/// A run on its way.
struct Run<'a> {
    journal: &'a Journal,
    parts: Vec<FullPart>,
    failed: Vec<(String, String)>,
    found: usize,
}

/// Makes every report that is asked for, and the page. A report that fails does not stop the others.
///
/// # Errors
/// A scene that does not exist; the journal's; a page that cannot be made or written.
pub fn run_full_bench(options: &FullOptions, progress: &Progress) -> Result<FullReport, BenchError> {
    check_scenes(options)?;
    let (results, machine) = (options.results.as_path(), options.machine.as_deref());
    let journal = Journal::open(results, machine, "-full", &settings(options), options.resume)?;
    let mut run = Run { journal: &journal, parts: Vec::new(), failed: Vec::new(), found: 0 };
    if let Some(stability) = &options.stability {
        run.part("esvo bench stability", || {
            let report = run_stability_bench(stability, progress)?;
            Ok((write_stability_record(&report, results, machine)?, report.passed()))
        })?;
    }
    if let Some(tables) = &options.tables {
        run.part("esvo bench", || {
            let outcome = resume_paper_bench(tables, &journal, progress)?;
            Ok((write_paper_record(&outcome, results, machine)?, outcome.report.passed()))
        })?;
    }
    if let Some(sweep) = &options.sweep {
        run.part("esvo bench sweep", || {
            let report = resume_sweep_bench(sweep, &journal, progress)?;
            Ok((write_sweep_record(&report, results, machine)?, report.passed()))
        })?;
    }
    if let Some(needs) = &options.needs {
        run.part("esvo bench needs", || {
            let report = resume_needs_bench(needs, &journal, progress)?;
            Ok((write_needs_record(&report, results, machine)?, report.passed()))
        })?;
    }
    for rays in &options.rays {
        run.part(&format!("esvo bench rays --scene {}", rays.scene), || {
            let report = run_ray_bench(rays, progress)?;
            Ok((write_ray_record(&report, results, machine)?, report.passed()))
        })?;
    }
    let mut left_out = Vec::new();
    if let Some(voxelize) = &options.voxelize {
        let command = "esvo bench voxelize";
        match unavailable(voxelize) {
            Some(why) => left_out.push((command.into(), why)),
            None => run.part(command, || {
                let outcome = resume_voxel_bench(voxelize, &journal, progress)?;
                Ok((write_voxel_record(&outcome, results, machine)?, outcome.report.passed()))
            })?,
        }
    }
    let Run { parts, failed, found, .. } = run;
    let mut report = FullReport { parts, failed, left_out, folder: PathBuf::new(), found };
    progress.say("the page");
    report.folder = write_folder(results, &Machine::detect(), machine, "-full", |folder| {
        write_text(&folder.join("run.md"), &report.table().to_markdown())?;
        if report.parts.is_empty() { Ok(()) } else { page(&report, &folder.join("page.html")) }
    })?;
    journal.remove()?;
    Ok(report)
}

/// Finds every scene that is named, so that a wrong name is told before hours have passed.
fn check_scenes(options: &FullOptions) -> Result<(), BenchError> {
    let manifest = scene::manifest(None)?;
    let tables = options.tables.iter().flat_map(|tables| &tables.matrix.scenes).map(|scene| &scene.name);
    for name in tables {
        scene::buildable(&manifest, name)?;
    }
    let sweep = options.sweep.iter().flat_map(|sweep| &sweep.plan.scenes).map(|scene| &scene.name);
    let needs = options.needs.iter().flat_map(|needs| &needs.scenes);
    let rays = options.rays.iter().map(|rays| &rays.scene);
    let voxelize = options.voxelize.iter().flat_map(|voxelize| &voxelize.scenes).map(|scene| &scene.name);
    for name in sweep.chain(needs).chain(rays).chain(voxelize) {
        scene::entry(&manifest, name)?;
    }
    Ok(())
}

fn page(report: &FullReport, path: &Path) -> Result<(), BenchError> {
    let inputs = report.parts.iter().map(|part| part.folder.clone()).collect();
    let page = make_page(&PageOptions { inputs, ..PageOptions::default() })?;
    write_page(&page, path).map(drop)
}

/// What the results depend on.
fn settings(options: &FullOptions) -> impl Serialize + use<> {
    let FullOptions { stability, tables, sweep, needs, rays, voxelize, .. } = options.clone();
    let tables = tables.map(|tables| (tables.matrix, tables.threads));
    let sweep = sweep.map(|sweep| (sweep.plan, sweep.threads, sweep.all_on_software));
    (stability, tables, sweep, needs, rays, voxelize)
}

impl Run<'_> {
    /// Makes a report, unless it is in the journal.
    fn part(
        &mut self,
        command: &str,
        make: impl FnOnce() -> Result<(PathBuf, bool), BenchError>,
    ) -> Result<(), BenchError> {
        if let Some(part) = self.journal.find::<FullPart>(command)? {
            self.found += 1;
            self.parts.push(part);
            return Ok(());
        }
        let start = Instant::now();
        // Scenes of this report that were measured before the run was stopped.
        let before = self.journal.found_seconds();
        match make() {
            Ok((folder, right)) => {
                let seconds = start.elapsed().as_secs_f64() + self.journal.found_seconds() - before;
                let part = FullPart { command: command.into(), folder, right, seconds };
                self.journal.keep(command, start, &part)?;
                self.parts.push(part);
            }
            Err(error) => self.failed.push((command.into(), error.to_string())),
        }
        Ok(())
    }
}
