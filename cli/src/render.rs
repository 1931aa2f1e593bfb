//! `esvo render`.

use std::sync::Arc;

use esvo_bench::picture::write_png;
use esvo_bench::{Backend, Progress, scene, viewpoint};
use esvo_core::{Camera, CastOptions, View, shading};
use esvo_format::Octree;
use esvo_scenes::SceneVariant;

use crate::args::{Render, ViewMode};
use crate::fail::{Failure, check_not_input, check_output, complain, name_file, print};

/// Iterations that `--view-mode iterations` shows as white: about what grazing rays take at 12 levels.
const MOST_ITERATIONS: u32 = 100;

pub(crate) fn run(arguments: &Render) -> Result<(), Failure> {
    check_output(&arguments.output)?;
    check_not_input(&arguments.output, &arguments.file)?;
    let octree = Arc::new(Octree::open(&arguments.file).map_err(|e| name_file(&arguments.file, e))?);
    octree.sound().map_err(|e| name_file(&arguments.file, e))?;
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
    let mut caster = Backend::from(arguments.backend).open(None)?;
    caster.load(&octree)?;
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
    let covered = hits.iter().filter(|h| !h.is_miss()).count() as f64 / hits.len() as f64;
    print(&format!(
        "{}: {}x{}, {:.1} % of the pixels hit, cast by {} on {}\n",
        arguments.output.display(),
        view.width,
        view.height,
        100.0 * covered,
        caster.name(),
        caster.device().name
    ))
}

fn camera(arguments: &Render, octree: &Octree) -> Result<Camera, Failure> {
    let up: [f64; 3] = numbers(&arguments.up)
        .and_then(|n| n.try_into().ok())
        .ok_or_else(|| format!("--up {}: three numbers, as 0,1,0", arguments.up))?;
    let fov = arguments.fov.unwrap_or(60.0);
    if let Some(text) = &arguments.camera {
        let n = numbers(text).filter(|n| n.len() == 6 || n.len() == 7).ok_or_else(|| {
            format!(
                "--camera {text}: six numbers, eye and direction, or seven with the field of view: ex,ey,ez,fx,fy,fz,60"
            )
        })?;
        let eye = [n[0], n[1], n[2]];
        let (near, far) = viewpoint::planes(octree, eye);
        let fov_degrees = arguments.fov.or(n.get(6).copied()).unwrap_or(60.0);
        return Ok(Camera { eye, forward: [n[3], n[4], n[5]], up, fov_degrees, near, far });
    }
    let Some(name) = &arguments.scene else {
        if !(fov > 0.0 && fov < 180.0) {
            return Err(format!("--fov {fov}: between 0 and 180 degrees").into());
        }
        return Ok(viewpoint::overview(octree, up, fov));
    };
    let manifest = esvo_scenes::SceneManifest::builtin()?;
    let entry = scene::entry(&manifest, name)?;
    let (variant, views) = scene::cameras(entry, arguments.scenes_dir.as_deref(), arguments.stand_in)?;
    let index = arguments.view.wrapping_sub(1);
    let view =
        views.get(index).ok_or_else(|| format!("--view {}: {name} has views 1 to {}", arguments.view, views.len()))?;
    if variant == SceneVariant::StandIn && !arguments.stand_in {
        let what = "its mesh is not here, so this is a viewpoint of its stand-in; --scenes-dir says where the mesh is";
        complain("warning", &format!("--scene {name}: {what}"));
    }
    let mut camera = view.camera;
    camera.fov_degrees = arguments.fov.unwrap_or(camera.fov_degrees);
    Ok(camera)
}

fn numbers(text: &str) -> Option<Vec<f64>> {
    text.split(',').map(|s| s.trim().parse::<f64>().ok().filter(|x| x.is_finite())).collect()
}
