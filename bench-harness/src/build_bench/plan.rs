//! The matrix of `esvo bench build`: which octrees are built, within which limits.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::BenchError;
use crate::matrix_parts::{LeftOut, SceneLevels, check_scenes, parse_toml, select_scenes};

/// Scenes, levels and limits.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BuildMatrix {
    /// Name, for the record.
    pub name: String,
    /// How often each octree is built; times are medians. Builds are interleaved: every octree is built once before any is
    /// built again.
    pub repeats: usize,
    /// An octree whose first build took longer than this many seconds is not built again.
    pub repeat_below_seconds: f64,
    /// Errors are measured from at most this many viewpoints of a scene.
    pub views: usize,
    /// Approximate number of rays per scene, over all its viewpoints.
    pub rays: u64,
    /// Memory that a build may take, in GB (10^9 bytes).
    pub memory_gb: f64,
    /// Disk that the file of a build may take, in GB (10^9 bytes).
    pub disk_gb: f64,
    /// Seconds that one build may take, import and writing included.
    pub build_limit_seconds: f64,
    /// Seconds that the run may take. Absent: no limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_limit_seconds: Option<f64>,
    /// Which kinds of octrees are built.
    pub contours: Vec<Contours>,
    /// The scenes and their levels.
    #[serde(rename = "scene")]
    pub scenes: Vec<SceneLevels>,
    /// What this matrix leaves out, and why.
    #[serde(default)]
    pub left_out: Vec<LeftOut>,
}

/// With contours or without.
#[derive(Clone, Copy, PartialEq, Eq, Debug, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Contours {
    /// With contours and the paper's settings for the scene.
    On,
    /// Without contours: all geometry is divided down to the deepest level.
    Off,
}

impl Contours {
    /// The name in tables.
    pub fn title(self) -> &'static str {
        match self {
            Self::On => "contours",
            Self::Off => "cubical",
        }
    }
}

impl BuildMatrix {
    /// The default matrix.
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
    /// The file cannot be read, is not the TOML of a matrix, or has values out of range.
    pub fn read(path: &Path) -> Result<Self, BenchError> {
        let text = std::fs::read_to_string(path).map_err(|e| BenchError::io(path, e))?;
        Self::parse(&text, &path.display().to_string())
    }

    fn parse(text: &str, name: &str) -> Result<Self, BenchError> {
        let bad = |what: String| BenchError::Matrix { file: name.into(), what };
        let matrix: Self = parse_toml(text).map_err(bad)?;
        matrix.validate().map_err(bad)?;
        Ok(matrix)
    }

    /// Keeps only these scenes, in this order. A scene that is not in the matrix gets the levels of the matrix's first scene.
    pub fn select_scenes(&mut self, names: &[String]) {
        self.scenes = select_scenes(&self.scenes, names);
        self.left_out.clear();
    }

    /// Checks that every value is in its range.
    ///
    /// # Errors
    /// The first value out of range, in words.
    pub fn validate(&self) -> Result<(), String> {
        if self.repeats == 0 || self.views == 0 || self.contours.is_empty() {
            return Err("repeats and views must be at least 1, and contours must have an entry".into());
        }
        if !(1..=1 << 28).contains(&self.rays) {
            return Err(format!("rays is {}, expected 1 to 2^28", self.rays));
        }
        let numbers = [
            ("memory_gb", self.memory_gb),
            ("disk_gb", self.disk_gb),
            ("build_limit_seconds", self.build_limit_seconds),
            ("time_limit_seconds", self.time_limit_seconds.unwrap_or(1.0)),
        ];
        if let Some((name, value)) = numbers.iter().find(|(_, x)| !(*x > 0.0 && x.is_finite())) {
            return Err(format!("{name} is {value}, expected a number above 0"));
        }
        if self.repeat_below_seconds.is_nan() || self.repeat_below_seconds < 0.0 {
            return Err(format!("repeat_below_seconds is {}, expected 0 or more", self.repeat_below_seconds));
        }
        check_scenes(&self.scenes)
    }

    /// Size of each picture, 4 to 3, so that all pictures of a scene together have about `rays` rays.
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
        for scene in ["sibenik", "sibenik-plain", "conference"] {
            assert!([10, 12].iter().all(|level| levels(scene).contains(level)), "{scene}");
        }
        assert!(levels("hairball").contains(&10));
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
