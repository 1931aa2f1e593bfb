//! The wgpu compute caster of esvo: the WGSL kernel of `esvo-core` on any Vulkan device.
//!
//! ```no_run
//! # use esvo_core::Caster as _;
//! # fn main() -> Result<(), esvo_core::CastError> {
//! let caster = esvo_wgpu::WgpuCaster::new(&esvo_wgpu::GpuOptions::default())?;
//! println!("{}", caster.device().name);
//! # Ok(()) }
//! ```

mod caster;
mod gpu;

pub use caster::WgpuCaster;
pub use esvo_core::gpu::kernel::GpuOptions;
pub use gpu::adapters;
