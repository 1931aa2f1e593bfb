//! One build as a process of its own, so that its memory is its own, and the limits that it is held to.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use super::limit::Limit;
use super::plan::Contours;
use crate::BenchError;
use crate::build_summary::BuildSummary;
use crate::system::process::Process;
use crate::text::GB;

/// Time between two looks at a child.
const POLL: Duration = Duration::from_millis(20);

/// What is built, by whom, and within which limits.
pub(crate) struct Job<'a> {
    /// The program that has `build`: this one.
    pub(crate) program: &'a Path,
    /// Where real meshes are looked for first.
    pub(crate) scenes_dir: Option<&'a Path>,
    /// Name of the scene.
    pub(crate) scene: &'a str,
    /// Whether the scene's stand-in is built.
    pub(crate) stand_in: bool,
    /// Deepest level.
    pub(crate) levels: u32,
    /// With contours or without.
    pub(crate) contours: Contours,
    /// Where the octree goes.
    pub(crate) output: &'a Path,
    /// Bytes that the process may hold.
    pub(crate) memory: f64,
    /// Bytes that the octree may take on disk.
    pub(crate) disk: f64,
    /// Seconds that it may take.
    pub(crate) seconds: f64,
    /// Whose limit that is: of one build, or what the run has left.
    pub(crate) seconds_of: Limit,
}

/// How a build ended.
pub(crate) enum Ended {
    /// It is done.
    Done(Box<BuildSummary>),
    /// There is no octree: a limit, and in words what happened.
    Stopped(Limit, String),
}

impl Job<'_> {
    fn command(&self) -> Command {
        let mut command = Command::new(self.program);
        command.arg("build").arg("--json").args(["--scene", self.scene]);
        command.arg("--levels").arg(self.levels.to_string()).arg("--output").arg(self.output);
        if self.stand_in {
            command.arg("--stand-in");
        }
        if self.contours == Contours::Off {
            command.arg("--no-contours");
        }
        if let Some(folder) = self.scenes_dir {
            command.arg("--scenes-dir").arg(folder);
        }
        command
    }

    /// Runs it to its end or to a limit. That it failed is a limit too.
    ///
    /// # Errors
    /// The program cannot be started, or does not report as it should.
    pub(crate) fn run(&self) -> Result<Ended, BenchError> {
        let failed = |what: String| {
            let what = format!("{} at {} levels, {}: {what}", self.scene, self.levels, self.contours.title());
            BenchError::scene(self.scene, what)
        };
        let stopped = |limit: Limit, what: String| Ok(Ended::Stopped(limit, what));
        let folder = self.output.parent().unwrap_or(Path::new("."));
        let (out, err) = (folder.join("build.json"), folder.join("build.log"));
        let create = |path: &PathBuf| File::create(path).map_err(|e| BenchError::io(path, e));
        let mut command = self.command();
        command.stdin(Stdio::null()).stdout(create(&out)?).stderr(create(&err)?);
        let start = Instant::now();
        let process = Process::start(&mut command).map_err(|e| BenchError::io(self.program, e))?;
        let status = loop {
            if let Some(status) = process.ended().map_err(|e| BenchError::io(self.program, e))? {
                break status;
            }
            if start.elapsed().as_secs_f64() > self.seconds {
                return stopped(self.seconds_of, format!("stopped after {:.0} s, the limit", self.seconds));
            }
            if process.held_bytes().is_some_and(|held| held as f64 > self.memory) {
                let what = format!("stopped when it held more than {:.1} GB; see --memory", self.memory / GB);
                return stopped(Limit::Memory, what);
            }
            std::thread::sleep(POLL);
        };
        let read = |path: &PathBuf| std::fs::read(path).map(|b| String::from_utf8_lossy(&b).into_owned());
        if !status.success() {
            let log = read(&err).unwrap_or_default();
            let last = log.lines().last().unwrap_or("it said nothing");
            return stopped(Limit::Failed, format!("the build failed: {}", last.trim_start_matches("error: ")));
        }
        let text = read(&out).map_err(|e| BenchError::io(&out, e))?;
        let mut summary: BuildSummary =
            serde_json::from_str(&text).map_err(|e| failed(format!("its report cannot be read: {e}")))?;
        if summary.file_bytes as f64 > self.disk {
            let what = format!("took {:.1} GB of disk; see --disk", summary.file_bytes as f64 / GB);
            return stopped(Limit::Disk, what);
        }
        // The folder is gone when the record is read.
        summary.output = Path::new(&summary.output).file_name().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Ended::Done(Box::new(summary)))
    }
}
