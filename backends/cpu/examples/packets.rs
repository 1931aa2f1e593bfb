//! Measures how many rays per second each instruction set casts against octrees of scenes, on one thread, and checks that
//! all find the same.
//!
//! ```text
//! cargo run --release -p esvo-cpu --example packets -- [--rounds N] [--sets scalar,AVX2] sibenik=sibenik.esvo ...
//! ```
//!
//! An argument is the name of a scene of the built-in manifest and an octree of it. Every viewpoint of the manifest is cast at
//! 1024 x 768 with contours, with contours and beam, and with cubes. All are cast in turn in every round; what is printed is
//! the median of the rounds in million rays per second of processor time, over all viewpoints.

use std::sync::Arc;

use esvo_core::{Camera, CastOptions, Caster, Hit, View};
use esvo_cpu::{CpuCaster, InstructionSet};
use esvo_format::Octree;
use esvo_scenes::{SceneManifest, SceneVariant};

const SIZE: (u32, u32) = (1024, 768);

const MODES: [(&str, CastOptions); 3] = [
    ("contours", CastOptions { contours: true, beam: false, max_voxel_pixels: 1.0 }),
    ("beam", CastOptions { contours: true, beam: true, max_voxel_pixels: 1.0 }),
    ("cubical", CastOptions { contours: false, beam: false, max_voxel_pixels: 1.0 }),
];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut rounds = 5;
    let mut sets: Vec<InstructionSet> = InstructionSet::available().collect();
    let mut scenes = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match (argument.as_str(), argument.split_once('=')) {
            ("--rounds", _) => rounds = arguments.next().ok_or("--rounds: expected a number")?.parse()?,
            ("--sets", _) => {
                let names = arguments.next().ok_or("--sets: expected names")?;
                sets.retain(|set| names.split(',').any(|name| name == set.name()));
            }
            (_, Some((scene, path))) => scenes.push((scene.to_owned(), path.to_owned())),
            _ => return Err(format!("{argument}: expected SCENE=OCTREE").into()),
        }
    }
    let manifest = SceneManifest::builtin()?;
    for (name, path) in scenes {
        let octree = Arc::new(Octree::open(path.as_ref())?);
        let entry = manifest.scene(&name).ok_or("no such scene in the manifest")?;
        let mut cameras = entry.cameras(SceneVariant::Real);
        if cameras.is_empty() || name == "hairball" {
            cameras = entry.cameras(SceneVariant::StandIn);
        }
        let mut casters = Vec::new();
        for set in &sets {
            let mut caster = CpuCaster::with_instructions(Some(1), *set)?;
            caster.load(&octree)?;
            casters.push(caster);
        }
        for (mode, options) in MODES {
            let views: Vec<View> = cameras
                .iter()
                .map(|spec| {
                    let camera = Camera {
                        eye: spec.eye,
                        forward: spec.forward,
                        up: spec.up,
                        fov_degrees: spec.fov_degrees,
                        near: spec.near,
                        far: spec.far,
                    };
                    let root = octree.objects()[0].root_slot as u32;
                    View::new(&camera, octree.octree_to_mesh(0), root, SIZE, &options)
                })
                .collect::<Result<_, _>>()?;
            let mut seconds = vec![Vec::new(); casters.len()];
            for _ in 0..rounds {
                let mut total = vec![0.0; casters.len()];
                for view in &views {
                    for (caster, total) in casters.iter_mut().zip(&mut total) {
                        let start = processor_time();
                        caster.time(view)?;
                        *total += processor_time() - start;
                    }
                }
                seconds.iter_mut().zip(total).for_each(|(all, total)| all.push(total));
            }
            let mut different = 0;
            let (mut first, mut other) = (Vec::new(), Vec::new());
            for view in &views {
                casters[0].cast(view, &mut first)?;
                for caster in &mut casters[1..] {
                    caster.cast(view, &mut other)?;
                    let same = |(a, b): (&Hit, &Hit)| a.raw_t.to_bits() == b.raw_t.to_bits() && a.same_voxel(b);
                    different += first.iter().zip(&other).filter(|pair| !same(*pair)).count();
                }
            }
            print!("{name:<11} {mode:<9}");
            for (set, seconds) in sets.iter().zip(&mut seconds) {
                seconds.sort_by(f64::total_cmp);
                let rays = views.len() as f64 * f64::from(SIZE.0 * SIZE.1);
                print!(" {set} {:.2}", rays / seconds[seconds.len() / 2] / 1e6);
            }
            println!("   {} views, {different} hits differ", views.len());
        }
    }
    Ok(())
}

/// Seconds that the threads of this process have run on a processor, as Linux counts them.
fn processor_time() -> f64 {
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let nanoseconds = tasks.filter_map(|task| {
        let text = std::fs::read_to_string(task.path().join("schedstat")).ok()?;
        text.split_whitespace().next()?.parse::<u64>().ok()
    });
    nanoseconds.sum::<u64>() as f64 * 1e-9
}
