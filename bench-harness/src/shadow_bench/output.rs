//! Writing the record of `esvo bench shadow`.

use std::path::{Path, PathBuf};

use super::{ShadowOutcome, to_markdown, to_svg};
use crate::BenchError;
use crate::output::{write_folder, write_text};

/// Writes `report.json`, `tables.md`, plots and pictures to `<results>/<machine>/<date>-shadow/` and returns that folder. `machine` and a second
/// run on the same day are treated as by [`write_paper_record`](crate::paper_bench::write_paper_record).
///
/// # Errors
/// The system's.
pub fn write_shadow_record(
    outcome: &ShadowOutcome,
    results: &Path,
    machine: Option<&str>,
) -> Result<PathBuf, BenchError> {
    let report = &outcome.report;
    write_folder(results, &report.machine, machine, "-shadow", |folder| {
        write_text(&folder.join("report.json"), &report.to_json())?;
        write_text(&folder.join("tables.md"), &to_markdown(report))?;
        for (name, svg) in to_svg(report) {
            write_text(&folder.join(name), &svg)?;
        }
        for picture in &outcome.pictures {
            picture.write(folder)?;
        }
        Ok(())
    })
}
