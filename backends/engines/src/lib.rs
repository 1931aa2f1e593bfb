//! The engines of esvo: which there are, and opening one by name.
//!
//! ```
//! use esvo_engines::{EngineId, OpenOptions};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let engine: EngineId = "cpu".parse()?;
//! let caster = engine.open(&OpenOptions { threads: Some(2), ..OpenOptions::default() })?;
//! println!("{} on {}", caster.name(), caster.device().name);
//! # Ok(()) }
//! ```
//!
//! # What is where
//! - [`EngineId`]: the name of an engine, as a type. It is written, read and typed as `reference`, `cpu`, `wgpu` or `ash`.
//! - [`Engine`]: what is known of an engine without opening it: description, cargo feature, what may differ from the
//!   reference caster. `table.rs` holds the table of them.
//! - [`OpenOptions`]: threads, instruction set, GPU. [`EngineId::open`] opens an engine; [`OpenError`] says why it cannot.
//!
//! # An engine of one's own
//! [`EngineId::register`] makes a caster known that is in another crate. The example `measure_own_caster` in `examples/` runs one through
//! the checks, the tables, the error and the stability suite of `esvo-bench`.
//!
//! # Adding an engine
//! Write a crate with a type that implements [`Caster`](esvo_core::Caster), add it to this crate as an optional
//! dependency with a feature of the same name, and add one line to the table in `table.rs`.

mod id;
mod open;
mod options;
mod own;
mod table;

pub use esvo_core::gpu::kernel::GpuOptions;
pub use esvo_core::testing::compare::Allowed;
pub use esvo_cpu::{InstructionSet, LeaveOut};
pub use id::UnknownEngine;
pub use open::{OpenError, OpenFailure};
pub use options::OpenOptions;
pub use own::{OwnEngine, RegisterError};
pub use table::{Engine, EngineId};
