//! Writing the record of `esvo bench build`.

use std::path::{Path, PathBuf};

use super::{BuildReport, to_markdown};
use crate::BenchError;
use crate::output::write_text;

/// Writes `<matrix>.json` and `<matrix>.md` to the folder, which is made if needed, and returns their paths.
///
/// # Errors
/// The system's.
pub fn write_build_record(report: &BuildReport, folder: &Path) -> Result<[PathBuf; 2], BenchError> {
    std::fs::create_dir_all(folder).map_err(|e| BenchError::io(folder, e))?;
    let paths = ["json", "md"].map(|extension| folder.join(format!("{}.{extension}", report.matrix.name)));
    write_text(&paths[0], &report.to_json())?;
    write_text(&paths[1], &to_markdown(report))?;
    Ok(paths)
}
