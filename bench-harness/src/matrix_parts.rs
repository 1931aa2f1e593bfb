//! What the matrices of `esvo bench` and `esvo bench build` have in common: scenes with their levels, what is left out, and
//! how they are read.

use esvo_engines::{EngineId, UnknownEngine};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// A scene and the levels that its octrees are built to.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneLevels {
    /// Name of the scene in the manifest.
    pub name: String,
    /// Deepest levels of the octrees to build, ascending, each 1..=23. Casting is timed on the last one that was built.
    pub levels: Vec<u32>,
}

/// Something that was not measured, and the reason.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LeftOut {
    /// What was not measured.
    pub what: String,
    /// The reason, and what to do about it if something can be done.
    pub reason: String,
}

/// Reads a matrix from TOML; `Err` says the line and what is wrong with it.
pub(crate) fn parse_toml<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    toml::from_str(text).map_err(|e| {
        let line = e.span().map_or(String::new(), |s| format!("line {}: ", text[..s.start].matches('\n').count() + 1));
        format!("{line}{}", e.message())
    })
}

/// The named scenes, in this order. A scene that is not among `scenes` gets the levels of the first.
pub(crate) fn select_scenes(scenes: &[SceneLevels], names: &[String]) -> Vec<SceneLevels> {
    let levels = scenes.first().map(|s| s.levels.clone()).unwrap_or_default();
    let pick = |name: &String| {
        let known = scenes.iter().find(|s| s.name.eq_ignore_ascii_case(name));
        known.cloned().unwrap_or_else(|| SceneLevels { name: name.clone(), levels: levels.clone() })
    };
    names.iter().map(pick).collect()
}

/// Checks that this program knows every engine.
///
/// # Errors
/// The first that it does not know, with those that it does.
pub(crate) fn check_engines(engines: &[EngineId]) -> Result<(), String> {
    let unknown = engines.iter().find(|engine| !engine.is_known());
    unknown.map_or(Ok(()), |engine| Err(UnknownEngine { name: engine.to_string() }.to_string()))
}

/// Checks that there are scenes and that their levels ascend within 1 to 23. `Err` says what is wrong.
pub(crate) fn check_scenes(scenes: &[SceneLevels]) -> Result<(), String> {
    if scenes.is_empty() {
        return Err("the list of scenes is empty".into());
    }
    for scene in scenes {
        if scene.levels.is_empty() {
            return Err(format!("scene {}: levels is empty", scene.name));
        }
        if let Some(levels) = scene.levels.iter().find(|l| !(1..=23).contains(*l)) {
            return Err(format!("scene {}: levels must be between 1 and 23, not {levels}", scene.name));
        }
        if scene.levels.windows(2).any(|w| w[0] >= w[1]) {
            return Err(format!("scene {}: levels must ascend", scene.name));
        }
    }
    Ok(())
}
