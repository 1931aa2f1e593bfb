//! What `esvo bench build` is told to build.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::BenchError;
use crate::paper_bench::matrix::{LeftOut, SceneEntry};

/// Scenes, levels and limits.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BuildMatrix {
    /// Name, for the record.
    pub name: String,
    /// How often each octree is built; times are medians. Rounds are interleaved: every octree is built once before one is
    /// built again.
    pub repeats: usize,
    /// What took longer than so many seconds the first time is not built again.
    pub repeat_below_seconds: f64,
    /// Most viewpoints of a scene that errors are measured from.
    pub views: usize,
    /// Rays over all viewpoints of a scene, about.
    pub rays: u64,
    /// Memory that a build may take, in GB (10^9 bytes).
    pub memory_gb: f64,
    /// Disk that the file of a build may take, in GB (10^9 bytes).
    pub disk_gb: f64,
    /// Seconds that one build may take, import and writing included.
    pub build_limit_seconds: f64,
    /// Seconds that the run may take; none: no limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_limit_seconds: Option<f64>,
    /// Which octrees.
    pub contours: Vec<Contours>,
    /// The scenes and their levels.
    #[serde(rename = "scene")]
    pub scenes: Vec<SceneEntry>,
    /// What is left out from the start, and why.
    #[serde(default)]
    pub left_out: Vec<LeftOut>,
}

/// With contours or without.
#[derive(Clone, Copy, PartialEq, Eq, Debug, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Contours {
    /// With contours and the paper's settings for the scene.
    On,
    /// Every voxel down to the last level, as cubes.
    Off,
}

impl Contours {
    /// As tables say it.
    pub fn title(self) -> &'static str {
        match self {
            Self::On => "contours",
            Self::Off => "cubical",
        }
    }
}

impl BuildMatrix {
    /// What runs if nothing else is said.
    pub fn default_run() -> Self {
        Self::parse(include_str!("../../matrices/build.toml"), "build.toml").expect("checked by a test")
    }

    /// The paper's Table 1.
    pub fn full_run() -> Self {
        Self::parse(include_str!("../../matrices/build-table1.toml"), "build-table1.toml").expect("checked by a test")
    }

    /// Reads one from a TOML file.
    ///
    /// # Errors
    /// The file cannot be read, is no such TOML, or holds values out of range.
    pub fn read(path: &Path) -> Result<Self, BenchError> {
        let text = std::fs::read_to_string(path).map_err(|e| BenchError::io(path, e))?;
        Self::parse(&text, &path.display().to_string())
    }

    fn parse(text: &str, name: &str) -> Result<Self, BenchError> {
        let bad = |what: String| BenchError::Matrix { file: name.into(), what };
        let matrix: Self = toml::from_str(text).map_err(|e| bad(e.message().to_string()))?;
        matrix.validate().map_err(bad)?;
        Ok(matrix)
    }

    /// Keeps these scenes only, in this order. One that the matrix has not takes the levels of its first scene.
    pub fn select_scenes(&mut self, names: &[String]) {
        self.scenes = crate::paper_bench::matrix::selected(&self.scenes, names);
        self.left_out.clear();
    }

    /// Checks that every value is in its range.
    ///
    /// # Errors
    /// The first that is not, in words.
    pub fn validate(&self) -> Result<(), String> {
        if self.repeats == 0 || self.views == 0 || self.contours.is_empty() {
            return Err("repeats and views are at least 1, and contours needs an entry".into());
        }
        if !(1..=1 << 28).contains(&self.rays) {
            return Err(format!("rays is between 1 and 2^28, not {}", self.rays));
        }
        let numbers = [
            ("memory_gb", self.memory_gb),
            ("disk_gb", self.disk_gb),
            ("build_limit_seconds", self.build_limit_seconds),
            ("time_limit_seconds", self.time_limit_seconds.unwrap_or(1.0)),
        ];
        if let Some((name, value)) = numbers.iter().find(|(_, x)| !(*x > 0.0 && x.is_finite())) {
            return Err(format!("{name} is a positive number, not {value}"));
        }
        if self.repeat_below_seconds.is_nan() || self.repeat_below_seconds < 0.0 {
            return Err("repeat_below_seconds is a number from 0 on".into());
        }
        crate::paper_bench::matrix::check_scenes(&self.scenes)
    }

    /// Size of the pictures that together have about as many rays as are wanted, 4 to 3.
    pub fn picture_size(&self, views: usize) -> [u32; 2] {
        let pixels = (self.rays as f64 / views.max(1) as f64).max(1.0);
        let width = (pixels * 4.0 / 3.0).sqrt().round().clamp(1.0, 16384.0);
        [width as u32, (pixels / width).round().clamp(1.0, 16384.0) as u32]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_built_in_matrices_are_valid_and_hold_what_the_authors_builder_was_measured_on() {
        let matrix = BuildMatrix::default_run();
        let levels = |name: &str| &matrix.scenes.iter().find(|s| s.name == name).unwrap().levels;
        assert!(levels("sibenik").contains(&12) && levels("conference").contains(&10));
        let full = BuildMatrix::full_run();
        assert!(full.scenes.iter().all(|s| s.levels.ends_with(&[10, 11, 12, 13, 14, 15, 16])));
        assert!(full.scenes.iter().any(|s| s.name == "sibenik-d"));
    }

    #[test]
    fn pictures_have_the_rays() {
        let matrix = BuildMatrix::default_run();
        for views in 1..9 {
            let [w, h] = matrix.picture_size(views);
            let rays = views as f64 * f64::from(w) * f64::from(h);
            assert!((rays / matrix.rays as f64 - 1.0).abs() < 0.01, "{views}: {w}x{h}");
        }
    }

    #[test]
    fn values_out_of_range_are_named() {
        let message = |change: fn(&mut BuildMatrix)| {
            let mut matrix = BuildMatrix::default_run();
            change(&mut matrix);
            matrix.validate().unwrap_err()
        };
        assert!(message(|m| m.repeats = 0).contains("repeats"));
        assert!(message(|m| m.disk_gb = f64::NAN).contains("disk_gb"));
        assert!(message(|m| m.scenes[0].levels = vec![24]).contains("between 1 and 23"));
    }
}
