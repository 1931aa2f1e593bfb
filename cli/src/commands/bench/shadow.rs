//! `esvo bench shadow`.

use std::path::PathBuf;

use clap::Args;
use esvo_bench::Progress;
use esvo_bench::output::check_writable;
use esvo_bench::shadow_bench::{ShadowOptions, run_shadow_bench, to_text, write_shadow_record};

use crate::commands::bench::record::RecordArguments;
use crate::commands::bench::selection::check_scenes_dir;
use crate::fail::Failure;
use crate::values::parse_size;

/// Trace shadows, occlusion, reflections and fog through a volume of one bit a voxel, and measure how wrong its shortcuts are.
#[derive(Debug, Args)]
#[command(after_help = "\
Measures a large world, objects that move in it, and a picture of it pass by pass; rays that leave
closed rooms, which must be none if every voxel is looked at; rays a second with and without mips,
beside the octree's caster; and for each effect the error to the converged answer of the exact
octree, and to that of the triangles, against time: by the voxel's size, the number of rays, steps
in the place of every voxel, rays that begin in the picture, and smoothing. Prints tables and
writes report.json, tables.md, plots and pictures to results/<machine>/<date>-shadow/. Exit code 1
if a ray leaves a room, if the volume is wrong after objects have moved, if rays have other answers
with mips or on a GPU, or if a GPU's picture is another. Scenes are taken to be 40 m long.

Examples:
  esvo bench shadow                                  SIBENIK at 2.5 to 20 cm
  esvo bench shadow --voxels 5,10 --rays 4 --leak-rays 100000")]
pub(crate) struct BenchShadowArguments {
    /// Scenes
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_value = "sibenik")]
    scenes: Vec<String>,
    /// Edges of voxels in centimetres
    #[arg(long, value_name = "CM", value_delimiter = ',', default_value = "2.5,5,10,20")]
    voxels: Vec<f64>,
    /// Rays for each pixel
    #[arg(long, value_name = "N", value_delimiter = ',', default_value = "1,4,16,64")]
    rays: Vec<u32>,
    /// Size of the pictures that errors are measured in; those of the record are larger
    #[arg(long, value_name = "WxH", value_parser = parse_size, default_value = "320x240")]
    size: [u32; 2],
    /// Levels of the octrees that surfaces are seen with
    #[arg(long, value_name = "N", default_value_t = 11)]
    levels: u32,
    /// Rays for each pixel of the converged answer
    #[arg(long, value_name = "N", default_value_t = 256)]
    converged: u32,
    /// How often each time is measured
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    rounds: u32,
    /// Rays that try to leave closed rooms
    #[arg(long, value_name = "N", default_value_t = 10_000_000)]
    leak_rays: u64,
    /// Voxels along each axis of the world that objects move in
    #[arg(long, value_name = "N", value_delimiter = ',', num_args = 1, default_value = "2000,2000,500")]
    world: Vec<u32>,
    /// Size of the picture of that world, with ten lamps and all effects, of which each pass is timed
    #[arg(long, value_name = "WxH", value_parser = parse_size, default_value = "1920x1080")]
    picture: [u32; 2],
    /// Make no pictures
    #[arg(long)]
    no_pictures: bool,
    /// Folder that is searched first for real meshes; then $ESVO_SCENES, then ../shared/scenes
    #[arg(long, value_name = "FOLDER")]
    scenes_dir: Option<PathBuf>,
    #[command(flatten)]
    record: RecordArguments,
}

pub(crate) fn run_bench_shadow(arguments: &BenchShadowArguments) -> Result<(), Failure> {
    check_scenes_dir(arguments.scenes_dir.as_deref())?;
    check_writable(&arguments.record.out)?;
    let Ok(world) = <[u32; 3]>::try_from(arguments.world.clone()) else {
        return Err(
            format!("--world: {} numbers were given; give three, e.g. 2000,2000,500", arguments.world.len()).into()
        );
    };
    let options = ShadowOptions {
        scenes: arguments.scenes.clone(),
        voxels_cm: arguments.voxels.clone(),
        rays: arguments.rays.clone(),
        size: arguments.size.into(),
        levels: arguments.levels,
        converged: arguments.converged,
        rounds: arguments.rounds,
        leak_rays: arguments.leak_rays,
        world,
        picture: arguments.picture.into(),
        pictures: !arguments.no_pictures,
        scenes_dir: arguments.scenes_dir.clone(),
    };
    let progress = Progress::terminal();
    let outcome = run_shadow_bench(&options, &progress);
    progress.finish();
    let outcome = outcome?;
    let report = &outcome.report;
    let folder = write_shadow_record(&outcome, &arguments.record.out, arguments.record.machine.as_deref())?;
    arguments.record.print(&folder, || report.to_json(), || to_text(report))?;
    if report.passed() {
        Ok(())
    } else {
        let what = "a ray left a closed room, the volume was wrong after objects had moved, or rays or pictures had two answers";
        Err(what.to_owned().into())
    }
}
