//! Writing the record of `esvo bench voxelize`.

use std::path::{Path, PathBuf};

use super::{VoxelOutcome, curve_to_svg, to_markdown, to_svg};
use crate::BenchError;
use crate::output::{write_folder, write_text};

/// Writes `report.json`, `tables.md`, plots and pictures to `<results>/<machine>/<date>-voxelize/` and returns that folder. `machine` and a
/// second run on the same day are treated as by [`write_paper_record`](crate::paper_bench::write_paper_record).
///
/// # Errors
/// The system's.
pub fn write_voxel_record(
    outcome: &VoxelOutcome,
    results: &Path,
    machine: Option<&str>,
) -> Result<PathBuf, BenchError> {
    let report = &outcome.report;
    write_folder(results, &report.machine, machine, "-voxelize", |folder| {
        write_text(&folder.join("report.json"), &report.to_json())?;
        write_text(&folder.join("tables.md"), &to_markdown(report))?;
        for (name, plot) in [("error.svg", to_svg(report)), ("triangles.svg", curve_to_svg(report))] {
            // There is no plot of nothing.
            if let Ok(svg) = plot {
                write_text(&folder.join(name), &svg)?;
            }
        }
        for picture in &outcome.pictures {
            picture.write(folder)?;
        }
        Ok(())
    })
}
