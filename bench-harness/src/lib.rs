//! The benchmark harness of esvo: matrix, checks, timing, error, tables.
//!
//! [`run::run`] takes a [`Matrix`] and gives a [`Report`], from which [`tables`] makes what is printed and
//! [`output`] what is written.

mod backend;
pub mod build_bench;
pub mod build_summary;
pub mod check;
mod clock;
mod cutout;
pub mod error;
mod failure;
pub mod flip;
pub mod format_bench;
pub mod import_table;
mod levels;
pub mod machine;
pub mod matrix;
mod measure;
mod mesh_picture;
pub mod output;
mod paper;
pub mod pictures;
mod process;
mod progress;
pub mod report;
pub mod run;
pub mod scene;
mod scratch;
pub mod tables;
pub mod text;
pub mod timing;

pub use backend::Backend;
pub use failure::BenchError;
pub use matrix::Matrix;
pub use process::interrupted;
pub use progress::Progress;
pub use report::Report;
