//! `esvo bench format`.

use std::path::PathBuf;

use clap::Args;
use esvo_bench::Progress;
use esvo_bench::format_bench::{FormatBenchOptions, run_format_bench, to_text, write_format_record};
use esvo_bench::output::check_writable;

use crate::commands::bench::record::RecordArguments;
use crate::fail::Failure;

/// Measure the file format: storing, validating, reading one block of a large file.
#[derive(Debug, Args)]
#[command(after_help = "\
Builds octrees of a procedural mesh, or reads the given files; stores them uncompressed and
compressed, validates them, and writes a large file of copies of the first to the temporary folder
($TMPDIR), which is removed afterwards. Uses one core, and two to compare the checksums of the
large file, which every caster does on loading. Prints tables and writes report.json and tables.md
to results/<machine>/<date>-format/.

Examples:
  esvo bench format  a file of 1000 MB; takes 90 seconds and 1.2 GB of memory
  esvo bench format --size 100 --seconds 1
  esvo bench format sibenik.esvo --json")]
pub(crate) struct BenchFormatArguments {
    /// Octrees to measure instead of those of a procedural mesh; the large file consists of copies of the first
    pub(crate) files: Vec<PathBuf>,
    /// Size of the large file in MB (10^6 bytes), 2 to 32000
    #[arg(long, value_name = "MB", default_value_t = 1000, value_parser = clap::value_parser!(u64).range(2..=32_000))]
    pub(crate) size: u64,
    /// Levels of the procedural octree, 2 to 14; the octree of descriptors alone has one more
    #[arg(long, value_name = "N", default_value_t = 9, value_parser = clap::value_parser!(u32).range(2..=14))]
    pub(crate) levels: u32,
    /// Minimum time for each figure in seconds; each figure has at least five runs
    #[arg(long, value_name = "SECONDS", default_value_t = 2.0)]
    pub(crate) seconds: f64,
    #[command(flatten)]
    pub(crate) record: RecordArguments,
}

pub(crate) fn run_bench_format(arguments: &BenchFormatArguments) -> Result<(), Failure> {
    check_writable(&arguments.record.out)?;
    let options = FormatBenchOptions {
        large_bytes: arguments.size * 1_000_000,
        levels: arguments.levels,
        seconds: arguments.seconds,
        files: arguments.files.clone(),
        ..FormatBenchOptions::default()
    };
    let progress = Progress::terminal();
    let report = run_format_bench(&options, &progress);
    progress.finish();
    let report = report?;
    let folder = write_format_record(&report, &arguments.record.out, arguments.record.machine.as_deref())?;
    arguments.record.print(&folder, || report.to_json(), || to_text(&report))
}
