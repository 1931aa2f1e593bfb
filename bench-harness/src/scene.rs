//! Finding a scene by name: its mesh, viewpoints and settings.

use std::path::Path;
use std::time::Instant;

use esvo_builder::{BuildSettings, DisplaceOptions, Mesh};
use esvo_core::Camera;
use esvo_scenes::{CameraSpec, FoundScene, SceneEntry, SceneManifest, SceneVariant, StandIn, locate_scene};
use glam::{DMat4, DVec4};
use serde::{Deserialize, Serialize};

use crate::BenchError;
use crate::matrix_parts::LeftOut;

/// A scene with its mesh in memory.
pub struct Scene {
    /// As in the manifest; for [`SceneVariant::Other`] followed by what the mesh is: see [`title`].
    pub name: String,
    /// Which of its meshes this is.
    pub variant: SceneVariant,
    /// What the mesh is called if it has the listed file's name but not its content: `another mesh, cube.obj, sha256 ...`.
    pub other: Option<String>,
    /// Whether the file is the one that the manifest names, or which generator made the mesh.
    pub identity: String,
    /// Credit line.
    pub credit: String,
    /// Why pictures may not be published; `None` if they may.
    pub not_published: Option<&'static str>,
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

/// The manifest of the paper's scenes, or one of the user's own.
///
/// # Errors
/// A file that cannot be read or is no manifest.
pub fn manifest(own: Option<&Path>) -> Result<SceneManifest, BenchError> {
    let read = own.map_or_else(SceneManifest::builtin, SceneManifest::load);
    read.map_err(|e| BenchError::scene("manifest", e))
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
        let what = "displacement is not supported here; esvo build, esvo bench, esvo bench build and esvo bench pictures support it";
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

/// Why a scene of several is left out: its mesh is not there and it has no stand-in. `None`: it is there, or is the only one, so that
/// loading it says why it cannot be measured.
///
/// # Errors
/// A mesh file that exists but cannot be read.
pub(crate) fn left_out(
    entry: &SceneEntry,
    scenes_dir: Option<&Path>,
    scenes: usize,
) -> Result<Option<LeftOut>, BenchError> {
    let why = if scenes > 1 { SceneSource::find(entry, scenes_dir, false)?.absent() } else { None };
    Ok(why.map(|reason| LeftOut { what: entry.name.clone(), reason }))
}

/// The name of a scene in tables, records and messages: `SIBENIK`, or `SIBENIK: another mesh, cube.obj, sha256 0123456789ab` if
/// its mesh is not the listed one.
pub fn title(name: &str, other: Option<&str>) -> String {
    other.map_or_else(|| name.to_owned(), |other| format!("{name}: {other}"))
}

/// The name by which figures of the paper and its authors are found; empty for a mesh that they were not measured on.
pub(crate) fn compared_as(name: &str, mesh: SceneVariant) -> &str {
    if mesh == SceneVariant::Other { "" } else { name }
}

/// Where the mesh of a scene comes from.
pub struct SceneSource<'a> {
    entry: &'a SceneEntry,
    /// The mesh file; `None`: the stand-in.
    found: Option<FoundScene<'a>>,
    /// Whether the stand-in was asked for.
    stand_in: bool,
}

impl<'a> SceneSource<'a> {
    /// The real mesh's file if it is found and `stand_in` is false, otherwise the stand-in. The file is hashed, but not loaded.
    ///
    /// # Errors
    /// A mesh file that exists but cannot be read.
    pub fn find(entry: &'a SceneEntry, scenes_dir: Option<&Path>, stand_in: bool) -> Result<Self, BenchError> {
        let locate = || locate_scene(entry, scenes_dir).map_err(|e| BenchError::scene(&entry.name, e));
        Ok(Self { entry, found: if stand_in { None } else { locate()? }, stand_in })
    }

    /// Whether the stand-in is used because the mesh file was not found.
    pub fn is_replaced(&self) -> bool {
        self.found.is_none() && !self.stand_in && self.entry.stand_in.is_some()
    }

    /// Why the mesh file was not found, and what to do if something can be done.
    pub fn missing(&self) -> String {
        match (&self.entry.folder, self.entry.meshes.first()) {
            (_, None) => "the manifest lists no mesh file for it".into(),
            (Some(folder), Some(mesh)) => format!("{} does not exist", folder.join(&mesh.file).display()),
            (None, Some(_)) => "its mesh was not found; give the folder of the mesh by --scenes-dir".into(),
        }
    }

    /// Why there is neither a mesh file nor a stand-in; `None` if there is one of them.
    pub fn absent(&self) -> Option<String> {
        match (&self.found, &self.entry.stand_in) {
            (Some(_), _) | (_, Some(_)) => None,
            (None, None) if self.stand_in => Some("it has no stand-in".into()),
            (None, None) => Some(format!("it has no stand-in, and {}", self.missing())),
        }
    }

    /// Which mesh it is.
    pub fn variant(&self) -> SceneVariant {
        self.found.as_ref().map_or(SceneVariant::StandIn, FoundScene::variant)
    }

    /// What the mesh is called if it is not the listed one, as in [`Scene::other`].
    pub fn other(&self) -> Option<String> {
        self.found.as_ref().and_then(FoundScene::other_name)
    }

    /// The mesh in one line: whether the file is the one that the manifest names, or which generator makes the mesh.
    pub fn identity(&self) -> String {
        let identity = match (&self.found, &self.entry.stand_in) {
            (Some(found), _) => found.identity.to_string(),
            (None, Some(made)) => format!("procedural, generator {}, seed {}", made.generator, made.seed),
            (None, None) => return "absent".into(),
        };
        if self.entry.textures { identity } else { format!("{identity}, without textures") }
    }

    /// The mesh in a few words, as octree files store it: the name of the file, the generator, or what another mesh is called.
    pub fn source(&self) -> String {
        let name = |found: &FoundScene| found.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let Some(source) = self.other().or_else(|| self.found.as_ref().map(name)) else { return self.identity() };
        if self.entry.textures { source } else { format!("{source}, without textures") }
    }

    /// All viewpoints, in the units of the mesh. For another mesh: those of the listed one.
    pub fn views(&self) -> Vec<NamedView> {
        let specs = match &self.found {
            Some(found) => &found.mesh.cameras[..],
            None => self.entry.cameras(SceneVariant::StandIn),
        };
        specs.iter().map(named_view).collect()
    }

    /// Reads or generates the mesh.
    ///
    /// # Errors
    /// A mesh file that cannot be read; a scene without a mesh file and without a stand-in.
    pub fn load(&self) -> Result<Mesh, BenchError> {
        let mut mesh = self.load_with_textures()?;
        if !self.entry.textures {
            drop_textures(&mut mesh);
        }
        Ok(mesh)
    }

    fn load_with_textures(&self) -> Result<Mesh, BenchError> {
        let failed = |what: &dyn ToString| BenchError::scene(&self.entry.name, what.to_string());
        if let Some(found) = &self.found {
            let mut mesh = esvo_builder::import::load_mesh(&found.path).map_err(|e| failed(&e))?;
            if let Some(rows) = found.mesh.transform {
                let row = |i: usize| DVec4::from_array(rows[i]);
                mesh.transform(&DMat4::from_cols(row(0), row(1), row(2), DVec4::W).transpose());
            }
            return Ok(mesh);
        }
        if let Some(why) = self.absent() {
            return Err(failed(&why));
        }
        self.entry.stand_in.as_ref().and_then(StandIn::generate).ok_or_else(|| failed(&"its generator does not exist"))
    }
}

/// Drops all images of a mesh, and what only they need.
fn drop_textures(mesh: &mut Mesh) {
    for material in &mut mesh.materials {
        (material.texture, material.normal_map, material.height_map) = (None, None, None);
    }
    mesh.uvs.clear();
    mesh.tangents.clear();
}

impl Scene {
    /// Reads the real mesh if it is found in `scenes_dir`, `$ESVO_SCENES` or `../shared/scenes`; generates the stand-in
    /// otherwise. Takes at most `views` viewpoints.
    ///
    /// # Errors
    /// A mesh file that exists but cannot be read; a scene without a mesh file and without a stand-in.
    pub fn load(entry: &SceneEntry, scenes_dir: Option<&Path>, views: usize) -> Result<Self, BenchError> {
        let start = Instant::now();
        let source = SceneSource::find(entry, scenes_dir, false)?;
        let mesh = source.load()?;
        let (variant, other) = (source.variant(), source.other());
        let mut all = source.views();
        all.truncate(views);
        if all.is_empty() {
            return Err(BenchError::scene(&entry.name, "the manifest has no viewpoints for it"));
        }
        Ok(Self {
            name: title(&entry.name, other.as_deref()),
            variant,
            identity: source.identity(),
            credit: match variant {
                SceneVariant::Real => entry.credit.clone(),
                SceneVariant::StandIn => "generated".into(),
                SceneVariant::Other if entry.folder.is_some() && !entry.credit.is_empty() => entry.credit.clone(),
                SceneVariant::Other => "unknown".into(),
            },
            not_published: match variant {
                SceneVariant::StandIn => None,
                // A mesh that no manifest lists: the terms of the listed one say nothing about it.
                _ if other.is_some() => Some("the mesh is not the listed one, and its terms are not known"),
                _ if entry.publish => None,
                _ => Some("the terms of the mesh do not allow publishing them"),
            },
            other,
            mesh,
            displaced: entry.displaced,
            views: all,
            settings: settings(entry),
            seconds: start.elapsed().as_secs_f64(),
        })
    }
}

fn named_view(spec: &CameraSpec) -> NamedView {
    let CameraSpec { name, eye, forward, up, fov_degrees, near, far } = spec.clone();
    NamedView { name, camera: Camera { eye, forward, up, fov_degrees, near, far } }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_without_textures_has_plain_colours_and_says_so() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &[u8]| std::fs::write(folder.path().join(name), text).unwrap();
        write("a.obj", b"mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n");
        write("a.mtl", b"newmtl m\nKd 0.5 0.25 0.125\nmap_Kd a.bmp\n");
        // One red pixel of 24 bits.
        let head = [0x42, 0x4d, 58, 0, 0, 0, 0, 0, 0, 0, 54, 0, 0, 0, 40, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 24];
        let mut image = head.to_vec();
        image.resize(54, 0);
        image.extend([0, 0, 255, 0]);
        write("a.bmp", &image);
        let camera = r#"cameras = [{ name = "v", eye = [0, 0, 2], target = [0, 0, 0], up = [0, 1, 0], fov = 60, near = 0.1, far = 9 }]"#;
        let scene = |name: &str, textures: bool| {
            format!("[[scene]]\nname = \"{name}\"\ntextures = {textures}\n[[scene.mesh]]\nfile = \"a.obj\"\n{camera}\n")
        };
        let text = format!("version = 1\n{}{}", scene("WITH", true), scene("WITHOUT", false));
        write("scenes.toml", text.as_bytes());
        let manifest = manifest(Some(&folder.path().join("scenes.toml"))).unwrap();
        let source = |name: &str| SceneSource::find(manifest.scene(name).unwrap(), None, false).unwrap();
        let [with, without] = ["WITH", "WITHOUT"].map(|name| source(name).load().unwrap());
        assert!(with.warnings.is_empty(), "{:?}", with.warnings);
        assert!(with.materials.iter().any(|m| m.texture.is_some()) && with.uvs.len() == 3);
        assert!(without.materials.iter().all(|m| m.texture.is_none()) && without.uvs.is_empty());
        assert!(without.validate().is_ok());
        assert_eq!(with.materials[0].base_color, without.materials[0].base_color);
        assert_eq!([source("WITH").source(), source("WITHOUT").source()], ["a.obj", "a.obj, without textures"]);
        assert!(source("WITHOUT").identity().ends_with(", without textures"));
    }
}
