//! `esvo bench needs`.

use clap::Args;
use esvo_bench::Progress;
use esvo_bench::journal::Journal;
use esvo_bench::needs_bench::{NeedsBenchOptions, resume_needs_bench, to_text, write_needs_record};
use esvo_engines::EngineId;

use crate::commands::bench::casting::CastingArguments;
use crate::fail::Failure;
use crate::values::{engine, parse_size};

/// Measure what code costs that a scene does not need.
#[derive(Debug, Args)]
#[command(after_help = "\
Builds octrees with and without contours, small enough to have no far pointers and larger; casts
pictures of them by code that contains everything, and by code that leaves out, one by one and
together, what neither the octree nor the rays need: clipping by contours, following far pointers,
the test whether a voxel is small, on GPUs frames of the stack; compares the hits with the reference caster's. Prints tables and
writes report.json and tables.md to results/<machine>/<date>-needs/. Exit code 1 if hits are wrong.

Examples:
  esvo bench needs  SIBENIK and CONFERENCE at 7 and 10 levels, in a minute on two cores
  esvo bench needs --scenes fairy --levels 6,8,11 --rounds 9
  esvo bench needs --scenes all --levels 7,9 --views 2 --rounds 3
  esvo bench needs --backends cpu,wgpu,ash --views 2 --size 320x240")]
pub(crate) struct BenchNeedsArguments {
    /// The scenes; all: every scene of the manifest but SIBENIK-D and SIBENIK-PLAIN
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_value = "sibenik,conference")]
    pub(crate) scenes: Vec<String>,
    /// Levels of their octrees
    #[arg(long, value_name = "N", value_delimiter = ',', default_value = "7,10", value_parser = clap::value_parser!(u32).range(1..=23))]
    pub(crate) levels: Vec<u32>,
    /// Size of the pictures
    #[arg(long, value_name = "WxH", default_value = "512x384", value_parser = parse_size)]
    pub(crate) size: [u32; 2],
    /// Viewpoints of each scene, at most
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub(crate) views: u16,
    /// Rounds
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub(crate) rounds: u16,
    /// The engines that are measured: those that can be told what to leave out. cpu is measured by one ray at a time and by its
    /// fastest instructions
    #[arg(long, value_name = "NAMES", value_delimiter = ',', value_parser = engine(), default_value = "cpu")]
    pub(crate) backends: Vec<EngineId>,
    /// Go on with the run of the same options that was stopped: scenes that were finished are not measured again
    #[arg(long)]
    pub(crate) resume: bool,
    #[command(flatten)]
    pub(crate) casting: CastingArguments,
}

pub(crate) fn run_bench_needs(arguments: &BenchNeedsArguments) -> Result<(), Failure> {
    arguments.casting.check()?;
    if arguments.backends.contains(&EngineId::Reference) {
        return Err("--backends reference: always has all code; expected cpu, wgpu or ash".to_owned().into());
    }
    let options = NeedsBenchOptions {
        scenes: if arguments.scenes == ["all"] { Vec::new() } else { arguments.scenes.clone() },
        levels: arguments.levels.clone(),
        size: arguments.size,
        views: arguments.views.into(),
        rounds: arguments.rounds.into(),
        engines: arguments.backends.clone(),
        threads: arguments.casting.threads(),
        scenes_dir: arguments.casting.scenes_dir.clone(),
    };
    let record = &arguments.casting.record;
    let journal = Journal::open(&record.out, record.machine.as_deref(), "-needs", &options, arguments.resume)?;
    let progress = Progress::terminal();
    let report = resume_needs_bench(&options, &journal, &progress);
    progress.finish();
    let report = report?;
    let folder = write_needs_record(&report, &record.out, record.machine.as_deref())?;
    journal.remove()?;
    arguments.casting.record.print(&folder, || report.to_json(), || to_text(&report))?;
    if report.passed() { Ok(()) } else { Err("hits are not the reference's".to_string().into()) }
}
