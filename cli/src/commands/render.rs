//! `esvo render`.

use std::path::PathBuf;
use std::sync::Arc;

use clap::{Args, ValueEnum};
use esvo_bench::Progress;
use esvo_core::camera::viewpoint;
use esvo_core::picture::write_png;
use esvo_core::{Hit, shading};
use esvo_engines::{EngineId, InstructionSet, OpenOptions};
use glam::DVec3;

use crate::fail::{Failure, complain, print};
use crate::files::{check_extension, check_not_input, check_output, name_file, open};
use crate::memory::check_memory;
use crate::values::engine;
use crate::view::ViewArguments;

/// Iterations that `--view-mode iterations` shows as white: about the number that grazing rays take at 12 levels.
const MOST_ITERATIONS: u32 = 100;

/// Render a picture of an octree.
#[derive(Debug, Args)]
#[command(after_help = "\
Without a camera, the picture shows the whole object from outside. Cameras are in the units of the
mesh.

Examples:
  esvo render sibenik.esvo -o nave.png --scene sibenik --view 2
  esvo render sibenik.esvo -o nave.png --camera=-15,-9,0,1,0.2,0 --fov 60 --size 1920x1080
  esvo render sibenik.esvo -o steps.png --view-mode iterations --backend reference")]
pub(crate) struct RenderArguments {
    /// The octree
    pub(crate) file: PathBuf,
    /// The PNG to write
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// The engine that casts the rays
    #[arg(short, long, value_parser = engine(), default_value_t = EngineId::Cpu)]
    pub(crate) backend: EngineId,
    #[command(flatten)]
    pub(crate) rays: ViewArguments,
    /// Use the beam optimization
    #[arg(long)]
    pub(crate) beam: bool,
    /// What to show
    #[arg(long, value_enum, default_value_t = ViewMode::Shaded)]
    pub(crate) view_mode: ViewMode,
    /// Do not compare the checksums of the blocks: for a file that was verified before, e.g. by `esvo validate`. Only what
    /// the picture needs is then read from an uncompressed file
    #[arg(long)]
    pub(crate) no_verify: bool,
}

/// What a picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ViewMode {
    /// Colours and normals of the voxels, lit by a lamp at the camera
    Shaded,
    /// Iterations of each ray: black, violet, red, yellow; white from 100
    Iterations,
    /// Normals of the voxels as colours
    Normals,
    /// Near is white, far is black
    Depth,
}

pub(crate) fn run_render(arguments: &RenderArguments) -> Result<(), Failure> {
    check_output(&arguments.output)?;
    check_extension(&arguments.output, "png", "pictures are written as PNG")?;
    check_not_input(&arguments.output, &arguments.file)?;
    arguments.rays.check()?;
    let octree = Arc::new(open(&arguments.file, !arguments.no_verify)?);
    let (camera, view) = arguments.rays.view(&octree, arguments.beam)?;
    let progress = Progress::terminal();
    progress.say("rendering");
    // Packets of rays have one number of iterations.
    let instructions = (arguments.view_mode == ViewMode::Iterations).then_some(InstructionSet::Scalar);
    let mut caster = arguments.backend.open(&OpenOptions { instructions, ..OpenOptions::default() })?;
    caster.load(&octree).map_err(|e| name_file(&arguments.file, e))?;
    // Hits, the picture and its encoded form.
    let bytes = view.pixels().saturating_mul(size_of::<Hit>() + 3 * 2);
    check_memory(bytes, &format!("--size {}x{}", view.width, view.height))?;
    let mut hits = Vec::with_capacity(view.pixels());
    caster.cast(&view, &mut hits)?;
    let picture = match arguments.view_mode {
        ViewMode::Shaded => shading::shade(&octree, &view, &hits),
        ViewMode::Iterations => shading::iteration_map(&view, &hits, MOST_ITERATIONS),
        ViewMode::Normals => shading::normal_map(&octree, &view, &hits),
        ViewMode::Depth => shading::depth_map(&view, &hits),
    };
    write_png(&arguments.output, &picture).map_err(|e| format!("{}: {e}", arguments.output.display()))?;
    progress.finish();
    let hit = hits.iter().filter(|h| !h.is_miss()).count();
    if octree.objects().len() > 1 {
        let others = octree.objects().len() - 1;
        complain("warning", &format!("only object 0 is drawn; {} has {others} more", arguments.file.display()));
    }
    if hit == 0 {
        let (low, high) = viewpoint::bounds(&octree);
        let place = [low, high].map(|p| octree.octree_to_mesh(0).transform_point3(p));
        let what = format!(
            "no ray hits anything: the object lies between {:.4} and {:.4}; the camera is at {:.4} and looks along {:.4}",
            place[0],
            place[1],
            DVec3::from(camera.eye),
            DVec3::from(camera.forward)
        );
        complain("warning", &what);
    }
    print(&format!(
        "{}: {}x{}, {:.1} % of the pixels hit, cast by {} on {}\n",
        arguments.output.display(),
        view.width,
        view.height,
        100.0 * hit as f64 / hits.len() as f64,
        caster.name(),
        caster.device().name
    ))
}
