//! `esvo bench compare` and `esvo bench bless`.

use std::path::PathBuf;

use clap::Args;
use esvo_bench::compare::{self, CompareReport, DEFAULT_THRESHOLD, Verdict, read_run};

use crate::fail::{Failure, print};
use crate::values::parse_positive;

/// Compare the times of two records, or of a record and its baseline.
#[derive(Debug, Args)]
#[command(after_help = "\
Compares every cell that both records of `esvo bench`, or of `esvo bench sweep`, rays or needs,
have: times divided by those of the calibration casts, which tell how fast the machine was at that
moment. Lists what became slower or faster, what only one record has, and what cannot be compared:
another machine, mesh, octree, size or set of instructions. With one record, the baseline is the
one that `esvo bench bless` made for this kind of machine, or else the newest record under
--baselines. Records without calibration casts are compared as they are.
Exit code 1 if something is slower, if answers in the second record are wrong, or if nothing could
be compared.

Examples:
  esvo bench --matrix bench-harness/matrices/guard.toml --out after
  esvo bench compare after/*/*/report.json
  esvo bench compare before.json after.json --threshold 3 --json")]
pub(crate) struct BenchCompareArguments {
    /// A record; the one to judge if it is the only one
    #[arg(value_name = "BEFORE.json")]
    first: PathBuf,
    /// The record to judge
    #[arg(value_name = "AFTER.json")]
    second: Option<PathBuf>,
    /// Report differences of more than this
    #[arg(long, value_name = "PERCENT", default_value_t = DEFAULT_THRESHOLD, value_parser = parse_positive)]
    threshold: f64,
    /// Where records are: MACHINE/RUN/*.json
    #[arg(long, value_name = "FOLDER", default_value = "results", conflicts_with = "second")]
    baselines: PathBuf,
    /// List the cells that did not move, too
    #[arg(long)]
    all: bool,
    /// Print JSON
    #[arg(long, conflicts_with_all = ["all", "markdown"])]
    json: bool,
    /// Print Markdown
    #[arg(long)]
    markdown: bool,
}

/// Make a record the baseline of its kind of machine.
#[derive(Debug, Args)]
#[command(after_help = "\
Copies a record with times to MACHINE/baseline/BENCHMARK-MATRIX.json in the folder of baselines, in
place of the one that was there: `esvo bench compare` compares with it from then on.

Example:
  esvo bench bless after/amd-epyc-2-threads/2026-01-02/report.json")]
pub(crate) struct BenchBlessArguments {
    /// The record
    #[arg(value_name = "RUN.json")]
    record: PathBuf,
    /// Where records are
    #[arg(long, value_name = "FOLDER", default_value = "results")]
    baselines: PathBuf,
}

pub(crate) fn run_bench_compare(arguments: &BenchCompareArguments) -> Result<(), Failure> {
    let (before, after, names) = match &arguments.second {
        Some(second) => (read_run(&arguments.first)?, read_run(second)?, [&arguments.first, second].map(Clone::clone)),
        None => {
            let after = read_run(&arguments.first)?;
            let (path, before) = compare::baseline::find_baseline(&arguments.baselines, &after, &arguments.first)?;
            (before, after, [path, arguments.first.clone()])
        }
    };
    let [first, second] = names.map(|path| path.display().to_string());
    let report = compare::compare(&before, &after, [&first, &second], arguments.threshold);
    let text = if arguments.json {
        report.to_json()
    } else if arguments.markdown {
        compare::to_markdown(&report, arguments.all)
    } else {
        compare::to_text(&report, arguments.all)
    };
    // The verdict counts even if standard output is closed.
    let printed = print(&text);
    match failure(&report, arguments.threshold) {
        Some(what) => Err(format!("{second}: {what}").into()),
        None => printed,
    }
}

/// Why the comparison fails; `None` if it does not.
fn failure(report: &CompareReport, threshold: f64) -> Option<String> {
    let slower = report.count(Verdict::Slower);
    if !report.wrong.is_empty() {
        return Some(format!("{} checks of answers failed; see its tables", report.wrong.len()));
    }
    if slower > 0 {
        return Some(format!("{slower} of {} cells are slower by more than {threshold} %", report.compared()));
    }
    (!report.passed()).then(|| "no cell could be compared; measure the same matrix on the same kind of machine".into())
}

pub(crate) fn run_bench_bless(arguments: &BenchBlessArguments) -> Result<(), Failure> {
    let path = compare::baseline::bless(&arguments.record, &arguments.baselines)?;
    print(&format!("{} is the baseline now\n", path.display()))
}
