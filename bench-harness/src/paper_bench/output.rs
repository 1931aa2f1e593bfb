//! Writing the record of `esvo bench`.

use std::path::{Path, PathBuf};

use crate::BenchError;
use crate::output::{write_folder, write_text};
use crate::paper_bench::report::PaperOutcome;
use crate::paper_bench::tables::{to_csv, to_latex, to_markdown};

/// Writes `report.json`, `tables.md`, `tables.csv`, `tables.tex` and the pictures to `<results>/<machine>/<date>/` and returns that folder.
///
/// `machine` replaces the name made from the processor. A second run on the same day goes to `<date>.2`, and so on: nothing is
/// overwritten. The folder appears under its name when everything is in it.
///
/// # Errors
/// The system's.
pub fn write_paper_record(
    outcome: &PaperOutcome,
    results: &Path,
    machine: Option<&str>,
) -> Result<PathBuf, BenchError> {
    let report = &outcome.report;
    write_folder(results, &report.machine, machine, "", |folder| {
        write_text(&folder.join("report.json"), &report.to_json())?;
        write_text(&folder.join("tables.md"), &to_markdown(report))?;
        write_text(&folder.join("tables.csv"), &to_csv(report))?;
        write_text(&folder.join("tables.tex"), &to_latex(report))?;
        outcome.pictures.iter().try_for_each(|picture| picture.write(folder).map(drop))
    })
}
