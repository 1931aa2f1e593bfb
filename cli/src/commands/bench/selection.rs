//! Options that `esvo bench` and `esvo bench build` share: the matrix, and changes to it.

use std::path::{Path, PathBuf};

use clap::Args;
use esvo_bench::matrix_parts::SceneLevels;

use crate::fail::Failure;

/// Changes to a matrix.
#[derive(Debug, Args)]
pub(crate) struct Selection {
    /// Read the matrix from a TOML file
    #[arg(long, value_name = "FILE")]
    pub(crate) matrix: Option<PathBuf>,
    /// Measure only these scenes
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub(crate) scenes: Vec<String>,
    /// Build these levels of every scene
    #[arg(long, value_name = "N,...", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(1..=23))]
    pub(crate) levels: Vec<u32>,
    /// Memory limit of the run (of each build in `bench build`) in GB (10^9 bytes); levels that need more are left out
    #[arg(long, value_name = "GB")]
    memory: Option<f64>,
    /// Planned length of the run in seconds; deeper levels are left out to stay within it; 0: no limit
    #[arg(long, value_name = "SECONDS")]
    time_limit: Option<f64>,
    /// Folder that is searched first for real meshes; then $ESVO_SCENES, then ../shared/scenes
    #[arg(long, value_name = "FOLDER")]
    pub(crate) scenes_dir: Option<PathBuf>,
    /// Read the scenes from this manifest of your own instead of the paper's: see scenes/README.md. Without --scenes: those of
    /// --matrix if the manifest has any of them, otherwise all of the manifest
    #[arg(long, value_name = "FILE", conflicts_with = "scenes_dir")]
    pub(crate) manifest: Option<PathBuf>,
    /// Print the record as JSON instead of the tables
    #[arg(long)]
    pub(crate) json: bool,
}

/// Rejects --scenes-dir unless it is a directory.
pub(crate) fn check_scenes_dir(folder: Option<&Path>) -> Result<(), Failure> {
    match folder.filter(|folder| !folder.is_dir()) {
        Some(folder) => Err(format!("--scenes-dir {}: is not a folder", folder.display()).into()),
        None => Ok(()),
    }
}

impl Selection {
    /// Rejects --scenes-dir unless it is a directory.
    pub(crate) fn check(&self) -> Result<(), Failure> {
        check_scenes_dir(self.scenes_dir.as_deref())
    }

    /// The planned length of the run in seconds; `None`: no limit.
    pub(crate) fn time_limit(&self) -> Option<f64> {
        self.time_limit.filter(|seconds| *seconds > 0.0)
    }

    /// Names of the scenes to measure; empty: those of the matrix, which has these scenes.
    ///
    /// # Errors
    /// A manifest that cannot be used.
    pub(crate) fn names(&self, matrix: &[SceneLevels]) -> Result<Vec<String>, Failure> {
        if self.manifest.is_none() || !self.scenes.is_empty() {
            return Ok(self.scenes.clone());
        }
        let manifest = esvo_bench::scene::manifest(self.manifest.as_deref())?;
        // A matrix that was written for this manifest.
        if matrix.iter().any(|scene| manifest.scene(&scene.name).is_some()) {
            return Ok(Vec::new());
        }
        Ok(manifest.scenes.iter().map(|scene| scene.name.clone()).collect())
    }

    /// Replaces levels and limits of a matrix by those that are given.
    pub(crate) fn apply(&self, scenes: &mut [SceneLevels], memory_gb: &mut f64, time_limit: &mut Option<f64>) {
        if !self.levels.is_empty() {
            let mut levels = self.levels.clone();
            levels.sort_unstable();
            levels.dedup();
            for scene in scenes {
                scene.levels.clone_from(&levels);
            }
        }
        *memory_gb = self.memory.unwrap_or(*memory_gb);
        match self.time_limit {
            Some(0.0) => *time_limit = None,
            Some(seconds) => *time_limit = Some(seconds),
            None => {}
        }
    }
}
