//! Pictures of octrees next to the triangles that they were built from, with the same view and light.

use std::path::PathBuf;
use std::sync::Arc;

use esvo_builder::{BuildSettings, TextureTest};
use esvo_core::exact::CameraRays;
use esvo_core::shading::{decode_srgb, encode_srgb, shade};
use esvo_core::{Camera, CastOptions, Caster, Picture, View};
use esvo_cpu::CpuCaster;
use esvo_format::Octree;
use esvo_scenes::SceneManifest;

use crate::error::image::image_error;
use crate::output::NamedPicture;
use crate::scene::{self, Scene};
use crate::scene_triangles::SceneTriangles;
use crate::seen::Seen;
use crate::system::machine::slug;
use crate::{BenchError, Progress};

/// Rays along each side of a pixel.
pub(crate) const RAYS: u32 = 2;

/// The pictures: title, scene, viewpoint, levels, whether the mesh is displaced.
const SHOWN: [(&str, &str, &str, u32, bool); 4] = [
    ("SIBENIK-D", "SIBENIK", "nave-east", 10, true),
    ("FLIGHT-HELMET", "FLIGHT-HELMET", "front", 11, false),
    ("FLIGHT-HELMET", "FLIGHT-HELMET", "goggles", 11, false),
    ("JUNGLE", "JUNGLE", "ground", 11, false),
];

/// What [`run_picture_bench`] makes.
#[derive(Clone, Debug)]
pub struct PictureBenchOptions {
    /// Titles of the pictures; empty: all.
    pub scenes: Vec<String>,
    /// Deepest level; `None`: each picture's own.
    pub levels: Option<u32>,
    /// Size of each half.
    pub size: [u32; 2],
    /// The folder that is searched first for real meshes.
    pub scenes_dir: Option<PathBuf>,
}

/// One picture. Its left half shows the octree, its right half the triangles.
#[derive(Clone, Debug)]
pub struct PicturePair {
    /// Name of the scene, with `-D` if it is displaced; followed by what the mesh is if it is not the listed one.
    pub scene: String,
    /// Name of the viewpoint.
    pub view: String,
    /// Deepest level.
    pub levels: u32,
    /// Voxels of the octree.
    pub voxels: u64,
    /// Triangles, after displacement.
    pub triangles: u64,
    /// Mean FLIP between the halves.
    pub flip: f64,
    /// Credit to print with the picture.
    pub credit: String,
    /// Whether the mesh is the one that the manifest names.
    pub identity: String,
    /// The picture and its file's name.
    pub picture: NamedPicture,
}

/// Makes the pictures one after the other and passes each to `done`.
///
/// # Errors
/// A scene without a picture, a mesh that cannot be used, a scene whose terms do not allow pictures, an error of `done`.
pub fn run_picture_bench(
    options: &PictureBenchOptions,
    progress: &Progress,
    mut done: impl FnMut(PicturePair) -> Result<(), BenchError>,
) -> Result<(), BenchError> {
    let mut titles: Vec<_> = SHOWN.iter().map(|s| s.0).collect();
    titles.dedup();
    if let Some(name) = options.scenes.iter().find(|n| !titles.iter().any(|t| t.eq_ignore_ascii_case(n))) {
        return Err(BenchError::scene(name, format!("has no picture; there are {}", titles.join(", "))));
    }
    let manifest = SceneManifest::builtin().map_err(|e| BenchError::scene("manifest", e))?;
    let mut last: Option<(&str, u32, Shown)> = None;
    for (title, name, view, levels, displaced) in SHOWN {
        if !options.scenes.is_empty() && !options.scenes.iter().any(|n| n.eq_ignore_ascii_case(title)) {
            continue;
        }
        let levels = options.levels.unwrap_or(levels);
        let shown = match last.take().filter(|(t, l, _)| (*t, *l) == (title, levels)) {
            Some((_, _, shown)) => shown,
            None => {
                progress.say(format!("{title}: reading the mesh"));
                let scene = Scene::load(scene::entry(&manifest, name)?, options.scenes_dir.as_deref(), usize::MAX)?;
                Shown::new(title, scene, levels, displaced, progress)?
            }
        };
        done(shown.pair(title, view, levels, options.size, progress)?)?;
        last = Some((title, levels, shown));
    }
    Ok(())
}

/// A scene with its octree.
struct Shown {
    scene: Scene,
    triangles: SceneTriangles,
    octree: Arc<Octree>,
    /// Triangles, after displacement.
    count: u64,
}

impl Shown {
    fn new(title: &str, scene: Scene, levels: u32, displaced: bool, progress: &Progress) -> Result<Self, BenchError> {
        if let Some(why) = scene.not_published {
            return Err(BenchError::scene(title, format!("pictures of it may not be published: {why}")));
        }
        progress.say(format!("{title}: {}", if displaced { "displacing" } else { "sorting triangles" }));
        let displacement = displaced.then(|| scene::displacement(&scene.mesh, levels));
        let triangles = SceneTriangles::new(title, &scene.mesh, displacement)?;
        progress.say(format!("{title}: building {levels} levels"));
        // Pictures are for looking at: build textures as fine as the level can show, and no finer.
        let settings = BuildSettings { levels, texture_test: TextureTest::Averages, ..scene.settings };
        let built = triangles.build(&scene.mesh, &settings, &|_| ()).map_err(|e| BenchError::scene(title, e))?;
        Ok(Self { triangles, octree: Arc::new(built.octree), count: built.stats.triangles as u64, scene })
    }

    fn pair(
        &self,
        title: &str,
        view: &str,
        levels: u32,
        [width, height]: [u32; 2],
        progress: &Progress,
    ) -> Result<PicturePair, BenchError> {
        let failed = |what: String| BenchError::scene(title, what);
        let named = self.scene.views.iter().find(|v| v.name == view);
        let camera = named.ok_or_else(|| failed(format!("it has no viewpoint {view} here")))?.camera;
        progress.say(format!("{title}: casting {view}"));
        let size = (width * RAYS, height * RAYS);
        let (octree, rays) = self.octree_picture(&camera, size).map_err(|e| failed(e.to_string()))?;
        progress.say(format!("{title}: the triangles from {view}"));
        let seen = self.triangles.see(&self.scene.mesh, &[rays]).map_err(|e| failed(e.to_string()))?;
        let [Seen { picture: triangles, .. }] = &seen[..] else { return Err(failed("no picture".into())) };
        let [left, right] = [&octree, triangles].map(smaller);
        let error = image_error(&right, &left).ok_or_else(|| failed("an empty picture".into()))?;
        let title = scene::title(title, self.scene.other.as_deref());
        let name = format!("{}-{}-{levels}.png", slug(&title), slug(view));
        Ok(PicturePair {
            scene: title,
            view: view.into(),
            levels,
            voxels: esvo_format::stats(&self.octree).voxels,
            triangles: self.count,
            flip: error.flip,
            credit: self.scene.credit.clone(),
            identity: self.scene.identity.clone(),
            picture: NamedPicture { name, picture: side_by_side(&left, &right) },
        })
    }

    fn octree_picture(&self, camera: &Camera, size: (u32, u32)) -> Result<(Picture, CameraRays), esvo_core::CastError> {
        let to_mesh = self.octree.octree_to_mesh(0);
        let root = self.octree.objects()[0].root_slot as u32;
        let view = View::new(camera, to_mesh, root, size, &CastOptions::default())?;
        let mut caster = CpuCaster::new(None)?;
        caster.load(&self.octree)?;
        let mut hits = Vec::new();
        caster.cast(&view, &mut hits)?;
        Ok((shade(&self.octree, &view, &hits), CameraRays::of_view(&view, to_mesh)))
    }
}

/// The picture reduced to one pixel for each square of rays, averaged in linear light.
fn smaller(picture: &Picture) -> Picture {
    let decoded: [f32; 256] = std::array::from_fn(|i| decode_srgb(i as f32 / 255.0));
    Picture::from_fn((picture.width / RAYS, picture.height / RAYS), |x, y| {
        let mut sum = [0.0; 3];
        for k in 0..RAYS * RAYS {
            let pixel = picture.pixel(x * RAYS + k % RAYS, y * RAYS + k / RAYS);
            (0..3).for_each(|c| sum[c] += decoded[usize::from(pixel[c])]);
        }
        sum.map(|c| encode_srgb(c / (RAYS * RAYS) as f32))
    })
}

/// Two pictures of equal height side by side, with a white line between them.
fn side_by_side(left: &Picture, right: &Picture) -> Picture {
    const LINE: u32 = 4;
    let (width, height) = (left.width + LINE + right.width, left.height.min(right.height));
    Picture::from_fn((width, height), |x, y| {
        let pixel = match x {
            _ if x < left.width => left.pixel(x, y),
            _ if x < left.width + LINE => [255; 3],
            _ => right.pixel(x - left.width - LINE, y),
        };
        pixel.map(|c| f32::from(c) / 255.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_keep_their_pixels_and_rays_are_averaged_in_linear_light() {
        let plain = |v: u8| Picture { width: 4, height: 2, rgb8: vec![v; 24] };
        let pair = side_by_side(&plain(10), &plain(200));
        assert_eq!((pair.width, pair.height), (12, 2));
        assert_eq!([pair.pixel(3, 1), pair.pixel(5, 0), pair.pixel(8, 1)], [[10; 3], [255; 3], [200; 3]]);
        let mut mixed = plain(0);
        mixed.rgb8[..6].fill(255);
        let small = smaller(&mixed);
        assert_eq!((small.width, small.height), (2, 1));
        // Half of the light of white.
        assert_eq!([small.pixel(0, 0), small.pixel(1, 0)], [[188; 3], [0; 3]]);
    }

    #[test]
    fn every_viewpoint_that_is_shown_exists_and_may_be() {
        let manifest = SceneManifest::builtin().unwrap();
        for (_, name, view, _, _) in SHOWN {
            let entry = manifest.scene(name).unwrap();
            assert!(entry.publish && entry.meshes[0].cameras.iter().any(|c| c.name == view), "{name} {view}");
        }
    }
}
