//! `esvo bench`: the paper's Table 1 and Table 2, measured on this machine.
//!
//! [`run_paper_bench`] takes a [`Matrix`](matrix::Matrix) and returns a [`PaperReport`](report::PaperReport);
//! [`tables`] makes the tables from the report, and [`write_paper_record`] writes report, tables and pictures.

pub mod check;
pub(crate) mod figures;
mod filter_row;
pub(crate) mod levels;
pub mod matrix;
mod measure;
mod output;
pub mod pair;
pub(crate) mod paper;
pub mod report;
mod run;
pub mod slowed;
pub mod tables;
mod timed_row;

pub use output::write_paper_record;
pub use run::{PaperBenchOptions, resume_paper_bench, run_paper_bench};
pub use slowed::Slowed;
