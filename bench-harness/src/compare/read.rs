//! Reading a record of any benchmark that has times.

use std::path::Path;

use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::compare::measured::{Measured, MeasuredRun};
use crate::needs_bench::{self, NeedsReport};
use crate::ray_bench::{self, RayReport};
use crate::sweep_bench::{SweepReport, read_sweep_record};
use crate::{BenchError, PaperReport, paper_bench};

/// Reads a record of `esvo bench`, `esvo bench sweep`, `esvo bench rays` or `esvo bench needs`.
///
/// # Errors
/// A file that cannot be read, is no record of these, or is of another version.
pub fn read_run(path: &Path) -> Result<MeasuredRun, BenchError> {
    let bad = |what: String| BenchError::Matrix { file: path.display().to_string(), what };
    let text = std::fs::read_to_string(path).map_err(|e| BenchError::io(path, e))?;
    let value: Value = serde_json::from_str(&text).map_err(|e| bad(format!("is no record of a benchmark: {e}")))?;
    let has = |key: &str| value.get(key).is_some();
    if has("matrix") && has("devices") {
        let report: PaperReport = parse(&text, "esvo bench", paper_bench::report::SCHEMA).map_err(bad)?;
        return Ok(report.measured());
    }
    if has("plan") {
        let report: SweepReport = read_sweep_record(path)?;
        return Ok(report.measured());
    }
    if has("sets") && has("view") {
        let report: RayReport = parse(&text, "esvo bench rays", ray_bench::SCHEMA).map_err(bad)?;
        return Ok(report.measured());
    }
    if has("cases") && has("engines") && has("size") {
        let report: NeedsReport = parse(&text, "esvo bench needs", needs_bench::SCHEMA).map_err(bad)?;
        return Ok(report.measured());
    }
    Err(bad("expected report.json of esvo bench, or of esvo bench sweep, rays or needs".into()))
}

fn parse<T: DeserializeOwned>(text: &str, command: &str, schema: u32) -> Result<T, String> {
    let bad = |e| format!("is no record of {command}: {e}");
    let value: Value = serde_json::from_str(text).map_err(bad)?;
    let found = value.get("schema").cloned().unwrap_or_default();
    if found != schema {
        return Err(format!("its schema is {found}, and this program reads schema {schema}"));
    }
    serde_json::from_str(text).map_err(bad)
}
