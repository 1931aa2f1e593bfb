//! `esvo bench import`.

use std::path::PathBuf;

use clap::Args;
use esvo_bench::Progress;
use esvo_bench::import_bench::{ImportBenchOptions, run_import_bench};
use esvo_bench::output::write_text;

use crate::fail::{Failure, complain, print};

/// Build all mesh files below some folders, and list which give an octree and which an error.
#[derive(Debug, Args)]
#[command(after_help = "\
Each file (.obj, .gltf, .glb, .ply, .stl) is built in a process of its own with limits on time and
memory, and the octree is validated. Exit code 1 if a file makes the program crash, hang, exceed
its memory or print anything but one line of error.

Example:
  esvo bench import glTF-validator/test /usr/share/assimp/models -o import-robustness.md")]
pub(crate) struct BenchImportArguments {
    /// Folders that are searched, including all folders below them
    #[arg(required = true, value_name = "FOLDER")]
    pub(crate) folders: Vec<PathBuf>,
    /// Write the table to this Markdown file instead of printing it
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
    /// Levels of the octrees
    #[arg(short, long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=23))]
    pub(crate) levels: u32,
    /// Limit on the time of one file in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 60.0)]
    pub(crate) time_limit: f64,
    /// Limit on the memory of one process in GB (10^9 bytes)
    #[arg(long, value_name = "GB", default_value_t = 2.0)]
    pub(crate) memory: f64,
}

pub(crate) fn run_bench_import(arguments: &BenchImportArguments) -> Result<(), Failure> {
    for (name, value) in [("--time-limit", arguments.time_limit), ("--memory", arguments.memory)] {
        if !(value > 0.0 && value.is_finite()) {
            return Err(format!("{name} {value}: expected a number above 0").into());
        }
    }
    if let Some(output) = &arguments.output {
        crate::files::check_output(output)?;
    }
    let program = std::env::current_exe().map_err(|e| format!("this program cannot find itself: {e}"))?;
    let options = ImportBenchOptions {
        folders: arguments.folders.clone(),
        program,
        levels: arguments.levels,
        seconds: arguments.time_limit,
        memory: (arguments.memory * 1e9) as u64,
    };
    let progress = Progress::terminal();
    let report = run_import_bench(&options, &progress);
    progress.finish();
    let report = report?;
    let text = report.to_markdown();
    match &arguments.output {
        Some(output) => {
            write_text(output, &text)?;
            complain("written", &output.display().to_string());
        }
        None => print(&text)?,
    }
    for (file, what) in report.broken() {
        complain("broken", &format!("{file}: {what}"));
    }
    match report.broken().count() {
        0 => Ok(()),
        broken => Err(format!("{broken} files gave neither an octree nor one line of error").into()),
    }
}
