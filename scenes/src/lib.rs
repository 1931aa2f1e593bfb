//! Scene manifests, camera sets and procedural meshes for the esvo benchmarks.
//!
//! No mesh is part of the repository. A [`SceneManifest`] names each scene by content hash and says where a person gets
//! it; [`locate_scene`] looks for it on this machine; where it is not, a procedural stand-in with the same number of
//! triangles takes its place, and tables say which of the two was measured.
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

mod camera;
pub mod generate;
mod locate;
mod manifest;

pub use camera::CameraSpec;
pub use generate::procedural;
pub use locate::{
    DEFAULT_SCENES_DIR, FileIdentity, FoundScene, SCENES_VARIABLE, SceneVariant, find_scene_file, locate_scene,
    locate_scene_in, scene_dirs, sha256_of,
};
pub use manifest::{
    BuildSettings, MANIFEST_VERSION, ManifestError, MeshFile, MeshPart, SceneEntry, SceneManifest, StandIn,
};
