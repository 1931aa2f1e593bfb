//! `esvo bench stability`.

use clap::Args;
use esvo_bench::Progress;
use esvo_bench::output::check_writable;
use esvo_bench::stability_bench::{
    Case, StabilityOptions, replay, run_stability_bench, to_text, write_stability_record,
};
use esvo_engines::EngineId;

use crate::commands::bench::record::RecordArguments;
use crate::fail::{Failure, print};
use crate::values::{engine, parse_count};

/// Test every engine with hard rays, hard octrees and hard meshes.
#[derive(Debug, Args)]
#[command(after_help = "\
Casts rays along axes, in faces, through edges and corners, with components and spans of any
size, from a millionth of a voxel to a billion voxels away, through octrees of 1 to 23 levels with
contours at their limits. The reference caster's hits are judged by an oracle in double precision,
which derives how far off single precision may be; every engine must find the same in every bit,
or on a GPU what the oracle allows. Octrees built of hard meshes are compared with their
triangles. Mistakes made on purpose must be caught. Prints tables and writes report.json and
tables.md to results/<machine>/<date>-stability/. Exit code 1 if anything fails.

Examples:
  esvo bench stability                                  about a minute on two cores
  esvo bench stability --rays 10M --gpu-rays 1M
  esvo bench stability --replay sparse/far/cubes#123    one ray alone")]
pub(crate) struct BenchStabilityArguments {
    /// Rays for each engine on the processor and instruction set, e.g. 500000 or 10M
    #[arg(long, value_name = "N", default_value = "500k", value_parser = parse_count)]
    pub(crate) rays: u64,
    /// Rays for each GPU engine, at most as many as for the others
    #[arg(long, value_name = "N", default_value = "200k", value_parser = parse_count)]
    pub(crate) gpu_rays: u64,
    /// Number of the first ray of each kind: another one gives other rays
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u64).range(..=1 << 62))]
    pub(crate) seed: u64,
    /// Cast this ray of the suite alone, as the report names it, and say what each engine finds
    #[arg(long, value_name = "CASE")]
    pub(crate) replay: Option<Case>,
    /// Test only these engines
    #[arg(long, value_parser = engine(), value_delimiter = ',')]
    pub(crate) backends: Vec<EngineId>,
    #[command(flatten)]
    pub(crate) record: RecordArguments,
}

pub(crate) fn run_bench_stability(arguments: &BenchStabilityArguments) -> Result<(), Failure> {
    let mut options = StabilityOptions {
        rays: arguments.rays,
        gpu_rays: arguments.gpu_rays,
        seed: arguments.seed,
        ..StabilityOptions::default()
    };
    if !arguments.backends.is_empty() {
        options.engines.clone_from(&arguments.backends);
    }
    if let Some(case) = &arguments.replay {
        let (text, right) = replay(case, &options)?;
        print(&text)?;
        return if right { Ok(()) } else { Err(format!("{case}: a hit is wrong").into()) };
    }
    check_writable(&arguments.record.out)?;
    let progress = Progress::terminal();
    let report = run_stability_bench(&options, &progress);
    progress.finish();
    let report = report?;
    let folder = write_stability_record(&report, &arguments.record.out, arguments.record.machine.as_deref())?;
    arguments.record.print(&folder, || report.to_json(), || to_text(&report))?;
    if report.passed() {
        Ok(())
    } else {
        Err(format!("{} cases failed, or a mistake made on purpose was not caught", report.failures()).into())
    }
}
