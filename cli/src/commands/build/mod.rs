//! `esvo build`.

mod describe;
pub(crate) mod displacement;
pub(crate) mod input;
mod part;
mod voxelizer;

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{Args, ValueEnum};
use esvo_bench::build_summary::{BuildSeconds, BuildSummary};
use esvo_bench::scene::SceneSource;
use esvo_bench::system::peak_bytes;
use esvo_bench::{Progress, scene};
use esvo_builder::{
    BuildError, BuildSettings, ComponentSettings, FileOptions, build_displaced_file, build_file, build_voxels_file,
    import,
};
use esvo_format::{FormatError, Stats, StreamReader, WriteOptions, stream_stats};
use esvo_scenes::{SceneEntry, SceneManifest};

use crate::commands::build::displacement::Displacement;
use crate::commands::build::input::{Input, is_standard_input, read_input};
use crate::commands::build::voxelizer::VoxelizerName;
use crate::fail::{Failure, complain, print};
use crate::files::{check_extension, check_not_input, check_output, extension, name_file};
use crate::memory::limit;
use crate::space::SpaceArguments;
use crate::values::parse_gigabytes;
use crate::words::{count, size};

/// Build an octree from a mesh (.obj, .gltf, .glb, .ply, .stl) or a voxel model (.vox).
#[derive(Debug, Args)]
#[command(after_help = "\
A voxel is divided until its shape, colour and normal are within the three allowed errors
(--contour-error, --color-error, --normal-error), or to the deepest level. The defaults are those
of the paper's authors, and so is what they are compared with. Most voxels of a textured scene are
there for its textures: --texture-test centroids leaves them out.

A voxel model of MagicaVoxel does not go through triangles: each of its voxels becomes one voxel
of the octree on the deepest level, which follows from the size of the model. Its z axis points up
(render it with --up 0,0,1).

The file says where it comes from, with which settings it was built, and the name and bounds of the
object. glTF files are in metres, have +y up and are right-handed, voxel models have +z up; of
others, and against these, --unit, --up and --handedness say it. esvo info shows it.

Examples:
  esvo build conference.obj -o conference.esvo --levels 12 --paper conference
  esvo build scan.ply -o scan.esvo --levels 10 --no-contours
  esvo build sibenik.obj -o sibenik-d.esvo --levels 11 --displace 0.05
  esvo build castle.vox -o castle.esvo
  esvo build conference.obj -o c10.esvo --levels 10 --no-contours --voxelizer compute
  zcat bunny.obj.gz | esvo build - --format obj -o bunny.esvo
  esvo build city.obj -o 2.esvopart --levels 15 --part 2/7
  esvo build --scene hairball -o hairball.esvo --levels 10 --json")]
pub(crate) struct BuildArguments {
    /// The mesh or voxel model; - reads it from standard input and needs --format
    #[arg(required_unless_present = "scene", conflicts_with = "scene")]
    pub(crate) mesh: Option<PathBuf>,
    /// The format of the mesh or voxel model [default: by the extension]
    #[arg(long, value_name = "NAME", conflicts_with = "scene")]
    pub(crate) format: Option<Format>,
    /// The file to write
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// Deepest level, 1 to 23: the finest voxels have 2^-N of the edge of the root cube [default: 10; of a voxel model, the level
    /// of its voxels]
    #[arg(short, long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=23))]
    pub(crate) levels: Option<u32>,
    /// Who finds the voxels. A GPU finds those of the deepest level, with --no-contours, up to level 12; their colours and normals are
    /// means over the triangles that meet a voxel
    #[arg(long, value_name = "NAME", default_value = "exact")]
    pub(crate) voxelizer: VoxelizerName,
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
    /// What the decoded colour and normal of a voxel are compared with [default: texels]
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
    /// What to store of the materials where it is not everywhere the default: emission, roughness (with metalness), opacity, material
    /// (its number), all, or none [default: of glTF files emission, roughness and opacity, of others none]
    #[arg(long, value_name = "LIST", value_enum, value_delimiter = ',')]
    pub(crate) components: Vec<Component>,
    #[command(flatten)]
    pub(crate) displacement: Displacement,
    /// Keep finished parts in OUTPUT.part, and continue from there if an earlier build of the same octree was interrupted. Parts of
    /// another build are kept and refused
    #[arg(long)]
    pub(crate) resume: bool,
    /// Memory that the program may hold, in GB (10^9 bytes). With little, fewer threads work at once; what cannot fit is refused, before
    /// anything is read where that is known, and at the limit otherwise
    #[arg(long, value_name = "GB", value_parser = parse_gigabytes)]
    pub(crate) memory_limit: Option<f64>,
    /// Compress blocks with Zstandard at this level, 1 to 22 [without a number: 3]
    #[arg(long, value_name = "LEVEL", num_args = 0..=1, default_missing_value = "3", value_parser = clap::value_parser!(i32).range(1..=22))]
    pub(crate) compress: Option<i32>,
    /// Store the blocks in parts by level, as streams of fields: the smallest files, and a coarse version is read by few
    /// ranges. --compress says how hard their streams are compressed
    #[arg(long)]
    pub(crate) parts: bool,
    /// Largest blocks in slots of 8 bytes for descriptors: 262144 with --parts for a file on a server, so that a picture needs fewer
    /// bytes [default: 1048576]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(64..=1 << 20))]
    pub(crate) block_slots: Option<u32>,
    /// Build part K of N alone: the voxels in some cubes of level 4, which esvo plan lists. The output is an .esvopart; esvo join makes
    /// of all N the file that a build without this option writes, byte for byte
    #[arg(long, value_name = "K/N", value_parser = part::parse_part, conflicts_with_all = ["compress", "parts", "hash"])]
    pub(crate) part: Option<(u32, u32)>,
    /// Write a SHA-256 of the file and an id of its octree, which `esvo validate` compares
    #[arg(long)]
    pub(crate) hash: bool,
    /// Name of the object [default: the name of the mesh without its extension, or of the scene]
    #[arg(long, value_name = "NAME")]
    pub(crate) name: Option<String>,
    #[command(flatten)]
    pub(crate) space: SpaceArguments,
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

/// The deepest level of the octree of a mesh unless --levels gives another.
const DEFAULT_LEVELS: u32 = 10;

/// The formats of [`esvo_builder::import::Format`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Format {
    /// Wavefront OBJ
    Obj,
    /// glTF 2.0 as JSON
    Gltf,
    /// glTF 2.0 in a binary container
    Glb,
    /// PLY
    Ply,
    /// STL
    Stl,
    /// Voxel model of MagicaVoxel
    Vox,
}

impl From<Format> for import::Format {
    fn from(format: Format) -> Self {
        match format {
            Format::Obj => Self::Obj,
            Format::Gltf => Self::Gltf,
            Format::Glb => Self::Glb,
            Format::Ply => Self::Ply,
            Format::Stl => Self::Stl,
            Format::Vox => Self::Vox,
        }
    }
}

/// What of a material can be stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Component {
    /// Emitted light; Ke of OBJ materials
    Emission,
    /// Roughness and metalness; Pr and Pm
    Roughness,
    /// Opacity of materials that blend; d and Tr
    Opacity,
    /// Number of the material in the file, from 1
    Material,
    /// All of them
    All,
    /// None of them
    None,
}

/// The presets of [`esvo_builder::Preset`]. Help lists shape (level), colour (steps) and normal error.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Preset {
    /// Quick and coarse: contour error 12, colour error 32, normal error 0.1, --texture-test centroids
    Fast,
    /// The authors' defaults: 15, 16, 0.01
    Balanced,
    /// Small files: 13, 64, 0.25, --texture-test centroids
    Small,
    /// Shapes and colours twice as exact as the authors' defaults: 16, 8, 0.01
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
    /// The least and greatest of all texels, vertex colours and normals in the voxel: the test of the paper's authors
    Texels,
    /// The same with textures averaged to the finest voxels: detail that no voxel could show refines none
    Averages,
    /// One sample for each triangle in the voxel: the smallest files, with textures as coarse as the shape allows
    Centroids,
}

impl From<TextureTest> for esvo_builder::TextureTest {
    fn from(test: TextureTest) -> Self {
        match test {
            TextureTest::Texels => Self::Texels,
            TextureTest::Averages => Self::Averages,
            TextureTest::Centroids => Self::Centroids,
        }
    }
}

pub(crate) fn run_build(arguments: &BuildArguments) -> Result<(), Failure> {
    let manifest = scene::manifest(None)?;
    let own = arguments.manifest.as_deref().map(|file| scene::manifest(Some(file))).transpose()?;
    let scene =
        arguments.scene.as_ref().map(|name| scene::buildable(own.as_ref().unwrap_or(&manifest), name)).transpose()?;
    let mut settings = settings(arguments, &manifest, scene)?;
    settings.check()?;
    voxelizer::check(arguments)?;
    check_output(&arguments.output)?;
    match extension(&arguments.output).as_str() {
        _ if arguments.part.is_some() => {
            check_extension(&arguments.output, "esvopart", "parts of builds are written as .esvopart")?;
        }
        "oct" => check_extension(
            &arguments.output,
            "esvo",
            "octrees are built as .esvo; esvo convert makes .oct files from them",
        )?,
        _ => check_extension(&arguments.output, "esvo", "octrees are written as .esvo")?,
    }
    if let Some(mesh) = arguments.mesh.as_ref().filter(|mesh| !is_standard_input(mesh)) {
        check_not_input(&arguments.output, mesh)?;
    }
    let progress = Progress::terminal();
    // Hashing the file is no part of the time of the import.
    let found = scene.map(|scene| found(arguments, scene)).transpose()?;
    let start = Instant::now();
    let memory_limit = arguments.memory_limit.map(|gigabytes| (gigabytes * 1e9) as u64);
    if let Some(bytes) = memory_limit {
        limit::set(bytes);
    }
    let (input, source) = input(arguments, found.as_ref(), memory_limit, &progress)?;
    let input = match input {
        Input::Mesh(mesh) => {
            let always = scene.is_some_and(|scene| scene.displaced);
            let whole = arguments.voxelizer != VoxelizerName::Exact;
            arguments.displacement.apply(mesh, &source, settings.levels, always, whole)?
        }
        // Nothing reads such a mesh.
        displaced @ Input::Displaced(..) => displaced,
        Input::Voxels(model) => {
            check_for_voxels(arguments)?;
            settings.levels = model.levels().map_err(|e| format!("{source}: {e}"))?;
            settings.contours = false;
            Input::Voxels(model)
        }
    };
    let import = start.elapsed().as_secs_f64();
    if let Input::Mesh(mesh) | Input::Displaced(mesh, _) = &input {
        warn_of_size(mesh, &settings);
    }
    let import_peak_bytes = peak_bytes();
    limit::build_begins();
    let start = Instant::now();
    let what = format!("building {}", count(settings.levels, "level"));
    let options = FileOptions {
        write: WriteOptions { compress: arguments.compress, parts: arguments.parts, hash: arguments.hash },
        meta: describe::metadata(arguments, &input, &source, &settings)?.to_string(),
        resume: arguments.resume,
        memory_limit,
    };
    let report = |p: esvo_builder::Progress| {
        if p.resumed > 0 {
            let parts =
                format!("{}.part, which holds {}", arguments.output.display(), count(p.resumed, "finished voxel"));
            complain("note", &format!("going on from {parts}"));
        }
        progress.fraction(&what, p.done, &format!("{:.1} M voxels", p.voxels as f64 / 1e6));
    };
    if let Some(part) = arguments.part {
        let built = part::run(arguments, part, &input, &source, &settings, &options, &report);
        progress.finish();
        input.warnings().iter().for_each(|warning| complain("warning", warning));
        return print(&built?);
    }
    let output = &arguments.output;
    let built = match &input {
        Input::Mesh(mesh) if arguments.voxelizer != VoxelizerName::Exact => {
            progress.say(format!("{what}, on a GPU"));
            voxelizer::build(arguments, mesh, &source, &settings, &options)?
        }
        _ => match &input {
            Input::Mesh(mesh) => build_file(mesh, &settings, output, &options, &report),
            Input::Displaced(mesh, displacement) => {
                build_displaced_file(mesh, displacement, &settings, output, &options, &report)
            }
            Input::Voxels(model) => build_voxels_file(model, &settings, output, &options),
        }
        .map_err(|e| match e {
            BuildError::Format(e) => name_file(&arguments.output, e),
            BuildError::Io { .. } | BuildError::Busy(_) | BuildError::OtherWork(_) | BuildError::Part { .. } => {
                e.to_string()
            }
            _ => format!("{source}: {e}"),
        })?,
    };
    let build = start.elapsed().as_secs_f64();
    let peaks = (import_peak_bytes, peak_bytes());
    progress.finish();
    for warning in input.warnings() {
        complain("warning", warning);
    }
    let stats = counts(&arguments.output).map_err(|e| name_file(&arguments.output, e))?;
    let seconds = BuildSeconds {
        import,
        build,
        prepare: built.stats.prepare.as_secs_f64(),
        voxelize: built.stats.voxelize.as_secs_f64(),
        write: built.stats.assemble.as_secs_f64(),
    };
    let mesh = input.summary_mesh();
    let mut summary = BuildSummary::new(&source, &arguments.output, &mesh, &settings, seconds, peaks, &stats);
    if let Input::Displaced(..) = &input {
        summary.triangles = built.stats.triangles as u64;
    }
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

/// The counts of the octree in a file, which may be larger than the memory.
fn counts(path: &Path) -> Result<Stats, FormatError> {
    let file = std::fs::File::open(path).map_err(|source| FormatError::Io { path: path.into(), source })?;
    stream_stats(&StreamReader::open(file)?)
}

/// Leaves from which a build says first how large it may become: some 7 GB, and minutes to hours.
const MANY_LEAVES: f64 = 1e9;

/// Says how large a large build may become.
fn warn_of_size(mesh: &esvo_builder::Mesh, settings: &BuildSettings) {
    let leaves = esvo_builder::expected_leaves(mesh, settings.levels);
    if leaves > MANY_LEAVES {
        // Each level has a quarter of the voxels of the next one. A voxel takes 4 to 8 bytes.
        let voxels = leaves * 4.0 / 3.0;
        let ends = if settings.contours {
            "; parts that contours, colours and normals describe well enough end earlier, see --contour-error"
        } else {
            ""
        };
        let levels = count(settings.levels, "level");
        let gigabytes = voxels * 5.0 / 1e9;
        complain("note", &format!("{levels}: up to about {voxels:.1e} voxels and {gigabytes:.0} GB{ends}"));
    }
}

/// Where the mesh of a scene comes from. Warns if it is another mesh than the one that the manifest lists, or a stand-in that
/// was not asked for.
fn found<'a>(arguments: &BuildArguments, scene: &'a SceneEntry) -> Result<SceneSource<'a>, Failure> {
    let source = SceneSource::find(scene, arguments.scenes_dir.as_deref(), arguments.stand_in)?;
    if let Some(other) = source.other() {
        let what = "not the mesh that the manifest lists, so its octree is not comparable with those of others";
        complain("warning", &format!("--scene {}: {other}: {what}", scene.name));
    }
    if source.is_replaced() {
        complain("warning", &format!("--scene {}: its stand-in is built: {}", scene.name, source.missing()));
    }
    Ok(source)
}

/// What to build, and its name.
fn input(
    arguments: &BuildArguments,
    scene: Option<&SceneSource>,
    memory_limit: Option<u64>,
    progress: &Progress,
) -> Result<(Input, String), Failure> {
    if let Some(path) = &arguments.mesh {
        let maps = !components(arguments).names().is_empty();
        return read_input(path, arguments.format.map(Into::into), memory_limit, maps, progress);
    }
    // clap requires one of the two.
    let scene = scene.ok_or("neither a mesh nor a scene is given")?;
    let source = scene.source();
    progress.say(format!("reading {source}"));
    Ok((Input::Mesh(scene.load()?), source))
}

/// Refuses options that do not apply to voxel models.
fn check_for_voxels(arguments: &BuildArguments) -> Result<(), Failure> {
    let given = [
        ("--levels", arguments.levels.is_some()),
        ("--no-contours", arguments.no_contours),
        ("--voxelizer", arguments.voxelizer != VoxelizerName::Exact),
        ("--contour-error", arguments.contour_error.is_some()),
        ("--color-error", arguments.color_error.is_some()),
        ("--normal-error", arguments.normal_error.is_some()),
        ("--texture-test", arguments.texture_test.is_some()),
        ("--preset", arguments.preset.is_some()),
        ("--paper", arguments.paper.is_some()),
        ("--components", !arguments.components.is_empty()),
        ("--displace", arguments.displacement.displace.is_some()),
        ("--height-map", !arguments.displacement.height_map.is_empty()),
        ("--resume", arguments.resume),
        ("--memory-limit", arguments.memory_limit.is_some()),
        ("--part", arguments.part.is_some()),
    ];
    match given.into_iter().find(|(_, given)| *given) {
        Some((option, _)) => {
            Err(format!("{option} does not apply to voxel models, whose voxels are taken as they are; leave it out")
                .into())
        }
        None => Ok(()),
    }
}

/// What is stored of the materials: what the option says, else what says how voxels look if the mesh is a glTF file.
fn components(arguments: &BuildArguments) -> ComponentSettings {
    let has = |name| arguments.components.contains(&name) || arguments.components.contains(&Component::All);
    if !arguments.components.is_empty() {
        return ComponentSettings {
            emission: has(Component::Emission),
            roughness_metalness: has(Component::Roughness),
            opacity: has(Component::Opacity),
            material: has(Component::Material),
        };
    }
    let format = arguments
        .mesh
        .as_ref()
        .and_then(|mesh| arguments.format.map(Into::into).or_else(|| import::format_of(mesh).ok()));
    match format {
        Some(import::Format::Gltf | import::Format::Glb) if arguments.voxelizer == VoxelizerName::Exact => {
            ComponentSettings::LOOK
        }
        _ => ComponentSettings::NONE,
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
    settings.levels = arguments.levels.unwrap_or(DEFAULT_LEVELS);
    settings.contours = !arguments.no_contours;
    settings.colors = !arguments.no_colors;
    settings.normals = !arguments.no_normals;
    settings.plain_attributes = arguments.plain_attributes;
    settings.components = components(arguments);
    settings.contour_error = arguments.contour_error.unwrap_or(settings.contour_error);
    settings.color_error = arguments.color_error.unwrap_or(settings.color_error);
    settings.normal_error = arguments.normal_error.unwrap_or(settings.normal_error);
    settings.texture_test = arguments.texture_test.map_or(settings.texture_test, Into::into);
    if let Some(slots) = arguments.block_slots {
        settings.assemble.block_slots = slots;
    }
    Ok(settings)
}
