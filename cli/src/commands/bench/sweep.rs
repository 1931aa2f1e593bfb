//! `esvo bench sweep`.

use std::path::PathBuf;

use clap::Args;
use esvo_bench::Progress;
use esvo_bench::journal::Journal;
use esvo_bench::sweep_bench::{SweepBenchOptions, SweepPlan, resume_sweep_bench, to_text, write_sweep_record};
use esvo_engines::EngineId;

use crate::commands::bench::cache::CacheArguments;
use crate::commands::bench::casting::CastingArguments;
use crate::fail::Failure;
use crate::values::{engine, parse_gigabytes, parse_size};

/// Measure error against run time: every level, contours, beam, termination and engine, and triangles.
#[derive(Debug, Args)]
#[command(after_help = "\
Builds octrees of each scene at several levels with and without contours, or takes them from the
cache; casts them with and without the beam, with rays that end at voxels of 0.5, 1, 2 and 4
pixels, and the triangles themselves; compares all hits with the reference caster's and with the
exact answer in double precision, and times all settings of a scene in turn. Answers in words how
many levels contours save, what each feature costs at equal error, and where triangles win. GPU
drivers that run on the processor cast a few settings only. Prints tables of the Pareto fronts and
writes report.json, sweep.csv, tables.md with all settings and a plot of each scene to
results/<machine>/<date>-sweep/. `esvo advise` picks settings from report.json. Exit code 1 if hits
are wrong.

Examples:
  esvo bench sweep  three scenes, in about ten minutes on two cores
  esvo bench sweep --scenes sibenik --levels 8,9,10 --engines cpu
  esvo bench sweep --full --memory 16")]
pub(crate) struct BenchSweepArguments {
    /// All scenes but SIBENIK-D, three viewpoints of each
    #[arg(long)]
    full: bool,
    /// Measure only these scenes
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    scenes: Vec<String>,
    /// Levels of the octrees of every scene
    #[arg(long, value_name = "N,...", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=23))]
    levels: Vec<u32>,
    /// Measure only these engines
    #[arg(long, alias = "backends", value_name = "NAMES", value_delimiter = ',', value_parser = engine())]
    engines: Vec<EngineId>,
    /// Size of the pictures
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<[u32; 2]>,
    /// Rays end at voxels of these sizes in pixels; 0: at leaves only
    #[arg(long, value_name = "PIXELS,...", value_delimiter = ',')]
    terminations: Vec<f32>,
    /// Viewpoints of each scene, at most
    #[arg(long, value_name = "N")]
    views: Option<usize>,
    /// Timed rounds
    #[arg(long, value_name = "N")]
    rounds: Option<usize>,
    /// Memory limit in GB (10^9 bytes); octrees that need more are left out
    #[arg(long, value_name = "GB", value_parser = parse_gigabytes)]
    memory: Option<f64>,
    /// GPU drivers that run on the processor cast all settings, too
    #[arg(long)]
    all_on_software: bool,
    /// Go on with the run of the same options that was stopped: scenes that were finished are not measured again
    #[arg(long)]
    resume: bool,
    /// Read the scenes from this manifest of your own instead of the paper's: see scenes/README.md
    #[arg(long, value_name = "FILE", conflicts_with = "scenes_dir", requires = "scenes")]
    manifest: Option<PathBuf>,
    #[command(flatten)]
    cache: CacheArguments,
    #[command(flatten)]
    casting: CastingArguments,
}

pub(crate) fn run_bench_sweep(arguments: &BenchSweepArguments) -> Result<(), Failure> {
    arguments.casting.check()?;
    let options = SweepBenchOptions {
        plan: plan(arguments)?,
        scenes_dir: arguments.casting.scenes_dir.clone(),
        manifest: arguments.manifest.clone(),
        threads: arguments.casting.threads(),
        all_on_software: arguments.all_on_software,
        cache: arguments.cache.open(),
        views: Vec::new(),
    };
    let record = &arguments.casting.record;
    let settings = (&options.plan, options.threads, options.all_on_software);
    let journal = Journal::open(&record.out, record.machine.as_deref(), "-sweep", &settings, arguments.resume)?;
    let progress = Progress::terminal();
    let report = resume_sweep_bench(&options, &journal, &progress);
    progress.finish();
    let report = report?;
    let folder = write_sweep_record(&report, &record.out, record.machine.as_deref())?;
    journal.remove()?;
    let printed = record.print(&folder, || report.to_json(), || to_text(&report));
    let wrong = report.failures().count();
    if wrong > 0 {
        let tables = folder.join("tables.md");
        return Err(format!("the hits of {wrong} settings are wrong; see {}", tables.display()).into());
    }
    printed
}

fn plan(arguments: &BenchSweepArguments) -> Result<SweepPlan, Failure> {
    let mut plan = if arguments.full { SweepPlan::full_run() } else { SweepPlan::default_run() };
    if !arguments.scenes.is_empty() {
        plan.select_scenes(&arguments.scenes);
    }
    if !arguments.levels.is_empty() {
        plan.set_levels(&arguments.levels);
    }
    if !arguments.engines.is_empty() {
        plan.engines = arguments.engines.clone();
        plan.engines.sort();
        plan.engines.dedup();
    }
    if !arguments.terminations.is_empty() {
        plan.terminations = arguments.terminations.clone();
        plan.terminations.sort_by(f32::total_cmp);
        plan.terminations.dedup();
    }
    plan.size = arguments.size.unwrap_or(plan.size);
    plan.views = arguments.views.unwrap_or(plan.views);
    plan.rounds = arguments.rounds.unwrap_or(plan.rounds);
    plan.memory_gb = arguments.memory.unwrap_or(plan.memory_gb);
    plan.validate()?;
    Ok(plan)
}
