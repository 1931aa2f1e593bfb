//! What an engine can be told when it is opened.

use esvo_core::gpu::kernel::GpuOptions;

/// Options for opening an engine. Each engine reads those that concern it and ignores the others.
#[derive(Clone, Debug, Default)]
pub struct OpenOptions {
    /// Threads of the CPU caster, at least 1; `None`: one per core.
    pub threads: Option<usize>,
    /// Device and kernel of the GPU casters.
    pub gpu: GpuOptions,
}
