//! Scene manifests: the scenes, the content hashes of their meshes, and their viewpoints.

use std::collections::HashSet;
use std::path::{Component, Path, PathBuf};

use esvo_builder::mesh::Mesh;
use serde::Deserialize;

use crate::camera::CameraSpec;
use crate::generate::generator;

/// The version of manifests that this crate reads.
pub const MANIFEST_VERSION: u32 = 1;

const BUILTIN: &str = include_str!("../manifests/paper.toml");

/// A list of scenes.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneManifest {
    /// [`MANIFEST_VERSION`].
    pub version: u32,
    /// The scenes, in the order in which tables list them.
    #[serde(rename = "scene")]
    pub scenes: Vec<SceneEntry>,
}

/// One scene: its real mesh, its stand-in, or both.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneEntry {
    /// The name in tables; that of the paper's tables if it is one of the paper's scenes. Unique, ignoring letter case.
    pub name: String,
    /// True for the scenes of the paper's tables, false for others.
    #[serde(default)]
    pub paper: bool,
    /// Number of triangles that the paper states.
    pub paper_triangles: Option<u64>,
    /// What the scene is or tests, in one line. Empty if the manifest does not say.
    #[serde(default)]
    pub about: String,
    /// Where to get the mesh. Empty if the manifest does not say.
    #[serde(default)]
    pub source: String,
    /// Credit line to print wherever a picture or a table of the real mesh is published. Empty if the manifest does not say.
    #[serde(default)]
    pub credit: String,
    /// Whether pictures of the real mesh may be published; true if the manifest does not say. Pictures of stand-ins always may.
    #[serde(default = "yes")]
    pub publish: bool,
    /// Whether the mesh must be displaced by the height maps of its materials before it is built.
    #[serde(default)]
    pub displaced: bool,
    /// Whether the mesh has its textures: the images of colours, normals and heights that its materials name. False: they are dropped, and
    /// materials have their plain colours.
    #[serde(default = "yes")]
    pub textures: bool,
    /// Why the scene cannot be measured: tables list it as left out with this reason. Absent: it can be measured.
    pub unsupported: Option<String>,
    /// The paper's settings of the builder for this scene; those of most of its scenes if the manifest does not say.
    #[serde(default)]
    pub build: BuildSettings,
    /// Copies of the real mesh, the preferred one first. Empty if none is known.
    #[serde(default, rename = "mesh")]
    pub meshes: Vec<MeshFile>,
    /// The procedural stand-in, if there is one.
    pub stand_in: Option<StandIn>,
    /// For scenes of a manifest of the user's own: the folder that the manifest is in, to which paths are relative.
    #[serde(skip)]
    pub folder: Option<PathBuf>,
}

fn yes() -> bool {
    true
}

/// Errors at which the paper's builder stops dividing voxels.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BuildSettings {
    /// Allowed deviation of a colour component, in 256ths of its range; 256 switches the test off.
    pub color_error: f64,
    /// Allowed deviation of a component of the unit normal (0..=2).
    pub normal_error: f64,
    /// Allowed deviation of the surface: the diagonal of a voxel this many levels deep (fractions allowed, at most 23).
    pub contour_error: f64,
}

impl Default for BuildSettings {
    /// 16, 0.01 and 15: those of most of the paper's scenes.
    fn default() -> Self {
        Self { color_error: 16.0, normal_error: 0.01, contour_error: 15.0 }
    }
}

/// A mesh file, and viewpoints in its units.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshFile {
    /// Path relative to the directory of scenes, with `/`; in a manifest of the user's own, to the manifest's folder.
    pub file: String,
    /// SHA-256 of the file, 64 lower-case hexadecimal digits. Only a manifest of the user's own may leave it out: empty.
    #[serde(default)]
    pub sha256: String,
    /// First three rows of the matrix that is applied to the vertices: `x' = m[0] * (x, y, z, 1)`. Absent: none. Cameras are in
    /// the space behind it.
    pub transform: Option<[[f64; 4]; 3]>,
    /// Number of triangles, if known.
    pub triangles: Option<u64>,
    /// Other files with parts of the geometry (buffers of a glTF file).
    #[serde(default)]
    pub parts: Vec<MeshPart>,
    /// A remark about this copy.
    pub note: Option<String>,
    /// Viewpoints in the units of this file.
    #[serde(default)]
    pub cameras: Vec<CameraSpec>,
}

/// A file that a mesh file refers to.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshPart {
    /// Path relative to the directory of scenes, with `/`.
    pub file: String,
    /// SHA-256 of the file, 64 lower-case hexadecimal digits.
    pub sha256: String,
}

/// A procedural mesh that replaces a real one, and viewpoints in its units.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StandIn {
    /// Name of a generator in [`crate::generate::GENERATORS`].
    pub generator: String,
    /// Seed of the generator.
    pub seed: u64,
    /// Exact number of triangles; must agree with the generator.
    pub triangles: u64,
    /// Viewpoints in the units of the generator.
    pub cameras: Vec<CameraSpec>,
}

impl StandIn {
    /// Makes the mesh. `None` if the generator does not exist, which validation rules out.
    pub fn generate(&self) -> Option<Mesh> {
        Some((generator(&self.generator)?.make)(self.seed))
    }
}

/// Why a manifest could not be used.
#[derive(Debug, thiserror::Error)]
pub enum ManifestError {
    /// The file could not be read.
    #[error("cannot read the scene manifest {}: {source}", path.display())]
    Read {
        /// The manifest.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Not TOML, or a key is unknown, missing, or of the wrong type. The source names line and column.
    #[error("scene manifest {}: {source}", path.display())]
    Parse {
        /// The manifest.
        path: PathBuf,
        /// What the parser said.
        source: Box<toml::de::Error>,
    },
    /// A value is out of range or contradicts another.
    #[error("scene manifest {}: {what}", path.display())]
    Invalid {
        /// The manifest.
        path: PathBuf,
        /// The scene and what is wrong with it.
        what: String,
    },
}

impl SceneManifest {
    /// Reads and validates a manifest of the user's own. Paths of its meshes are relative to the folder that it is in. Names of the
    /// paper's scenes are refused, so that no figure of the paper is compared with another mesh. Hashes and cameras may be left out.
    ///
    /// # Errors
    /// A file that cannot be read or is no manifest; the text says where and what is wrong.
    pub fn load(path: &Path) -> Result<Self, ManifestError> {
        let text =
            std::fs::read_to_string(path).map_err(|source| ManifestError::Read { path: path.to_owned(), source })?;
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut manifest = Self::read(&text, path)?;
        let invalid = |what| ManifestError::Invalid { path: path.to_owned(), what };
        let builtin = Self::builtin()?;
        for scene in &mut manifest.scenes {
            if builtin.scene(&scene.name).is_some() || scene.paper {
                return Err(invalid(format!(
                    "scene \"{}\": the names of esvo's own scenes and `paper` are taken; give another name",
                    scene.name
                )));
            }
            scene.folder = Some(folder.to_owned());
        }
        manifest.validate().map_err(invalid)?;
        Ok(manifest)
    }

    fn read(text: &str, path: &Path) -> Result<Self, ManifestError> {
        toml::from_str(text).map_err(|source| ManifestError::Parse { path: path.to_owned(), source: Box::new(source) })
    }

    /// The manifest of the paper's scenes, which is part of this crate.
    pub fn builtin() -> Result<Self, ManifestError> {
        Self::parse(BUILTIN, Path::new("paper.toml (built in)"))
    }

    /// Reads and validates a manifest from text. `path` is used in error messages only.
    pub fn parse(text: &str, path: &Path) -> Result<Self, ManifestError> {
        let manifest = Self::read(text, path)?;
        manifest.validate().map_err(|what| ManifestError::Invalid { path: path.to_owned(), what })?;
        Ok(manifest)
    }

    /// The scene of that name, ignoring letter case.
    pub fn scene(&self, name: &str) -> Option<&SceneEntry> {
        self.scenes.iter().find(|s| s.name.eq_ignore_ascii_case(name))
    }

    fn validate(&self) -> Result<(), String> {
        if self.version != MANIFEST_VERSION {
            return Err(format!(
                "`version` is {}, this program reads version {MANIFEST_VERSION}: use the esvo release that the manifest was made for",
                self.version
            ));
        }
        let mut names = HashSet::new();
        for scene in &self.scenes {
            scene.validate().map_err(|what| format!("scene \"{}\": {what}", scene.name))?;
            if !names.insert(scene.name.to_ascii_uppercase()) {
                return Err(format!("scene \"{}\" is listed twice", scene.name));
            }
        }
        Ok(())
    }
}

impl SceneEntry {
    fn validate(&self) -> Result<(), String> {
        if self.name.is_empty() {
            return Err("the name is empty".into());
        }
        if self.meshes.is_empty() && self.stand_in.is_none() {
            return Err("neither a `mesh` nor a `stand_in` is given; give at least one".into());
        }
        if self.displaced && !self.textures {
            return Err("`displaced` needs height maps, which `textures = false` drops; leave one of them out".into());
        }
        let BuildSettings { color_error, normal_error, contour_error } = self.build;
        for (key, value, most) in [
            ("color_error", color_error, 256.0),
            ("normal_error", normal_error, 2.0),
            ("contour_error", contour_error, 23.0),
        ] {
            if !(value > 0.0 && value <= most) {
                return Err(format!("`build.{key}` is {value}, expected more than 0 and at most {most}"));
            }
        }
        for mesh in &self.meshes {
            if self.folder.is_none() || !mesh.sha256.is_empty() {
                check_hash(&mesh.file, &mesh.sha256)?;
            }
            check_file(&mesh.file)?;
            if mesh.transform.is_some_and(|rows| !rows.iter().flatten().all(|x| x.is_finite())) {
                return Err(format!("mesh {}: `transform` has numbers that are not finite", mesh.file));
            }
            for part in &mesh.parts {
                check_file(&part.file)?;
                check_hash(&part.file, &part.sha256)?;
            }
            self.check_cameras(&mesh.cameras).map_err(|what| format!("mesh {}: {what}", mesh.file))?;
        }
        if let Some(stand_in) = &self.stand_in {
            let Some(generator) = generator(&stand_in.generator) else {
                return Err(format!("`stand_in.generator`: no generator is called \"{}\"", stand_in.generator));
            };
            if generator.triangles as u64 != stand_in.triangles {
                return Err(format!(
                    "`stand_in.triangles` is {}, but the generator \"{}\" makes {}",
                    stand_in.triangles, stand_in.generator, generator.triangles
                ));
            }
            self.check_cameras(&stand_in.cameras).map_err(|what| format!("stand-in: {what}"))?;
        }
        Ok(())
    }

    fn check_cameras(&self, cameras: &[CameraSpec]) -> Result<(), String> {
        if cameras.is_empty() && self.unsupported.is_none() && self.folder.is_none() {
            return Err("has no `cameras`, which only a scene marked `unsupported` may lack".into());
        }
        let mut names = HashSet::new();
        match cameras.iter().find(|c| !names.insert(&c.name)) {
            Some(camera) => Err(format!("two cameras have the name \"{}\"", camera.name)),
            None => Ok(()),
        }
    }
}

fn check_file(file: &str) -> Result<(), String> {
    // A manifest must not be able to point outside the directory of scenes.
    let plain = Path::new(file).components().all(|c| matches!(c, Component::Normal(_)));
    if file.is_empty() || !plain || file.contains('\\') {
        return Err(format!("`file` \"{file}\" must be a relative path with `/`, without `..`"));
    }
    Ok(())
}

fn check_hash(file: &str, sha256: &str) -> Result<(), String> {
    if sha256.len() != 64 || !sha256.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f')) {
        return Err(format!("`sha256` of {file} must be 64 lower-case hexadecimal digits"));
    }
    Ok(())
}
