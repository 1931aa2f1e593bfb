//! The matrix of `esvo bench`, read from TOML: scenes, levels, resolutions, variants, engines.

use std::path::Path;

use esvo_engines::EngineId;
use serde::{Deserialize, Serialize};

use crate::BenchError;
use crate::matrix_parts::{LeftOut, SceneLevels, check_engines, check_scenes, parse_toml, select_scenes};

/// The matrix of a run.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Matrix {
    /// Name of the matrix, shown in the report.
    pub name: String,
    /// Viewpoints per scene, at least 1; fewer if the scene's manifest has fewer.
    pub views: usize,
    /// Timed rounds per row, at least 1. In every round each variant of the row casts each view once.
    pub rounds: usize,
    /// Warm-up rounds before the timed ones; they are not recorded.
    pub warm_up: usize,
    /// Planned length of the run in seconds: deeper levels and further rounds are left out to stay within it, and the report
    /// lists them. Absent: no limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_limit_seconds: Option<f64>,
    /// Memory that a run may use, in GB (10^9 bytes). A level that is expected to need more is left out.
    pub memory_gb: f64,
    /// Width and height of the pictures in pixels.
    pub resolutions: Vec<[u32; 2]>,
    /// Columns of Table 2.
    pub variants: Vec<Variant>,
    /// Engines. Those that find no device are left out, and the report says so.
    pub backends: Vec<EngineId>,
    /// Rows.
    #[serde(rename = "scene")]
    pub scenes: Vec<SceneLevels>,
    /// What the paper measures and this matrix leaves out.
    #[serde(default)]
    pub left_out: Vec<LeftOut>,
}

/// A column of Table 2: what is cast, and how.
#[derive(Clone, Copy, PartialEq, Eq, Debug, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Variant {
    /// The triangle mesh itself, through a BVH: two-wide on the CPU, eight-wide on GPUs.
    Triangles,
    /// An octree built without contours: cubes, full resolution everywhere.
    Cubical,
    /// An octree built with contours.
    Contours,
    /// An octree built with contours, cast with beam optimization.
    Beam,
}

impl Variant {
    /// Every variant, in the order of the paper's columns.
    pub const ALL: [Self; 4] = [Self::Triangles, Self::Cubical, Self::Contours, Self::Beam];

    /// Heading of its column.
    pub fn title(self) -> &'static str {
        match self {
            Self::Triangles => "triangles",
            Self::Cubical => "cubical",
            Self::Contours => "contours",
            Self::Beam => "with beam",
        }
    }

    /// Short heading for narrow columns.
    pub fn short_title(self) -> &'static str {
        match self {
            Self::Triangles => "tri",
            Self::Cubical => "cub",
            Self::Contours => "con",
            Self::Beam => "beam",
        }
    }
}

impl Matrix {
    /// The default matrix, which takes about five minutes on two cores.
    pub fn default_run() -> Self {
        Self::parse(include_str!("../../matrices/default.toml"), "default.toml").expect("checked by a test")
    }

    /// The paper's whole matrix.
    pub fn full_run() -> Self {
        Self::parse(include_str!("../../matrices/full.toml"), "full.toml").expect("checked by a test")
    }

    /// Reads a matrix from a file.
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
        if self.views == 0 || self.rounds == 0 {
            return Err("views and rounds must be at least 1".into());
        }
        if !(self.memory_gb > 0.0 && self.memory_gb.is_finite()) {
            return Err(format!("memory_gb is {}, expected a number above 0", self.memory_gb));
        }
        if self.time_limit_seconds.is_some_and(|s| !(s > 0.0 && s.is_finite())) {
            return Err("time_limit_seconds must be a number above 0; leave it out for no limit".into());
        }
        if self.scenes.is_empty() || self.resolutions.is_empty() || self.variants.is_empty() {
            return Err("scenes, resolutions and variants must each have an entry".into());
        }
        if let Some([w, h]) = self.resolutions.iter().find(|r| r.iter().any(|n| !(1..=16384).contains(n))) {
            return Err(format!("a resolution must be between 1x1 and 16384x16384, not {w}x{h}"));
        }
        check_engines(&self.backends)?;
        check_scenes(&self.scenes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_built_in_matrices_are_valid() {
        assert!(Matrix::default_run().time_limit_seconds.unwrap() <= 180.0);
        let full = Matrix::full_run();
        assert_eq!(full.resolutions, [[512, 384], [1024, 768], [2048, 1536]]);
        assert_eq!(full.variants, Variant::ALL);
        assert!(
            full.scenes.len() == 9 && full.scenes.iter().any(|s| s.name == "sibenik-d") && full.left_out.is_empty()
        );
    }

    #[test]
    fn values_out_of_range_are_named() {
        let parse = |from: &str, to: &str| {
            let text = include_str!("../../matrices/default.toml").replacen(from, to, 1);
            Matrix::parse(&text, "m.toml").unwrap_err().to_string()
        };
        assert!(parse("rounds = 3", "rounds = 0").contains("at least 1"));
        assert!(parse("[9, 10]", "[30]").contains("between 1 and 23, not 30"));
        assert!(parse("[9, 10]", "[10, 9]").contains("ascend"));
        assert!(parse("\"wgpu\"", "\"cuda\"").contains("cuda"));
        assert!(parse("warm_up", "warmup").starts_with("m.toml: line 5"));
        assert!(parse("[512, 384]", "[0, 384]").contains("not 0x384"));
    }
}
