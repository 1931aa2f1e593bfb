//! The machine: its time, memory, processes and temporary folders.

pub(crate) mod clock;
pub(crate) mod cpu_time;
pub mod machine;
pub(crate) mod proc;
pub(crate) mod process;
pub(crate) mod scratch;

pub use proc::{available_bytes, ignores_signal, peak_bytes};
