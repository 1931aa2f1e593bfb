//! Turns triangle meshes into esvo sparse voxel octrees.
//!
//! ```
//! use esvo_builder::{BuildSettings, Material, Mesh, build};
//!
//! let mesh = Mesh {
//!     positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.5]],
//!     triangles: vec![[0, 1, 2]],
//!     triangle_materials: vec![0],
//!     materials: vec![Material::default()],
//!     ..Mesh::default()
//! };
//! let settings = BuildSettings { levels: 6, ..BuildSettings::default() };
//! let built = build(&mesh, &settings, &|_progress| ())?;
//! assert!(built.octree.objects()[0].leaf_voxels > 0);
//! # Ok::<(), esvo_builder::BuildError>(())
//! ```

mod build;
mod clip;
mod displace;
mod error;
pub mod import;
pub mod mesh;
mod settings;
mod shape;
mod surface;

pub use build::{BuildStats, Built, BuiltFile, FileOptions, Progress, build, build_file};
pub use displace::{DisplaceOptions, displace};
pub use error::BuildError;
pub use mesh::maps::{HeightMap, LinearMip, LinearTexture, NormalMap, UvTransform, mapped_normal};
pub use mesh::{Material, Mesh, MipLevel, Texture};
pub use settings::{BuildSettings, Preset, TextureTest};
