//! `esvo bench rays`.

use clap::Args;
use esvo_bench::Progress;
use esvo_bench::ray_bench::{RayBenchOptions, run_ray_bench, to_text, write_ray_record};
use esvo_engines::EngineId;

use crate::commands::bench::casting::CastingArguments;
use crate::fail::Failure;
use crate::values::{engine, parse_size};

/// Measure lists of rays on every engine, next to a picture.
#[derive(Debug, Args)]
#[command(after_help = "\
Builds an octree of a scene with contours; casts a picture, the picture's rays as a list, and from
its hits shadow rays, rays of ambient occlusion and a diffuse bounce; then incoherent rays, all on
every engine; compares the hits with the reference caster's; and measures rays per second,
including copies to and from a GPU. Prints tables and writes report.json and tables.md to
results/<machine>/<date>-rays/. Exit code 1 if the hits of an engine are wrong.

Examples:
  esvo bench rays  SIBENIK at 10 levels, in two minutes on two cores
  esvo bench rays --scene conference --backends cpu,wgpu")]
pub(crate) struct BenchRaysArguments {
    /// The scene
    #[arg(long, value_name = "NAME", default_value = "sibenik")]
    pub(crate) scene: String,
    /// Levels of its octree
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=23))]
    pub(crate) levels: u32,
    /// Size of the picture
    #[arg(long, value_name = "WxH", default_value = "512x384", value_parser = parse_size)]
    pub(crate) size: [u32; 2],
    /// Number of incoherent rays in the long list, 1 to 100 million
    #[arg(long, value_name = "N", default_value_t = 1_000_000, value_parser = clap::value_parser!(u32).range(1..=100_000_000))]
    pub(crate) rays: u32,
    /// Time for the measurements in seconds; three rounds are made at least
    #[arg(long, value_name = "SECONDS", default_value_t = 60.0)]
    pub(crate) seconds: f64,
    /// Measure only these engines
    #[arg(long, value_parser = engine(), value_delimiter = ',')]
    pub(crate) backends: Vec<EngineId>,
    #[command(flatten)]
    pub(crate) casting: CastingArguments,
}

pub(crate) fn run_bench_rays(arguments: &BenchRaysArguments) -> Result<(), Failure> {
    arguments.casting.check()?;
    let mut options = RayBenchOptions {
        scene: arguments.scene.clone(),
        levels: arguments.levels,
        size: arguments.size,
        rays: arguments.rays as usize,
        seconds: arguments.seconds,
        threads: arguments.casting.threads(),
        scenes_dir: arguments.casting.scenes_dir.clone(),
        ..RayBenchOptions::default()
    };
    if !arguments.backends.is_empty() {
        options.engines.clone_from(&arguments.backends);
    }
    let progress = Progress::terminal();
    let report = run_ray_bench(&options, &progress);
    progress.finish();
    let report = report?;
    let folder = write_ray_record(&report, &arguments.casting.record.out, arguments.casting.record.machine.as_deref())?;
    arguments.casting.record.print(&folder, || report.to_json(), || to_text(&report))?;
    if report.passed() { Ok(()) } else { Err("the hits of an engine are not the reference's".to_string().into()) }
}
