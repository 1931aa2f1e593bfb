//! `esvo bench`: the paper's two tables, measured on this machine.

pub mod check;
mod levels;
pub mod matrix;
mod measure;
mod output;
pub mod pair;
pub(crate) mod paper;
pub mod report;
mod run;
pub mod tables;
mod timed_row;

pub use output::write_paper_record;
pub use run::{PaperBenchOptions, run_paper_bench};
