//! The benchmark harness of esvo: matrix, checks, timing, error, tables.
//!
//! [`run::run`](paper_bench::run::run) takes a [`Matrix`] and gives a [`Report`], from which
//! [`tables`](paper_bench::tables) makes what is printed and [`output`] what is written.

mod bench_error;
pub mod build_bench;
pub mod build_summary;
pub mod error;
pub mod format_bench;
mod growth;
pub mod import_bench;
pub mod matrix_parts;
pub mod output;
pub mod paper_bench;
pub mod picture_bench;
mod progress;
pub mod scene;
pub mod system;
pub mod text;
pub mod timing;
mod units;

pub use bench_error::BenchError;
pub use paper_bench::matrix::Matrix;
pub use paper_bench::report::PaperReport;
pub use progress::Progress;
pub use system::process::interrupted;
