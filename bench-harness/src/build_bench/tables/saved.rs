//! What contours save.

use super::{cell, ratio};
use crate::build_bench::plan::Contours;
use crate::build_bench::record::{BuildReport, BuildRow, Measure, SavedLevels, SceneBuilds};
use crate::text::{TextTable, short};
use crate::units::MIB;

/// How many levels contours save.
pub(super) fn saved(report: &BuildReport) -> TextTable {
    let head = [
        "scene",
        "mesh",
        "levels",
        "median error",
        "MiB",
        "cubical levels",
        "cubical MiB",
        "bytes",
        "levels saved",
        "by the 90th",
        "by the 99th",
    ];
    let mut table = TextTable::new("What contours save", 2, &head);
    table.notes = vec![
        "The cubical octree that is as near to the triangles as the one with contours: its level by the errors that were \
         measured, interpolated in the logarithm of the error between two levels, and its bytes likewise. (>) beyond the \
         deepest cubical octree, (<) above the coarsest: their trend goes on."
            .into(),
        "Median error in finest voxels of the octree with contours, rays ending at leaves; bytes: cubical over contours. \
         Levels saved at an equal median error, and at an equal 90th and 99th percentile of it."
            .into(),
    ];
    for scene in &report.scenes {
        for median in scene.saved.iter().filter(|s| s.measure == Measure::Median) {
            let levels = median.levels;
            let of = |measure| scene.saved.iter().find(|s| s.measure == measure && s.levels == levels);
            let voxels = scene.row(Contours::On, levels).and_then(|r| r.error).map(|e| e.voxels.median);
            let mib = |bytes: f64| short(bytes / MIB);
            let spared = |s: &SavedLevels| format!("{:.1}{}", s.cubical_levels - f64::from(levels), beyond(scene, s));
            table.rows.push(vec![
                scene.name.clone(),
                scene.mesh.title().into(),
                levels.to_string(),
                cell(voxels.map(|v| format!("{v:.3}"))),
                mib(median.bytes),
                format!("{:.1}{}", median.cubical_levels, beyond(scene, median)),
                mib(median.cubical_bytes),
                ratio(median.cubical_bytes, median.bytes),
                spared(median),
                cell(of(Measure::P90).map(spared)),
                cell(of(Measure::P99).map(spared)),
            ]);
        }
    }
    table
}

/// Marks what lies outside the levels of the cubical octrees.
fn beyond(scene: &SceneBuilds, saved: &SavedLevels) -> &'static str {
    let coarser = |r: &BuildRow| r.contours == Contours::Off && f64::from(r.levels) <= saved.cubical_levels;
    match saved.extrapolated {
        false => "",
        true if scene.rows.iter().any(coarser) => " (>)",
        true => " (<)",
    }
}
