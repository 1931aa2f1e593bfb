//! `esvo build`.

pub(crate) mod displacement;

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{Args, ValueEnum};
use esvo_bench::build_summary::{BuildSeconds, BuildSummary};
use esvo_bench::scene::SceneSource;
use esvo_bench::system::peak_bytes;
use esvo_bench::{Progress, scene};
use esvo_builder::import::{ImportError, load_mesh};
use esvo_builder::{BuildError, BuildSettings, FileOptions, Mesh};
use esvo_format::WriteOptions;
use esvo_scenes::{SceneEntry, SceneManifest};

use crate::commands::build::displacement::Displacement;
use crate::fail::{Failure, complain, print};
use crate::files::{check_extension, check_not_input, check_output, extension, name_file};
use crate::values::parse_gigabytes;
use crate::words::{count, size};

/// Build an octree from a mesh (.obj, .gltf, .glb, .ply, .stl).
#[derive(Debug, Args)]
#[command(after_help = "\
A voxel is divided until its shape, colour and normal are within the three allowed errors (--contour-error, --color-error,
--normal-error), or to the deepest level. The default numbers are those of the paper's authors.

Examples:
  esvo build conference.obj -o conference.esvo --levels 12 --paper conference
  esvo build scan.ply -o scan.esvo --levels 10 --no-contours
  esvo build sibenik.obj -o sibenik-d.esvo --levels 11 --displace 0.05
  esvo build --scene hairball -o hairball.esvo --levels 10 --json")]
pub(crate) struct BuildArguments {
    /// The mesh file
    #[arg(required_unless_present = "scene", conflicts_with = "scene")]
    pub(crate) mesh: Option<PathBuf>,
    /// The file to write
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// Deepest level, 1 to 23: the finest voxels have 2^-N of the edge of the root cube
    #[arg(short, long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=23))]
    pub(crate) levels: u32,
    /// Build without contours: divide all geometry down to the deepest level
    #[arg(long)]
    pub(crate) no_contours: bool,
    /// Allowed error of the shape: the diagonal of a voxel at this level [default: 15]
    #[arg(long, value_name = "LEVEL", conflicts_with = "no_contours")]
    pub(crate) contour_error: Option<f64>,
    /// Allowed error of a colour channel in steps of 1/256 [default: 16]
    #[arg(long, value_name = "STEPS", conflicts_with = "no_colors")]
    pub(crate) color_error: Option<f64>,
    /// Allowed error of a component of the unit normal [default: 0.01]
    #[arg(long, value_name = "X", conflicts_with = "no_normals")]
    pub(crate) normal_error: Option<f64>,
    /// What colours and normals are compared with: one sample for each triangle in a voxel, or all texels. Neither is exactly the
    /// authors' test, which compares with the least and greatest of all texels, vertex colours and normals after decoding the
    /// stored block
    #[arg(long, value_name = "TEST")]
    pub(crate) texture_test: Option<TextureTest>,
    /// Use a preset of the errors above; options given next to it take precedence
    #[arg(long, value_name = "NAME", conflicts_with = "paper")]
    pub(crate) preset: Option<Preset>,
    /// Use the paper's settings for one of its scenes; options given next to it take precedence
    #[arg(long, value_name = "SCENE")]
    pub(crate) paper: Option<String>,
    /// Store no colours
    #[arg(long)]
    pub(crate) no_colors: bool,
    /// Store no normals
    #[arg(long)]
    pub(crate) no_normals: bool,
    #[command(flatten)]
    pub(crate) displacement: Displacement,
    /// Keep finished parts in OUTPUT.part, and continue from there if an earlier build of the same octree was interrupted. Parts of
    /// another build are kept and refused
    #[arg(long)]
    pub(crate) resume: bool,
    /// Memory limit in GB (10^9 bytes); with little memory, fewer threads work at once
    #[arg(long, value_name = "GB", value_parser = parse_gigabytes)]
    pub(crate) memory_limit: Option<f64>,
    /// Compress blocks with Zstandard at this level, 1 to 22 [without a number: 3]
    #[arg(long, value_name = "LEVEL", num_args = 0..=1, default_missing_value = "3", value_parser = clap::value_parser!(i32).range(1..=22))]
    pub(crate) compress: Option<i32>,
    /// Store colours and normals uncompressed, 4 bytes each
    #[arg(long)]
    pub(crate) plain_attributes: bool,
    /// Build this scene of the manifest with the paper's settings: its real mesh if it is found, otherwise its procedural
    /// stand-in; SIBENIK-D is displaced
    #[arg(long, value_name = "NAME")]
    pub(crate) scene: Option<String>,
    /// Build the scene's procedural stand-in, even if the real mesh is found
    #[arg(long, requires = "scene", conflicts_with = "scenes_dir")]
    pub(crate) stand_in: bool,
    /// Folder that is searched first for real meshes; then $ESVO_SCENES, then ../shared/scenes
    #[arg(long, value_name = "FOLDER", requires = "scene")]
    pub(crate) scenes_dir: Option<PathBuf>,
    /// Read the scene from this manifest of your own instead of the paper's: see scenes/README.md
    #[arg(long, value_name = "FILE", requires = "scene", conflicts_with = "scenes_dir")]
    pub(crate) manifest: Option<PathBuf>,
    /// Print time, memory and the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

/// The presets of [`esvo_builder::Preset`]. Help lists shape (level), colour (steps) and normal error.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Preset {
    /// Quick and coarse: contour error 12, colour error 32, normal error 0.1
    Fast,
    /// The authors' default numbers: 15, 16, 0.01
    Balanced,
    /// Small files: 13, 64, 0.25
    Small,
    /// Textures as fine as the deepest level can show: 16, 8, 0.01, --texture-test texels
    Fine,
}

impl From<Preset> for esvo_builder::Preset {
    fn from(preset: Preset) -> Self {
        match preset {
            Preset::Fast => Self::Fast,
            Preset::Balanced => Self::Balanced,
            Preset::Small => Self::Small,
            Preset::Fine => Self::Fine,
        }
    }
}

/// The tests of [`esvo_builder::TextureTest`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum TextureTest {
    /// One colour and normal for each triangle in a voxel
    Samples,
    /// All texels
    Texels,
}

impl From<TextureTest> for esvo_builder::TextureTest {
    fn from(test: TextureTest) -> Self {
        match test {
            TextureTest::Samples => Self::Samples,
            TextureTest::Texels => Self::Texels,
        }
    }
}

pub(crate) fn run_build(arguments: &BuildArguments) -> Result<(), Failure> {
    let manifest = scene::manifest(None)?;
    let own = arguments.manifest.as_deref().map(|file| scene::manifest(Some(file))).transpose()?;
    let scene =
        arguments.scene.as_ref().map(|name| scene::buildable(own.as_ref().unwrap_or(&manifest), name)).transpose()?;
    let settings = settings(arguments, &manifest, scene)?;
    settings.check()?;
    check_output(&arguments.output)?;
    match extension(&arguments.output).as_str() {
        "oct" => check_extension(
            &arguments.output,
            "esvo",
            "octrees are built as .esvo; esvo convert makes .oct files from them",
        )?,
        _ => check_extension(&arguments.output, "esvo", "octrees are written as .esvo")?,
    }
    if let Some(mesh) = &arguments.mesh {
        check_not_input(&arguments.output, mesh)?;
    }
    let progress = Progress::terminal();
    // Hashing the file is no part of the time of the import.
    let found = scene.map(|scene| found(arguments, scene)).transpose()?;
    let start = Instant::now();
    let (mesh, source) = mesh(arguments, found.as_ref(), &progress)?;
    let mesh =
        arguments.displacement.apply(mesh, &source, settings.levels, scene.is_some_and(|scene| scene.displaced))?;
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
        if p.resumed > 0 {
            let parts =
                format!("{}.part, which holds {}", arguments.output.display(), count(p.resumed, "finished voxel"));
            complain("note", &format!("going on from {parts}"));
        }
        progress.fraction(&what, p.done, &format!("{:.1} M voxels", p.voxels as f64 / 1e6));
    })
    .map_err(|e| match e {
        BuildError::Format(e) => name_file(&arguments.output, e),
        BuildError::Io { .. } | BuildError::Busy(_) | BuildError::OtherWork(_) | BuildError::Part { .. } => {
            e.to_string()
        }
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

/// Where the mesh of a scene comes from. Warns if it is another mesh than the one that the manifest lists.
fn found<'a>(arguments: &BuildArguments, scene: &'a SceneEntry) -> Result<SceneSource<'a>, Failure> {
    let source = SceneSource::find(scene, arguments.scenes_dir.as_deref(), arguments.stand_in)?;
    if let Some(other) = source.other() {
        let what = "not the mesh that the manifest lists, so its octree is not comparable with those of others";
        complain("warning", &format!("--scene {}: {other}: {what}", scene.name));
    }
    Ok(source)
}

/// The mesh and its name.
fn mesh(
    arguments: &BuildArguments,
    scene: Option<&SceneSource>,
    progress: &Progress,
) -> Result<(Mesh, String), Failure> {
    if let Some(path) = &arguments.mesh {
        progress.say(format!("reading {}", path.display()));
        let mesh = load_mesh(path).map_err(|e| explain(path, &e))?;
        return Ok((mesh, path.file_name().unwrap_or_default().to_string_lossy().into_owned()));
    }
    // clap requires one of the two.
    let scene = scene.ok_or("neither a mesh nor a scene is given")?;
    let source = scene.source();
    progress.say(format!("reading {source}"));
    Ok((scene.load()?, source))
}

/// The error of the importer; it also says what to do if the file is an octree already.
fn explain(path: &Path, error: &ImportError) -> String {
    match error {
        ImportError::UnknownKind { .. } if matches!(extension(path).as_str(), "esvo" | "oct") => {
            format!("{}: is an octree already; octrees are built from meshes", path.display())
        }
        _ => error.to_string(),
    }
}

fn settings(
    arguments: &BuildArguments,
    manifest: &SceneManifest,
    scene: Option<&SceneEntry>,
) -> Result<BuildSettings, Failure> {
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
