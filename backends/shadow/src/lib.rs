//! A shadow volume: a world of one bit a voxel with mips, objects that move in it, and rays through it.
//!
//! A renderer that wants shadows, ambient occlusion, reflections or fog needs to know one thing of the world: is something in the way? A bit for each voxel says so.
//! The bits of a whole world fit a GPU's memory, can be rewritten where an object moves, and a ray reads eight of them at once.
//!
//! ```
//! use esvo_shadow::trace::{Fidelity, Ray, first_hit};
//! use esvo_shadow::{Cubes, Grid, Pose, Rule, Shape, World};
//! use glam::{DQuat, DVec3};
//!
//! # fn main() -> Result<(), esvo_shadow::ShadowError> {
//! // A world of 10 m x 10 m x 5 m at 5 cm, with a cube of 1 m that stands turned in its middle.
//! let grid = Grid { origin: DVec3::ZERO, voxel: 0.05 };
//! let mut world = World::new(grid, [200, 200, 100], 2)?;
//! let cube = Shape::Cubes(Cubes::new([[0, 0, 0]], 1.0, Rule::Middle)?);
//! let mut pose = Pose { rotation: DQuat::from_rotation_z(0.5), position: DVec3::new(5.0, 5.0, 2.0) };
//! let id = world.insert(cube, &pose)?;
//! world.update(0);
//!
//! let ray = Ray::new(grid.to_voxels(DVec3::new(5.0, 5.5, 0.1)), DVec3::Z, 80.0)?;
//! let hit = first_hit(world.volume(), &ray, Fidelity::EXACT).hit.expect("the cube is above");
//! assert!((f64::from(hit.distance) * grid.voxel - 1.9).abs() < 0.051);
//!
//! // The cube moves away. What changed is in few regions, which a program sends to its GPU.
//! pose.position.x += 3.0;
//! world.move_to(&[(id, pose)])?;
//! let changes = world.update(0);
//! assert!(!changes.regions.is_empty());
//! assert!(first_hit(world.volume(), &ray, Fidelity::EXACT).hit.is_none());
//! # Ok(()) }
//! ```
//!
//! # How it works
//! A byte has the eight voxels of a cube, a bit each; a byte of a mip has a bit for each byte below that is not zero. A world of 2000 x 2000 x 500 voxels has
//! 285,187,500 bytes with two mips. With the bits, that is four levels: voxels, cubes of 2 voxels (a byte is zero or not), of 4 and of 8.
//!
//! Rays are in whole numbers, and so is all of their tracing. [`trace::first_hit`] meets every voxel that the ray touches, edges and corners
//! included; it is held against fractions of whole numbers (`tests/exact.rs`), and no ray leaves a closed room (`tests/leaks.rs`). [`trace::Steps`] looks at the
//! ray in steps, which is cheaper and leaks: the longer the steps, the more.
//!
//! Objects have a shape and a pose. A [`World`] keeps the voxels that each fills, and what is fixed, a second time, so that it can make any part of the volume
//! anew when an object moves. After an update the volume is bit for bit as if it had been made from nothing (`tests/moving.rs`).
//!
//! # What is where
//! - `volume`: [`Volume`], all bytes of a bounded world, and [`Bricks`], which have only those that are not zero. [`Occupancy`] is what rays need of them.
//! - `trace`: [`trace::Ray`]; [`trace::first_hit`] and [`trace::is_blocked`], every voxel; [`trace::batch`], the same of lists of rays; [`trace::Steps`], samples. [`trace::Fidelity`]: mips, and
//!   how fidelity falls along a ray.
//! - `grid`: [`Grid`] and [`Pose`]. `shape`: [`Shape`], what objects are made of: [`Mesh`] and [`Cubes`], and [`Stamp`], the voxels of one object.
//! - [`rooms`]: closed rooms, to count leaks.
//! - [`octree`]: octrees as shapes. [`effects`]: ambient occlusion, shadows, reflections, fog, indirect light.
//! - `world`: [`World`]. `extent`: [`Extent`], parts of a volume, and [`cluster`], which makes few of many.
//! - `gpu`, a feature that is off by default: the volume on a device, kept up to date by regions, and the same rays in a kernel, equal in every bit. `kernels/`: the
//!   kernels.
//! - `error`: [`ShadowError`].

pub mod effects;
mod error;
mod extent;
#[cfg(feature = "gpu")]
pub mod gpu;
mod grid;
pub mod octree;
pub mod rooms;
mod shape;
pub mod trace;
mod volume;
mod world;

pub use error::ShadowError;
pub use extent::{Extent, cluster};
pub use grid::{Grid, Pose};
pub use shape::{Cubes, Mesh, Rule, Shape, Stamp};
pub use volume::{Bricks, MAX_MIPS, MAX_VOXELS, Occupancy, Volume};
pub use world::{Changes, ObjectId, World};
