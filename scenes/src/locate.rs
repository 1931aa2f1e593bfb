//! Finding real meshes on this machine and identifying them by their hashes.

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::{LazyLock, Mutex, PoisonError};
use std::time::SystemTime;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::camera::CameraSpec;
use crate::manifest::{MeshFile, SceneEntry};

/// The environment variable that names the directory of scenes.
pub const SCENES_VARIABLE: &str = "ESVO_SCENES";
/// The directory that is searched last for scenes, relative to the current directory.
pub const DEFAULT_SCENES_DIR: &str = "../shared/scenes";

/// Which mesh of a scene was measured: tables always name it. Stored as `real`, `stand-in` or `other`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SceneVariant {
    /// The mesh that the manifest of the paper's scenes lists: its SHA-256 is equal.
    Real,
    /// The procedural mesh that is used if the real mesh is not found.
    StandIn,
    /// Any other mesh: a file with the real mesh's name but another SHA-256, or a mesh of the user's own manifest. Figures of the
    /// paper and its authors are not comparable with it.
    Other,
}

impl SceneVariant {
    /// Its name in tables: `real mesh`, `stand-in` or `other mesh`.
    pub fn title(self) -> &'static str {
        match self {
            Self::Real => "real mesh",
            Self::StandIn => "stand-in",
            Self::Other => "other mesh",
        }
    }
}

impl std::fmt::Display for SceneVariant {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Real => "real",
            Self::StandIn => "stand-in",
            Self::Other => "other",
        })
    }
}

/// Whether a file is the one that the manifest lists.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FileIdentity {
    /// All hashes agree.
    Listed,
    /// The mesh of a manifest of the user's own: it has the hash that the manifest gives, if it gives one.
    Own {
        /// The file.
        path: PathBuf,
        /// Its hash.
        sha256: String,
    },
    /// A file differs from the one in the manifest: results cannot be compared with those of others.
    Modified {
        /// The file that differs.
        path: PathBuf,
        /// The hash in the manifest.
        expected: String,
        /// The hash of the file, or `None` if the file (a part of the mesh) is missing.
        found: Option<String>,
    },
}

impl std::fmt::Display for FileIdentity {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Listed => f.write_str("as listed in the manifest"),
            Self::Own { path, sha256 } => write!(f, "the user's own, {}, sha256 {sha256}", path.display()),
            Self::Modified { path, expected, found: Some(found) } => write!(
                f,
                "{} is modified: its sha256 is {found}, the manifest names {expected}; results are not comparable with others",
                path.display()
            ),
            Self::Modified { path, expected, found: None } => {
                write!(f, "{} is missing (the manifest names sha256 {expected})", path.display())
            }
        }
    }
}

/// A real mesh that was found.
#[derive(Clone, Debug)]
pub struct FoundScene<'a> {
    /// Where it is.
    pub path: PathBuf,
    /// The copy in the manifest that has the file's SHA-256, or the one of its file name if no copy has it. Its cameras are in the
    /// units of this copy.
    pub mesh: &'a MeshFile,
    /// Whether its content is that in the manifest. If not, it is another mesh: see [`FoundScene::other_name`].
    pub identity: FileIdentity,
    /// SHA-256 of the file, 64 lower-case hexadecimal digits.
    pub sha256: String,
}

impl FoundScene<'_> {
    /// Real if the content is that in the manifest.
    pub fn variant(&self) -> SceneVariant {
        if self.identity == FileIdentity::Listed { SceneVariant::Real } else { SceneVariant::Other }
    }

    /// How a mesh that is not listed is called after the scene's name: `another mesh, cube.obj, sha256 0123456789ab`. Names the
    /// file that differs: the mesh or one of its parts. `None` if the content is that in the manifest.
    pub fn other_name(&self) -> Option<String> {
        let FileIdentity::Modified { path, found, .. } = &self.identity else { return None };
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Some(match found {
            Some(found) => format!("another mesh, {name}, sha256 {}", &found[..12.min(found.len())]),
            None => format!("another mesh, without {name}"),
        })
    }
}

/// The directories that are searched, in order: the explicit one, `$ESVO_SCENES`, `../shared/scenes`.
///
/// An explicit directory does not replace the others: scenes that it lacks may be in one of them.
pub fn scene_dirs(explicit: Option<&Path>) -> Vec<PathBuf> {
    let variable = std::env::var_os(SCENES_VARIABLE).filter(|v| !v.is_empty()).map(PathBuf::from);
    explicit.map(Path::to_owned).into_iter().chain(variable).chain([PathBuf::from(DEFAULT_SCENES_DIR)]).collect()
}

/// The path of the scene's real mesh, or `None` if no copy is in any of [`scene_dirs`]. Does not read the file.
pub fn find_scene_file(entry: &SceneEntry, explicit_dir: Option<&Path>) -> Option<PathBuf> {
    find(entry, &dirs_of(entry, explicit_dir)).map(|(path, _, _)| path)
}

/// Finds the scene's real mesh and compares its hashes with the manifest. `Ok(None)` if it is not found: use the stand-in.
///
/// # Errors
/// A file that exists but cannot be read; the message names it.
pub fn locate_scene<'a>(entry: &'a SceneEntry, explicit_dir: Option<&Path>) -> io::Result<Option<FoundScene<'a>>> {
    locate_scene_in(entry, &dirs_of(entry, explicit_dir))
}

/// Where the meshes of a scene are searched: for a manifest of the user's own, in its folder only.
fn dirs_of(entry: &SceneEntry, explicit_dir: Option<&Path>) -> Vec<PathBuf> {
    entry.folder.as_ref().map_or_else(|| scene_dirs(explicit_dir), |folder| vec![folder.clone()])
}

/// Like [`locate_scene`], but searches only the given directories. Hashes are kept while the program runs, see
/// [`known_sha256_of`].
pub fn locate_scene_in<'a>(entry: &'a SceneEntry, dirs: &[PathBuf]) -> io::Result<Option<FoundScene<'a>>> {
    let Some((path, dir, named)) = find(entry, dirs) else { return Ok(None) };
    let sha256 = known_sha256_of(&path)?;
    // The content decides, not the name: the file may be another copy of the list.
    let mesh = entry.meshes.iter().find(|m| m.sha256 == sha256).unwrap_or(named);
    let mut identity = FileIdentity::Listed;
    let listed = mesh.sha256 == sha256 || mesh.sha256.is_empty();
    if !listed {
        identity =
            FileIdentity::Modified { path: path.clone(), expected: mesh.sha256.clone(), found: Some(sha256.clone()) };
    }
    for part in mesh.parts.iter().take_while(|_| listed) {
        let path = dir.join(&part.file);
        let found = if path.is_file() { Some(known_sha256_of(&path)?) } else { None };
        if found.as_ref() != Some(&part.sha256) {
            identity = FileIdentity::Modified { path, expected: part.sha256.clone(), found };
            break;
        }
    }
    if entry.folder.is_some() && identity == FileIdentity::Listed {
        identity = FileIdentity::Own { path: path.clone(), sha256: sha256.clone() };
    }
    Ok(Some(FoundScene { path, mesh, identity, sha256 }))
}

fn find<'a, 'd>(entry: &'a SceneEntry, dirs: &'d [PathBuf]) -> Option<(PathBuf, &'d Path, &'a MeshFile)> {
    // All copies are looked for in the first directory before the second: the user's choice comes first.
    dirs.iter()
        .flat_map(|dir| entry.meshes.iter().map(move |mesh| (dir.join(&mesh.file), dir.as_path(), mesh)))
        .find(|(path, _, _)| path.is_file())
}

/// SHA-256 of a file as 64 lower-case hexadecimal digits. The file is read in pieces.
pub fn sha256_of(path: &Path) -> io::Result<String> {
    let annotate = |e: io::Error| io::Error::new(e.kind(), format!("cannot read {}: {e}", path.display()));
    let mut file = File::open(path).map_err(annotate)?;
    let mut hash = Sha256::new();
    let mut piece = vec![0; 1 << 16];
    loop {
        match file.read(&mut piece) {
            Ok(0) => break,
            Ok(n) => hash.update(&piece[..n]),
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(annotate(e)),
        }
    }
    Ok(hash.finalize().iter().map(|b| format!("{b:02x}")).collect())
}

/// Like [`sha256_of`], but reads a file once while the program runs, unless its size or its time of modification has changed.
pub fn known_sha256_of(path: &Path) -> io::Result<String> {
    type Known = HashMap<PathBuf, (u64, SystemTime, String)>;
    static KNOWN: LazyLock<Mutex<Known>> = LazyLock::new(Mutex::default);
    let known = || KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    let annotate = |e: io::Error| io::Error::new(e.kind(), format!("cannot read {}: {e}", path.display()));
    let path = path.canonicalize().map_err(annotate)?;
    let metadata = path.metadata().map_err(annotate)?;
    // Without a time of modification, a change would not be seen.
    let Ok(modified) = metadata.modified() else { return sha256_of(&path) };
    if let Some((size, time, sha256)) = known().get(&path)
        && (*size, *time) == (metadata.len(), modified)
    {
        return Ok(sha256.clone());
    }
    let sha256 = sha256_of(&path)?;
    known().insert(path, (metadata.len(), modified, sha256.clone()));
    Ok(sha256)
}

impl SceneEntry {
    /// The viewpoints of a variant, in the units of its mesh. For [`SceneVariant::Real`] and [`SceneVariant::Other`] those of the preferred copy; those of
    /// other copies are in [`FoundScene::mesh`]. Empty if the scene has no such variant.
    pub fn cameras(&self, variant: SceneVariant) -> &[CameraSpec] {
        match variant {
            SceneVariant::Real | SceneVariant::Other => self.meshes.first().map_or(&[], |m| &m.cameras),
            SceneVariant::StandIn => self.stand_in.as_ref().map_or(&[], |s| &s.cameras),
        }
    }
}
