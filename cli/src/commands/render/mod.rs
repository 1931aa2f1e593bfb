//! `esvo render`.

mod casters;
mod compare;
mod draw;
mod effects;
#[cfg(feature = "wgpu")]
mod effects_gpu;
#[cfg(not(feature = "wgpu"))]
#[path = "no_effects_gpu.rs"]
mod effects_gpu;
mod frames;
mod look;
mod path;
mod served;

use std::path::{Path, PathBuf};

use clap::{ArgGroup, Args};
use esvo_bench::Progress;
use esvo_core::camera::viewpoint;
use esvo_core::lights::Light;
use esvo_core::picture::write_png;
use esvo_core::sky::Sky;
use esvo_core::{Camera, Hit, Object};
use esvo_engines::EngineId;
use esvo_format::Octree;
use esvo_format::file::attachment;
use glam::DVec3;

use crate::fail::{Failure, complain, print};
use crate::files::{check_extension, check_not_input, check_output, extension};
use crate::memory::check_memory;
use crate::remote::{RemoteArguments, is_address};
use crate::stage::{LIST, Stage};
use crate::values::{SkyValue, engine, parse_beam_block, parse_light, parse_sky};
use crate::view::{DEFAULT_FOV, Key, ViewArguments};
use casters::Casters;
use compare::{Comparison, Difference, compare, parse_comparison};
use draw::{Lighting, Total, draw};
use effects::{EffectArguments, Effects};
use look::{Filter, Look, ViewMode};
use path::CameraPath;

/// Frames of a path or a turn without `--frames`.
const DEFAULT_FRAMES: u32 = 120;

/// Render a picture of an octree or of many at their places, a comparison of two, or the frames of a film.
#[derive(Debug, Args)]
#[command(group = ArgGroup::new("moves").args(["path", "turn"]))]
#[command(after_help = "\
Without a camera, the picture shows the whole object from outside. Cameras are in the units of the
mesh.

A scene list places octrees, each as often as wanted, in TOML (scenes/README.md says more):
  version = 1
  [[place]]
  file = \"tree.esvo\"
  scale = 0.5
  rotation = { axis = [0, 1, 0], degrees = 30 }
  translation = [4, 0, -2]
Cameras and lights are in the units of the scene then.

--effects traces rays through a volume of one bit a voxel, which is made of what is shown: ao,
shadows, reflections, fog and bounce, in any number. Rays begin in the picture and go on in the
volume; what they gather is smoothed. Reflections have the colours that the picture shows and are
black elsewhere; bounced light has those of the voxels. Lights become lamps that fade with distance.
With --backend wgpu the GPU makes them, and light bounces from what the picture shows.

Where voxels are larger than a pixel, the picture is blurred by the paper's post-process filter
(section 4.3); --filter off shows the voxels.

--compare A,B writes one picture: A, B, and how different they look (FLIP), from black, not at
all, over violet, red and yellow to white, like black beside white. The scale is on its right, 1 on
top. The mean is printed, and the number of pixels that differ. A side is a name, or several with
plus signs between them; what it does not name is as the other options say. The names:
  shaded, iterations, normals, depth, levels, voxel-size, ambient, emission, roughness, metalness,
  opacity, material: --view-mode
  reference, cpu, wgpu, ash: --backend
  filter, own-filter, no-filter: --filter adapted, own, off
  contours, no-contours
  beam, wide-beam, no-beam: --beam=4, --beam=8, neither

A file for --path has one camera a line, as for --camera. Before it there may be its time in
seconds and a colon; without times, all are equally far apart. Empty lines and lines that start
with # are ignored. Frames are taken at equal times, on smooth curves through all cameras:
  # from the door to the altar
  0: -15,-9,0,1,0.2,0
  4: -5,-9,0,1,0.1,0.1
  6: 5,-11,0,1,0,0,40

Examples:
  esvo render sibenik.esvo -o nave.png --scene sibenik --view 2
  esvo render sibenik.esvo -o nave.png --camera=-15,-9,0,1,0.2,0 --fov 60 --size 1920x1080
  esvo render sibenik.esvo -o sun.png --light sun:1,2,0.5 --light point:0,-12,0
  esvo render list.toml -o place.png --light sun:1,2,0.5
  esvo render sibenik.esvo -o soft.png --light point:0,-9,0 --light-radius 0.3 --effects ao,shadows,fog
  esvo render sibenik.esvo -o steps.png --view-mode iterations --backend reference
  esvo render sibenik.esvo -o contours.png --compare contours,no-contours+no-filter
  esvo render sibenik.esvo -o same.png --compare cpu,wgpu+beam
  esvo render sibenik.esvo -o turn.png --turn --frames 120        # turn-001.png to turn-120.png
  esvo render sibenik.esvo -o walk.png --path walk.txt --sky dome
  esvo render https://example.org/sibenik.esvo -o nave.png --scene sibenik

An octree may be on a web server or in an object store (http://, https://, s3://, gs://, az://), if the
program was built with --features remote. Only what the picture needs is read, best of a file that was
written with --parts: voxels in the picture, down to the size at which rays end. All of it is read for
shadows of lights and for effects.")]
pub(crate) struct RenderArguments {
    /// The octree, its address, or a scene list (.toml): octrees and where they stand
    pub(crate) file: PathBuf,
    /// The PNG to write. Frames of a film have their number before the extension: -o turn.png writes turn-001.png and so on
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// The engine that casts the rays
    #[arg(short, long, value_parser = engine(), default_value_t = EngineId::Cpu)]
    pub(crate) backend: EngineId,
    #[command(flatten)]
    pub(crate) rays: ViewArguments,
    /// Use the beam optimization, in blocks of 4x4 or 8x8 pixels; several objects, and those of a few pixels, are cast without it
    #[arg(long, value_name = "4|8", num_args = 0..=1, require_equals = true, default_missing_value = "4", value_parser = parse_beam_block)]
    pub(crate) beam: Option<u32>,
    /// What to show
    #[arg(long, value_enum, default_value_t = ViewMode::Shaded)]
    pub(crate) view_mode: ViewMode,
    /// Show two pictures beside each other, and how different they look: see below
    #[arg(long, value_name = "A,B", value_parser = parse_comparison)]
    pub(crate) compare: Option<Comparison>,
    /// Move the camera through those of this file, with --fov where they have none of their own: see below
    #[arg(long, value_name = "FILE", conflicts_with_all = ["camera", "scene"])]
    pub(crate) path: Option<PathBuf>,
    /// Move the camera once around the objects: that of --camera or --scene, else one that sees all of them
    #[arg(long)]
    pub(crate) turn: bool,
    /// Frames of the path or of the turn [default: 120]
    #[arg(long, value_name = "N", requires = "moves", value_parser = clap::value_parser!(u32).range(1..=99_999))]
    pub(crate) frames: Option<u32>,
    /// Light a shaded picture by this light and not by the lamp at the camera; may be given several times. In the units of the mesh:
    /// sun:X,Y,Z (the direction to it), point:X,Y,Z, spot:X,Y,Z,DX,DY,DZ,DEGREES (place, axis, full angle of the cone), or sky:
    /// from all directions, as far as the stored ambient occlusion lets it through (see `esvo ambient`)
    #[arg(long = "light", value_name = "LIGHT", value_parser = parse_light)]
    pub(crate) lights: Vec<Light>,
    /// Lights cast no shadows
    #[arg(long, requires = "lights")]
    pub(crate) no_shadows: bool,
    #[command(flatten)]
    pub(crate) effects: EffectArguments,
    /// Background of a shaded picture: screen (blue on top of the picture, white at its bottom), dome (blue above, white at the
    /// horizon, grey below, so that it stays in its place when the camera turns), or a colour, RRGGBB
    #[arg(long, value_name = "SKY", default_value = "screen", value_parser = parse_sky)]
    pub(crate) sky: SkyValue,
    /// Blur a shaded picture where voxels are larger than a pixel
    #[arg(long, value_enum, default_value_t = Filter::Adapted)]
    pub(crate) filter: Filter,
    /// Print how long casting, shading and filtering take; the first picture is cast and filtered twice, and measured the second
    /// time
    #[arg(long)]
    pub(crate) times: bool,
    /// Do not compare the checksums of the blocks: for a file that was verified before, e.g. by `esvo validate`. Only what
    /// the picture needs is then read from an uncompressed file
    #[arg(long)]
    pub(crate) no_verify: bool,
    #[command(flatten)]
    pub(crate) remote: RemoteArguments,
}

pub(crate) fn run_render(arguments: &RenderArguments) -> Result<(), Failure> {
    let outputs = arguments.outputs();
    for output in &outputs {
        check_output(output)?;
        check_extension(output, "png", "pictures are written as PNG")?;
        check_not_input(output, &arguments.file)?;
    }
    arguments.rays.check()?;
    let looks = arguments.looks()?;
    let fov = arguments.rays.fov()?.unwrap_or(DEFAULT_FOV);
    let path = arguments.path.as_deref().map(|path| CameraPath::read(path, fov)).transpose()?;
    let (stage, read) = if is_address(&arguments.file) {
        arguments.served_stage(path.as_ref(), &looks)?
    } else {
        (Stage::open(&arguments.file, !arguments.no_verify)?, String::new())
    };
    arguments.warn_of_missing_ambient(&stage.octree, &looks);
    arguments.warn_of_missing_components(&stage.octree, &looks);
    let objects = stage.objects();
    let cameras = arguments.cameras(&objects, path.as_ref())?;
    let progress = Progress::terminal();
    if !arguments.effects.effects.is_empty() {
        progress.say("making the volume");
    }
    let effects = arguments.effects.prepare(&objects, &arguments.lights, arguments.backend)?;
    progress.say("rendering");
    let mut casters = Casters::default();
    for look in &looks {
        casters.load(look, &stage.octree, &arguments.file)?;
    }
    let size = arguments.rays.size;
    check_memory(bytes(size, looks.len()), &format!("--size {}x{}", size[0], size[1]))?;
    let mut totals = vec![Total::default(); looks.len()];
    let mut differences = Vec::new();
    let mut empty = Vec::new();
    for (number, (camera, output)) in cameras.iter().zip(&outputs).enumerate() {
        if outputs.len() > 1 {
            let note = format!("frame {} of {}", number + 1, outputs.len());
            progress.fraction("rendering", number as f64 / outputs.len() as f64, &note);
        }
        let lighting = arguments.lighting(camera, effects.as_ref());
        let mut drawn = Vec::with_capacity(looks.len());
        for (look, total) in looks.iter().zip(&mut totals) {
            let views = arguments.rays.views(camera, &objects, look.contours, look.beam)?;
            let caster = casters.of(look)?;
            let one = draw(caster, &objects, &views, look, &lighting, arguments.times && number == 0)?;
            total.add(&one);
            drawn.push(one);
        }
        if drawn.iter().all(|one| one.hit() == 0) {
            empty.push(number);
        }
        let compared;
        let picture = match &drawn[..] {
            [one] => &one.picture,
            [a, b] => {
                let difference;
                (compared, difference) = compare(a, b)?;
                differences.push(difference);
                &compared
            }
            _ => return Err("there is nothing to draw".to_owned().into()),
        };
        write_png(output, picture).map_err(|e| format!("{}: {e}", output.display()))?;
    }
    progress.finish();
    if let Some(first) = empty.first() {
        warn_of_nothing(&objects, (empty.len(), cameras.len()), &outputs[*first], &cameras[*first]);
    }
    arguments.report(&outputs, &looks, &casters, &totals, &differences)?;
    print(&read)?;
    effects.map_or(Ok(()), |effects| print(&effects.about()))
}

impl RenderArguments {
    /// The files that are written.
    fn outputs(&self) -> Vec<PathBuf> {
        if self.path.is_none() && !self.turn {
            return vec![self.output.clone()];
        }
        frames::names(&self.output, self.frames.unwrap_or(DEFAULT_FRAMES))
    }

    /// How the picture is made, or both of a comparison.
    fn looks(&self) -> Result<Vec<Look>, Failure> {
        let look = Look {
            engine: self.backend,
            mode: self.view_mode,
            filter: self.filter,
            contours: !self.rays.no_contours,
            beam: self.beam,
        };
        let looks = match &self.compare {
            None => vec![look],
            Some(Comparison { sides }) => sides.iter().map(|side| side.look(&look)).collect::<Result<_, _>>()?,
        };
        let shaded = looks.iter().any(|look| look.mode == ViewMode::Shaded);
        if !self.lights.is_empty() && !shaded {
            return Err("--light: only shaded pictures are lit; leave out --view-mode".to_owned().into());
        }
        if !self.effects.effects.is_empty() && !shaded {
            return Err("--effects: only shaded pictures have effects; leave out --view-mode".to_owned().into());
        }
        self.effects.check(&self.lights)?;
        if self.sky != SkyValue::Screen && !shaded {
            return Err("--sky: only shaded pictures have a sky; leave out --view-mode".to_owned().into());
        }
        Ok(looks)
    }

    /// The cameras of all frames, with planes around what they see.
    fn cameras(&self, objects: &[Object], path: Option<&CameraPath>) -> Result<Vec<Camera>, Failure> {
        let frames = self.frames.unwrap_or(DEFAULT_FRAMES);
        if let (Some(path), Some(file)) = (path, &self.path) {
            let name = file.display().to_string();
            let keys = path.frames(&name, frames)?;
            let camera = |(number, key): (usize, &Key)| {
                self.rays.camera_of(key, objects, &format!("{name}: frame {}", number + 1))
            };
            return keys.iter().enumerate().map(camera).collect();
        }
        if !self.turn {
            return Ok(vec![self.rays.camera(objects)?]);
        }
        let (low, high) = viewpoint::bounds_of(objects);
        let (camera, centre) = if self.rays.camera.is_some() || self.rays.scene.is_some() {
            (self.rays.camera(objects)?, (low + high) / 2.0)
        } else {
            let fov = self.rays.fov()?.unwrap_or(DEFAULT_FOV);
            viewpoint::turntable(objects, self.rays.up()?.to_array(), fov, self.rays.aspect())
        };
        let mut cameras = path::turn(&camera, centre, frames);
        for camera in &mut cameras {
            (camera.near, camera.far) = viewpoint::planes_of(objects, camera.eye);
        }
        Ok(cameras)
    }

    fn lighting<'a>(&'a self, camera: &'a Camera, effects: Option<&'a Effects>) -> Lighting<'a> {
        let sky = match self.sky {
            SkyValue::Screen => None,
            SkyValue::Dome => Some(Sky::Dome { up: camera.up.into() }),
            SkyValue::Plain(color) => Some(Sky::Plain(color)),
        };
        Lighting {
            lights: &self.lights,
            shadows: !self.no_shadows,
            effects: effects.map(|effects| (effects, camera)),
            sky,
        }
    }

    /// Says that the picture shows ambient occlusion, which the octree has not.
    fn warn_of_missing_ambient(&self, octree: &Octree, looks: &[Look]) {
        let shown = looks.iter().any(|look| look.mode == ViewMode::Ambient) || self.lights.contains(&Light::Sky);
        if shown && !octree.needs().ambient {
            let name = self.file.display();
            let what = "no ambient occlusion, so all of it is shown as open; compute it: esvo ambient";
            let text = match extension(&self.file).as_str() {
                LIST => format!("{name}: none of the octrees has {what}"),
                _ => format!("{name}: has {what} {name}"),
            };
            complain("warning", &text);
        }
    }

    /// Says that the picture shows components of which no voxel has any.
    fn warn_of_missing_components(&self, octree: &Octree, looks: &[Look]) {
        let there = octree.component_kinds();
        for kind in looks.iter().filter_map(|look| look.mode.components()).filter(|kind| !there.contains(kind)) {
            let (name, what) = (self.file.display(), attachment::name(kind));
            complain(
                "warning",
                &format!("{name}: has no {what}, so the default is shown; store it: esvo build --components"),
            );
        }
    }

    /// Prints what was written.
    fn report(
        &self,
        outputs: &[PathBuf],
        looks: &[Look],
        casters: &Casters,
        totals: &[Total],
        differences: &[Difference],
    ) -> Result<(), Failure> {
        let [width, height] = self.rays.size;
        let mut text = match outputs {
            [] => String::new(),
            [one] => format!("{}: ", one.display()),
            [first, .., last] => {
                format!("{} to {}: {} frames of ", first.display(), last.display(), outputs.len())
            }
        };
        text += &format!("{width}x{height}, ");
        if let Some(Comparison { sides: [a, b] }) = &self.compare {
            text += &format!("{}, {} and their difference\n", a.name, b.name);
        }
        for (number, (look, total)) in looks.iter().zip(totals).enumerate() {
            if let Some(Comparison { sides }) = &self.compare {
                text += &format!("{}: ", sides[number].name);
            }
            text += &format!("{}, cast by {}\n", total.hits(), casters.name(look));
            if self.times {
                text += &total.times();
            }
        }
        if !differences.is_empty() {
            text += &Difference::of_all(differences).text();
            text.push('\n');
        }
        print(&text)
    }
}

/// Bytes that one picture of this size, or two and their comparison, need at most.
fn bytes([width, height]: [u32; 2], pictures: usize) -> usize {
    // Nearest hits, whose they are, the picture; hits of an object, the picture's radii, with margins, filtered, and its encoded form.
    let (kept, working) = (size_of::<Hit>() + 4 + 3, size_of::<Hit>() + 3 * 2 + 4 + 8);
    let compared = if pictures > 1 { compare::BYTES_PER_PIXEL } else { 0 };
    let pixels = width as usize * height as usize;
    pixels.saturating_mul(pictures * kept + working.max(compared))
}

/// Says that frames are empty, and where the objects are.
fn warn_of_nothing(objects: &[Object], (empty, all): (usize, usize), first: &Path, camera: &Camera) {
    let (low, high) = viewpoint::bounds_of(objects);
    let frames = match all {
        1 => String::new(),
        _ => format!(" in {empty} of {all} frames, the first of which is {}", first.display()),
    };
    let what = format!(
        "no ray hits anything{frames}: the object lies between {:.4} and {:.4}; the camera is at {:.4} and looks along {:.4}",
        low,
        high,
        DVec3::from(camera.eye),
        DVec3::from(camera.forward)
    );
    complain("warning", &what);
}
