//! `esvo bench pictures`.

use std::path::PathBuf;

use clap::Args;
use esvo_bench::output::check_writable;
use esvo_bench::picture_bench::{PictureBenchOptions, run_picture_bench, write_picture_table};
use esvo_bench::system::machine::Machine;
use esvo_bench::{BenchError, Progress};

use crate::commands::bench::selection::check_scenes_dir;
use crate::fail::{Failure, print};
use crate::values::parse_size;

/// Make pictures of octrees next to the triangles they were built from.
#[derive(Debug, Args)]
#[command(after_help = "\
The left half shows the octree, the right half the triangles, in the same light with four rays per
pixel: SIBENIK-D (displacement), FLIGHT-HELMET (normal maps), JUNGLE (cut-outs). FLIP measures how
different the halves look, 0 to 1. The table of the pictures is written to pictures.md in the same
folder.

Example:
  esvo bench pictures --scenes jungle --levels 10 --out pictures")]
pub(crate) struct BenchPicturesArguments {
    /// Make pictures of these scenes only
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub(crate) scenes: Vec<String>,
    /// Levels of the octrees [default: 10 or 11]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=23))]
    pub(crate) levels: Option<u32>,
    /// Size of each half
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = parse_size)]
    pub(crate) size: [u32; 2],
    /// Folder that is searched first for real meshes; then $ESVO_SCENES, then ../shared/scenes
    #[arg(long, value_name = "FOLDER")]
    pub(crate) scenes_dir: Option<PathBuf>,
    /// Folder for the pictures and their table, pictures.md
    #[arg(long, value_name = "FOLDER", default_value = "results/pictures")]
    pub(crate) out: PathBuf,
}

pub(crate) fn run_bench_pictures(arguments: &BenchPicturesArguments) -> Result<(), Failure> {
    if arguments.size.iter().any(|&n| n > 8192) {
        return Err("--size: must be at most 8192x8192, as four rays are cast for each pixel".into());
    }
    check_scenes_dir(arguments.scenes_dir.as_deref())?;
    check_writable(&arguments.out)?;
    let machine = Machine::detect();
    let options = PictureBenchOptions {
        scenes: arguments.scenes.clone(),
        levels: arguments.levels,
        size: arguments.size,
        scenes_dir: arguments.scenes_dir.clone(),
    };
    let progress = Progress::terminal();
    let mut lines = String::new();
    let mut pairs = Vec::new();
    let made = run_picture_bench(&options, &progress, |pair| {
        // The folder is made with the first picture: a run without pictures leaves no folder.
        std::fs::create_dir_all(&arguments.out).map_err(|e| BenchError::io(&arguments.out, e))?;
        let path = pair.picture.write(&arguments.out)?;
        lines += &format!(
            "{}: {} from {}, {} levels, {:.1} M voxels, {} triangles, FLIP {:.3}. {}\n",
            path.display(),
            pair.scene,
            pair.view,
            pair.levels,
            pair.voxels as f64 / 1e6,
            pair.triangles,
            pair.flip,
            pair.credit
        );
        pairs.push(pair);
        // The table is written after each picture, so that it is complete if the run is stopped.
        write_picture_table(&pairs, &machine, &arguments.out).map(drop)
    });
    progress.finish();
    print(&lines)?;
    Ok(made?)
}
