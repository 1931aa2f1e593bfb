//! The record that a run is compared with if none is named, and blessing.

use std::path::{Path, PathBuf};

use crate::BenchError;
use crate::compare::measured::MeasuredRun;
use crate::compare::read::read_run;
use crate::compare::verdicts::is_comparable;
use crate::output::write_text;
use crate::system::machine::slug;

/// Folder of blessed records, in that of the machine.
const BLESSED: &str = "baseline";

/// The record in `baselines`, laid out as `results/`, that `run` is compared with: the blessed one of the same kind of machine, or else
/// the newest one. Only records count that have a cell which can be compared with one of `run`; the file of `run` itself does not.
///
/// # Errors
/// A folder that cannot be read. No such record: the text says how to make one.
pub fn find_baseline(baselines: &Path, run: &MeasuredRun, file: &Path) -> Result<(PathBuf, MeasuredRun), BenchError> {
    let own = file.canonicalize().ok();
    let is_own = |path: &Path| own.is_some() && path.canonicalize().ok() == own;
    let mut found: Vec<(bool, PathBuf, MeasuredRun)> = Vec::new();
    for path in records(baselines)?.into_iter().filter(|path| !is_own(path)) {
        // Other benchmarks write records there, too.
        if let Ok(candidate) = read_run(&path)
            && candidate.slowed.is_empty()
            && candidate.wrong.is_empty()
            && is_comparable(&candidate, run)
        {
            let blessed = path.parent().is_some_and(|folder| folder.ends_with(BLESSED));
            found.push((blessed, path, candidate));
        }
    }
    let newest = found.into_iter().max_by(|(blessed, path, run), (other_blessed, other_path, other)| {
        (blessed, &run.machine.date, path).cmp(&(other_blessed, &other.machine.date, other_path))
    });
    newest.map(|(_, path, run)| (path, run)).ok_or_else(|| BenchError::Matrix {
        file: baselines.display().to_string(),
        what: format!(
            "no record of {} that can be compared with {}; name one, or accept this one: esvo bench bless {}",
            run.machine.slug(),
            file.display(),
            file.display()
        ),
    })
}

/// Makes a record the baseline of its kind of machine: copies it to `<baselines>/<machine>/baseline/<benchmark>-<matrix>.json`, whole or
/// not at all, in place of the one that was there. Returns that path.
///
/// # Errors
/// A file that is no record with times, whose answers are wrong, or that was slowed on purpose; the system's.
pub fn bless(file: &Path, baselines: &Path) -> Result<PathBuf, BenchError> {
    let run = read_run(file)?;
    let refuse = |what: String| BenchError::Matrix { file: file.display().to_string(), what };
    if let Some(wrong) = run.wrong.first() {
        return Err(refuse(format!("has wrong answers ({wrong}); it cannot be a baseline")));
    }
    if let Some(slowed) = run.slowed.first() {
        return Err(refuse(format!("was slowed on purpose ({slowed}); it cannot be a baseline")));
    }
    if run.cells.is_empty() {
        return Err(refuse("has no times; it cannot be a baseline".into()));
    }
    let folder = baselines.join(run.machine.slug()).join(BLESSED);
    let text = std::fs::read_to_string(file).map_err(|e| BenchError::io(file, e))?;
    std::fs::create_dir_all(&folder).map_err(|e| BenchError::io(&folder, e))?;
    let path = folder.join(format!("{}-{}.json", run.kind.name(), slug(&run.name)));
    write_text(&path, &text)?;
    Ok(path)
}

/// The files `<machine>/<run>/*.json`.
fn records(baselines: &Path) -> Result<Vec<PathBuf>, BenchError> {
    let list = |folder: &Path| -> Result<Vec<PathBuf>, BenchError> {
        let entries = std::fs::read_dir(folder).map_err(|e| BenchError::io(folder, e))?;
        let mut paths = Vec::new();
        for entry in entries {
            paths.push(entry.map_err(|e| BenchError::io(folder, e))?.path());
        }
        Ok(paths)
    };
    let mut files = Vec::new();
    for machine in list(baselines)?.into_iter().filter(|path| path.is_dir()) {
        for run in list(&machine)?.into_iter().filter(|path| path.is_dir()) {
            files.extend(list(&run)?.into_iter().filter(|path| path.extension().is_some_and(|e| e == "json")));
        }
    }
    Ok(files)
}
