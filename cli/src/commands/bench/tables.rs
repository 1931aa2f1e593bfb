//! `esvo bench`: the paper's Table 1 and Table 2.

use std::path::PathBuf;

use clap::Args;
use esvo_bench::journal::Journal;
use esvo_bench::output::check_writable;
use esvo_bench::paper_bench::{PaperBenchOptions, Slowed, resume_paper_bench, tables, write_paper_record};
use esvo_bench::{Matrix, Progress};
use esvo_engines::EngineId;

use crate::commands::bench::full::{FullKind, run_bench_full};
use crate::commands::bench::repeat::run_bench_repeat;
use crate::commands::bench::selection::Selection;
use crate::fail::{Failure, complain, print};
use crate::values::{engine, parse_size, parse_slowed};

/// What `esvo bench` measures, and where its record goes.
#[derive(Debug, Args)]
pub(crate) struct TablesArguments {
    /// Make every report: hard cases, the paper's whole matrix (all scenes, resolutions and viewpoints, levels as deep as memory
    /// allows), error against run time, what code costs that a scene does not need, lists of rays, voxelization; and a page of them all
    #[arg(long, conflicts_with = "matrix")]
    pub(crate) full: bool,
    /// With --full: make only these reports
    #[arg(long, value_name = "NAMES", value_delimiter = ',', requires = "full", value_enum)]
    pub(crate) reports: Vec<FullKind>,
    /// Go on with the run of the same options that was stopped: what was finished is not measured again
    #[arg(long)]
    pub(crate) resume: bool,
    /// Run what this record says again: report.json of this command, or of sweep, stability, rays, needs, voxelize or shadow; and say where the
    /// results differ
    #[arg(long, value_name = "RECORD", conflicts_with_all = ["full", "matrix", "scenes", "levels", "memory", "time_limit", "json", "backends", "resolutions", "views", "rounds", "threads", "slow"])]
    pub(crate) repeat: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) selection: Selection,
    /// Measure only these engines
    #[arg(long, value_parser = engine(), value_delimiter = ',')]
    pub(crate) backends: Vec<EngineId>,
    /// Cast pictures of these sizes
    #[arg(long, value_name = "WxH,...", value_delimiter = ',', value_parser = parse_size)]
    pub(crate) resolutions: Vec<[u32; 2]>,
    /// Number of viewpoints per scene
    #[arg(long, value_name = "N")]
    pub(crate) views: Option<usize>,
    /// Number of timed rounds per row
    #[arg(long, value_name = "N")]
    pub(crate) rounds: Option<usize>,
    /// Threads of the CPU caster
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub(crate) threads: Option<u16>,
    /// Make every time of an engine this many percent longer: the negative control of `esvo bench compare`
    #[arg(long, value_name = "ENGINE=PERCENT", hide = true, value_parser = parse_slowed)]
    pub(crate) slow: Vec<Slowed>,
    /// Folder in which the folder MACHINE/DATE/ is made
    #[arg(long, value_name = "FOLDER", default_value = "results")]
    pub(crate) out: PathBuf,
    /// Name of the machine's folder [default: made from the processor's]
    #[arg(long, value_name = "NAME")]
    pub(crate) machine: Option<String>,
}

pub(crate) fn run_bench_tables(arguments: &TablesArguments) -> Result<(), Failure> {
    let selection = &arguments.selection;
    selection.check()?;
    check_writable(&arguments.out)?;
    if let Some(record) = &arguments.repeat {
        return run_bench_repeat(record, arguments);
    }
    let options = PaperBenchOptions {
        scenes_dir: selection.scenes_dir.clone(),
        manifest: selection.manifest.clone(),
        threads: arguments.threads.map(Into::into),
        slowed: arguments.slow.clone(),
        ..PaperBenchOptions::new(matrix(arguments)?)
    };
    if arguments.full {
        return run_bench_full(options, arguments);
    }
    let (out, machine) = (&arguments.out, arguments.machine.as_deref());
    let settings = (&options.matrix, options.threads, &options.slowed);
    let journal = Journal::open(out, machine, "", &settings, arguments.resume)?;
    let progress = Progress::terminal();
    let outcome = resume_paper_bench(&options, &journal, &progress);
    progress.finish();
    let outcome = outcome?;
    let folder = write_paper_record(&outcome, out, machine)?;
    journal.remove()?;
    let report = &outcome.report;
    let text = if selection.json {
        report.to_json()
    } else {
        format!("{}\nWritten to {}\n", tables::to_text(report), folder.display())
    };
    // Report wrong answers even if standard output is closed.
    let printed = print(&text);
    if selection.json {
        complain("written", &folder.display().to_string());
    }
    let wrong = report.failures().count();
    if wrong > 0 {
        return Err(format!(
            "{wrong} checks failed: an engine's answers differ from the reference caster's; see {}",
            folder.join("tables.md").display()
        )
        .into());
    }
    printed
}

fn matrix(arguments: &TablesArguments) -> Result<Matrix, Failure> {
    let selection = &arguments.selection;
    let mut matrix = match &selection.matrix {
        Some(file) => Matrix::read(file)?,
        None if arguments.full => Matrix::full_run(),
        None => Matrix::default_run(),
    };
    let names = selection.names(&matrix.scenes)?;
    if !names.is_empty() {
        matrix.select_scenes(&names);
    }
    selection.apply(&mut matrix.scenes, &mut matrix.memory_gb, &mut matrix.time_limit_seconds);
    if !arguments.backends.is_empty() {
        matrix.backends = arguments.backends.clone();
        matrix.backends.dedup();
    }
    if !arguments.resolutions.is_empty() {
        matrix.resolutions.clone_from(&arguments.resolutions);
    }
    matrix.views = arguments.views.unwrap_or(matrix.views);
    matrix.rounds = arguments.rounds.unwrap_or(matrix.rounds);
    matrix.validate()?;
    Ok(matrix)
}
