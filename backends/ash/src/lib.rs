//! The Vulkan caster of esvo: runs the WGSL kernel of `esvo-core` as SPIR-V, through `ash`.
//!
//! ```no_run
//! # use esvo_core::Caster as _;
//! # fn main() -> Result<(), esvo_core::CastError> {
//! let caster = esvo_ash::AshCaster::new(&esvo_ash::GpuOptions::default())?;
//! println!("{}", caster.device().name);
//! # Ok(()) }
//! ```
//!
//! # SPIR-V
//! naga translates the kernel when an octree is loaded or an option is first used, not when the crate is built. The number
//! of storage bindings and the size of the stack are part of the kernel's text, and naga writes no specialization
//! constants, so hundreds of variants exist. A run uses two or three of them; each takes milliseconds. A test compiles all
//! variants.
//!
//! Unlike wgpu, this caster forbids the driver to fuse a multiplication with an addition, so that a driver that runs on
//! the processor gives the hits of the reference caster bit by bit. And it uses no bounds checks: [`Caster::load`] takes
//! only octrees that are sound, and [`Caster::cast`] only views of their roots.
//!
//! # Validation
//! Where the Khronos validation layer is installed, every report of it is an error, in programs with debug assertions, which tests are.
//! `ESVO_VALIDATION=1` in the environment demands it in others too, and `ESVO_VALIDATION=0` in none.
//!
//! # What is where
//! - `caster`: [`AshCaster`], the caster: octree and picture buffers, passes.
//! - `filter`: the post-process filter.
//! - `triangles`: [`AshTriangles`], the same for triangles: closest and any hits.
//! - `rays`: buffers and submission of lists of rays.
//! - `instances`: buffers and submission of pictures of many placed objects.
//! - `pipeline`: descriptor sets and compute pipelines.
//! - `subgroup`: subgroups of a demanded size.
//! - `spirv`: [`module`], from WGSL to SPIR-V; [`forbid_contraction`].
//! - `data`: what kernels only read, in buffers or in a texture.
//! - `buffers`: buffers and their memory.
//! - `gpu`: the open device: queue, command buffer, timestamps.
//! - `instance`: the Vulkan library, [`adapters`], the validation layer.
//!
//! [`Caster::load`]: esvo_core::Caster::load
//! [`Caster::cast`]: esvo_core::Caster::cast

mod buffers;
mod caster;
mod data;
mod filter;
mod gpu;
mod instance;
mod instances;
mod pipeline;
mod rays;
mod spirv;
mod subgroup;
mod texture;
mod triangles;

pub use caster::AshCaster;
pub use esvo_core::gpu::kernel::GpuOptions;
pub use instance::adapters;
pub use spirv::{forbid_contraction, module};
pub use triangles::AshTriangles;
