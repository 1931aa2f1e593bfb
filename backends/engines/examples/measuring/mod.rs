//! What the examples that run GPU kernels have in common: modes, views of scenes, and processor time.
#![allow(dead_code, reason = "no example uses all of it")]

use esvo_core::{Camera, CastOptions, View};
use esvo_format::Octree;
use esvo_scenes::{CameraSpec, SceneManifest, SceneVariant};

pub(crate) type Error = Box<dyn std::error::Error>;

pub(crate) const MODES: [(&str, CastOptions); 3] = [
    ("contours", CastOptions { contours: true, beam: false, max_voxel_pixels: 1.0 }),
    ("beam", CastOptions { contours: true, beam: true, max_voxel_pixels: 1.0 }),
    ("cubical", CastOptions { contours: false, beam: false, max_voxel_pixels: 1.0 }),
];

/// All viewpoints of a scene of the built-in manifest.
pub(crate) fn views(scene: &str, octree: &Octree, size: (u32, u32), options: &CastOptions) -> Result<Vec<View>, Error> {
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

/// Seconds that the threads of this process have run on a processor, as Linux counts them.
pub(crate) fn processor_time() -> f64 {
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let nanoseconds = tasks.filter_map(|task| {
        let text = std::fs::read_to_string(task.path().join("schedstat")).ok()?;
        text.split_whitespace().next()?.parse::<u64>().ok()
    });
    nanoseconds.sum::<u64>() as f64 * 1e-9
}
