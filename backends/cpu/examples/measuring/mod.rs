//! What the examples that measure casting have in common: arguments, views of scenes, and processor time.
#![allow(dead_code, reason = "no example uses all of it")]

use std::sync::Arc;

use esvo_core::{Camera, CastOptions, View};
use esvo_cpu::InstructionSet;
use esvo_format::Octree;
use esvo_scenes::{CameraSpec, SceneManifest, SceneVariant};

pub(crate) const SIZE: (u32, u32) = (1024, 768);

pub(crate) const MODES: [(&str, CastOptions); 3] = [
    ("contours", CastOptions { contours: true, beam: false, max_voxel_pixels: 1.0 }),
    ("beam", CastOptions { contours: true, beam: true, max_voxel_pixels: 1.0 }),
    ("cubical", CastOptions { contours: false, beam: false, max_voxel_pixels: 1.0 }),
];

pub(crate) type Error = Box<dyn std::error::Error>;

/// What the command line asks for: rounds, instruction sets, and octrees with the names of their scenes.
pub(crate) struct Arguments {
    pub(crate) rounds: usize,
    pub(crate) sets: Vec<InstructionSet>,
    pub(crate) scenes: Vec<(String, Arc<Octree>)>,
}

impl Arguments {
    pub(crate) fn parse() -> Result<Self, Error> {
        let (mut rounds, mut scenes) = (5, Vec::new());
        let mut sets: Vec<InstructionSet> = InstructionSet::available().collect();
        let mut arguments = std::env::args().skip(1);
        while let Some(argument) = arguments.next() {
            match (argument.as_str(), argument.split_once('=')) {
                ("--rounds", _) => {
                    let number = arguments.next().and_then(|number| number.parse().ok()).filter(|number| *number > 0);
                    rounds = number.ok_or("--rounds: expected a number above 0")?;
                }
                ("--sets", _) => {
                    let names = arguments.next().ok_or("--sets: expected names, separated by commas")?;
                    let find =
                        |name: &str| InstructionSet::available().find(|set| set.name().eq_ignore_ascii_case(name));
                    sets = names
                        .split(',')
                        .map(|name| find(name).ok_or_else(|| format!("--sets: this processor has no {name}").into()))
                        .collect::<Result<_, Error>>()?;
                }
                (_, Some((scene, path))) => {
                    let octree = Octree::open(path.as_ref()).map_err(|e| format!("{path}: {e}"))?;
                    scenes.push((scene.to_owned(), Arc::new(octree)));
                }
                _ => return Err(format!("{argument}: expected --rounds, --sets or SCENE=OCTREE").into()),
            }
        }
        if scenes.is_empty() {
            return Err("expected at least one SCENE=OCTREE, e.g. sibenik=sibenik.esvo".into());
        }
        Ok(Self { rounds, sets, scenes })
    }
}

/// All viewpoints of a scene of the built-in manifest.
pub(crate) fn views(scene: &str, octree: &Octree, options: &CastOptions) -> Result<Vec<View>, Error> {
    let manifest = SceneManifest::builtin()?;
    let entry = manifest.scene(scene).ok_or_else(|| format!("{scene}: the manifest has no such scene"))?;
    let mut cameras = entry.cameras(SceneVariant::Real);
    // The real HAIRBALL is not free to use: octrees of it are of the stand-in.
    if cameras.is_empty() || scene == "hairball" {
        cameras = entry.cameras(SceneVariant::StandIn);
    }
    let root = octree.objects()[0].root_slot as u32;
    let view = |spec| Ok(View::new(&camera(spec), octree.octree_to_mesh(0), root, SIZE, options)?);
    cameras.iter().map(view).collect()
}

/// The camera of a viewpoint.
pub(crate) fn camera(spec: &CameraSpec) -> Camera {
    let &CameraSpec { eye, forward, up, fov_degrees, near, far, .. } = spec;
    Camera { eye, forward, up, fov_degrees, near, far }
}

/// Prints what was measured, where and by which command. `features` are the options of cargo that name them.
pub(crate) fn title(what: &str, example: &str, features: &str) {
    let command: Vec<String> = std::env::args().skip(1).collect();
    println!("# {what}\n\n{}, {} x {}.\n\n```text", esvo_cpu::cpu_name(), SIZE.0, SIZE.1);
    println!("cargo run --release -p esvo-cpu{features} --example {example} -- {}\n```\n", command.join(" "));
}

/// Seconds that the threads of this process have run on a processor, as Linux counts them.
pub(crate) fn processor_time() -> f64 {
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let nanoseconds = tasks.filter_map(|task| {
        let text = std::fs::read_to_string(task.path().join("schedstat")).ok()?;
        text.split_whitespace().next()?.parse::<u64>().ok()
    });
    nanoseconds.sum::<u64>() as f64 * 1e-9
}
