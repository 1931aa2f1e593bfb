//! `esvo bench sweep`: error against run time, of every setting: levels, contours, beam, termination, engine; and triangles.
//!
//! - `plan.rs`: what is measured. `run.rs`: from the plan to the record. `subject.rs`: octrees, from the cache or built. `measure.rs`:
//!   comparing with the reference caster and with the exact answers (`exact.rs`), then timing in turn.
//! - `cache.rs`: octrees and exact hits of former runs, by content hash.
//! - `record.rs`: the record. `pareto.rs`, `errors.rs`, `answers.rs`: fronts, measures, and the questions in words. `tables.rs`,
//!   `csv.rs`, `plot.rs`, `output.rs`: what is written.
//! - `advice.rs`: `esvo advise`, settings that keep a wish. `file_sweep.rs`: the settings of one file.

pub mod advice;
pub mod answers;
mod cache;
pub mod csv;
pub mod errors;
mod exact;
mod file_sweep;
mod measure;
mod output;
pub mod pareto;
pub mod plan;
pub mod plot;
pub mod record;
mod run;
#[cfg(test)]
pub(crate) mod sample;
mod subject;
pub(crate) mod tables;

pub use crate::content_hash::image_key;
pub use cache::Cache;
pub(crate) use cache::mesh_sha256;
pub use file_sweep::{FileSweepOptions, run_file_sweep};
pub use output::{read_sweep_record, write_sweep_record};
pub use plan::SweepPlan;
pub use record::SweepReport;
pub use run::{SweepBenchOptions, resume_sweep_bench, run_sweep_bench};
pub use tables::{to_markdown, to_text};
