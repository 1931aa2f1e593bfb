//! `esvo render`.

mod draw;
mod look;

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use esvo_bench::Progress;
use esvo_core::camera::viewpoint;
use esvo_core::lights::Light;
use esvo_core::picture::write_png;
use esvo_core::{Camera, Hit};
use esvo_engines::EngineId;
use esvo_format::Octree;
use glam::DVec3;

use crate::fail::{Failure, complain, print};
use crate::files::{check_extension, check_not_input, check_output, name_file, open};
use crate::memory::check_memory;
use crate::values::{engine, parse_light};
use crate::view::ViewArguments;
use draw::{Lighting, draw};
use look::{Filter, Look, ViewMode};

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

pub(crate) fn run_render(arguments: &RenderArguments) -> Result<(), Failure> {
    check_output(&arguments.output)?;
    check_extension(&arguments.output, "png", "pictures are written as PNG")?;
    check_not_input(&arguments.output, &arguments.file)?;
    arguments.rays.check()?;
    if !arguments.lights.is_empty() && arguments.view_mode != ViewMode::Shaded {
        return Err("--light: only shaded pictures are lit; leave out --view-mode".to_owned().into());
    }
    let octree = Arc::new(open(&arguments.file, !arguments.no_verify)?);
    let look = arguments.look();
    let camera = arguments.rays.camera(&octree)?;
    let views = arguments.rays.views(&camera, &octree, look.contours, look.beam)?;
    let view = views[0];
    let progress = Progress::terminal();
    progress.say("rendering");
    let mut caster = look.engine.open(&look.open_options())?;
    caster.load(&octree).map_err(|e| name_file(&arguments.file, e))?;
    // Nearest hits, those of an object, whose they are; the picture, with its radii, with margins, filtered, and its encoded form.
    let bytes = view.pixels().saturating_mul(2 * size_of::<Hit>() + 4 + 3 * 3 + 4 + 8);
    check_memory(bytes, &format!("--size {}x{}", view.width, view.height))?;
    let lighting = Lighting { lights: &arguments.lights, shadows: !arguments.no_shadows };
    let drawn = draw(&mut *caster, &octree, &views, &look, &lighting, arguments.times)?;
    write_png(&arguments.output, &drawn.picture).map_err(|e| format!("{}: {e}", arguments.output.display()))?;
    progress.finish();
    if drawn.hit == 0 {
        warn_of_nothing(&octree, &camera);
    }
    print(&format!(
        "{}: {}x{}, {:.1} % of the pixels hit, cast by {} on {}\n",
        arguments.output.display(),
        view.width,
        view.height,
        100.0 * drawn.hit as f64 / view.pixels() as f64,
        caster.name(),
        caster.device().name
    ))?;
    if arguments.times {
        let [casting, shading, filtering] =
            [drawn.casting, drawn.shading, drawn.filtering].map(|time| time.as_secs_f64() * 1e3);
        print(&format!("casting {casting:.1} ms, shading {shading:.1} ms, filter {filtering:.1} ms\n"))?;
    }
    Ok(())
}

impl RenderArguments {
    /// How the picture is made.
    fn look(&self) -> Look {
        Look {
            engine: self.backend,
            mode: self.view_mode,
            filter: self.filter,
            contours: !self.rays.no_contours,
            beam: self.beam,
        }
    }
}

/// Says that a picture is empty, and where the object is.
fn warn_of_nothing(octree: &Octree, camera: &Camera) {
    let (low, high) = viewpoint::bounds_in_mesh(octree);
    let what = format!(
        "no ray hits anything: the object lies between {:.4} and {:.4}; the camera is at {:.4} and looks along {:.4}",
        low,
        high,
        DVec3::from(camera.eye),
        DVec3::from(camera.forward)
    );
    complain("warning", &what);
}
