//! `esvo bench serve`.

use std::path::PathBuf;

use clap::Args;
use esvo_bench::Progress;
use esvo_bench::output::check_writable;
use esvo_bench::serve_bench::{ServeBenchOptions, run_serve_bench, to_text, write_serve_record};

use crate::commands::bench::record::RecordArguments;
use crate::fail::Failure;
use crate::values::{parse_positive, parse_size};

/// Measure what pictures of octrees on a server take.
#[derive(Debug, Args)]
#[command(after_help = "\
Serves each file from the loopback device, with a delay before each answer and so many bits in a
second; reads by ranges what a coarse picture and pictures with voxels of these sizes need, and counts
bytes, requests and seconds. Compares the pictures with those of the whole file, and those with one
level less as a negative control. Prints tables and writes report.json and tables.md to
results/<machine>/<date>-serve/. Exit code 1 if a picture is not that of the whole file. The program
must be built with --features remote.

Examples:
  esvo bench serve raw.esvo zstd.esvo parts.esvo --scene sibenik
  esvo bench serve parts.esvo --pixels 16,4 --delay 10 --mbit 1000 --json")]
pub(crate) struct BenchServeArguments {
    /// The octrees: the same one stored in several ways, or others
    #[arg(required = true)]
    pub(crate) files: Vec<PathBuf>,
    /// Take the camera from the manifest of this scene [default: one that sees all from outside]
    #[arg(long, value_name = "NAME")]
    pub(crate) scene: Option<String>,
    /// Number of the camera in the manifest, from 1
    #[arg(long, value_name = "K", default_value_t = 1, requires = "scene")]
    pub(crate) view: usize,
    /// Folder that is searched first for the real mesh; its cameras are taken if it is found
    #[arg(long, value_name = "FOLDER", requires = "scene")]
    pub(crate) scenes_dir: Option<PathBuf>,
    /// Size of the pictures
    #[arg(long, value_name = "WxH", default_value = "1024x768", value_parser = parse_size)]
    pub(crate) size: [u32; 2],
    /// Sizes in pixels of the voxels at which rays end; 0: at leaves only
    #[arg(long, value_name = "NUMBERS", value_delimiter = ',', default_value = "64,16,1,0")]
    pub(crate) pixels: Vec<f32>,
    /// Deepest level of a first, coarse picture of the whole
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=23))]
    pub(crate) coarse: u32,
    /// Milliseconds before each answer
    #[arg(long, value_name = "MS", default_value_t = 50, value_parser = clap::value_parser!(u64).range(0..=10_000))]
    pub(crate) delay: u64,
    /// Millions of bits in a second
    #[arg(long, value_name = "MBIT", default_value = "50", value_parser = parse_positive)]
    pub(crate) mbit: f64,
    /// Do not read pictures of files without an index that take more seconds than this; say only how many bytes they need
    #[arg(long, value_name = "SECONDS", default_value = "60", value_parser = parse_positive)]
    pub(crate) longest: f64,
    #[command(flatten)]
    pub(crate) record: RecordArguments,
}

pub(crate) fn run_bench_serve(arguments: &BenchServeArguments) -> Result<(), Failure> {
    if let Some(bad) = arguments.pixels.iter().find(|pixels| !(**pixels >= 0.0 && pixels.is_finite())) {
        return Err(format!("--pixels {bad}: expected 0 or positive numbers").into());
    }
    check_writable(&arguments.record.out)?;
    let options = ServeBenchOptions {
        files: arguments.files.clone(),
        scene: arguments.scene.clone(),
        view: arguments.view,
        scenes_dir: arguments.scenes_dir.clone(),
        size: arguments.size,
        pixels: arguments.pixels.clone(),
        coarse_level: arguments.coarse,
        delay_ms: arguments.delay,
        mbit: arguments.mbit,
        longest_seconds: arguments.longest,
    };
    let progress = Progress::terminal();
    let report = run_serve_bench(&options, &progress);
    progress.finish();
    let report = report?;
    let folder = write_serve_record(&report, &arguments.record.out, arguments.record.machine.as_deref())?;
    arguments.record.print(&folder, || report.to_json(), || to_text(&report))?;
    if report.passed() {
        Ok(())
    } else {
        Err("a picture is not that of the whole file, or nothing showed that this would be seen".to_owned().into())
    }
}
