//! `esvo bench compare`: what is slower in a second record, on a machine that others use, too.
//!
//! - `measured.rs`: what is compared of a record, whichever benchmark made it. `read.rs`: reading one.
//! - `ratio.rs`: the statistic, and what it says of a cell. `verdicts.rs`: from two records to a verdict on each cell.
//! - `tables.rs`: what is printed. `baseline.rs`: the record that a run is compared with, and blessing.

pub mod baseline;
pub mod measured;
pub mod ratio;
mod read;
mod tables;
pub mod verdicts;

pub use measured::{Measured, MeasuredCell, MeasuredRun, RecordKind};
pub use ratio::Verdict;
pub use read::read_run;
pub use tables::{to_markdown, to_text};
pub use verdicts::{CompareReport, DEFAULT_THRESHOLD, compare};
