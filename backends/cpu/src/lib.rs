//! Casts rays on a processor: at octrees on all cores, and at triangles through a bounding volume hierarchy.
//!
//! ```
//! use esvo_core::testing::sample::{Sample, cameras};
//! use esvo_core::{CastOptions, Caster, View};
//! use esvo_cpu::CpuCaster;
//!
//! let octree = Sample::plain(5, true).octree()?; // or Arc::new(Octree::open(path)?)
//! let mut caster = CpuCaster::new(None)?;
//! caster.load(&octree)?;
//! let root = octree.objects()[0].root_slot as u32;
//! let view = View::new(&cameras()[0], octree.octree_to_mesh(0), root, (64, 48), &CastOptions::default())?;
//! let mut hits = Vec::new();
//! caster.cast(&view, &mut hits)?;
//! assert!(hits.iter().any(|hit| !hit.is_miss()));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # What is where
//!
//! | to | see |
//! |---|---|
//! | cast at octrees | [`CpuCaster`]: hits are equal to the reference caster's in every bit |
//! | choose the instructions | [`InstructionSet`], [`CpuCaster::with_instructions`] |
//! | cast at triangles, fast or exactly | [`triangles`] |
//! | count visits, pushes and bytes | [`counters`], with the feature `counters` |
//! | name the processor | [`cpu_name`] |
//!
//! In `src/octree/`, `shared/` casts pictures, fans and lists in packets of rays that share a stack, pictures in tiles, with one
//! source for all instruction sets and the proof that their hits are the reference's. Rays that do not stay together are cast in
//! lockstep (`lockstep.rs`), without vectors one by one (`single.rs`, with the work of `task.rs`). [`LeaveOut`] says what is
//! compiled out. `src/triangles/packet.rs` casts triangles with the same vectors, and `src/filter.rs` filters
//! pictures. For a further instruction set, add a variant of [`InstructionSet`] in `octree/instructions.rs`, one of `Vectors` in
//! `vectors.rs`, and a line in `tests/conformance.rs`.

pub mod triangles;

mod filter;
mod machine;
mod octree;
mod vectors;

pub use esvo_core::LeaveOut;
pub use machine::cpu_name;
pub use octree::counters;
pub use octree::{CpuCaster, InstructionSet};
