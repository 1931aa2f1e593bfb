//! Turns triangle meshes and voxel models into esvo sparse voxel octrees.
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
//!
//! [`import::load_mesh`] reads a mesh from a file, [`import::load_voxels`] a voxel model. [`build`] makes an octree in memory;
//! [`build_file`] writes it directly to a file, within a memory limit, and can continue an interrupted build. [`build_displaced`]
//! and [`build_displaced_file`] displace the mesh meanwhile, one subtree at a time.
//!
//! # From triangles to blocks
//!
//! ```text
//! file --import--> Mesh --(displace)--> Mesh --prepare--> Surface --recursion--> blocks --> file
//!                                                            |
//!                                     per voxel: clip -> shape, attributes
//! ```
//!
//! 1. A [`Mesh`] comes from a file (`import/`) or from the caller. [`displace`] can move its surfaces by height maps. Where that
//!    would give too many triangles, `build/subtrees.rs` makes those of one subtree at a time, and goes through 2 and 3 with each.
//! 2. `surface/` prepares the mesh once: triangles in the root cube, normals, kinds of edges, appearance.
//! 3. `build/recursion.rs` goes from the root cube to the leaves, on all threads. For each voxel, `clip/` cuts the triangles
//!    of its parent to the voxel, `shape/` decides on a contour and whether it is close enough to the surface, and
//!    `surface/attributes.rs` averages colour and normal. `build/pair.rs` encodes them as they will be stored, a block of
//!    sixteen voxels at a time, and decides whether what is decoded is close enough. A voxel that is close enough in shape,
//!    colour and normal, or on the deepest level, is a leaf.
//! 4. Subtrees that are large enough become packed blocks in an [`esvo_format::BlockStore`] at once. At the end the store
//!    orders the blocks and sets the pointers between them: an octree in memory, or a file.
//!
//! # What is where
//!
//! | folder or file | subject |
//! |---|---|
//! | [`mesh`] | the mesh with its materials, textures, normal maps and height maps; sampling them |
//! | [`import`] | reading OBJ, glTF, PLY and STL files and their images, and MagicaVoxel's models |
//! | `displace/` | displacement by height maps: dicing triangles and moving their vertices |
//! | `clip/` | clipping triangles to cubes without losing a voxel; areas of polygons |
//! | `surface/` | the prepared mesh; colours, normals and holes of pieces, and bounds of them; attributes of voxels |
//! | `shape/` | contours: slabs, the polyhedron that they leave of a voxel, how one is chosen, the short way for planes |
//! | `build/` | a build from start to end, the recursion, which voxels are leaves, the journal of an interrupted build, builds in parts, progress |
//! | [`cells`] | which cubes of a level triangles meet, for comparing other voxelizers; octrees of lists of such cubes |
//! | [`voxels`] | voxel models and the octrees that they become, without triangles |
//! | `settings.rs`, `error.rs` | [`BuildSettings`] and [`Preset`]; [`BuildError`] |
//!
//! Each row uses only rows above it (and settings and errors), except that [`import`] makes the models of [`voxels`]. Two
//! folders are wider than their names: `surface/` needs `clip/` because areas and holes are those of clipped pieces, and
//! `shape/plane.rs` also gives a voxel's attributes, because for a voxel inside one large triangle both follow from the same
//! plane.
//!
//! # Guarantees
//!
//! - The voxels are those whose closed cubes meet a closed triangle, plus some whose distance from one is at most 2^-45 of
//!   the root cube's edge; the proof is in `clip/mod.rs`.
//! - Every contour encloses the surface in its voxel.
//! - The bytes depend on the mesh and the settings only, not on the number of threads.

mod build;
pub mod cells;
mod clip;
mod displace;
mod error;
pub mod export;
pub mod import;
pub mod mesh;
mod settings;
mod shape;
mod surface;
pub mod voxels;

pub use build::{
    BuildPlan, BuildStats, Built, BuiltFile, BuiltPart, DisplacedPart, FileOptions, PlannedPart, Progress, build,
    build_displaced, build_displaced_file, build_file, build_part, expected_leaves, is_part, join_parts,
    visit_displaced, visit_displaced_parts,
};
pub use cells::{CellTriangles, Cells, PreparedMesh, build_cells, build_cells_file};
pub use displace::{DisplaceOptions, displace, displaced_triangles};
pub use error::BuildError;
pub use mesh::maps::{HeightMap, LinearMip, LinearTexture, NormalMap, UvTransform, mapped_normal};
pub use mesh::properties::{Properties, PropertyMap};
pub use mesh::{Material, Mesh, MipLevel, Texture, Wrap};
pub use settings::{BuildSettings, ComponentSettings, Preset, TextureTest};
pub use voxels::{ModelVoxel, VoxelModel, build_voxels, build_voxels_file};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExample;
