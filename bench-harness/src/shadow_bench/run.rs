//! The measurement, part after part.

use std::time::Instant;

use super::device::Device;
use super::picture_time::picture_time;
use super::pictures::Pictures;
use super::stage::Stage;
use super::{SCHEMA, SceneShadows, ShadowOptions, ShadowOutcome, ShadowReport, VolumeRow, errors, leaks, rates, world};
use crate::matrix_parts::LeftOut;
use crate::scene::{self, Scene};
use crate::system::machine::Machine;
use crate::{BenchError, Progress};

/// The most voxels of the world that objects move in: bytes of 2 GB, with a copy to compare with.
const MOST_VOXELS: u64 = 1 << 33;

/// The most pixels of a picture.
const MOST_PIXELS: u64 = 1 << 23;
/// The size of a picture of the world that is not made: records from before there was one have it.
const NO_PICTURE: (u32, u32) = (0, 0);
/// The most rays for each pixel.
const MOST_RAYS: u32 = 1 << 16;
/// The most rays in closed rooms: days of work.
const MOST_LEAK_RAYS: u64 = 100_000_000_000;

/// Measures all parts.
///
/// # Errors
/// A number out of its range; a scene that cannot be used; not enough memory.
pub fn run_shadow_bench(options: &ShadowOptions, progress: &Progress) -> Result<ShadowOutcome, BenchError> {
    check(options)?;
    let start = Instant::now();
    let manifest = scene::manifest(None)?;
    let mut left_out = Vec::new();
    let mut stages = Vec::new();
    for name in &options.scenes {
        let entry = scene::entry(&manifest, name)?;
        match scene::left_out(entry, options.scenes_dir.as_deref(), options.scenes.len())? {
            Some(absent) => left_out.push(absent),
            None => stages.push(entry),
        }
    }
    let (mut large, row) = world::large_world(options.world, progress)?;
    let device = Device::open();
    if let Err(error) = &device {
        left_out.push(LeftOut { what: "a GPU".into(), reason: error.to_string() });
    }
    let device = device.ok();
    let moving = world::moving(&mut large, device.as_ref(), progress)?;
    let mut pictures = Pictures::new(options.size);
    let picture = match options.picture {
        NO_PICTURE => None,
        _ => {
            let (time, shown, light) = picture_time(&large, device.as_ref(), options, progress)?;
            if options.pictures {
                pictures.world(&shown.frame, &light);
            }
            Some(time)
        }
    };
    drop(large);
    let leaks = leaks::leaks(options.leak_rays, progress)?;
    let mut scenes = Vec::new();
    for entry in stages {
        progress.say(format!("{}: reading the mesh", entry.name));
        let scene = Scene::load(entry, options.scenes_dir.as_deref(), 1)?;
        progress.say(format!("{}: building the octree", entry.name));
        let stage = Stage::new(scene, options.levels)?;
        let frame = stage.frame(options.size)?;
        let mut volumes = Vec::new();
        let mut worlds = Vec::new();
        for &voxel_cm in &options.voxels_cm {
            progress.say(format!("{}: voxels of {voxel_cm} cm", entry.name));
            let start = Instant::now();
            let world = stage.world(voxel_cm, 2)?;
            volumes.push(VolumeRow {
                voxel_cm,
                voxels: world.volume().voxels(),
                bytes: world.volume().bytes(),
                brick_bytes: world.fixed().bytes(),
                fill_seconds: start.elapsed().as_secs_f64(),
            });
            worlds.push((voxel_cm, world));
        }
        let rates = rates::rates(&stage, &frame, device.as_ref(), options, progress)?;
        let errors = errors::errors(&stage, &frame, &worlds, options, progress)?;
        if options.pictures && stage.scene.not_published.is_none() {
            progress.say(format!("{}: pictures", entry.name));
            pictures.scene(&stage, options.base())?;
        }
        scenes.push(SceneShadows {
            name: stage.scene.name.clone(),
            identity: stage.scene.identity.clone(),
            credit: stage.scene.credit.clone(),
            view: stage.view().name.clone(),
            volumes,
            rates,
            errors,
        });
    }
    if options.pictures {
        progress.say("pictures of the courtyard");
        pictures.courtyard()?;
    }
    let report = ShadowReport {
        schema: SCHEMA,
        machine: Machine::detect(),
        options: options.clone(),
        left_out,
        world: row,
        moving,
        picture,
        leaks,
        scenes,
        pictures: pictures.notes,
        seconds: start.elapsed().as_secs_f64(),
    };
    Ok(ShadowOutcome { report, pictures: pictures.made })
}

fn check(options: &ShadowOptions) -> Result<(), BenchError> {
    let bad = |option: &str, what: String| Err(BenchError::option(option, what));
    if let Some(voxel) = options.voxels_cm.iter().find(|voxel| !(**voxel >= 0.5 && **voxel <= 400.0)) {
        return bad("--voxels", format!("voxels of {voxel} cm were asked for; their edge is 0.5 to 400 cm"));
    }
    if options.voxels_cm.is_empty() {
        return bad("--voxels", "none was given; give at least one".into());
    }
    if options.rays.is_empty() {
        return bad("--rays", "none was given; give at least one".into());
    }
    for (option, numbers) in [("--rays", &options.rays[..]), ("--converged", &[options.converged])] {
        if let Some(rays) = numbers.iter().find(|rays| !(1..=MOST_RAYS).contains(*rays)) {
            return bad(option, format!("{rays} rays for each pixel were asked for; there are 1 to {MOST_RAYS}"));
        }
    }
    if options.rounds == 0 {
        return bad("--rounds", "0 rounds were asked for; the least is 1".into());
    }
    if options.leak_rays > MOST_LEAK_RAYS {
        let rays = options.leak_rays;
        return bad("--leak-rays", format!("{rays} rays in closed rooms were asked for; the most is {MOST_LEAK_RAYS}"));
    }
    if !(1..=16).contains(&options.levels) {
        return bad("--levels", format!("an octree of {} levels was asked for; there are 1 to 16", options.levels));
    }
    let voxels: u64 = options.world.iter().map(|&n| u64::from(n)).product();
    if voxels > MOST_VOXELS || options.world.iter().any(|n| !(64..=esvo_shadow::MAX_VOXELS).contains(n)) {
        let [x, y, z] = options.world;
        let what = format!(
            "a world of {x} x {y} x {z} voxels was asked for; it has 64 to {} along each axis and at most {MOST_VOXELS} in all",
            esvo_shadow::MAX_VOXELS
        );
        return bad("--world", what);
    }
    for (option, (width, height)) in [("--size", options.size), ("--picture", options.picture)] {
        let none = option == "--picture" && (width, height) == NO_PICTURE;
        if !none && (width == 0 || height == 0) || u64::from(width) * u64::from(height) > MOST_PIXELS {
            let what = format!("pictures of {width}x{height} were asked for; they have 1 to {MOST_PIXELS} pixels");
            return bad(option, what);
        }
    }
    Ok(())
}
