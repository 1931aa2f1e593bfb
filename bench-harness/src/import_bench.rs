//! `esvo bench import`: builds each mesh file of some folders in a process of its own and lists which files give an octree and
//! which an error. Made for collections of unusual files: a crash or a hang is recorded and does not end the run.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use esvo_builder::import::is_mesh_file;

use crate::system::process::Process;
use crate::text::TextTable;
use crate::{BenchError, Progress};

/// Time between two checks of a process.
const POLL: Duration = Duration::from_millis(5);

/// Maximum number of bytes read from the standard error of a process: an error is one line.
const MOST_WORDS: u64 = 1 << 16;

/// Which files [`run_import_bench`] tries, and within which limits.
#[derive(Clone, Debug)]
pub struct ImportBenchOptions {
    /// Folders that are searched for mesh files, including all folders below them.
    pub folders: Vec<PathBuf>,
    /// The program whose `build` command is run: `esvo`.
    pub program: PathBuf,
    /// Levels of the octrees.
    pub levels: u32,
    /// Seconds that one file may take.
    pub seconds: f64,
    /// Bytes that one process may hold.
    pub memory: u64,
}

/// The result for a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ImportOutcome {
    /// An octree that keeps every rule of the specification.
    Octree {
        /// Triangles of the mesh.
        triangles: u64,
        /// Voxels of the octree.
        voxels: u64,
        /// Warnings of the importer.
        warnings: Vec<String>,
    },
    /// One line of error.
    Refused(String),
    /// A crash, a hang, too much memory, an invalid octree, or an output other than one line of error.
    Broken(String),
}

/// A file and its result.
#[derive(Clone, Debug)]
pub struct ImportRow {
    /// Index of the folder in [`ImportBenchOptions::folders`].
    pub folder: usize,
    /// Path of the file relative to the folder.
    pub file: String,
    /// The result.
    pub outcome: ImportOutcome,
}

/// All files of all folders, ordered by folder and name.
#[derive(Clone, Debug)]
pub struct ImportReport {
    /// Names of the folders.
    pub folders: Vec<String>,
    /// Levels of the octrees.
    pub levels: u32,
    /// The files.
    pub rows: Vec<ImportRow>,
}

impl ImportReport {
    /// Files that gave neither an octree nor one line of error.
    /// Each is given with what happened.
    pub fn broken(&self) -> impl Iterator<Item = (&str, &str)> {
        self.rows.iter().filter_map(|row| match &row.outcome {
            ImportOutcome::Broken(what) => Some((&*row.file, &**what)),
            _ => None,
        })
    }

    /// A table per folder.
    pub fn to_markdown(&self) -> String {
        let mut out = format!(
            "# Import of mesh files\n\nMade by `esvo bench import`: each file is built to {} levels by a process of its own. Files \
             with numbers gave an octree; the others gave the error.\n\n",
            self.levels
        );
        for (index, name) in self.folders.iter().enumerate() {
            let rows: Vec<&ImportRow> = self.rows.iter().filter(|row| row.folder == index).collect();
            let count = |kind: fn(&ImportOutcome) -> bool| rows.iter().filter(|row| kind(&row.outcome)).count();
            let mut table = TextTable::new(name.as_str(), 1, &["file", "triangles", "voxels", "error or warnings"]);
            table.left = 1;
            table.notes.push(format!(
                "{} files: {} octrees, {} refused with one error, {} broken",
                rows.len(),
                count(|o| matches!(o, ImportOutcome::Octree { .. })),
                count(|o| matches!(o, ImportOutcome::Refused(_))),
                count(|o| matches!(o, ImportOutcome::Broken(_))),
            ));
            for row in rows {
                let (triangles, voxels, words) = match &row.outcome {
                    ImportOutcome::Octree { triangles, voxels, warnings } => {
                        let words = match warnings.as_slice() {
                            [] => String::new(),
                            [one] => format!("warning: {one}"),
                            [first, rest @ ..] => format!("warning: {first} (and {} more)", rest.len()),
                        };
                        (triangles.to_string(), voxels.to_string(), words)
                    }
                    ImportOutcome::Refused(error) => (String::new(), String::new(), error.clone()),
                    ImportOutcome::Broken(what) => (String::new(), String::new(), format!("**BROKEN**: {what}")),
                };
                table.rows.push(vec![row.file.clone(), triangles, voxels, words]);
            }
            out.push_str(&table.to_markdown());
            out.push('\n');
        }
        out.truncate(out.trim_end().len());
        out.push('\n');
        out
    }
}

/// Tries all mesh files (told by their extension) below the folders.
///
/// # Errors
/// A folder that cannot be read or has no mesh files, or a program that cannot be started. Failures of a file are in its row.
pub fn run_import_bench(options: &ImportBenchOptions, progress: &Progress) -> Result<ImportReport, BenchError> {
    let mut files = Vec::new();
    for (index, folder) in options.folders.iter().enumerate() {
        let before = files.len();
        let mut found = Vec::new();
        collect(folder, &mut found)?;
        found.sort();
        files.extend(found.into_iter().map(|file| (index, file)));
        if files.len() == before {
            let nothing = std::io::Error::new(std::io::ErrorKind::NotFound, "holds no mesh files");
            return Err(BenchError::io(folder, nothing));
        }
    }
    let scratch = tempfile::tempdir().map_err(|e| BenchError::io(&std::env::temp_dir(), e))?;
    let mut rows = Vec::with_capacity(files.len());
    for (done, (index, path)) in files.iter().enumerate() {
        let folder = &options.folders[*index];
        let file = path.strip_prefix(folder).unwrap_or(path).to_string_lossy().replace('\\', "/");
        progress.fraction("reading", done as f64 / files.len() as f64, &file);
        let outcome = Trial { options, path, folder, output: scratch.path().join("out.esvo") }.run()?;
        rows.push(ImportRow { folder: *index, file, outcome });
    }
    let name = |folder: &PathBuf| folder.file_name().unwrap_or(folder.as_os_str()).to_string_lossy().into_owned();
    Ok(ImportReport { folders: options.folders.iter().map(name).collect(), levels: options.levels, rows })
}

/// Finds all mesh files below a folder. Links are not followed, as they may form a circle.
fn collect(folder: &Path, found: &mut Vec<PathBuf>) -> Result<(), BenchError> {
    let failed = |e| BenchError::io(folder, e);
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let kind = entry.file_type().map_err(failed)?;
        let path = entry.path();
        if kind.is_dir() {
            collect(&path, found)?;
        } else if kind.is_file() && is_mesh_file(&path) {
            found.push(path);
        }
    }
    Ok(())
}

/// The trial of one file.
struct Trial<'a> {
    options: &'a ImportBenchOptions,
    path: &'a Path,
    folder: &'a Path,
    output: PathBuf,
}

impl Trial<'_> {
    fn run(&self) -> Result<ImportOutcome, BenchError> {
        // Remove the output of the previous file.
        if self.output.exists() {
            std::fs::remove_file(&self.output).map_err(|e| BenchError::io(&self.output, e))?;
        }
        let log = self.output.with_extension("log");
        let errors = File::create(&log).map_err(|e| BenchError::io(&log, e))?;
        let mut command = Command::new(&self.options.program);
        command.arg("build").arg(self.path).arg("--output").arg(&self.output);
        command.arg("--levels").arg(self.options.levels.to_string());
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(errors);
        let start = Instant::now();
        let process = Process::start(&mut command).map_err(|e| BenchError::io(&self.options.program, e))?;
        let status = loop {
            if let Some(exit) = process.ended().map_err(|e| BenchError::io(&self.options.program, e))? {
                break exit.status;
            }
            if start.elapsed().as_secs_f64() > self.options.seconds {
                return Ok(ImportOutcome::Broken(format!("not done after {:.0} s", self.options.seconds)));
            }
            if process.held_bytes().is_some_and(|held| held > self.options.memory) {
                let limit = self.options.memory as f64 / 1e9;
                return Ok(ImportOutcome::Broken(format!("held more than {limit:.1} GB of memory")));
            }
            std::thread::sleep(POLL);
        };
        let mut words = Vec::new();
        File::open(&log)
            .and_then(|file| file.take(MOST_WORDS).read_to_end(&mut words))
            .map_err(|e| BenchError::io(&log, e))?;
        Ok(self.judge(status, &String::from_utf8_lossy(&words)))
    }

    /// The result for the file, from the exit status and the standard error of its process.
    fn judge(&self, status: ExitStatus, words: &str) -> ImportOutcome {
        let folder = format!("{}/", self.folder.display());
        let lines: Vec<String> = words.lines().map(|line| line.replace(&folder, "")).collect();
        let last = || lines.last().cloned().unwrap_or_else(|| "no output".into());
        let warnings = || lines.iter().filter_map(|line| line.strip_prefix("warning: ")).map(str::to_owned).collect();
        match status.code() {
            Some(0) => match self.octree() {
                Ok((triangles, voxels)) => ImportOutcome::Octree { triangles, voxels, warnings: warnings() },
                Err(what) => ImportOutcome::Broken(what),
            },
            Some(1) => {
                let errors: Vec<&str> = lines.iter().filter_map(|line| line.strip_prefix("error: ")).collect();
                match errors.as_slice() {
                    [error] if !self.output.exists() => ImportOutcome::Refused((*error).to_owned()),
                    [_] => ImportOutcome::Broken("an error, but also an octree".into()),
                    _ => ImportOutcome::Broken(format!("not one line of error: {}", last())),
                }
            }
            _ => ImportOutcome::Broken(format!("crashed ({status}): {}", last())),
        }
    }

    /// Triangles and voxels of the octree, or why it is invalid.
    fn octree(&self) -> Result<(u64, u64), String> {
        let report = esvo_format::validate_file(&self.output).map_err(|e| format!("no octree: {e}"))?;
        if let Some(finding) = report.findings.iter().find(|f| !f.warning) {
            return Err(format!("the octree breaks a rule: {}", finding.broken));
        }
        let octree = esvo_format::Octree::open(&self.output).map_err(|e| format!("no octree: {e}"))?;
        let meta: serde_json::Value = serde_json::from_str(octree.meta()).map_err(|e| format!("metadata: {e}"))?;
        let triangles = meta["triangles"].as_u64().ok_or("the metadata has no number of triangles")?;
        Ok((triangles, esvo_format::stats(&octree).voxels))
    }
}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    /// A program that does what its mesh file says, as a shell would.
    fn stub(folder: &Path) -> PathBuf {
        let program = folder.join("stub.sh");
        std::fs::write(&program, "#!/bin/sh\n. \"$2\"\n").unwrap();
        std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
        program
    }

    #[test]
    fn outcomes_are_told_apart() {
        let folder = tempfile::tempdir().unwrap();
        let meshes = folder.path().join("meshes");
        std::fs::create_dir_all(meshes.join("deep/er")).unwrap();
        let write = |name: &str, text: &str| std::fs::write(meshes.join(name), text).unwrap();
        write("a.obj", &format!("echo 'error: {}/a.obj: is | bad' >&2; exit 1", meshes.display()));
        write("b.OBJ", "echo thread panicked >&2; exit 101");
        write("c.ply", "kill -9 $$");
        write("d.stl", "sleep 60");
        write("e.glb", "exit 0");
        write("f.obj", "echo 'error: one' >&2; echo 'error: two' >&2; exit 1");
        write("deep/er/g.gltf", "exit 1");
        write("h.txt", "exit 101");
        let options = ImportBenchOptions {
            folders: vec![meshes.clone()],
            program: stub(folder.path()),
            levels: 5,
            seconds: 1.0,
            memory: 1 << 30,
        };
        let report = run_import_bench(&options, &Progress::hidden()).unwrap();
        let found: Vec<(&str, &ImportOutcome)> = report.rows.iter().map(|r| (&*r.file, &r.outcome)).collect();
        let broken = |outcome: &ImportOutcome, words: &str| {
            assert!(matches!(outcome, ImportOutcome::Broken(what) if what.starts_with(words)), "{outcome:?}");
        };
        assert_eq!(found.len(), 7);
        assert_eq!(found[0], ("a.obj", &ImportOutcome::Refused("a.obj: is | bad".into())));
        broken(found[1].1, "crashed (exit status: 101): thread panicked");
        broken(found[2].1, "crashed (signal: 9");
        broken(found[3].1, "not done after 1 s");
        assert_eq!(found[4].0, "deep/er/g.gltf");
        broken(found[4].1, "not one line of error: no output");
        broken(found[5].1, "no octree: ");
        broken(found[6].1, "not one line of error: error: two");
        assert_eq!(report.broken().count(), 6);
        let text = report.to_markdown();
        assert!(text.contains("7 files: 0 octrees, 1 refused with one error, 6 broken"), "{text}");
        assert!(text.contains("| a.obj |  |  | a.obj: is \\| bad |"), "{text}");
    }

    #[test]
    fn memory_is_limited() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.obj"), "sleep 60").unwrap();
        let program = stub(folder.path());
        let folders = vec![folder.path().to_owned()];
        let options = ImportBenchOptions { folders, program, levels: 5, seconds: 30.0, memory: 1 };
        let report = run_import_bench(&options, &Progress::hidden()).unwrap();
        let held = matches!(&report.rows[0].outcome, ImportOutcome::Broken(what) if what.starts_with("held more than"));
        assert!(held || cfg!(not(target_os = "linux")), "{:?}", report.rows[0].outcome);
    }

    #[test]
    fn folders_without_meshes_are_errors() {
        let folder = tempfile::tempdir().unwrap();
        let options = |folder: &Path| ImportBenchOptions {
            folders: vec![folder.to_owned()],
            program: "none".into(),
            levels: 5,
            seconds: 1.0,
            memory: 1,
        };
        let message = |folder: &Path| run_import_bench(&options(folder), &Progress::hidden()).unwrap_err().to_string();
        assert!(message(folder.path()).ends_with(": holds no mesh files"));
        assert!(message(&folder.path().join("none")).contains("No such file"));
    }
}
