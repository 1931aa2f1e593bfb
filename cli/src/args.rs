//! What can be typed.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use esvo_bench::Backend;

use crate::commands::bench::build::BenchBuild;
use crate::commands::bench::format::BenchFormat;
use crate::commands::bench::import::BenchImport;
use crate::commands::bench::pictures::BenchPictures;
use crate::commands::bench::selection::Selection;
use crate::commands::build::displacement::Displacement;

/// Sparse voxel octrees: build, inspect, render and benchmark.
#[derive(Debug, Parser)]
#[command(
    name = "esvo",
    version,
    propagate_version = true,
    after_help = "\
Examples:
  esvo bench                                          the paper's two tables on this machine, within three minutes
  esvo build sibenik.obj -o sibenik.esvo --levels 11  a mesh to an octree
  esvo render sibenik.esvo -o sibenik.png             a picture of it
  esvo help render                                    everything about one command"
)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    Build(Build),
    Info(Info),
    Dump(Dump),
    Diff(Diff),
    Validate(Validate),
    Convert(Convert),
    Ambient(Ambient),
    Render(Render),
    Bench(Box<Bench>),
}

/// Build an octree from a mesh (.obj, .gltf, .glb, .ply, .stl).
#[derive(Debug, Args)]
#[command(after_help = "\
Errors bound how far a voxel may be from what it stands for; where all three hold, it is not divided further. The defaults
are those of the paper's authors: 16 steps of 256, 0.01, and the diagonal of a voxel at level 15.

Examples:
  esvo build conference.obj -o conference.esvo --levels 12 --paper conference
  esvo build scan.ply -o scan.esvo --levels 10 --no-contours
  esvo build sibenik.obj -o sibenik-d.esvo --levels 11 --displace 0.05
  esvo build --scene hairball -o hairball.esvo --levels 10 --json")]
pub(crate) struct Build {
    /// The mesh
    #[arg(required_unless_present = "scene", conflicts_with = "scene")]
    pub(crate) mesh: Option<PathBuf>,
    /// The file to write
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// Deepest level, 1 to 23: voxels are at least 2^-N of the root cube
    #[arg(short, long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=23))]
    pub(crate) levels: u32,
    /// No contours: all geometry goes down to the deepest level, as cubes
    #[arg(long)]
    pub(crate) no_contours: bool,
    /// Allowed deviation of the shape: the diagonal of a voxel of this level [default: 15]
    #[arg(long, value_name = "LEVEL")]
    pub(crate) contour_error: Option<f64>,
    /// Allowed deviation of a colour channel in steps of 1/256 [default: 16]
    #[arg(long, value_name = "STEPS")]
    pub(crate) color_error: Option<f64>,
    /// Allowed deviation of a component of the unit normal [default: 0.01]
    #[arg(long, value_name = "X")]
    pub(crate) normal_error: Option<f64>,
    /// What the two are compared with: one sample for each triangle's part of a voxel, as the authors do, or every texel
    #[arg(long, value_name = "TEST")]
    pub(crate) texture_test: Option<TextureTest>,
    /// Start from settings that go together
    #[arg(long, value_name = "NAME", conflicts_with = "paper")]
    pub(crate) preset: Option<Preset>,
    /// Start from the paper's settings for one of its scenes
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
    /// Keep what is finished in OUTPUT.part and go on from there if an earlier build of the same was interrupted
    #[arg(long)]
    pub(crate) resume: bool,
    /// Memory that may be used, in GB (10^9 bytes); where it is short fewer threads work
    #[arg(long, value_name = "GB", value_parser = parse_gigabytes)]
    pub(crate) memory_limit: Option<f64>,
    /// Store blocks compressed with Zstandard at this level
    #[arg(long, value_name = "LEVEL", num_args = 0..=1, default_missing_value = "3", value_parser = clap::value_parser!(i32).range(1..=22))]
    pub(crate) compress: Option<i32>,
    /// Store colours and normals as they are, 4 bytes each, instead of compressed in blocks
    #[arg(long)]
    pub(crate) plain_attributes: bool,
    /// Build this scene of the manifest with the paper's settings: its real mesh, or its procedural stand-in; SIBENIK-D is
    /// displaced
    #[arg(long, value_name = "NAME")]
    pub(crate) scene: Option<String>,
    /// Build the scene's procedural stand-in even if the real mesh is found
    #[arg(long, requires = "scene")]
    pub(crate) stand_in: bool,
    /// Where real meshes are looked for first; then $ESVO_SCENES, then ../shared/scenes
    #[arg(long, value_name = "FOLDER", requires = "scene")]
    pub(crate) scenes_dir: Option<PathBuf>,
    /// Print what it took and what came out as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

/// Say what a file contains.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  esvo info sibenik.esvo --json")]
pub(crate) struct Info {
    /// The file
    pub(crate) file: PathBuf,
    /// As JSON
    #[arg(long)]
    pub(crate) json: bool,
}

/// Show what lies where in a file: its tables, a block slot by slot, or a voxel.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esvo dump sibenik.esvo                     the object and block tables
  esvo dump sibenik.esvo --block 0           every slot of a block and what it is
  esvo dump sibenik.esvo --path 0/3/7        the voxels of the descriptor at child slots 0, 3, 7 from the root
  esvo dump sibenik.esvo --path / --json     those of the root, as JSON")]
pub(crate) struct Dump {
    /// The file
    pub(crate) file: PathBuf,
    /// A block, by its index in the block table
    #[arg(long, value_name = "N", conflicts_with = "path")]
    pub(crate) block: Option<usize>,
    /// A descriptor or a leaf voxel, by child slots from the root
    #[arg(long, value_name = "SLOTS")]
    pub(crate) path: Option<String>,
    /// The object that the path begins in
    #[arg(long, value_name = "N", default_value_t = 0, requires = "path")]
    pub(crate) object: usize,
    /// As JSON
    #[arg(long)]
    pub(crate) json: bool,
}

/// Compare what two files hold, however it is laid out.
#[derive(Debug, Args)]
#[command(after_help = "\
Objects, transforms, topology, contours, colours and normals are compared; blocks, pointers, compression, metadata and
unknown sections are not. Exit code 0: the same octree. 1: not, and the first differences are listed.

Example:
  esvo diff before.esvo after.esvo")]
pub(crate) struct Diff {
    /// A file
    pub(crate) first: PathBuf,
    /// Another
    pub(crate) second: PathBuf,
    /// List at most so many differences
    #[arg(long, value_name = "N", default_value_t = 20)]
    pub(crate) limit: usize,
    /// As JSON
    #[arg(long)]
    pub(crate) json: bool,
}

/// Check a file against every rule of the specification.
#[derive(Debug, Args)]
#[command(after_help = "\
Exit code 0: the file keeps every rule. 1: it breaks one; each finding names the rule, the offset and what was found.

Example:
  esvo validate sibenik.esvo")]
pub(crate) struct Validate {
    /// The file
    pub(crate) file: PathBuf,
    /// As JSON
    #[arg(long)]
    pub(crate) json: bool,
}

/// Convert between .esvo and the paper authors' .oct, or rewrite an .esvo.
#[derive(Debug, Args)]
#[command(after_help = "\
What a file is, its extension says. Contours, and colours and normals in blocks, are carried over bit for bit; what the other
kind of file cannot hold is listed.

Examples:
  esvo convert sibenik.oct -o sibenik.esvo
  esvo convert sibenik.esvo -o sibenik.oct
  esvo convert sibenik.esvo -o small.esvo --compress")]
pub(crate) struct Convert {
    /// The file to read: .esvo or .oct
    pub(crate) input: PathBuf,
    /// The file to write: .esvo or .oct
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// Compress the blocks of an .esvo with Zstandard, at this level, 1 to 22
    #[arg(long, value_name = "LEVEL", num_args = 0..=1, default_missing_value = "3", value_parser = clap::value_parser!(i32).range(1..=22))]
    pub(crate) compress: Option<i32>,
}

/// Compute ambient occlusion: how much light from all around reaches each voxel.
#[derive(Debug, Args)]
#[command(after_help = "\
From each leaf voxel rays go to all sides of its surface, by preference straight up. The share of them that meets nothing
is stored with the voxel, and pictures are darker where it is small. The octree must have normals. The cpu engine casts
many rays at once; GPU engines cast them one by one here, which takes long.

Examples:
  esvo ambient sibenik.esvo -o sibenik-ao.esvo
  esvo ambient conference.esvo -o conference-ao.esvo --radius 0.05 --flip-normals")]
pub(crate) struct Ambient {
    /// The octree
    pub(crate) input: PathBuf,
    /// The file to write: the same octree with ambient occlusion
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// Rays per leaf voxel
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub(crate) rays: u32,
    /// How far away something can be to be in the way, in parts of the scene's extent
    #[arg(long, value_name = "X", default_value_t = 0.05)]
    pub(crate) radius: f64,
    /// Look to the other side of the surface: for meshes whose normals point inwards
    #[arg(long)]
    pub(crate) flip_normals: bool,
    /// Rays ignore contours: voxels are cubes
    #[arg(long)]
    pub(crate) no_contours: bool,
    /// The engine
    #[arg(short, long, value_enum, default_value_t = Engine::Cpu)]
    pub(crate) backend: Engine,
}

/// Render a picture of an octree.
#[derive(Debug, Args)]
#[command(after_help = "\
Without a camera the whole object is looked at from outside. Cameras are in the units of the mesh.

Examples:
  esvo render sibenik.esvo -o nave.png --scene sibenik --view 2
  esvo render sibenik.esvo -o nave.png --camera=-15,-9,0,1,0.2,0 --fov 60 --size 1920x1080
  esvo render sibenik.esvo -o steps.png --view-mode iterations --backend reference")]
pub(crate) struct Render {
    /// The octree
    pub(crate) file: PathBuf,
    /// The PNG to write
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// The engine
    #[arg(short, long, value_enum, default_value_t = Engine::Cpu)]
    pub(crate) backend: Engine,
    /// Eye and viewing direction: ex,ey,ez,fx,fy,fz and if wanted the field of view in degrees
    #[arg(long, value_name = "NUMBERS", allow_hyphen_values = true, conflicts_with = "scene")]
    pub(crate) camera: Option<String>,
    /// Which way is up
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, default_value = "0,1,0")]
    pub(crate) up: String,
    /// Field of view over the shorter side in degrees [default: 60]
    #[arg(long, value_name = "DEGREES")]
    pub(crate) fov: Option<f64>,
    /// Take the camera from the manifest of this scene
    #[arg(long, value_name = "NAME")]
    pub(crate) scene: Option<String>,
    /// Which of its cameras, from 1
    #[arg(long, value_name = "K", default_value_t = 1, requires = "scene")]
    pub(crate) view: usize,
    /// Take the cameras of the scene's procedural stand-in even if the real mesh is found
    #[arg(long, requires = "scene")]
    pub(crate) stand_in: bool,
    /// Where real meshes are looked for first, to tell whose cameras to take
    #[arg(long, value_name = "FOLDER", requires = "scene")]
    pub(crate) scenes_dir: Option<PathBuf>,
    /// Size of the picture
    #[arg(long, value_name = "WxH", default_value = "1024x768", value_parser = parse_size)]
    pub(crate) size: [u32; 2],
    /// Ignore contours: voxels are cubes
    #[arg(long)]
    pub(crate) no_contours: bool,
    /// Use the beam optimization
    #[arg(long)]
    pub(crate) beam: bool,
    /// Rays end at voxels this many pixels large; 0: at leaves only
    #[arg(long, value_name = "PIXELS", default_value_t = 1.0)]
    pub(crate) max_voxel_pixels: f32,
    /// What to show
    #[arg(long, value_enum, default_value_t = ViewMode::Shaded)]
    pub(crate) view_mode: ViewMode,
}

/// Measure the paper's two tables on this machine.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true)]
#[command(after_help = "\
Builds octrees of the paper's scenes (real meshes where they are found, procedural stand-ins otherwise), checks the answers
of every engine against the reference caster, times them, prints the tables and writes report.json, tables.md and pictures
to results/<machine>/<date>/. Exit code 1 if an engine's answers are wrong.

Examples:
  esvo bench                                    within three minutes on two cores
  esvo bench --full --memory 16                 the paper's whole matrix
  esvo bench --scenes sibenik --levels 9,10,11 --backends cpu")]
pub(crate) struct Bench {
    /// What else can be measured; without one of these, the paper's tables
    #[command(subcommand)]
    pub(crate) command: Option<BenchCommand>,
    /// The paper's whole matrix: every scene, resolution and viewpoint, levels up to what the memory allows
    #[arg(long, conflicts_with = "matrix")]
    pub(crate) full: bool,
    #[command(flatten)]
    pub(crate) selection: Selection,
    /// Only these engines
    #[arg(long, value_enum, value_delimiter = ',')]
    pub(crate) backends: Vec<Engine>,
    /// These picture sizes
    #[arg(long, value_name = "WxH,...", value_delimiter = ',', value_parser = parse_size)]
    pub(crate) resolutions: Vec<[u32; 2]>,
    /// Viewpoints per scene
    #[arg(long, value_name = "N")]
    pub(crate) views: Option<usize>,
    /// Timed rounds per row
    #[arg(long, value_name = "N")]
    pub(crate) rounds: Option<usize>,
    /// Threads of the CPU caster
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub(crate) threads: Option<u16>,
    /// Where the folder MACHINE/DATE/ is made
    #[arg(long, value_name = "FOLDER", default_value = "results")]
    pub(crate) out: PathBuf,
    /// Name of the machine's folder [default: made from the processor's]
    #[arg(long, value_name = "NAME")]
    pub(crate) machine: Option<String>,
}

/// What else can be measured.
#[derive(Debug, Subcommand)]
pub(crate) enum BenchCommand {
    Build(BenchBuild),
    Format(BenchFormat),
    Pictures(BenchPictures),
    Import(BenchImport),
}

/// The names of [`esvo_builder::Preset`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Preset {
    /// For a first look: 12, 32 steps, 0.1
    Fast,
    /// The authors' defaults: 15, 16 steps, 0.01
    Balanced,
    /// Few bytes at a fair shape: 13, 64 steps, 0.25
    Small,
    /// Every texel that the deepest level can show: 16, 8 steps, 0.01, --texture-test texels
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

/// The names of [`esvo_builder::TextureTest`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum TextureTest {
    /// One colour and normal for each triangle's part of a voxel
    Samples,
    /// Every texel
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

/// An engine, as it is typed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Engine {
    /// The definition of a correct hit: one thread
    Reference,
    /// All cores
    Cpu,
    /// The GPU through wgpu
    Wgpu,
    /// The GPU through Vulkan
    Ash,
}

impl From<Engine> for Backend {
    fn from(engine: Engine) -> Self {
        match engine {
            Engine::Reference => Self::Reference,
            Engine::Cpu => Self::Cpu,
            Engine::Wgpu => Self::Wgpu,
            Engine::Ash => Self::Ash,
        }
    }
}

/// What a picture shows, as it is typed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ViewMode {
    /// The voxels' own colours and normals in the light of a lamp at the camera
    Shaded,
    /// Iterations of every ray: black, violet, red, yellow, and white from 100
    Iterations,
    /// The voxels' normals as colours
    Normals,
    /// Near is white, far is black
    Depth,
}

/// Gigabytes of 10^9 bytes, above 0.
fn parse_gigabytes(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().map_err(|e| e.to_string())?;
    if number > 0.0 && number.is_finite() { Ok(number) } else { Err("not a number above 0".into()) }
}

pub(crate) fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let number = |s: &str| s.trim().parse::<u32>().ok().filter(|n| (1..=16384).contains(n));
    match text.split_once(['x', 'X']).map(|(w, h)| (number(w), number(h))) {
        Some((Some(w), Some(h))) => Ok([w, h]),
        _ => Err("write width x height in pixels, 1x1 to 16384x16384, as 1024x768".into()),
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_definition_is_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn sizes() {
        assert_eq!(parse_size("512x384"), Ok([512, 384]));
        for bad in ["", "512", "0x3", "3x0", "x", "1x99999", "-1x2", "1x2x3"] {
            assert!(parse_size(bad).is_err(), "{bad}");
        }
    }
}
