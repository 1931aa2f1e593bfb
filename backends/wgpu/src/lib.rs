//! The wgpu caster of esvo: runs the WGSL kernel of `esvo-core` on any Vulkan device.
//!
//! ```no_run
//! # use esvo_core::Caster as _;
//! # fn main() -> Result<(), esvo_core::CastError> {
//! let caster = esvo_wgpu::WgpuCaster::new(&esvo_wgpu::GpuOptions::default())?;
//! println!("{}", caster.device().name);
//! # Ok(()) }
//! ```
//!
//! The kernel is compiled when an octree is loaded or an option is first used, in the variant that the octree and the
//! option need. wgpu's validation and bounds checks stay on.
//!
//! # What is where
//! - `caster`: [`WgpuCaster`], the caster: octree and picture buffers, passes.
//! - `data`: what kernels only read, in buffers or in a texture.
//! - `filter`: the post-process filter.
//! - `instances`: buffers and submission of pictures of many placed objects.
//! - `triangles`: [`WgpuTriangles`], the same for triangles: closest and any hits.
//! - `rays`: buffers for lists of rays; [`PendingHits`], which were not waited for.
//! - `esvo-device`: the device, its buffers, timestamps and errors; [`adapters`].
//! - `esvo_core::gpu`: the kernel, its variants, and how an octree is split over bindings.

mod caster;
mod data;
mod filter;
mod instances;
mod rays;
mod triangles;

pub use caster::WgpuCaster;
pub use esvo_core::gpu::kernel::GpuOptions;
pub use esvo_device::{adapters, wgpu};
pub use rays::PendingHits;
pub use triangles::WgpuTriangles;
