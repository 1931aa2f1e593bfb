//! The levels and bytes that contours save.

use super::ratio;
use crate::build_bench::plan::Contours;
use crate::build_bench::record::{BuildReport, BuildRow, Measure, SavedLevels, SceneBuilds};
use crate::text::{TextTable, or_dash, short};
use crate::units::MIB;

/// For each octree with contours, the cubical octree with the same error.
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
        "Cubical levels and MiB: those of the cubical octree with the same error as the octree with contours. They are \
         interpolated between the measured levels, linearly in the logarithms of error and bytes, and extrapolated beyond the \
         deepest (>) and the coarsest (<) cubical octree."
            .into(),
        "Median error: in edges of the finest voxel of the octree with contours, with rays that end at leaves. Bytes: cubical \
         divided by contours. Levels saved: at equal median error, and at equal 90th and 99th percentile of the error."
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
                or_dash(voxels.map(|v| format!("{v:.3}"))),
                mib(median.bytes),
                format!("{:.1}{}", median.cubical_levels, beyond(scene, median)),
                mib(median.cubical_bytes),
                ratio(median.cubical_bytes, median.bytes),
                spared(median),
                or_dash(of(Measure::P90).map(spared)),
                or_dash(of(Measure::P99).map(spared)),
            ]);
        }
    }
    table
}

/// Marks levels outside those of the cubical octrees.
fn beyond(scene: &SceneBuilds, saved: &SavedLevels) -> &'static str {
    let coarser = |r: &BuildRow| r.contours == Contours::Off && f64::from(r.levels) <= saved.cubical_levels;
    match saved.extrapolated {
        false => "",
        true if scene.rows.iter().any(coarser) => " (>)",
        true => " (<)",
    }
}
