//! Measures what the hierarchy over instances saves.
//!
//! ```text
//! cargo run --release -p esvo-engines --features wgpu,ash --example instances -- \
//!     FILE.esvo [--count 1000] [--size 320x240] [--frames 3] [--engines cpu,wgpu,ash] [--list list.toml]
//! ```
//!
//! The octree's first object is placed `count` times in a cloud, turned and scaled, each moving from frame to frame. Every frame is
//! cast with the hierarchy (`Caster::cast_instances`) and with each instance cast whole and the nearest hit taken
//! (`Nearest::cast`). Printed are the medians of the frames' wall times, with the copies of hits, how many instances' rectangles a
//! pixel is in, the pixels that differ (another voxel, `t` or instance: none may), and the memory of the octree and the hierarchy. The
//! last column is a negative control: the pixels that differ from the frame before. Exit code 1 if any pixel differs, or if the
//! control shows none. `--list` writes the first frame as a scene list for `esvo render` and measures nothing.

use std::process::ExitCode;
use std::sync::Arc;
use std::time::{Duration, Instant};

use esvo_core::camera::viewpoint::overview_of;
use esvo_core::glam::{DMat4, DQuat, DVec3};
use esvo_core::testing::sample::Noise;
use esvo_core::{CastOptions, Instances, Nearest, Object, View};
use esvo_engines::{EngineId, OpenOptions};
use esvo_format::Octree;

type Error = Box<dyn std::error::Error>;

/// Where the instances are in a frame: in a cube whose edge lets an instance have three times its own volume.
fn places(octree: &Octree, count: usize, frame: u32) -> Vec<DMat4> {
    let edge = octree.octree_to_mesh(0).transform_vector3(DVec3::X).length();
    let middle = octree.octree_to_mesh(0).transform_point3(DVec3::splat(0.5));
    let half = edge * (3.0 * count as f64).cbrt() / 2.0;
    let mut noise = Noise(5);
    (0..count)
        .map(|_| {
            let mut number = |low: f64, high: f64| low + (high - low) * noise.number();
            let mut vector = |half: f64| DVec3::from(std::array::from_fn(|_| number(-half, half)));
            let (at, way, axis) = (vector(half), vector(edge * 0.3), vector(1.0));
            let (angle, size) = (number(0.0, 6.3) + f64::from(frame) * 0.1, number(0.6, 1.2));
            DMat4::from_translation(at + way * f64::from(frame))
                * DMat4::from_quat(DQuat::from_axis_angle(axis.normalize(), angle))
                * DMat4::from_scale(DVec3::splat(size))
                * DMat4::from_translation(-middle)
        })
        .collect()
}

/// A scene list of these places.
fn scene_list(file: &str, places: &[DMat4]) -> String {
    let place = |place: &DMat4| {
        let rows = place.transpose().to_cols_array_2d();
        format!("\n[[place]]\nfile = {file:?}\nobject = 1\nmatrix = {rows:?}\n")
    };
    "version = 1\n".to_owned() + &places.iter().map(place).collect::<String>()
}

/// Pixels that end otherwise.
fn differences(a: &Nearest, b: &Nearest) -> usize {
    let pixels = a.hits.iter().zip(&b.hits).zip(a.views.iter().zip(&b.views));
    pixels.filter(|((a, b), (whose, other))| !a.same_voxel(b) || a.raw_t != b.raw_t || whose != other).count()
}

fn median(mut times: Vec<Duration>) -> f64 {
    times.sort_unstable();
    times[times.len() / 2].as_secs_f64() * 1e3
}

fn main() -> Result<ExitCode, Error> {
    let mut arguments = std::env::args().skip(1);
    let file = arguments.next().ok_or("give an octree")?;
    let (mut count, mut size, mut frames, mut engines) = (1000, (320, 240), 3, "cpu,wgpu,ash".to_owned());
    let mut list = None;
    while let Some(option) = arguments.next() {
        let value = arguments.next().ok_or_else(|| format!("{option}: give a value"))?;
        match option.as_str() {
            "--count" => count = value.parse()?,
            "--frames" => frames = value.parse::<u32>()?.max(2),
            "--engines" => engines = value,
            "--list" => list = Some(value),
            "--size" => {
                let (width, height) = value.split_once('x').ok_or("--size: expected WxH")?;
                size = (width.parse()?, height.parse()?);
            }
            _ => return Err(format!("{option}: unknown").into()),
        }
    }
    let octree = Arc::new(Octree::open(file.as_ref())?);
    let first = places(&octree, count, 0);
    if let Some(list) = list {
        std::fs::write(list, scene_list(&std::fs::canonicalize(&file)?.to_string_lossy(), &first))?;
        return Ok(ExitCode::SUCCESS);
    }
    let objects: Vec<Object> = first.iter().map(|place| Object::of(&octree, 0).placed(*place)).collect();
    let camera = overview_of(&objects, [0.0, 1.0, 0.0], 60.0, f64::from(size.0) / f64::from(size.1));
    let views = |frame: u32| -> Result<Vec<View>, Error> {
        let place = |place| Object::of(&octree, 0).placed(place).view(&camera, size, &CastOptions::default());
        Ok(places(&octree, count, frame).into_iter().map(place).collect::<Result<_, _>>()?)
    };
    println!("{count} instances of {file}, {} x {} pixels, {frames} frames\n", size.0, size.1);
    println!(
        "| engine | device | octree, MB | hierarchy, kB | hierarchy, ms | cast, ms | each alone, ms | times faster | rectangles per pixel | hit | differ | control |"
    );
    println!("|---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|");
    let mut right = true;
    for name in engines.split(',') {
        let engine: EngineId = name.parse()?;
        let mut caster = engine.open(&OpenOptions::default())?;
        caster.load(&octree)?;
        let (mut building, mut together, mut alone) = (Vec::new(), Vec::new(), Vec::new());
        let (mut differ, mut control, mut casts, mut hits, mut nodes) = (0, 0, 0, 0, 0);
        let mut before = Nearest::default();
        // The first time, kernels are compiled and memory is touched.
        caster.cast_instances(&Instances::new(views(0)?)?, &mut before)?;
        caster.cast(&views(0)?[0], &mut Vec::new())?;
        for frame in 1..=frames {
            let views = views(frame)?;
            let start = Instant::now();
            let instances = Instances::new(views.clone())?;
            building.push(start.elapsed());
            let mut ours = Nearest::default();
            ours.resize(&views[0]);
            let start = Instant::now();
            caster.cast_instances(&instances, &mut ours)?;
            together.push(start.elapsed());
            let start = Instant::now();
            let theirs = Nearest::cast(&mut *caster, &views)?;
            alone.push(start.elapsed());
            differ += differences(&ours, &theirs);
            control += differences(&before, &theirs);
            hits += ours.hits.iter().filter(|hit| !hit.is_miss()).count();
            casts += casts_of(&instances);
            nodes = size_of_val(instances.nodes());
            before = ours;
        }
        let pixels = f64::from(size.0 * size.1) * f64::from(frames);
        let (cast, each) = (median(together), median(alone));
        println!(
            "| {} | {} | {:.1} | {:.0} | {:.2} | {cast:.1} | {each:.0} | {:.0} | {:.2} | {:.0} % | {differ} | {control} |",
            caster.name(),
            caster.device().name,
            caster.resident_bytes() as f64 / 1e6,
            nodes as f64 / 1e3,
            median(building),
            each / cast,
            casts as f64 / pixels,
            100.0 * hits as f64 / pixels
        );
        right &= differ == 0 && control != 0;
    }
    Ok(if right { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// How many rectangles the pixels are in: as often a ray would be cast if none ended at a hit.
fn casts_of(instances: &Instances) -> usize {
    let areas = instances.nodes().iter().filter(|node| node.number != esvo_core::instances::NO_INSTANCE);
    areas.map(|node| ((node.high[0] - node.low[0] + 1) * (node.high[1] - node.low[1] + 1)) as usize).sum()
}
