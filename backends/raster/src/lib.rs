//! Voxelization on a GPU, through wgpu: which voxels of a grid a mesh meets, by rasterization in several ways and by compute.
//!
//! A GPU voxelizes by drawing triangles along an axis of the grid, with one pixel for each column of voxels, and writing voxels
//! from the fragment shader. Drawn in the plainest way, surfaces have cracks and holes. [`Method`] has what removes them, each as a pipeline of
//! its own, so that they can be compared with an exact answer.
//!
//! ```
//! use esvo_raster::{Method, Options, Surface, Voxelizer};
//! use glam::DVec3;
//!
//! # fn main() -> Result<(), esvo_raster::RasterError> {
//! # if let (Err(error), None) = (Voxelizer::open(None), std::env::var_os("ESVO_REQUIRE_GPU")) {
//! #     println!("skipped: {error}");
//! #     return Ok(());
//! # }
//! let triangle = [DVec3::new(0.1, 0.1, 0.1), DVec3::new(0.9, 0.2, 0.3), DVec3::new(0.4, 0.8, 0.9)];
//! let surface = Surface { corners: &[triangle], looks: None };
//! let voxelizer = Voxelizer::open(None)?;
//! let found = voxelizer.voxelize(&surface, &Options::new(5, Method::Compute))?;
//! let scale = 32.0;
//! for code in &found.codes {
//!     let cell = esvo_raster::morton_place(*code).map(i64::from);
//!     assert!(esvo_raster::bounds::meets(&triangle.map(|corner| corner * scale), cell));
//! }
//! # Ok(()) }
//! ```
//!
//! # How it works
//! 1. The grid is cut into tiles whose bits fit one binding of the device. Tiles that no triangle is near are skipped.
//! 2. For each tile, the processor moves triangles to coordinates of their own, in which single precision is most exact, and chooses the
//!    axis that each is projected along. A vertex shader reads all three corners of its triangle from a storage buffer: WGSL has no
//!    geometry shaders.
//! 3. A fragment shader, or a compute shader, finds voxels and sets their bits by `atomicOr`. Bits lie in Morton order.
//! 4. Prefix sums over the bits make an ascending list of voxels.
//! 5. If colours and normals are wanted, the same pass runs again and adds them to sums of each voxel, in whole numbers, so that
//!    two runs give equal results.
//!
//! # The test of a triangle and a voxel
//! The separating axis test has thirteen axes for a box and a triangle: three of the box, the triangle's normal, and nine products of an edge
//! and an axis. Presentations of GPU voxelization often have less. A test of bounding boxes that counts boxes as apart whose faces coincide
//! loses voxels that a surface only touches: here boxes are closed. A test of the edges in the three coordinate planes alone, with the
//! side of each edge chosen by the sign of the normal's component, is not the whole test: the plane is missing, so voxels before and behind
//! the triangle pass, and where a component of the normal is zero no side is right. Here the interval of the triangle is compared
//! on both sides, and the plane is tested.
//!
//! # Exactness
//! Single precision decides within bounds that [`bounds`] derives. [`Method::ExpandedTested`] and [`Method::HardwareTested`] keep
//! voxels within them: none is missing, and extra ones are within twice the bound. [`Method::Compute`] has such pairs of triangle and voxel decided on
//! the processor ([`Options::decide`]): its result is exact, but that a surface within 2^-48 of the grid's edge of a border of voxels counts as in
//! that border, whoever decides. The builder of esvo counts it so as well.
//!
//! # What is where
//! - `method`: [`Method`]. `surface`: [`Surface`], [`Looks`] and what they consist of. `error`: [`RasterError`].
//! - `voxelizer`: [`Voxelizer`], from a surface to voxels; also which missing voxels are cracks, and which pixels are shaded.
//! - `tiles`, `records`: tiles; triangles as shaders read them. `work`: one method over one tile. `passes`: pipelines.
//! - `grid`: bits and the list of them. `attributes`: colours and normals.
//! - [`bounds`]: what single precision may do.
//! - `kernels/`: the shaders.

mod attributes;
pub mod bounds;
mod error;
mod grid;
mod method;
mod passes;
mod records;
mod surface;
mod tiles;
mod voxelizer;
mod work;

pub use attributes::{Attributes, Wanted};
pub use error::RasterError;
pub use esvo_format::{morton, morton_place};
pub use method::Method;
pub use surface::{Looks, Material, Surface, Texture, TriangleLook, Wrap};
pub use voxelizer::{Decide, Options, Pair, Pixels, Stats, Voxelizer, Voxels};

/// The deepest level of a grid: 4096 voxels along its edge.
pub const MAX_LEVEL: u32 = 12;
