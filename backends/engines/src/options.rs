//! What an engine can be told when it is opened.

use esvo_core::gpu::kernel::GpuOptions;
use esvo_cpu::{InstructionSet, LeaveOut};

/// Options for opening an engine. Each engine reads those that concern it and ignores the others.
#[derive(Clone, Debug, Default)]
pub struct OpenOptions {
    /// Threads of the CPU caster, at least 1; `None`: one per core.
    pub threads: Option<usize>,
    /// Instructions of the CPU caster; `None`: the fastest that the processor has.
    pub instructions: Option<InstructionSet>,
    /// What casters leave out if nothing needs it; at first, all that can be.
    pub leave_out: LeaveOut,
    /// Device and kernel of the GPU casters. Its `leave_out` is not read.
    pub gpu: GpuOptions,
}
