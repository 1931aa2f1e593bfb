//! `esvo render`.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use clap::{Args, ValueEnum};
use esvo_bench::Progress;
use esvo_core::camera::viewpoint;
use esvo_core::filter::{Frame, Radius, code_at};
use esvo_core::lights::{self, Light};
use esvo_core::picture::write_png;
use esvo_core::{Hit, Nearest, shading};
use esvo_engines::{EngineId, InstructionSet, OpenOptions};
use glam::DVec3;

use crate::fail::{Failure, complain, print};
use crate::files::{check_extension, check_not_input, check_output, name_file, open};
use crate::memory::check_memory;
use crate::values::{engine, parse_light};
use crate::view::ViewArguments;

/// Iterations that `--view-mode iterations` shows as white, as in the paper's Figure 9.
const MOST_ITERATIONS: u32 = 64;

/// Render a picture of an octree.
#[derive(Debug, Args)]
#[command(after_help = "\
Without a camera, the picture shows the whole object from outside. Cameras are in the units of the
mesh.

Where voxels are larger than a pixel, the picture is blurred by the paper's post-process filter
(section 4.3); --filter off shows the voxels.

Examples:
  esvo render sibenik.esvo -o nave.png --scene sibenik --view 2
  esvo render sibenik.esvo -o nave.png --camera=-15,-9,0,1,0.2,0 --fov 60 --size 1920x1080
  esvo render sibenik.esvo -o sun.png --light sun:1,2,0.5 --light point:0,-12,0
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
    /// Light a shaded picture by this light and not by the lamp at the camera; may be given several times. In the units of the mesh:
    /// sun:X,Y,Z (the direction to it), point:X,Y,Z, or spot:X,Y,Z,DX,DY,DZ,DEGREES (place, axis, full angle of the cone)
    #[arg(long = "light", value_name = "LIGHT", value_parser = parse_light)]
    pub(crate) lights: Vec<Light>,
    /// Lights cast no shadows
    #[arg(long, requires = "lights")]
    pub(crate) no_shadows: bool,
    /// Blur a shaded picture where voxels are larger than a pixel
    #[arg(long, value_enum, default_value_t = Filter::Adapted)]
    pub(crate) filter: Filter,
    /// Print how long casting, shading and filtering take; casts and filters twice and measures the second time
    #[arg(long)]
    pub(crate) times: bool,
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
    /// Iterations of each ray: black, violet, red, yellow; white from 64
    Iterations,
    /// Normals of the voxels as colours
    Normals,
    /// Near is white, far is black
    Depth,
    /// Levels of the voxels: black, violet, red, yellow; white is the deepest
    Levels,
    /// Sizes of the voxels: black is one pixel or less, white 64 pixels
    VoxelSize,
    /// Stored ambient occlusion
    Ambient,
}

/// How far a pixel is blurred.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Filter {
    /// As far as its voxel, but no farther than its neighbours: the paper's filter
    Adapted,
    /// As far as its voxel: seams show where levels change, as on the left of the paper's Figure 10
    Own,
    /// Not at all
    Off,
}

impl Filter {
    fn radius(self) -> Option<Radius> {
        match self {
            Self::Adapted => Some(Radius::Adapted),
            Self::Own => Some(Radius::Own),
            Self::Off => None,
        }
    }
}

pub(crate) fn run_render(arguments: &RenderArguments) -> Result<(), Failure> {
    check_output(&arguments.output)?;
    check_extension(&arguments.output, "png", "pictures are written as PNG")?;
    check_not_input(&arguments.output, &arguments.file)?;
    arguments.rays.check()?;
    if !arguments.lights.is_empty() && arguments.view_mode != ViewMode::Shaded {
        return Err("--light: only shaded pictures are lit; leave out --view-mode".to_owned().into());
    }
    let octree = Arc::new(open(&arguments.file, !arguments.no_verify)?);
    let (camera, views) = arguments.rays.views(&octree, arguments.beam)?;
    let view = views[0];
    let progress = Progress::terminal();
    progress.say("rendering");
    // Packets of rays have one number of iterations.
    let instructions = (arguments.view_mode == ViewMode::Iterations).then_some(InstructionSet::Scalar);
    let mut caster = arguments.backend.open(&OpenOptions { instructions, ..OpenOptions::default() })?;
    caster.load(&octree).map_err(|e| name_file(&arguments.file, e))?;
    // Nearest hits, those of an object, whose they are; the picture, with its radii, with margins, filtered, and its encoded form.
    let bytes = view.pixels().saturating_mul(2 * size_of::<Hit>() + 4 + 3 * 3 + 4 + 8);
    check_memory(bytes, &format!("--size {}x{}", view.width, view.height))?;
    if arguments.times {
        // The first time, kernels are compiled and memory is touched.
        Nearest::cast(&mut *caster, &views)?;
    }
    let start = Instant::now();
    let nearest = Nearest::cast(&mut *caster, &views)?;
    let casting = start.elapsed();
    let hits = &nearest.hits;
    let start = Instant::now();
    let mut picture = match arguments.view_mode {
        ViewMode::Shaded if !arguments.lights.is_empty() => {
            lights::shade_lit(&mut *caster, &octree, &views, &nearest, &arguments.lights, !arguments.no_shadows)?
        }
        ViewMode::Shaded => shading::shade_nearest(&octree, &views, &nearest),
        ViewMode::Iterations => shading::iteration_map(&view, hits, MOST_ITERATIONS),
        ViewMode::Normals => shading::normal_map(&octree, &views, &nearest),
        ViewMode::Depth => shading::depth_map(&view, hits),
        ViewMode::Levels => shading::level_map(&view, hits, octree.needs().levels),
        ViewMode::VoxelSize => shading::size_map(&views, &nearest),
        ViewMode::Ambient => shading::ambient_map(&octree, &view, hits),
    };
    let shading = start.elapsed();
    let mut filtering = Duration::ZERO;
    let radius = arguments.filter.radius().filter(|_| arguments.view_mode == ViewMode::Shaded);
    if let Some(radius) = radius {
        let codes = nearest.views.iter().zip(hits).map(|(view, hit)| code_at(&views[*view as usize], hit));
        let frame = Frame::from_codes(&picture, codes)?;
        // Where no voxel is larger than a pixel, nothing changes.
        if frame.is_filtered() {
            if arguments.times {
                caster.filter(&frame, radius)?;
            }
            let filtered = caster.filter(&frame, radius)?;
            (picture, filtering) = (filtered.picture, filtered.time);
        }
    }
    write_png(&arguments.output, &picture).map_err(|e| format!("{}: {e}", arguments.output.display()))?;
    progress.finish();
    let hit = hits.iter().filter(|h| !h.is_miss()).count();
    if hit == 0 {
        let (low, high) = viewpoint::bounds_in_mesh(&octree);
        let what = format!(
            "no ray hits anything: the object lies between {:.4} and {:.4}; the camera is at {:.4} and looks along {:.4}",
            low,
            high,
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
    ))?;
    if arguments.times {
        let ms = |time: Duration| time.as_secs_f64() * 1e3;
        let (casting, shading, filtering) = (ms(casting), ms(shading), ms(filtering));
        print(&format!("casting {casting:.1} ms, shading {shading:.1} ms, filter {filtering:.1} ms\n"))?;
    }
    Ok(())
}
