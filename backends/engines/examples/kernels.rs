//! Measures GPU kernels against each other: how many rays per second each casts at octrees of scenes, and whether each finds
//! what the processor finds.
//!
//! ```text
//! git show 357f175:backends/core/kernels/cast.wgsl > old.wgsl
//! cargo run --release -p esvo-engines --features wgpu,ash --example kernels -- \
//!     [--engines wgpu,ash] [--rounds N] [--size 1024x768] old=old.wgsl sibenik=sibenik.esvo ...
//! ```
//!
//! `NAME=FILE.wgsl` adds a kernel, without its prelude; the first of all is the one that is built in. `SCENE=FILE.esvo` is a
//! scene of the built-in manifest and an octree of it. Every viewpoint of the manifest is cast with contours, with contours and
//! beam, and with cubes; rays end at voxels of one pixel. All kernels cast each view in turn in every round. Printed is a table
//! of million rays per second over all viewpoints, by the least time of each view in the rounds: by the device's own clock, or of
//! processor time where the device is a driver that runs on the processor, so that other work on the machine does not count.

use std::sync::Arc;

use esvo_core::gpu::kernel::GpuOptions;
use esvo_core::{Camera, CastOptions, Caster, DeviceKind, Hit, View};
use esvo_engines::{EngineId, OpenOptions};
use esvo_format::Octree;
use esvo_scenes::{CameraSpec, SceneManifest, SceneVariant};

type Error = Box<dyn std::error::Error>;

const MODES: [(&str, CastOptions); 3] = [
    ("contours", CastOptions { contours: true, beam: false, max_voxel_pixels: 1.0 }),
    ("beam", CastOptions { contours: true, beam: true, max_voxel_pixels: 1.0 }),
    ("cubical", CastOptions { contours: false, beam: false, max_voxel_pixels: 1.0 }),
];

struct Arguments {
    engines: Vec<EngineId>,
    rounds: usize,
    size: (u32, u32),
    kernels: Vec<(String, Option<String>)>,
    scenes: Vec<(String, Arc<Octree>)>,
}

impl Arguments {
    fn parse() -> Result<Self, Error> {
        let mut parsed = Self {
            engines: vec![EngineId::Wgpu, EngineId::Ash],
            rounds: 3,
            size: (1024, 768),
            kernels: vec![("built-in".to_owned(), None)],
            scenes: Vec::new(),
        };
        let mut arguments = std::env::args().skip(1);
        while let Some(argument) = arguments.next() {
            let mut value = || arguments.next().ok_or_else(|| format!("{argument}: expected a value after it"));
            match argument.as_str() {
                "--engines" => parsed.engines = value()?.split(',').map(str::parse).collect::<Result<_, _>>()?,
                "--rounds" => parsed.rounds = value()?.parse::<usize>()?.max(1),
                "--size" => {
                    let text = value()?;
                    let (width, height) = text.split_once('x').ok_or("--size: expected WIDTHxHEIGHT")?;
                    parsed.size = (width.parse()?, height.parse()?);
                }
                _ => match argument.split_once('=') {
                    Some((name, path)) if path.ends_with(".wgsl") => {
                        let text = std::fs::read_to_string(path).map_err(|e| format!("{path}: {e}"))?;
                        parsed.kernels.push((name.to_owned(), Some(text)));
                    }
                    Some((scene, path)) => {
                        let octree = Octree::open(path.as_ref()).map_err(|e| format!("{path}: {e}"))?;
                        parsed.scenes.push((scene.to_owned(), Arc::new(octree)));
                    }
                    None => return Err(format!("{argument}: expected NAME=FILE.wgsl or SCENE=FILE.esvo").into()),
                },
            }
        }
        if parsed.scenes.is_empty() {
            return Err("expected at least one SCENE=OCTREE, e.g. sibenik=sibenik.esvo".into());
        }
        Ok(parsed)
    }
}

fn views(scene: &str, octree: &Octree, size: (u32, u32), options: &CastOptions) -> Result<Vec<View>, Error> {
    let manifest = SceneManifest::builtin()?;
    let entry = manifest.scene(scene).ok_or_else(|| format!("{scene}: the manifest has no such scene"))?;
    let mut cameras = entry.cameras(SceneVariant::Real);
    // The real HAIRBALL is not free to use: octrees of it are of the stand-in.
    if cameras.is_empty() || scene == "hairball" {
        cameras = entry.cameras(SceneVariant::StandIn);
    }
    let root = octree.objects()[0].root_slot as u32;
    let view = |spec: &CameraSpec| {
        let &CameraSpec { eye, forward, up, fov_degrees, near, far, .. } = spec;
        let camera = Camera { eye, forward, up, fov_degrees, near, far };
        Ok(View::new(&camera, octree.octree_to_mesh(0), root, size, options)?)
    };
    cameras.iter().map(view).collect()
}

/// Seconds that casting a view takes.
fn seconds(caster: &mut dyn Caster, view: &View) -> Result<f64, Error> {
    if caster.device().kind != DeviceKind::SoftwareGpu {
        return Ok(caster.time(view)?.total.as_secs_f64());
    }
    let start = processor_time();
    caster.time(view)?;
    Ok(processor_time() - start)
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

/// Pixels in which a kernel finds something else than the processor.
fn differences(caster: &mut dyn Caster, views: &[View], expected: &[Vec<Hit>]) -> Result<usize, Error> {
    let mut hits = Vec::new();
    let mut different = 0;
    for (view, expected) in views.iter().zip(expected) {
        caster.cast(view, &mut hits)?;
        let same = |(a, b): (&Hit, &Hit)| a.raw_t.to_bits() == b.raw_t.to_bits() && a.same_voxel(b);
        different += hits.iter().zip(expected).filter(|pair| !same(*pair)).count();
    }
    Ok(different)
}

fn main() -> Result<(), Error> {
    let Arguments { engines, rounds, size, kernels, scenes } = Arguments::parse()?;
    for engine in engines {
        let mut casters = Vec::new();
        for (_, kernel) in &kernels {
            let gpu = GpuOptions { kernel: kernel.clone(), ..GpuOptions::default() };
            casters.push(engine.open(&OpenOptions { gpu, ..OpenOptions::default() })?);
        }
        println!(
            "{engine} on {} ({}), {} x {}\n",
            casters[0].device().name,
            casters[0].device().detail,
            size.0,
            size.1
        );
        let names: Vec<_> = kernels.iter().map(|(name, _)| name.as_str()).collect();
        println!("| scene, mode, views | {} | differ |", names.join(" | "));
        println!("|---|{}--:|", "--:|".repeat(names.len()));
        for (scene, octree) in &scenes {
            let mut processor = EngineId::Cpu.open(&OpenOptions::default())?;
            processor.load(octree)?;
            for caster in &mut casters {
                caster.load(octree)?;
            }
            for (mode, options) in MODES {
                let views = views(scene, octree, size, &options)?;
                let mut expected = vec![Vec::new(); views.len()];
                for (view, hits) in views.iter().zip(&mut expected) {
                    processor.cast(view, hits)?;
                }
                let mut different = Vec::new();
                for caster in &mut casters {
                    different.push(differences(&mut **caster, &views, &expected)?.to_string());
                }
                let mut best = vec![vec![f64::MAX; views.len()]; casters.len()];
                for _ in 0..rounds {
                    for (k, view) in views.iter().enumerate() {
                        for (caster, best) in casters.iter_mut().zip(&mut best) {
                            best[k] = seconds(&mut **caster, view)?.min(best[k]);
                        }
                    }
                }
                let rays = views.len() as f64 * f64::from(size.0 * size.1);
                let rates = best.iter().map(|best| format!("{:.2}", rays / best.iter().sum::<f64>() / 1e6));
                let rates: Vec<_> = rates.collect();
                println!("| {scene}, {mode}, {} | {} | {} |", views.len(), rates.join(" | "), different.join(" "));
            }
        }
        println!();
    }
    Ok(())
}
