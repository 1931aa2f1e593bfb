//! `esvo render`.

use std::path::PathBuf;
use std::sync::Arc;

use clap::{Args, ValueEnum};
use esvo_bench::scene::SceneSource;
use esvo_bench::{Progress, scene};
use esvo_core::camera::viewpoint;
use esvo_core::picture::write_png;
use esvo_core::{Camera, CastOptions, View, shading};
use esvo_engines::{EngineId, OpenOptions};
use esvo_format::Octree;
use esvo_scenes::SceneVariant;
use glam::DVec3;

use crate::fail::{Failure, complain, print};
use crate::files::{check_extension, check_not_input, check_output, name_file, open};
use crate::values::{engine, parse_numbers, parse_size};

/// Iterations that `--view-mode iterations` shows as white: about the number that grazing rays take at 12 levels.
const MOST_ITERATIONS: u32 = 100;

/// Render a picture of an octree.
#[derive(Debug, Args)]
#[command(after_help = "\
Without a camera, the picture shows the whole object from outside. Cameras are in the units of the mesh.

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
    /// Eye and viewing direction: ex,ey,ez,fx,fy,fz, optionally followed by the field of view in degrees
    #[arg(long, value_name = "NUMBERS", allow_hyphen_values = true, conflicts_with = "scene")]
    pub(crate) camera: Option<String>,
    /// The direction that is up in the picture
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, default_value = "0,1,0")]
    pub(crate) up: String,
    /// Field of view over the shorter side in degrees [default: 60]
    #[arg(long, value_name = "DEGREES")]
    pub(crate) fov: Option<f64>,
    /// Take the camera from the manifest of this scene
    #[arg(long, value_name = "NAME")]
    pub(crate) scene: Option<String>,
    /// Number of the camera in the manifest, from 1
    #[arg(long, value_name = "K", default_value_t = 1, requires = "scene")]
    pub(crate) view: usize,
    /// Take the cameras of the scene's procedural stand-in even if the real mesh is found
    #[arg(long, requires = "scene")]
    pub(crate) stand_in: bool,
    /// Folder that is searched first for the real mesh; its cameras are taken if it is found
    #[arg(long, value_name = "FOLDER", requires = "scene")]
    pub(crate) scenes_dir: Option<PathBuf>,
    /// Size of the picture
    #[arg(long, value_name = "WxH", default_value = "1024x768", value_parser = parse_size)]
    pub(crate) size: [u32; 2],
    /// Ignore contours: draw voxels as cubes
    #[arg(long)]
    pub(crate) no_contours: bool,
    /// Use the beam optimization
    #[arg(long)]
    pub(crate) beam: bool,
    /// Rays end at voxels of this size in pixels; 0: at leaves only
    #[arg(long, value_name = "PIXELS", default_value_t = 1.0)]
    pub(crate) max_voxel_pixels: f32,
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
    if !(arguments.max_voxel_pixels >= 0.0 && arguments.max_voxel_pixels.is_finite()) {
        return Err(
            format!("--max-voxel-pixels {}: expected 0 or a positive number", arguments.max_voxel_pixels).into()
        );
    }
    let octree = Arc::new(open(&arguments.file, !arguments.no_verify)?);
    let camera = camera(arguments, &octree)?;
    let options = CastOptions {
        contours: !arguments.no_contours,
        beam: arguments.beam,
        max_voxel_pixels: arguments.max_voxel_pixels,
    };
    let root = octree.objects()[0].root_slot as u32;
    let view = View::new(&camera, octree.octree_to_mesh(0), root, arguments.size.into(), &options)?;
    let progress = Progress::terminal();
    progress.say("rendering");
    let mut caster = arguments.backend.open(&OpenOptions::default())?;
    caster.load(&octree).map_err(|e| name_file(&arguments.file, e))?;
    let mut hits = Vec::new();
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

fn camera(arguments: &RenderArguments, octree: &Octree) -> Result<Camera, Failure> {
    let up: [f64; 3] = parse_numbers(&arguments.up)
        .and_then(|n| n.try_into().ok())
        .ok_or_else(|| format!("--up {}: expected three numbers, e.g. 0,1,0", arguments.up))?;
    if up == [0.0; 3] {
        return Err(format!("--up {}: is not a direction; expected one, e.g. 0,1,0", arguments.up).into());
    }
    let wide = |option: String, degrees: f64| -> Result<f64, Failure> {
        let fits = degrees > 0.0 && degrees < 180.0;
        if fits {
            Ok(degrees)
        } else {
            Err(format!("{option}: the field of view must be between 0 and 180 degrees").into())
        }
    };
    let fov = arguments.fov.map(|degrees| wide(format!("--fov {degrees}"), degrees)).transpose()?;
    if let Some(text) = &arguments.camera {
        let n = parse_numbers(text).filter(|n| n.len() == 6 || n.len() == 7).ok_or_else(|| {
            format!(
                "--camera {text}: expected six numbers, eye and direction, or seven with the field of view: ex,ey,ez,fx,fy,fz,60"
            )
        })?;
        let (eye, forward) = ([n[0], n[1], n[2]], [n[3], n[4], n[5]]);
        let own = n.get(6).map(|degrees| wide(format!("--camera {text}"), *degrees)).transpose()?;
        let Some(direction) = DVec3::from(forward).try_normalize() else {
            return Err(format!("--camera {text}: the direction (fourth to sixth number) is zero").into());
        };
        if DVec3::from(up).normalize_or_zero().cross(direction).length() < 1e-9 {
            let what = "is parallel to the viewing direction; give another direction, e.g. --up 0,0,1";
            return Err(format!("--up {}: {what}", arguments.up).into());
        }
        let (near, far) = viewpoint::planes(octree, eye);
        if !far.is_finite() {
            return Err(format!("--camera {text}: the eye is too far away").into());
        }
        return Ok(Camera { eye, forward, up, fov_degrees: fov.or(own).unwrap_or(60.0), near, far });
    }
    let Some(name) = &arguments.scene else {
        let [width, height] = arguments.size.map(f64::from);
        return Ok(viewpoint::overview(octree, up, fov.unwrap_or(60.0), width / height));
    };
    let manifest = esvo_scenes::SceneManifest::builtin()?;
    let entry = scene::buildable(&manifest, name)?;
    let source = SceneSource::find(entry, arguments.scenes_dir.as_deref(), arguments.stand_in)?;
    let views = source.views();
    let index = arguments.view.wrapping_sub(1);
    let view =
        views.get(index).ok_or_else(|| format!("--view {}: {name} has views 1 to {}", arguments.view, views.len()))?;
    match (source.variant(), source.other()) {
        (_, Some(other)) => {
            let what = "not the mesh that the manifest lists; the viewpoints are those of the listed one";
            complain("warning", &format!("--scene {name}: {other}: {what}"));
        }
        (SceneVariant::StandIn, None) if !arguments.stand_in => {
            let what = "its mesh was not found, so this is a viewpoint of its stand-in; give the mesh's folder by --scenes-dir";
            complain("warning", &format!("--scene {name}: {what}"));
        }
        _ => {}
    }
    let mut camera = view.camera;
    camera.fov_degrees = fov.unwrap_or(camera.fov_degrees);
    Ok(camera)
}
