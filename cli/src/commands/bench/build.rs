//! `esvo bench build`.

use std::path::PathBuf;

use clap::Args;
use esvo_bench::Progress;
use esvo_bench::build_bench::{
    BuildBenchOptions, BuildMatrix, Contours, build_journal, resume_build_bench, to_text, write_build_record,
};
use esvo_bench::output::check_writable;

use crate::commands::bench::selection::Selection;
use crate::fail::{Failure, complain, print};

/// Measure building: seconds, memory, bytes and error against the triangles.
#[derive(Debug, Args)]
#[command(after_help = "\
Each octree is built in a process of its own and compared with the triangles of its mesh: depth,
colours, normals and pictures. Tables show the figures of the paper and of its authors' builder too,
and mark where ours are worse. A deeper level is left out if the
growth of the last two levels predicts that it exceeds a limit. Record and tables are written
after every octree, so that a run which is stopped leaves its results. The same command with --resume
goes on with what is left, into the same record: after an interrupt or a crash, for builds that
failed, and after --time-limit, which then counts anew. Octrees are built in the temporary folder
($TMPDIR) and removed. Exit code 1 if a build failed.

Examples:
  esvo bench build         the scenes that the authors' builder was measured on
  esvo bench build --full  the paper's Table 1, levels 10 to 16; takes more than an hour
  esvo bench build --full --resume  the same, after it was stopped
  esvo bench build --scenes sibenik --levels 9,10 --contours on
  esvo bench build --beside ../old/esvo --scenes sibenik,sibenik-plain,conference --levels 10,12")]
pub(crate) struct BenchBuildArguments {
    /// Measure the paper's Table 1: all scenes, levels 10 to 16, as far as the limits allow
    #[arg(long, conflicts_with = "matrix")]
    pub(crate) full: bool,
    #[command(flatten)]
    pub(crate) selection: Selection,
    /// Build octrees with contours, without, or both
    #[arg(long, value_enum)]
    pub(crate) contours: Option<Which>,
    /// How often each octree is built
    #[arg(long, value_name = "N")]
    pub(crate) repeats: Option<usize>,
    /// Number of rays that measure errors, over all viewpoints of a scene
    #[arg(long, value_name = "N")]
    pub(crate) rays: Option<u64>,
    /// Limit on the size of a file in GB (10^9 bytes)
    #[arg(long, value_name = "GB")]
    pub(crate) disk: Option<f64>,
    /// Limit on the time of one build in seconds
    #[arg(long, value_name = "SECONDS")]
    pub(crate) build_limit: Option<f64>,
    /// Let this esvo program, of another version for instance, build each octree in the same rounds, and print the ratio of CPU seconds
    #[arg(long, value_name = "PROGRAM")]
    pub(crate) beside: Option<PathBuf>,
    /// Go on with the run of the same options that was stopped: octrees that were measured are not built again
    #[arg(long)]
    pub(crate) resume: bool,
    /// Folder for the record and the tables; the files are named after the matrix
    #[arg(long, value_name = "FOLDER", default_value = "results/build")]
    pub(crate) out: PathBuf,
}

/// Which octrees are built.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Which {
    /// Both
    Both,
    /// With contours
    On,
    /// Without contours: cubes only
    Off,
}

pub(crate) fn run_bench_build(arguments: &BenchBuildArguments) -> Result<(), Failure> {
    let matrix = matrix(arguments)?;
    let selection = &arguments.selection;
    selection.check()?;
    check_writable(&arguments.out)?;
    let program = std::env::current_exe().map_err(|e| format!("this program cannot find itself: {e}"))?;
    let options = BuildBenchOptions {
        matrix,
        scenes_dir: selection.scenes_dir.clone(),
        manifest: selection.manifest.clone(),
        program,
        beside: arguments.beside.clone(),
    };
    let journal = build_journal(&options, &arguments.out, arguments.resume)?;
    let progress = Progress::terminal();
    let mut save = |report: &_| write_build_record(report, &arguments.out).map(drop);
    let report = resume_build_bench(&options, &journal, &progress, &mut save);
    progress.finish();
    let report = report?;
    let written = write_build_record(&report, &arguments.out)?;
    if report.is_unfinished() {
        complain(
            "note",
            "some builds failed or were left out for the time limit; the same command with --resume tries them",
        );
    } else {
        journal.remove()?;
    }
    let printed = print(&if selection.json { report.to_json() } else { to_text(&report) });
    for path in written {
        complain("written", &path.display().to_string());
    }
    let failed: Vec<_> =
        report.failures().map(|(scene, s)| format!("{} at {} levels: {}", scene.name, s.levels, s.why)).collect();
    if !failed.is_empty() {
        return Err(failed.join("; ").into());
    }
    printed
}

fn matrix(arguments: &BenchBuildArguments) -> Result<BuildMatrix, Failure> {
    let selection = &arguments.selection;
    let mut matrix = match &selection.matrix {
        Some(file) => BuildMatrix::read(file)?,
        None if arguments.full => BuildMatrix::full_run(),
        None => BuildMatrix::default_run(),
    };
    let names = selection.names(&matrix.scenes)?;
    if !names.is_empty() {
        matrix.select_scenes(&names);
    }
    selection.apply(&mut matrix.scenes, &mut matrix.memory_gb, &mut matrix.time_limit_seconds);
    match arguments.contours {
        Some(Which::Both) => matrix.contours = vec![Contours::On, Contours::Off],
        Some(Which::On) => matrix.contours = vec![Contours::On],
        Some(Which::Off) => matrix.contours = vec![Contours::Off],
        None => {}
    }
    matrix.repeats = arguments.repeats.unwrap_or(matrix.repeats);
    matrix.rays = arguments.rays.unwrap_or(matrix.rays);
    matrix.disk_gb = arguments.disk.unwrap_or(matrix.disk_gb);
    matrix.build_limit_seconds = arguments.build_limit.unwrap_or(matrix.build_limit_seconds);
    matrix.validate()?;
    Ok(matrix)
}
