//! Scene manifests, viewpoints and procedural meshes for the benchmarks of esvo.
//!
//! No mesh is part of the repository. A [`SceneManifest`] identifies the meshes of each scene by content hash and says where to
//! get them. [`locate_scene`] looks for a scene's mesh on this machine. If it is not found, a procedural stand-in with the same
//! number of triangles is used. Tables say which mesh was measured ([`SceneVariant`]): the real one, the stand-in, or another
//! one, which is a file of other content or a mesh of a manifest of the user's own.
//!
//! ```
//! use esvo_scenes::{SceneManifest, SceneVariant};
//!
//! let manifest = SceneManifest::builtin()?;
//! let scene = manifest.scene("sibenik").ok_or("no such scene")?;
//! let mesh = scene.stand_in.as_ref().and_then(|s| s.generate()).ok_or("no stand-in")?;
//! assert_eq!(mesh.triangles.len(), 77_000);
//! assert!(scene.cameras(SceneVariant::StandIn).len() >= 4);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # What is where
//! - `manifest`: reading and checking manifests, [`SceneManifest`] and [`SceneEntry`]. `camera`: their viewpoints.
//! - `list`: octrees and where they stand, [`SceneList`].
//! - `locate`: finding the files of real meshes and comparing their hashes.
//! - [`generate`]: the procedural meshes, one file for each scene.

mod camera;
pub mod generate;
mod list;
mod locate;
mod manifest;

pub use camera::CameraSpec;
pub use generate::procedural;
pub use list::{LIST_VERSION, ListError, Place, SceneList};
pub use locate::{
    DEFAULT_SCENES_DIR, FileIdentity, FoundScene, SCENES_VARIABLE, SceneVariant, find_scene_file, known_sha256_of,
    locate_scene, locate_scene_in, scene_dirs, sha256_of,
};
pub use manifest::{
    BuildSettings, MANIFEST_VERSION, ManifestError, MeshFile, MeshPart, SceneEntry, SceneManifest, StandIn,
};
