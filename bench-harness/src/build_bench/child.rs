//! One build in a process of its own, so that its peak memory and its processor time can be measured, and the limits of that process.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde::de::DeserializeOwned;

use super::plan::Contours;
use super::record::Limit;
use crate::BenchError;
use crate::build_summary::BuildSummary;
use crate::system::process::Process;
use crate::units::GB;

/// Time between two checks of the process.
const POLL: Duration = Duration::from_millis(20);

/// What is built, by which program, and within which limits.
pub(crate) struct BuildJob<'a> {
    /// The program whose `build` command is run: `esvo`.
    pub(crate) program: &'a Path,
    /// The folder that is searched first for real meshes.
    pub(crate) scenes_dir: Option<&'a Path>,
    /// The manifest of the scenes; `None`: the one of the paper's scenes.
    pub(crate) manifest: Option<&'a Path>,
    /// Name of the scene.
    pub(crate) scene: &'a str,
    /// Whether the scene's stand-in is built instead of its real mesh.
    pub(crate) stand_in: bool,
    /// Deepest level.
    pub(crate) levels: u32,
    /// With contours or without.
    pub(crate) contours: Contours,
    /// The file for the octree.
    pub(crate) output: &'a Path,
    /// Bytes of memory that the process may hold.
    pub(crate) memory: f64,
    /// Bytes that the octree may take on disk.
    pub(crate) disk: f64,
    /// Seconds that the process may take.
    pub(crate) seconds: f64,
    /// Which limit `seconds` is: that of one build, or the rest of the run's.
    pub(crate) seconds_of: Limit,
}

/// How a build ended. `Report` is what is read of what the program prints.
pub(crate) enum Ended<Report> {
    /// The octree is written.
    Done {
        report: Box<Report>,
        /// Processor time of the process, user and system, in seconds; `None` if the system does not tell.
        cpu_seconds: Option<f64>,
    },
    /// There is no octree. The limit that was exceeded, and the reason in words.
    Stopped(Limit, String),
}

impl BuildJob<'_> {
    fn command(&self) -> Command {
        let mut command = Command::new(self.program);
        command.arg("build").arg("--json").args(["--scene", self.scene]);
        command.arg("--levels").arg(self.levels.to_string()).arg("--output").arg(self.output);
        if let Some(file) = self.manifest {
            command.arg("--manifest").arg(file);
        }
        if self.stand_in {
            command.arg("--stand-in");
        }
        if self.contours == Contours::Off {
            command.arg("--no-contours");
        }
        if let Some(folder) = self.scenes_dir.filter(|_| !self.stand_in) {
            command.arg("--scenes-dir").arg(folder);
        }
        command
    }

    /// Runs the build by this version of the program: see [`BuildJob::run_as`].
    ///
    /// # Errors
    /// As there.
    pub(crate) fn run(&self) -> Result<Ended<BuildSummary>, BenchError> {
        let mut ended = self.run_as::<BuildSummary>()?;
        if let Ended::Done { report, .. } = &mut ended {
            // Only the file name: the folder is temporary.
            report.output = Path::new(&report.output).file_name().unwrap_or_default().to_string_lossy().into_owned();
        }
        Ok(ended)
    }

    /// Runs the build until it ends or exceeds a limit. A failed build counts as [`Limit::Failed`].
    ///
    /// # Errors
    /// The program cannot be started, or its report cannot be read.
    pub(crate) fn run_as<Report: DeserializeOwned>(&self) -> Result<Ended<Report>, BenchError> {
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
        let exit = loop {
            if let Some(exit) = process.ended().map_err(|e| BenchError::io(self.program, e))? {
                break exit;
            }
            if start.elapsed().as_secs_f64() > self.seconds {
                return stopped(self.seconds_of, format!("stopped at the limit of {:.0} s", self.seconds));
            }
            if process.held_bytes().is_some_and(|held| held as f64 > self.memory) {
                let what =
                    format!("stopped because it held more than {:.1} GB of memory; see --memory", self.memory / GB);
                return stopped(Limit::Memory, what);
            }
            std::thread::sleep(POLL);
        };
        let read = |path: &PathBuf| std::fs::read(path).map(|b| String::from_utf8_lossy(&b).into_owned());
        if !exit.status.success() {
            let log = read(&err).unwrap_or_default();
            let last = log.lines().last().unwrap_or("it printed no error");
            return stopped(Limit::Failed, format!("the build failed: {}", last.trim_start_matches("error: ")));
        }
        let text = read(&out).map_err(|e| BenchError::io(&out, e))?;
        let report: Report =
            serde_json::from_str(&text).map_err(|e| failed(format!("its report cannot be read: {e}")))?;
        let bytes = std::fs::metadata(self.output).map_err(|e| BenchError::io(self.output, e))?.len() as f64;
        if bytes > self.disk {
            let what = format!("its file took {:.1} GB of disk; see --disk", bytes / GB);
            return stopped(Limit::Disk, what);
        }
        Ok(Ended::Done { report: Box::new(report), cpu_seconds: exit.cpu.map(|cpu| cpu.as_secs_f64()) })
    }
}
