//! `esvo build`.

use std::time::Instant;

use esvo_bench::Progress;
use esvo_builder::BuildSettings;

use crate::args::Build;
use crate::fail::{Failure, check_not_input, check_output, complain, print};

pub(crate) fn run(arguments: &Build) -> Result<(), Failure> {
    let settings = settings(arguments)?;
    settings.check()?;
    check_output(&arguments.output)?;
    check_not_input(&arguments.output, &arguments.mesh)?;
    let progress = Progress::terminal();
    progress.say(format!("reading {}", arguments.mesh.display()));
    let mesh = esvo_builder::import::load_mesh(&arguments.mesh)?;
    let start = Instant::now();
    let what = format!("building {} levels", settings.levels);
    let built = esvo_builder::build(&mesh, &settings, &|p| {
        progress.fraction(&what, p.done, &format!("{:.1} M voxels", p.voxels as f64 / 1e6));
    })
    .map_err(|e| format!("{}: {e}", arguments.mesh.display()))?;
    let seconds = start.elapsed().as_secs_f64();
    let mut octree = built.octree;
    let source = arguments.mesh.file_name().unwrap_or_default().to_string_lossy();
    octree.set_meta(
        serde_json::json!({
            "generator": concat!("esvo ", env!("CARGO_PKG_VERSION")),
            "source": source,
            "triangles": mesh.triangle_count(),
            "settings": settings,
        })
        .to_string(),
    );
    progress.say(format!("writing {}", arguments.output.display()));
    octree.write(&arguments.output)?;
    progress.finish();
    for warning in &mesh.warnings {
        complain("warning", warning);
    }
    let stats = esvo_format::stats(&octree);
    print(&format!(
        "{}: {} levels, {} voxels, {:.1} MB, {:.2} bytes per voxel, built in {seconds:.1} s\n",
        arguments.output.display(),
        settings.levels,
        stats.voxels,
        stats.image_bytes as f64 / (1u64 << 20) as f64,
        stats.image_bytes as f64 / stats.voxels.max(1) as f64,
    ))
}

fn settings(arguments: &Build) -> Result<BuildSettings, Failure> {
    let mut settings = BuildSettings::default();
    if let Some(name) = &arguments.paper {
        let manifest = esvo_scenes::SceneManifest::builtin()?;
        let entry = esvo_bench::scene::entry(&manifest, name)?;
        settings = esvo_bench::scene::settings(entry);
    }
    settings.levels = arguments.levels;
    settings.contours = !arguments.no_contours;
    settings.colors = !arguments.no_colors;
    settings.normals = !arguments.no_normals;
    settings.contour_error = arguments.contour_error.unwrap_or(settings.contour_error);
    settings.color_error = arguments.color_error.unwrap_or(settings.color_error);
    settings.normal_error = arguments.normal_error.unwrap_or(settings.normal_error);
    Ok(settings)
}
