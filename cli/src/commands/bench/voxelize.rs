//! `esvo bench voxelize`.

use std::path::PathBuf;

use clap::Args;
use esvo_bench::Progress;
use esvo_bench::output::check_writable;
use esvo_bench::voxel_bench::{VoxelBenchOptions, run_voxel_bench, to_text, write_voxel_record};

use crate::commands::bench::record::RecordArguments;
use crate::commands::bench::selection::check_scenes_dir;
use crate::fail::Failure;

/// Voxelize scenes on a GPU by each method, and compare with the exact voxels.
#[derive(Debug, Args)]
#[command(after_help = "\
The methods, by their letters: a one fixed projection; b the projection in which a triangle is
largest; c edges moved outwards by half a pixel, c' the same within the triangle's bounding box,
d the same with a test of every voxel; e4, e8 multisampling; f the device's conservative
rasterization, f+ the same with a test; g a compute shader. What the device lacks is left out.
Counts voxels that are missing (cracks, holes) and extra, and measures time on the device beside
the builder's on the processor. Prints tables and writes report.json, tables.md, plots and
pictures to results/<machine>/<date>-voxelize/. Exit code 1 if a method that tests voxels is wrong
by more than single precision allows, or g at all.

Examples:
  esvo bench voxelize                                SIBENIK, CONFERENCE, HAIRBALL
  esvo bench voxelize --scenes sibenik --grids 256,512 --methods b,d,g")]
pub(crate) struct BenchVoxelizeArguments {
    /// Scenes [default: sibenik,conference,hairball]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    scenes: Vec<String>,
    /// Voxels along the edge of each grid, powers of two from 2 to 4096 [default: 256,512,1024; of hairball 256,512]
    #[arg(long, value_name = "N", value_delimiter = ',', value_parser = parse_grid)]
    grids: Vec<u32>,
    /// Letters or names of methods [default: all]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    methods: Vec<String>,
    /// How often each method is timed
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    rounds: u32,
    /// Part of the name of the device [default: the best]
    #[arg(long, value_name = "NAME")]
    device: Option<String>,
    /// Planned length of the run in seconds; finer grids are left out to stay within it; 0: no limit
    #[arg(long, value_name = "SECONDS", value_parser = parse_seconds)]
    time_limit: Option<f64>,
    /// Make no pictures
    #[arg(long)]
    no_pictures: bool,
    /// Folder that is searched first for real meshes; then $ESVO_SCENES, then ../shared/scenes
    #[arg(long, value_name = "FOLDER")]
    scenes_dir: Option<PathBuf>,
    #[command(flatten)]
    record: RecordArguments,
}

/// The level of a grid of so many voxels along its edge.
fn parse_grid(text: &str) -> Result<u32, String> {
    match text.parse::<u32>() {
        Ok(voxels) if voxels.is_power_of_two() && (2..=4096).contains(&voxels) => Ok(voxels.ilog2()),
        _ => Err("expected a power of two from 2 to 4096".into()),
    }
}

fn parse_seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds: &f64| *seconds >= 0.0 && seconds.is_finite());
    seconds.ok_or_else(|| "expected seconds, at least 0".into())
}

pub(crate) fn run_bench_voxelize(arguments: &BenchVoxelizeArguments) -> Result<(), Failure> {
    check_scenes_dir(arguments.scenes_dir.as_deref())?;
    check_writable(&arguments.record.out)?;
    let mut options = VoxelBenchOptions {
        methods: arguments.methods.clone(),
        rounds: arguments.rounds,
        device: arguments.device.clone(),
        pictures: !arguments.no_pictures,
        time_limit_seconds: arguments.time_limit.filter(|seconds| *seconds > 0.0),
        scenes_dir: arguments.scenes_dir.clone(),
        ..VoxelBenchOptions::default()
    };
    if !arguments.scenes.is_empty() {
        options.select_scenes(&arguments.scenes);
    }
    if !arguments.grids.is_empty() {
        options.set_levels(&arguments.grids);
    }
    let progress = Progress::terminal();
    let outcome = run_voxel_bench(&options, &progress);
    progress.finish();
    let outcome = outcome?;
    let report = &outcome.report;
    let folder = write_voxel_record(&outcome, &arguments.record.out, arguments.record.machine.as_deref())?;
    arguments.record.print(&folder, || report.to_json(), || to_text(report))?;
    if report.passed() {
        Ok(())
    } else {
        Err("a method is wrong by more than single precision allows".to_string().into())
    }
}
