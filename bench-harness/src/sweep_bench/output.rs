//! Writing the record of `esvo bench sweep`.

use std::path::{Path, PathBuf};

use super::csv::to_csv;
use super::plot::to_svg;
use super::record::SweepReport;
use super::tables::to_markdown;
use crate::BenchError;
use crate::output::{write_folder, write_text};
use crate::system::machine::slug;

/// Writes `report.json`, `tables.md`, `sweep.csv` and a plot of each scene, `<scene>.svg`, to `<results>/<machine>/<date>-sweep/` and
/// returns that folder. `machine` and a second run on the same day are treated as by
/// [`write_paper_record`](crate::paper_bench::write_paper_record).
///
/// # Errors
/// The system's.
pub fn write_sweep_record(report: &SweepReport, results: &Path, machine: Option<&str>) -> Result<PathBuf, BenchError> {
    write_folder(results, &report.machine, machine, "-sweep", |folder| {
        write_text(&folder.join("report.json"), &report.to_json())?;
        write_text(&folder.join("sweep.csv"), &to_csv(report))?;
        write_text(&folder.join("tables.md"), &to_markdown(report))?;
        for scene in &report.scenes {
            // A scene of which nothing was timed has no plot; the tables say why.
            if let Ok(svg) = to_svg(report, scene) {
                write_text(&folder.join(format!("{}.svg", slug(&scene.name))), &svg)?;
            }
        }
        Ok(())
    })
}

/// Reads a record.
///
/// # Errors
/// A file that cannot be read or is no record of this version.
pub fn read_sweep_record(path: &Path) -> Result<SweepReport, BenchError> {
    let text = std::fs::read_to_string(path).map_err(|e| BenchError::io(path, e))?;
    let bad = |what: String| BenchError::Matrix { file: path.display().to_string(), what };
    let report: SweepReport =
        serde_json::from_str(&text).map_err(|e| bad(format!("is no record of esvo bench sweep: {e}")))?;
    if report.schema != super::record::SCHEMA {
        let what = format!("has version {}; this program reads {}", report.schema, super::record::SCHEMA);
        return Err(bad(what));
    }
    for scene in &report.scenes {
        if scene.cells.iter().filter_map(|cell| cell.octree).any(|octree| octree >= scene.octrees.len()) {
            return Err(bad(format!("scene {}: a cell names an octree that is not listed", scene.name)));
        }
    }
    Ok(report)
}
