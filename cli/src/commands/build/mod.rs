//! `esvo build`.

pub(crate) mod displacement;

use std::path::Path;
use std::time::Instant;

use esvo_bench::build_summary::{BuildSeconds, BuildSummary, peak_bytes};
use esvo_bench::{Progress, scene};
use esvo_builder::import::{ImportError, load_mesh};
use esvo_builder::{BuildError, BuildSettings, FileOptions, Mesh};
use esvo_format::WriteOptions;
use esvo_scenes::{SceneEntry, SceneManifest};

use crate::args::Build;
use crate::fail::{Failure, check_extension, check_not_input, check_output, complain, extension, name_file, print};
use crate::words::{count, size};

pub(crate) fn run(arguments: &Build) -> Result<(), Failure> {
    let manifest = SceneManifest::builtin()?;
    let scene = arguments.scene.as_ref().map(|name| scene::buildable(&manifest, name)).transpose()?;
    let settings = settings(arguments, &manifest, scene)?;
    settings.check()?;
    check_output(&arguments.output)?;
    match extension(&arguments.output).as_str() {
        "oct" => {
            check_extension(&arguments.output, "esvo", "builds are written as .esvo; esvo convert makes .oct of them")?
        }
        _ => check_extension(&arguments.output, "esvo", "octrees are written as .esvo")?,
    }
    if let Some(mesh) = &arguments.mesh {
        check_not_input(&arguments.output, mesh)?;
    }
    let progress = Progress::terminal();
    let start = Instant::now();
    let (mesh, source) = mesh(arguments, scene, &progress)?;
    let mesh = arguments.displacement.apply(mesh, &source, settings.levels, scene.is_some_and(scene::is_displaced))?;
    let import = start.elapsed().as_secs_f64();
    let import_peak_bytes = peak_bytes();
    let start = Instant::now();
    let what = format!("building {}", count(settings.levels, "level"));
    let options = FileOptions {
        write: WriteOptions { compress: arguments.compress },
        meta: serde_json::json!({
            "generator": concat!("esvo ", env!("CARGO_PKG_VERSION")),
            "source": source,
            "triangles": mesh.triangle_count(),
            "settings": settings,
        })
        .to_string(),
        resume: arguments.resume,
        memory_limit: arguments.memory_limit.map(|gigabytes| (gigabytes * 1e9) as u64),
    };
    let built = esvo_builder::build_file(&mesh, &settings, &arguments.output, &options, &|p| {
        progress.fraction(&what, p.done, &format!("{:.1} M voxels", p.voxels as f64 / 1e6));
    })
    .map_err(|e| match e {
        BuildError::Format(e) => name_file(&arguments.output, e),
        BuildError::Io { .. } | BuildError::Busy(_) => e.to_string(),
        _ => format!("{source}: {e}"),
    })?;
    let build = start.elapsed().as_secs_f64();
    let peaks = (import_peak_bytes, peak_bytes());
    progress.finish();
    for warning in &mesh.warnings {
        complain("warning", warning);
    }
    let written = esvo_format::Octree::open(&arguments.output).map_err(|e| name_file(&arguments.output, e))?;
    let stats = esvo_format::stats(&written);
    let seconds = BuildSeconds {
        import,
        build,
        prepare: built.stats.prepare.as_secs_f64(),
        voxelize: built.stats.voxelize.as_secs_f64(),
        write: built.stats.assemble.as_secs_f64(),
    };
    let summary = BuildSummary::new(&source, &arguments.output, &mesh, &settings, seconds, peaks, &stats);
    if arguments.json {
        return print(&format!("{}\n", serde_json::to_string_pretty(&summary)?));
    }
    print(&format!(
        "{}: {}, {}, {}, {:.2} bytes per voxel, built in {build:.1} s\n",
        arguments.output.display(),
        count(settings.levels, "level"),
        count(stats.voxels, "voxel"),
        size(stats.image_bytes),
        stats.image_bytes as f64 / stats.voxels.max(1) as f64,
    ))
}

/// The mesh, and what to call it.
fn mesh(arguments: &Build, scene: Option<&SceneEntry>, progress: &Progress) -> Result<(Mesh, String), Failure> {
    if let Some(path) = &arguments.mesh {
        progress.say(format!("reading {}", path.display()));
        let mesh = load_mesh(path).map_err(|e| explain(path, &e))?;
        return Ok((mesh, path.file_name().unwrap_or_default().to_string_lossy().into_owned()));
    }
    // The command line wants one of the two.
    let entry = scene.ok_or("neither a mesh nor a scene is given")?;
    progress.say(format!("reading {}", entry.name));
    let (mesh, source) = scene::mesh(entry, arguments.scenes_dir.as_deref(), arguments.stand_in)?;
    Ok((mesh, source))
}

/// What went wrong with a mesh, and what to do where the importer cannot know it.
fn explain(path: &Path, error: &ImportError) -> String {
    match error {
        ImportError::UnknownKind { .. } if matches!(extension(path).as_str(), "esvo" | "oct") => {
            format!("{}: is an octree already; octrees are built of meshes", path.display())
        }
        _ => error.to_string(),
    }
}

fn settings(arguments: &Build, manifest: &SceneManifest, scene: Option<&SceneEntry>) -> Result<BuildSettings, Failure> {
    let named = arguments.paper.as_ref().map(|name| scene::buildable(manifest, name)).transpose()?;
    let preset = arguments.preset.map(|preset| BuildSettings::preset(preset.into()));
    let mut settings = preset.or_else(|| named.or(scene).map(scene::settings)).unwrap_or_default();
    settings.levels = arguments.levels;
    settings.contours = !arguments.no_contours;
    settings.colors = !arguments.no_colors;
    settings.normals = !arguments.no_normals;
    settings.plain_attributes = arguments.plain_attributes;
    settings.contour_error = arguments.contour_error.unwrap_or(settings.contour_error);
    settings.color_error = arguments.color_error.unwrap_or(settings.color_error);
    settings.normal_error = arguments.normal_error.unwrap_or(settings.normal_error);
    settings.texture_test = arguments.texture_test.map_or(settings.texture_test, Into::into);
    Ok(settings)
}
