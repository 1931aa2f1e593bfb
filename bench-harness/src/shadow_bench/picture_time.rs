//! What each pass of a whole picture takes: the large world with ten lamps, their fog, ambient occlusion and reflections.

use esvo_shadow::World;
use esvo_shadow::effects::{Composed, Counts, Eye, Frame, Lamp, Settings, Wanted, compose};
use glam::{Vec2, Vec3};

use super::device::Device;
use super::world::height;
use super::{PassRow, PictureRow, PictureTime, ShadowOptions};
use crate::{BenchError, Progress};

const LAMPS: u32 = 10;
/// Where a lamp's light ends, in metres.
const REACH: f32 = 14.0;
const WANTED: Wanted = Wanted { occlusion: true, shadows: true, reflections: true, fog: true, bounce: false };
/// The document speaks of five rays of ambient occlusion and one to each lamp. How many places in the fog it asks at is not told.
const COUNTS: Counts = Counts { occlusion: 5, shadows: 1, reflections: 1, fog: 4, bounce: 1 };
/// Two pictures' light differs where it is farther apart than this, of 1 for white.
const APART: f32 = 0.01;

/// A picture of a world.
pub(super) struct Scene<'a> {
    pub(super) world: &'a World,
    pub(super) frame: Frame,
    pub(super) lamps: Vec<Lamp>,
    pub(super) settings: Settings,
}

/// Measures the picture on the processor and on a device. Gives its pixels as the processor has them, too.
pub(super) fn picture_time<'a>(
    world: &'a World,
    device: Option<&Device>,
    options: &ShadowOptions,
    progress: &Progress,
) -> Result<(PictureTime, Scene<'a>, Vec<Vec3>), BenchError> {
    let size = options.picture;
    progress.say(format!("a picture of {} x {} pixels of the world", size.0, size.1));
    // In the evening, when lamps are seen.
    let (ambient, sky) = (0.16, Vec3::new(0.1, 0.14, 0.24));
    let settings = Settings { wanted: WANTED, counts: COUNTS, fog: 0.03, ambient, sky, ..Settings::default() };
    let scene = Scene { world, frame: frame(world, size), lamps: lamps(world), settings };
    let name = format!("processor, {} threads", rayon::current_num_threads());
    let (first, row) = measure(name, options.rounds, None, || {
        Ok(compose(&scene.frame, scene.world.volume(), *scene.world.grid(), &scene.lamps, &scene.settings))
    })?;
    let mut rows = vec![row];
    if let Some(device) = device {
        progress.say("the same picture on the device");
        rows.push(device.picture(&scene, options.rounds, &first.light)?);
    }
    let time = PictureTime {
        size,
        lamps: LAMPS,
        occlusion_rays: COUNTS.occlusion,
        lamp_rays: COUNTS.shadows,
        reflection_rays: COUNTS.reflections,
        fog_places: COUNTS.fog,
        rows,
    };
    Ok((time, scene, first.light))
}

/// Times of each pass over some rounds, and the first picture. `expected` is what the light should be.
pub(super) fn measure(
    tracer: String,
    rounds: u32,
    expected: Option<&[Vec3]>,
    mut make: impl FnMut() -> Result<Composed, BenchError>,
) -> Result<(Composed, PictureRow), BenchError> {
    let mut row = PictureRow { tracer, passes: Vec::new(), different: 0.0 };
    let mut first: Option<Composed> = None;
    for _ in 0..rounds.max(1) {
        let made = make()?;
        if row.passes.is_empty() {
            let pass =
                |(pass, _): &(esvo_shadow::effects::Pass, _)| PassRow { pass: pass.name().into(), ms: Vec::new() };
            row.passes = made.passes.iter().map(pass).collect();
        }
        for (row, (_, time)) in row.passes.iter_mut().zip(&made.passes) {
            row.ms.push(time.as_secs_f64() * 1e3);
        }
        first.get_or_insert(made);
    }
    let first = first.unwrap_or_default();
    if let Some(expected) = expected {
        let differ = |(a, b): &(&Vec3, &Vec3)| (**a - **b).abs().max_element() > APART;
        row.different = first.light.iter().zip(expected).filter(differ).count() as f64 / expected.len().max(1) as f64;
    }
    Ok((first, row))
}

/// The world's size in metres, and how high its ground is at shares of it.
fn place(world: &World, x: f32, y: f32, above: f32) -> Vec3 {
    let size = world.volume().voxels().map(|n| n as f32 * world.grid().voxel as f32);
    let (x, y) = (x * size[0], y * size[1]);
    Vec3::new(x, y, height(x.into(), y.into()) as f32 + above)
}

/// From a hill over the houses.
fn frame(world: &World, size: (u32, u32)) -> Frame {
    let (from, to) = (place(world, 0.16, 0.1, 6.0), place(world, 0.4, 0.36, 0.0));
    let forward = (to - from).normalize();
    let right = forward.cross(Vec3::Z).normalize();
    let half = 0.6 * Vec2::new(size.0 as f32 / size.1 as f32, 1.0);
    let eye = Eye { position: from, right, up: right.cross(forward), forward, half, size };
    let color = |place: Vec3, normal: Vec3| {
        let ground = height(place.x.into(), place.y.into()) as f32;
        if place.z < ground + 0.15 {
            return Vec3::new(0.28, 0.4, 0.16);
        }
        if normal.z > 0.5 { Vec3::new(0.55, 0.2, 0.14) } else { Vec3::new(0.72, 0.66, 0.54) }
    };
    Frame::of_volume(eye, world.volume(), world.grid(), 150.0, &color)
}

/// Lamps among the houses, warm and cold, as large as a lantern.
fn lamps(world: &World) -> Vec<Lamp> {
    let lamp = |i: u32| {
        let (column, row) = ((i % 4) as f32, (i / 4) as f32);
        let color = if i % 3 == 1 { Vec3::new(10.0, 13.0, 20.0) } else { Vec3::new(20.0, 13.0, 6.0) };
        let position = place(world, 0.24 + 0.12 * column, 0.22 + 0.12 * row, 2.6);
        Lamp { position, radius: 0.15, color, reach: REACH, cone: None }
    };
    (0..LAMPS).map(lamp).collect()
}
