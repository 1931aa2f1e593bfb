//! Writing the record of `esvo bench serve`.

use std::path::{Path, PathBuf};

use super::{ServeReport, to_markdown};
use crate::BenchError;
use crate::output::{write_folder, write_text};

/// Writes `report.json` and `tables.md` to `<results>/<machine>/<date>-serve/` and returns that folder. `machine` and a second
/// run on the same day are treated as by [`write_paper_record`](crate::paper_bench::write_paper_record).
///
/// # Errors
/// The system's.
pub fn write_serve_record(report: &ServeReport, results: &Path, machine: Option<&str>) -> Result<PathBuf, BenchError> {
    write_folder(results, &report.machine, machine, "-serve", |folder| {
        write_text(&folder.join("report.json"), &report.to_json())?;
        write_text(&folder.join("tables.md"), &to_markdown(report))
    })
}
