//! Reading a record of any benchmark that has times.

use std::path::Path;

use crate::BenchError;
use crate::compare::measured::{Measured, MeasuredRun};
use crate::records::{Record, read_record};

/// Reads a record of `esvo bench`, `esvo bench sweep`, `esvo bench rays` or `esvo bench needs`.
///
/// # Errors
/// A file that cannot be read, is no record of these, or is of another version.
pub fn read_run(path: &Path) -> Result<MeasuredRun, BenchError> {
    match read_record(path)? {
        Some(Record::Paper(report)) => Ok(report.measured()),
        Some(Record::Sweep(report)) => Ok(report.measured()),
        Some(Record::Rays(report)) => Ok(report.measured()),
        Some(Record::Needs(report)) => Ok(report.measured()),
        Some(Record::Build(_) | Record::Stability(_) | Record::Voxelize(_) | Record::Shadow(_)) | None => {
            Err(BenchError::Matrix {
                file: path.display().to_string(),
                what: "expected report.json of esvo bench, or of esvo bench sweep, rays or needs".into(),
            })
        }
    }
}
