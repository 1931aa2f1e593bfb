//! Finding records and reading them. A record is known by its fields: it does not say of what benchmark it is.

use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::BenchError;
use crate::build_bench::BuildReport;
use crate::needs_bench::NeedsReport;
use crate::paper_bench::report::PaperReport;
use crate::ray_bench::RayReport;
use crate::shadow_bench::ShadowReport;
use crate::stability_bench::StabilityReport;
use crate::sweep_bench::{SweepReport, read_sweep_record};
use crate::system::machine::Machine;
use crate::voxel_bench::VoxelReport;

/// Folders below a given one in which records are looked for.
const DEPTH: usize = 4;

/// A record and where it was found.
#[derive(Debug)]
pub struct Found {
    /// The file.
    pub path: PathBuf,
    /// Its name with that of its folder: `2026-11-26-sweep/report.json`.
    pub name: String,
    /// The record.
    pub record: Record,
}

/// A record of one of the benchmarks that a page shows.
#[derive(Debug)]
pub enum Record {
    /// Of `esvo bench`.
    Paper(Box<PaperReport>),
    /// Of `esvo bench build`.
    Build(Box<BuildReport>),
    /// Of `esvo bench sweep`.
    Sweep(Box<SweepReport>),
    /// Of `esvo bench stability`.
    Stability(Box<StabilityReport>),
    /// Of `esvo bench rays`.
    Rays(Box<RayReport>),
    /// Of `esvo bench needs`.
    Needs(Box<NeedsReport>),
    /// Of `esvo bench voxelize`.
    Voxelize(Box<VoxelReport>),
    /// Of `esvo bench shadow`.
    Shadow(Box<ShadowReport>),
}

impl Record {
    /// The command that made it.
    pub fn command(&self) -> &'static str {
        match self {
            Self::Paper(_) => "esvo bench",
            Self::Build(_) => "esvo bench build",
            Self::Sweep(_) => "esvo bench sweep",
            Self::Stability(_) => "esvo bench stability",
            Self::Rays(_) => "esvo bench rays",
            Self::Needs(_) => "esvo bench needs",
            Self::Voxelize(_) => "esvo bench voxelize",
            Self::Shadow(_) => "esvo bench shadow",
        }
    }

    /// The machine that it was made on.
    pub fn machine(&self) -> &Machine {
        match self {
            Self::Paper(report) => &report.machine,
            Self::Build(report) => &report.machine,
            Self::Sweep(report) => &report.machine,
            Self::Stability(report) => &report.machine,
            Self::Rays(report) => &report.machine,
            Self::Needs(report) => &report.machine,
            Self::Voxelize(report) => &report.machine,
            Self::Shadow(report) => &report.machine,
        }
    }
}

/// The benchmarks by fields that only their records have.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Paper,
    Build,
    Sweep,
    Stability,
    Rays,
    Needs,
    Voxelize,
    Shadow,
    /// Records that pages do not show.
    Format,
    Serve,
}

fn kind(value: &Value) -> Option<Kind> {
    let has = |fields: &[&str]| fields.iter().all(|field| value.get(field).is_some());
    if !has(&["schema", "machine"]) {
        return None;
    }
    let kinds: [(Kind, &[&str]); 10] = [
        (Kind::Voxelize, &["curve", "device"]),
        (Kind::Shadow, &["world", "moving", "leaks"]),
        (Kind::Stability, &["controls", "leaks", "meshes"]),
        (Kind::Sweep, &["plan", "devices", "scenes"]),
        (Kind::Rays, &["sets", "engines", "view"]),
        (Kind::Needs, &["cases", "engines"]),
        (Kind::Paper, &["matrix", "devices", "scenes"]),
        (Kind::Build, &["matrix", "scenes"]),
        (Kind::Format, &["octrees", "storage"]),
        (Kind::Serve, &["served", "mbit"]),
    ];
    kinds.iter().find(|(_, fields)| has(fields)).map(|(kind, _)| *kind)
}

/// Reads every record that is named, and those below the folders that are named, four folders deep. The newest comes first; of the
/// same time, the first by name.
///
/// # Errors
/// An input that cannot be read, a named file that is no record or of another version, no record at all.
pub fn find_records(inputs: &[PathBuf]) -> Result<Vec<Found>, BenchError> {
    let mut found: Vec<Found> = Vec::new();
    for input in inputs {
        if input.is_dir() {
            let mut files = Vec::new();
            json_files(input, DEPTH, &mut files)?;
            for file in files {
                found.extend(read(&file, false)?);
            }
        } else {
            found.extend(read(input, true)?);
        }
    }
    if found.is_empty() {
        let names: Vec<_> = inputs.iter().map(|input| input.display().to_string()).collect();
        return Err(bad(
            &names.join(", "),
            "holds no record of esvo bench, build, sweep, stability, rays, needs, voxelize or shadow",
        ));
    }
    let mut seen = Vec::new();
    found.retain(|one| {
        let path = one.path.canonicalize().unwrap_or_else(|_| one.path.clone());
        let new = !seen.contains(&path);
        seen.push(path);
        new
    });
    found.sort_by(|a, b| b.record.machine().date.cmp(&a.record.machine().date).then_with(|| a.name.cmp(&b.name)));
    Ok(found)
}

/// Reads a file. `None`: it is no record of one of these benchmarks.
///
/// # Errors
/// A file that cannot be read or is no JSON; a record that is damaged or of another version.
pub fn read_record(path: &Path) -> Result<Option<Record>, BenchError> {
    let text = std::fs::read_to_string(path).map_err(|e| BenchError::io(path, e))?;
    let value = serde_json::from_str::<Value>(&text)
        .map_err(|e| bad(&path.display().to_string(), format!("is no record of a benchmark: {e}")))?;
    parse_record(path, &text, kind(&value))
}

/// The JSON files of a folder and of those below it, in the order of their names. Links are not followed.
fn json_files(folder: &Path, depth: usize, files: &mut Vec<PathBuf>) -> Result<(), BenchError> {
    let failed = |e| BenchError::io(folder, e);
    let mut entries = std::fs::read_dir(folder).map_err(failed)?.collect::<Result<Vec<_>, _>>().map_err(failed)?;
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        let kind = entry.file_type().map_err(failed)?;
        if kind.is_dir() && depth > 0 {
            json_files(&entry.path(), depth - 1, files)?;
        } else if kind.is_file() && entry.path().extension().is_some_and(|e| e == "json") {
            files.push(entry.path());
        }
    }
    Ok(())
}

fn bad(file: &str, what: impl ToString) -> BenchError {
    BenchError::Matrix { file: file.into(), what: what.to_string() }
}

/// Reads a file. One that was not named and is no record is passed over.
fn read(path: &Path, named: bool) -> Result<Option<Found>, BenchError> {
    let file = path.display().to_string();
    let text = std::fs::read_to_string(path).map_err(|e| BenchError::io(path, e))?;
    let kind = match serde_json::from_str::<Value>(&text) {
        Ok(value) => kind(&value),
        Err(error) if named => return Err(bad(&file, format!("is no record of a benchmark: {error}"))),
        Err(_) => None,
    };
    let Some(record) = parse_record(path, &text, kind)? else {
        return match kind {
            _ if !named => Ok(None),
            Some(_) => Err(bad(&file, "is a record of esvo bench format, which pages do not show")),
            None => {
                Err(bad(&file, "is no record of esvo bench, build, sweep, stability, rays, needs, voxelize or shadow"))
            }
        };
    };
    let own = path.file_name().unwrap_or_default().to_string_lossy();
    let folder = path.canonicalize().ok().and_then(|p| Some(p.parent()?.file_name()?.to_string_lossy().into_owned()));
    let name = folder.map_or_else(|| own.to_string(), |folder| format!("{folder}/{own}"));
    Ok(Some(Found { path: path.to_owned(), name, record }))
}

/// The record in a text of this kind. `None`: there is none.
fn parse_record(path: &Path, text: &str, kind: Option<Kind>) -> Result<Option<Record>, BenchError> {
    let file = path.display().to_string();
    let record = match kind {
        Some(Kind::Paper) => Record::Paper(parse(text, &file, crate::paper_bench::report::SCHEMA)?),
        Some(Kind::Build) => Record::Build(parse(text, &file, crate::build_bench::SCHEMA)?),
        Some(Kind::Stability) => Record::Stability(parse(text, &file, crate::stability_bench::SCHEMA)?),
        Some(Kind::Rays) => Record::Rays(parse(text, &file, crate::ray_bench::SCHEMA)?),
        Some(Kind::Needs) => Record::Needs(parse(text, &file, crate::needs_bench::SCHEMA)?),
        Some(Kind::Voxelize) => Record::Voxelize(parse(text, &file, crate::voxel_bench::SCHEMA)?),
        Some(Kind::Shadow) => Record::Shadow(parse(text, &file, crate::shadow_bench::SCHEMA)?),
        // Its cells point at octrees, which this function checks.
        Some(Kind::Sweep) => Record::Sweep(Box::new(read_sweep_record(path)?)),
        Some(Kind::Format | Kind::Serve) | None => return Ok(None),
    };
    Ok(Some(record))
}

fn parse<T: DeserializeOwned>(text: &str, file: &str, schema: u32) -> Result<Box<T>, BenchError> {
    let value: Value = serde_json::from_str(text).map_err(|e| bad(file, e))?;
    if value["schema"] != schema {
        return Err(bad(file, format!("has version {}; this program reads {schema}", value["schema"])));
    }
    serde_json::from_str(text).map(Box::new).map_err(|e| bad(file, format!("is a damaged record: {e}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn put(folder: &Path, name: &str, text: &str) -> PathBuf {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, text).unwrap();
        path
    }

    #[test]
    fn what_is_no_record_is_refused_if_it_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let other = put(folder.path(), "a/other.json", "{\"schema\": 1}");
        let text = put(folder.path(), "a/broken.json", "{");
        let format = put(folder.path(), "a/f.json", r#"{"schema":1,"machine":{},"octrees":[],"storage":[]}"#);
        let refused = |input: &Path| find_records(&[input.to_owned()]).unwrap_err().to_string();
        assert!(refused(&other).contains("other.json: is no record"), "{}", refused(&other));
        assert!(refused(&text).contains("broken.json: is no record"));
        assert!(refused(&format).contains("esvo bench format, which pages do not show"));
        // In a folder they are passed over, and then there is nothing.
        assert!(refused(folder.path()).contains("holds no record"));
        assert!(refused(&folder.path().join("absent")).contains("absent"));
    }

    #[test]
    fn damaged_records_and_other_versions_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let with = |schema: u32| {
            let text = format!(r#"{{"schema":{schema},"machine":{{}},"matrix":{{}},"devices":[],"scenes":[]}}"#);
            let file = put(folder.path(), "report.json", &text);
            find_records(&[file]).unwrap_err().to_string()
        };
        assert!(with(1).contains("is a damaged record"), "{}", with(1));
        assert!(with(9).contains("has version 9; this program reads 1"), "{}", with(9));
        // A benchmark is known by its own fields.
        let fields = [
            ("esvo bench voxelize", r#""curve":[],"device":{}"#),
            ("esvo bench shadow", r#""world":{},"moving":[],"leaks":[]"#),
            ("esvo bench stability", r#""controls":[],"leaks":[],"meshes":[]"#),
        ];
        for (command, fields) in fields {
            let text = format!(r#"{{"schema":1,"machine":{{}},{fields}}}"#);
            let error = find_records(&[put(folder.path(), "report.json", &text)]).unwrap_err().to_string();
            assert!(error.contains("is a damaged record"), "{command}: {error}");
        }
    }
}
