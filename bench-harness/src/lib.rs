//! The benchmark harness of esvo: it builds octrees, checks the answers of the engines, times them, measures errors against
//! the triangles, and writes records and tables.
//!
//! ```no_run
//! use esvo_bench::paper_bench::{PaperBenchOptions, run_paper_bench, tables};
//! use esvo_bench::{Matrix, Progress};
//!
//! let options = PaperBenchOptions::new(Matrix::default_run());
//! let outcome = run_paper_bench(&options, &Progress::terminal())?;
//! print!("{}", tables::to_text(&outcome.report));
//! # Ok::<(), esvo_bench::BenchError>(())
//! ```
//!
//! # What is where
//! Each benchmark is a folder with a function `run_...`, a record (plain data, stored as JSON), tables, and a writer:
//! - [`paper_bench`]: `esvo bench`, the paper's two tables. `table1.rs` and `table2.rs` in `paper_bench/tables/` print Table 1
//!   and Table 2; `timed_row.rs` takes the times of Table 2, `check.rs` compares engines with the reference caster, `paper.rs`
//!   has the paper's figures.
//! - [`build_bench`]: `esvo bench build`, time, memory, size and error of building, compared with the authors' builder.
//! - [`format_bench`]: `esvo bench format`, storing, validating and reading files.
//! - [`picture_bench`]: `esvo bench pictures`, octrees next to their triangles. Also the exact pictures of meshes.
//! - [`needs_bench`]: `esvo bench needs`, what code for features that a scene does not need costs.
//! - [`ray_bench`]: `esvo bench rays`, lists of rays on every engine next to a picture.
//! - [`stability_bench`]: `esvo bench stability`, hard rays through hard octrees on every engine, judged by an oracle.
//! - [`sweep_bench`]: `esvo bench sweep`, error against run time; `esvo advise` picks settings from its record.
//! - [`shadow_bench`]: `esvo bench shadow`, a volume of one bit a voxel, and how wrong its shortcuts are.
//! - [`serve_bench`]: `esvo bench serve`, what pictures of octrees on a server take.
//! - [`voxel_bench`]: `esvo bench voxelize`, voxelization on a GPU against the builder's voxels.
//! - [`import_bench`]: `esvo bench import`, what happens to each mesh file of a folder.
//! - [`full_bench`]: `esvo bench --full`, all of these one after the other.
//! - [`page`]: `esvo bench page`, one HTML file of the records of the others.
//!
//! What they share:
//! - [`scene`]: from a scene's name to its mesh and viewpoints. [`matrix_parts`]: scenes and levels of a matrix.
//! - [`calibration`]: a frozen kernel that is cast between timed casts. [`compare`]: `esvo bench compare`, what is slower in a
//!   second record, and baselines.
//! - `scene_triangles`: the triangles that octrees are built of and compared with; `seen`: their exact hits and pictures, also of a
//!   displaced mesh that is never in memory as a whole.
//! - [`error`]: depth error and image error (FLIP). [`timing`]: samples, medians and quartiles.
//! - [`text`]: tables as text and Markdown. [`output`]: the only writer of records, tables and pictures.
//! - [`journal`]: finished parts of a run that was stopped.
//! - [`records`]: finds records and reads them, of whichever benchmark.
//! - [`repeat`]: `esvo bench --repeat`, a record's run again.
//! - [`ray_files`]: rays and hits in files, and comparing hits.
//! - [`build_summary`]: what `esvo build --json` prints. `growth`: predicting the next level. `curve`: between
//!   levels and beyond them. `content_hash`: of octrees. `units`: bytes.
//! - [`system`]: machine, clock, processes, temporary folders; the only reader of `/proc`.
//! - [`BenchError`]: all errors. [`Progress`]: the line on the terminal.

mod bench_error;
pub mod build_bench;
pub mod build_summary;
pub mod calibration;
pub mod compare;
mod content_hash;
mod curve;
pub mod error;
pub mod format_bench;
pub mod full_bench;
mod growth;
pub mod import_bench;
pub mod journal;
pub mod matrix_parts;
pub mod needs_bench;
pub mod output;
pub mod page;
pub mod paper_bench;
pub mod picture_bench;
mod progress;
pub mod ray_bench;
pub mod ray_files;
pub mod records;
pub mod repeat;
pub mod scene;
mod scene_triangles;
mod seen;
pub mod serve_bench;
pub mod shadow_bench;
pub mod stability_bench;
pub mod sweep_bench;
pub mod system;
pub mod text;
pub mod timing;
mod units;
pub mod voxel_bench;

pub use bench_error::BenchError;
pub use paper_bench::matrix::Matrix;
pub use paper_bench::report::PaperReport;
pub use progress::Progress;
pub use system::process::interrupted;
