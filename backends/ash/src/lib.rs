//! The ash (Vulkan) compute caster of esvo: the WGSL kernel of `esvo-core` as SPIR-V.
//!
//! The SPIR-V is made by naga when an octree is loaded or an option first asked for, not when the crate is built: the
//! number of storage bindings and the size of the stack are part of the kernel's text, so that there are hundreds of
//! variants of which a run uses two or three, each a matter of milliseconds; and naga writes no specialization constants.
//! A test compiles them all. Unlike wgpu, this caster forbids the driver to fuse a multiplication with an addition, and
//! uses no bounds checks.
//!
//! With `ESVO_VALIDATION=1` in the environment and the Khronos validation layer installed, whatever the layer reports is
//! an error.

mod buffers;
mod caster;
mod gpu;
mod instance;
mod pipeline;
mod spirv;

pub use caster::AshCaster;
pub use esvo_core::gpu::kernel::GpuOptions;
pub use instance::adapters;
pub use spirv::{forbid_contraction, module};
