//! Cells: cubes of one level of an octree, which surface meets or does not, and octrees that are made of them.
//!
//! [`PreparedMesh`] tells which cells of a level the triangles of a mesh meet: all of them, or for one triangle and one cell.
//! This is what another voxelizer is compared with, voxel by voxel. [`build_cells`] makes an octree of a list of cells,
//! whoever found them.
//!
//! ```
//! use esvo_builder::{BuildSettings, Mesh, cells::{Cells, PreparedMesh, build_cells, morton}};
//!
//! let positions = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 1.0]];
//! let mesh = Mesh::from_triangles(positions, vec![[0, 1, 2]])?;
//! let prepared = PreparedMesh::new(&mesh, 6)?;
//! let codes = prepared.cells(6)?;
//! assert!(codes.contains(&morton([0, 0, 0])) && prepared.meets(0, [0, 0, 0], 6));
//! let cells = Cells { levels: 6, colors: vec![[90, 80, 70]; codes.len()], codes, ..Cells::default() };
//! let built = build_cells(&cells, prepared.octree_to_mesh(), &BuildSettings::default())?;
//! assert_eq!(built.octree.objects()[0].leaf_voxels, cells.codes.len() as u64);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Which cells a triangle meets
//!
//! Those that a build's cuts from the root cube downwards lead to: all whose closed cube meets the closed triangle, and some
//! whose distance from it is at most 2^-45 of the root cube's edge. Whether a triangle meets a cell does not depend on the
//! other triangles.
//!
//! A build without contours has the same voxels, with two exceptions. It leaves out the holes that alpha cuts. And in a cube
//! that a single triangle cuts completely it asks on which sides of a plane the voxels lie, instead of cutting further: the
//! two may decide differently for voxels that the triangle touches within 2^-45.

mod build;
mod list;
mod mesh;
mod walk;

pub use self::build::{build_cells, build_cells_file};
pub(crate) use self::build::{cells_in_file, cells_in_memory};
pub use self::list::Cells;
pub use self::mesh::CellTriangles;
pub(crate) use self::walk::{Parent, Walk};
pub use crate::surface::prepared::PreparedMesh;
pub use esvo_format::{morton, morton_place};

/// Most levels that cells may have: their Morton codes have 3 bits for each level, in 64.
pub const MAX_LEVELS: u32 = 21;
