//! `esvo bench --repeat`.

use std::path::Path;

use esvo_bench::Progress;
use esvo_bench::repeat::{RepeatOptions, repeat, to_text};
use esvo_bench::sweep_bench::Cache;

use crate::commands::bench::tables::TablesArguments;
use crate::fail::{Failure, print};

pub(crate) fn run_bench_repeat(record: &Path, arguments: &TablesArguments) -> Result<(), Failure> {
    let options = RepeatOptions {
        scenes_dir: arguments.selection.scenes_dir.clone(),
        manifest: arguments.selection.manifest.clone(),
        cache: Cache::in_folder(&Cache::default_folder()),
        results: arguments.out.clone(),
        machine: arguments.machine.clone(),
        resume: arguments.resume,
    };
    let progress = Progress::terminal();
    let report = repeat(record, &options, &progress);
    progress.finish();
    let report = report?;
    // The verdict counts even if standard output is closed.
    let printed = print(&format!("{}Written to {}\n", to_text(&report), report.folder.display()));
    if report.passed() {
        return printed;
    }
    let what = if report.right { "the second run found something else" } else { "answers of an engine are wrong" };
    Err(format!("{}: {what}", record.display()).into())
}
