//! Where a run's record, tables and pictures go.

use std::path::{Path, PathBuf};

use esvo_core::picture::{Picture, write_png};
use esvo_format::write_atomically;

use crate::format_bench::FormatReport;
use crate::paper_bench::run::Outcome;
use crate::paper_bench::tables;
use crate::picture::write_png;
use crate::system::machine::{Machine, slug};
use crate::{BenchError, format_bench};

/// A picture and where it goes.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct NamedPicture {
    /// File name.
    pub name: String,
    /// The picture.
    pub picture: Picture,
}

/// Whether something can be written below `results`, which need not exist: better known before a run than after it.
///
/// # Errors
/// The system's, at the folder or the nearest one above that exists.
pub fn check(results: &Path) -> Result<(), BenchError> {
    let above = results.ancestors().map(|p| if p.as_os_str().is_empty() { Path::new(".") } else { p });
    let existing = above.into_iter().find(|p| p.exists()).unwrap_or(Path::new("."));
    tempfile::tempfile_in(existing).map(drop).map_err(|e| BenchError::io(existing, e))
}

/// Writes `report.json`, `tables.md` and the pictures to `<results>/<machine>/<date>/` and returns that folder.
///
/// `machine` replaces the name made from the processor. A second run of a day goes to `<date>.2`, and so on: nothing is
/// overwritten. The folder appears under its name when everything is in it.
///
/// # Errors
/// The system's.
pub fn write(outcome: &Outcome, results: &Path, machine: Option<&str>) -> Result<PathBuf, BenchError> {
    let report = &outcome.report;
    write_folder(results, &report.machine, machine, "", |folder| {
        put(folder, "report.json", &report.to_json())?;
        put(folder, "tables.md", &tables::to_markdown(report))?;
        for picture in &outcome.pictures {
            let path = folder.join(&picture.name);
            write_png(&path, &picture.picture).map_err(|e| BenchError::io(&path, e))?;
        }
        Ok(())
    })
}

/// Writes `report.json` and `tables.md` of the format to `<results>/<machine>/<date>-format/`, like [`write()`].
///
/// # Errors
/// The system's.
pub fn write_format(report: &FormatReport, results: &Path, machine: Option<&str>) -> Result<PathBuf, BenchError> {
    write_folder(results, &report.machine, machine, "-format", |folder| {
        put(folder, "report.json", &format_bench::to_json(report))?;
        put(folder, "tables.md", &format_bench::to_markdown(report))
    })
}

fn put(folder: &Path, name: &str, text: &str) -> Result<(), BenchError> {
    let path = folder.join(name);
    write_atomically(&path, |out| out.write_all(text.as_bytes())).map_err(|e| BenchError::io(&path, e))
}

/// A new folder `<results>/<machine>/<date><kind>`, with a number behind it if there is one already.
fn write_folder(
    results: &Path,
    machine: &Machine,
    name: Option<&str>,
    kind: &str,
    fill: impl FnOnce(&Path) -> Result<(), BenchError>,
) -> Result<PathBuf, BenchError> {
    let parent = results.join(name.map_or_else(|| machine.slug(), slug));
    std::fs::create_dir_all(&parent).map_err(|e| BenchError::io(&parent, e))?;
    let temporary =
        tempfile::Builder::new().prefix(".esvo-").tempdir_in(&parent).map_err(|e| BenchError::io(&parent, e))?;
    fill(temporary.path())?;
    readable(temporary.path())?;
    let day = machine.day();
    for number in 1..10_000 {
        let name = if number == 1 { format!("{day}{kind}") } else { format!("{day}{kind}.{number}") };
        let folder = parent.join(name);
        if folder.exists() {
            continue;
        }
        std::fs::rename(temporary.path(), &folder).map_err(|e| BenchError::io(&folder, e))?;
        // It has moved: there is nothing left to remove.
        let _ = temporary.keep();
        return Ok(folder);
    }
    Err(BenchError::io(&parent, std::io::Error::other("too many runs of this day")))
}

/// A temporary folder is its owner's alone; results are for everybody.
fn readable(folder: &Path) -> Result<(), BenchError> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        std::fs::set_permissions(folder, std::fs::Permissions::from_mode(0o755))
            .map_err(|e| BenchError::io(folder, e))?;
    }
    Ok(())
}
