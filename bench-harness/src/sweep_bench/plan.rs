//! What a sweep measures, read from TOML: scenes and levels, settings, engines.

use esvo_engines::EngineId;
use serde::{Deserialize, Serialize};

use crate::BenchError;
use crate::matrix_parts::{SceneLevels, check_engines, check_scenes, parse_toml, select_scenes};

/// What a sweep measures.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SweepPlan {
    /// Name of the plan, shown in the report.
    pub name: String,
    /// Width and height of the pictures. Errors in pixels are those of pictures of this size.
    pub size: [u32; 2],
    /// Viewpoints of each scene, at most; at least 1.
    pub views: usize,
    /// Timed rounds, at least 1. In every round each setting casts each view once.
    pub rounds: usize,
    /// Rounds before the timed ones; they are not recorded.
    pub warm_up: usize,
    /// Memory that a run may use, in GB (10^9 bytes). An octree that is expected to need more is left out.
    pub memory_gb: f64,
    /// Rays end at voxels of these sizes in pixels; ascending, each at least 0; 0: at leaves only.
    pub terminations: Vec<f32>,
    /// The engines. Those that find no device are left out, and the report says so.
    pub engines: Vec<EngineId>,
    /// The scenes.
    #[serde(rename = "scene")]
    pub scenes: Vec<SceneLevels>,
}

impl SweepPlan {
    /// The default: about ten minutes on two cores.
    pub fn default_run() -> Self {
        Self::parse(include_str!("../../matrices/sweep.toml"), "sweep.toml").expect("checked by a test")
    }

    /// All scenes, deeper levels, larger pictures.
    pub fn full_run() -> Self {
        Self::parse(include_str!("../../matrices/sweep-full.toml"), "sweep-full.toml").expect("checked by a test")
    }

    fn parse(text: &str, name: &str) -> Result<Self, BenchError> {
        let bad = |what: String| BenchError::Matrix { file: name.into(), what };
        let plan: Self = parse_toml(text).map_err(bad)?;
        plan.validate()?;
        Ok(plan)
    }

    /// Keeps only these scenes, in this order. A scene that is not in the plan gets the levels of the plan's first.
    pub fn select_scenes(&mut self, names: &[String]) {
        self.scenes = select_scenes(&self.scenes, names);
    }

    /// Sorts levels, which apply to all scenes from now on.
    pub fn set_levels(&mut self, levels: &[u32]) {
        let mut levels = levels.to_vec();
        levels.sort_unstable();
        levels.dedup();
        for scene in &mut self.scenes {
            scene.levels.clone_from(&levels);
        }
    }

    /// Checks that every value is in its range.
    ///
    /// # Errors
    /// The first value out of range.
    pub fn validate(&self) -> Result<(), BenchError> {
        self.check().map_err(|what| BenchError::Matrix { file: self.name.clone(), what })
    }

    fn check(&self) -> Result<(), String> {
        if self.views == 0 || self.rounds == 0 {
            return Err("views and rounds must be at least 1".into());
        }
        if !(self.memory_gb > 0.0 && self.memory_gb.is_finite()) {
            return Err(format!("memory_gb is {}, expected a number above 0", self.memory_gb));
        }
        if self.size.iter().any(|n| !(1..=16384).contains(n)) {
            return Err(format!("size must be between 1x1 and 16384x16384, not {}x{}", self.size[0], self.size[1]));
        }
        if self.engines.is_empty() || self.terminations.is_empty() {
            return Err("engines and terminations must each have an entry".into());
        }
        if let Some(pixels) = self.terminations.iter().find(|p| !(p.is_finite() && **p >= 0.0)) {
            return Err(format!("terminations must be 0 or numbers above 0, not {pixels}"));
        }
        if self.terminations.windows(2).any(|w| w[0] >= w[1]) {
            return Err("terminations must ascend".into());
        }
        check_engines(&self.engines)?;
        check_scenes(&self.scenes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_built_in_plans_are_valid() {
        assert_eq!(SweepPlan::default_run().terminations, [0.5, 1.0, 2.0, 4.0]);
        let default = crate::Matrix::default_run();
        for scene in &SweepPlan::default_run().scenes {
            let deepest = default.scenes.iter().find(|s| s.name == scene.name).and_then(|s| s.levels.last());
            assert_eq!(scene.levels.last(), deepest, "{}: the default run's levels, and some below", scene.name);
        }
        assert!(SweepPlan::full_run().scenes.len() > 3);
    }

    #[test]
    fn values_out_of_range_are_named() {
        let parse = |from: &str, to: &str| {
            let text = include_str!("../../matrices/sweep.toml").replacen(from, to, 1);
            assert!(text.contains(to), "{to}");
            SweepPlan::parse(&text, "p.toml").unwrap_err().to_string()
        };
        assert!(parse("rounds = 5", "rounds = 0").contains("at least 1"));
        assert!(parse("[0.5, 1, 2, 4]", "[0.5, 1, 1]").contains("must ascend"));
        assert!(parse("[0.5, 1, 2, 4]", "[-1, 1]").contains("not -1"));
        assert!(parse("[0.5, 1, 2, 4]", "[]").contains("must each have an entry"));
        assert!(parse("memory_gb = 8", "memory_gb = 0").contains("memory_gb is 0"));
        assert!(parse("[512, 384]", "[512, 0]").contains("not 512x0"));
        assert!(parse("[6, 7, 8, 9, 10]", "[6, 24]").contains("not 24"));
        assert!(parse("views = 2", "vews = 2").contains("line 5"));
    }

    #[test]
    fn levels_are_sorted_and_apply_to_all_scenes() {
        let mut plan = SweepPlan::default_run();
        plan.select_scenes(&["hairball".into(), "fairy".into()]);
        plan.set_levels(&[7, 5, 7]);
        assert!(plan.scenes.len() == 2 && plan.scenes.iter().all(|s| s.levels == [5, 7]));
    }
}
