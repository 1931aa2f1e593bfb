//! `esvo rays`.

use std::path::PathBuf;

use clap::Args;
use esvo_bench::Progress;
use esvo_bench::ray_files::{FileHeader, write_rays};

use crate::fail::{Failure, print};
use crate::files::{check_not_input, check_output, open};
use crate::view::ViewArguments;
use crate::words::{count, size};

/// Write the rays of a view to a file, for other casters and for esvo hits.
#[derive(Debug, Args)]
#[command(after_help = "\
The extension tells the form: .bin or .json. A .bin has a header of 192 bytes and 40 bytes for
each ray, all little-endian; the page of esvo_bench::ray_files has every field. Origins and
directions are in the cube 1 to 2 of the casters; the header's matrix leads from the cube 0 to 1
to the mesh. With numpy:

  rays = numpy.fromfile('rays.bin', offset=192, dtype=[
    ('origin', '<f4', 3), ('direction', '<f4', 3), ('t_min', '<f4'), ('t_max', '<f4'),
    ('size_at_origin', '<f4'), ('size_per_t', '<f4')])

Examples:
  esvo rays sibenik.esvo -o rays.bin --scene sibenik --view 2 --size 512x384
  esvo rays sibenik.esvo -o rays.json --camera=-15,-9,0,1,0.2,0 --size 4x3")]
pub(crate) struct RaysArguments {
    /// The octree
    pub(crate) file: PathBuf,
    /// The file to write: .bin or .json
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) rays: ViewArguments,
}

pub(crate) fn run_rays(arguments: &RaysArguments) -> Result<(), Failure> {
    check_output(&arguments.output)?;
    check_not_input(&arguments.output, &arguments.file)?;
    arguments.rays.check()?;
    let octree = open(&arguments.file, true)?;
    let (_, view) = arguments.rays.view(&octree)?;
    let header = FileHeader {
        object: 0,
        contours: view.contours(),
        size: [view.width, view.height],
        octree_to_mesh: octree.octree_to_mesh(0).to_cols_array(),
    };
    let progress = Progress::terminal();
    progress.say(format!("writing {}", arguments.output.display()));
    let rays = (0..view.height).flat_map(|y| (0..view.width).map(move |x| view.ray(x, y)));
    let number = view.pixels() as u64;
    write_rays(&arguments.output, &header, number, rays)?;
    progress.finish();
    let bytes = std::fs::metadata(&arguments.output).map_or(0, |m| m.len());
    print(&format!("{}: {}, {}\n", arguments.output.display(), count(number, "ray"), size(bytes)))
}
