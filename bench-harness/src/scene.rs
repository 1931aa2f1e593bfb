//! Finding a scene by name: its mesh, viewpoints and settings.

use std::path::Path;
use std::time::Instant;

use esvo_builder::{BuildSettings, DisplaceOptions, Mesh};
use esvo_core::Camera;
use esvo_scenes::{CameraSpec, FoundScene, SceneEntry, SceneManifest, SceneVariant, locate_scene};
use serde::{Deserialize, Serialize};

use crate::BenchError;

/// A scene with its mesh in memory.
pub struct Scene {
    /// As in the manifest.
    pub name: String,
    /// Which of its two meshes this is.
    pub variant: SceneVariant,
    /// Whether the file is the one that the manifest names, or which generator made the mesh.
    pub identity: String,
    /// Credit line.
    pub credit: String,
    /// Whether pictures may be published.
    pub publish: bool,
    /// The mesh, not displaced.
    pub mesh: Mesh,
    /// Whether the mesh must be displaced before it is built.
    pub displaced: bool,
    /// Viewpoints; at least one.
    pub views: Vec<NamedView>,
    /// The paper's settings of the builder for the scene; levels and contours are the default's.
    pub settings: BuildSettings,
    /// Seconds to read or generate the mesh.
    pub seconds: f64,
}

/// A viewpoint.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct NamedView {
    /// Name in the manifest.
    pub name: String,
    /// In mesh units.
    pub camera: Camera,
}

/// The scene of that name in the manifest.
///
/// # Errors
/// The scene does not exist or cannot be measured; the text says why.
pub fn entry<'a>(manifest: &'a SceneManifest, name: &str) -> Result<&'a SceneEntry, BenchError> {
    let Some(entry) = manifest.scene(name) else {
        let names: Vec<_> = manifest.scenes.iter().map(|s| s.name.to_ascii_lowercase()).collect();
        return Err(BenchError::scene(name, format!("unknown scene; the scenes are {}", names.join(", "))));
    };
    if entry.displaced {
        let what =
            "displacement is not supported here; esvo build, esvo bench build and esvo bench pictures support it";
        return Err(BenchError::scene(&entry.name, what));
    }
    match &entry.unsupported {
        Some(why) => Err(BenchError::scene(&entry.name, format!("{why} is not supported yet"))),
        None => Ok(entry),
    }
}

/// Like [`entry`], for callers that displace meshes: also finds scenes with [`SceneEntry::displaced`].
///
/// # Errors
/// As for [`entry`], except that displaced scenes are no error.
pub fn buildable<'a>(manifest: &'a SceneManifest, name: &str) -> Result<&'a SceneEntry, BenchError> {
    match manifest.scene(name).filter(|e| e.displaced) {
        Some(displaced) => Ok(displaced),
        None => entry(manifest, name),
    }
}

/// The default displacement of a mesh for an octree of `levels`: a height of 1 (white) is 1/500 of the mesh's largest extent.
pub fn displacement(mesh: &Mesh, levels: u32) -> DisplaceOptions {
    let (low, high) = mesh.bounds().unwrap_or_default();
    let extent = (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max);
    DisplaceOptions::for_levels(mesh, levels, extent / 500.0)
}

/// The paper's settings of the builder for a scene; levels and contours are the default's.
pub fn settings(entry: &SceneEntry) -> BuildSettings {
    BuildSettings {
        color_error: entry.build.color_error,
        normal_error: entry.build.normal_error,
        contour_error: entry.build.contour_error,
        ..BuildSettings::default()
    }
}

/// The mesh of a scene and a description of its source. The real mesh is used if it is found and `stand_in` is false; its file
/// is not hashed.
///
/// # Errors
/// As for [`Scene::load`].
pub fn mesh(entry: &SceneEntry, scenes_dir: Option<&Path>, stand_in: bool) -> Result<(Mesh, String), BenchError> {
    let failed = |what: String| BenchError::scene(&entry.name, what);
    let found = if stand_in { None } else { esvo_scenes::find_scene_file(entry, scenes_dir) };
    if let Some(path) = found {
        let mesh = esvo_builder::import::load_mesh(&path).map_err(|e| failed(e.to_string()))?;
        return Ok((mesh, path.file_name().unwrap_or_default().to_string_lossy().into_owned()));
    }
    generate(entry)
}

/// The stand-in of a scene, and a description of its generator.
fn generate(entry: &SceneEntry) -> Result<(Mesh, String), BenchError> {
    let missing = || {
        BenchError::scene(
            &entry.name,
            "its mesh was not found, and it has no stand-in; give the folder of the mesh by --scenes-dir",
        )
    };
    let stand_in = entry.stand_in.as_ref().ok_or_else(missing)?;
    let mesh = stand_in.generate().ok_or_else(missing)?;
    Ok((mesh, format!("procedural, generator {}, seed {}", stand_in.generator, stand_in.seed)))
}

/// Viewpoints of a scene: those of the real mesh if it is found and `stand_in` is false, otherwise those of the stand-in.
///
/// # Errors
/// A mesh file that exists but cannot be read.
pub fn cameras(
    entry: &SceneEntry,
    scenes_dir: Option<&Path>,
    stand_in: bool,
) -> Result<(SceneVariant, Vec<NamedView>), BenchError> {
    let found = if stand_in { None } else { locate(entry, scenes_dir)? };
    let (variant, specs) = match &found {
        Some(found) => (SceneVariant::Real, &found.mesh.cameras[..]),
        None => (SceneVariant::StandIn, entry.cameras(SceneVariant::StandIn)),
    };
    Ok((variant, specs.iter().map(named_view).collect()))
}

fn locate<'a>(entry: &'a SceneEntry, scenes_dir: Option<&Path>) -> Result<Option<FoundScene<'a>>, BenchError> {
    locate_scene(entry, scenes_dir).map_err(|e| BenchError::scene(&entry.name, e))
}

impl Scene {
    /// Reads the real mesh if it is found in `scenes_dir`, `$ESVO_SCENES` or `../shared/scenes`; generates the stand-in
    /// otherwise. Takes at most `views` viewpoints.
    ///
    /// # Errors
    /// A mesh file that exists but cannot be read; a scene without a mesh file and without a stand-in.
    pub fn load(entry: &SceneEntry, scenes_dir: Option<&Path>, views: usize) -> Result<Self, BenchError> {
        let failed = |what: String| BenchError::scene(&entry.name, what);
        let start = Instant::now();
        let found = locate(entry, scenes_dir)?;
        let (variant, mesh, identity, cameras) = match &found {
            Some(found) => {
                let mesh = esvo_builder::import::load_mesh(&found.path).map_err(|e| failed(e.to_string()))?;
                (SceneVariant::Real, mesh, found.identity.to_string(), &found.mesh.cameras[..])
            }
            None => {
                let (mesh, identity) = generate(entry)?;
                (SceneVariant::StandIn, mesh, identity, entry.cameras(SceneVariant::StandIn))
            }
        };
        let views: Vec<_> = cameras.iter().take(views).map(named_view).collect();
        if views.is_empty() {
            return Err(failed("the manifest has no viewpoints for it".into()));
        }
        Ok(Self {
            name: entry.name.clone(),
            variant,
            identity,
            credit: match variant {
                SceneVariant::Real => entry.credit.clone(),
                SceneVariant::StandIn => "generated".into(),
            },
            publish: entry.publish || variant == SceneVariant::StandIn,
            mesh,
            displaced: entry.displaced,
            views,
            settings: settings(entry),
            seconds: start.elapsed().as_secs_f64(),
        })
    }
}

fn named_view(spec: &CameraSpec) -> NamedView {
    let CameraSpec { name, eye, forward, up, fov_degrees, near, far } = spec.clone();
    NamedView { name, camera: Camera { eye, forward, up, fov_degrees, near, far } }
}
