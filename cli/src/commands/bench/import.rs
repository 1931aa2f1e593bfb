//! `esvo bench import`.

use std::path::PathBuf;

use clap::Args;
use esvo_bench::Progress;
use esvo_bench::import_bench::{ImportBenchOptions, run_import_bench};
use esvo_bench::output::write_text;

use crate::fail::{Failure, complain, print};

/// Try every mesh file below some folders, and say which gave an octree and which an error.
#[derive(Debug, Args)]
#[command(after_help = "\
Each file (.obj, .gltf, .glb, .ply, .stl) is built by a process of its own, within a limit of time and of memory, and the octree
is validated. Exit code 1 if a file made the program crash, hang, run out of memory or say anything but one line of error.

Example:
  esvo bench import glTF-validator/test /usr/share/assimp/models -o import-robustness.md")]
pub(crate) struct BenchImportArguments {
    /// Folders, searched with all folders in them
    #[arg(required = true, value_name = "FOLDER")]
    pub(crate) folders: Vec<PathBuf>,
    /// Write the table there, as Markdown, instead of printing it
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
    /// Levels of the octrees
    #[arg(short, long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=23))]
    pub(crate) levels: u32,
    /// Seconds that one file may take
    #[arg(long, value_name = "SECONDS", default_value_t = 60.0)]
    pub(crate) time_limit: f64,
    /// Memory that one process may hold, in GB (10^9 bytes)
    #[arg(long, value_name = "GB", default_value_t = 2.0)]
    pub(crate) memory: f64,
}

pub(crate) fn run_bench_import(arguments: &BenchImportArguments) -> Result<(), Failure> {
    for (name, value) in [("--time-limit", arguments.time_limit), ("--memory", arguments.memory)] {
        if !(value > 0.0 && value.is_finite()) {
            return Err(format!("{name} {value}: must be above zero").into());
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
    for row in report.broken() {
        complain("broken", &format!("{}: {:?}", row.file, row.outcome));
    }
    match report.broken().count() {
        0 => Ok(()),
        broken => Err(format!("{broken} files gave neither an octree nor one line of error").into()),
    }
}
