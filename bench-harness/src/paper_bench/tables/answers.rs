//! The tables of errors against the triangles, and of checks against the reference caster.

use crate::paper_bench::report::PaperReport;
use crate::text::{TextTable, or_dash, short};

/// Distance of the hits from the triangles.
pub(crate) fn errors(report: &PaperReport) -> TextTable {
    let head = [
        "scene",
        "cast",
        "levels",
        "mean level hit",
        "median px",
        "90th",
        "99th",
        "median voxels",
        "holes",
        "hit/miss differ",
        "FLIP",
    ];
    let mut table = TextTable::new("Error against the triangles", 2, &head);
    table.notes = vec![
        "Difference of depth along the ray where both hit, in pixels (the footprint of a pixel at the hit), at 512x384, \
         with rays that end at voxels of one pixel: median and percentiles, averaged over the views. Mean level hit: of the voxels \
         that the rays end at."
            .into(),
        "Median voxels: in edges of the finest voxel. Holes: rays that hit a triangle but no voxel. Hit/miss: holes and rays that hit a voxel but no triangle."
            .into(),
        "FLIP: visible difference of the shaded picture from that of the triangles, 0 to 1, averaged over pixels and views.".into(),
    ];
    for scene in &report.scenes {
        for e in &scene.errors {
            table.rows.push(vec![
                scene.name.clone(),
                format!("{}, {}", e.variant.title(), scene.mesh.title()),
                e.levels.to_string(),
                or_dash(e.mean_hit_level().map(|level| format!("{level:.2}"))),
                short(e.mean(|v| v.pixels.median)),
                short(e.mean(|v| v.pixels.p90)),
                short(e.mean(|v| v.pixels.p99)),
                short(e.mean(|v| v.voxels.median)),
                format!("{:.4}%", 100.0 * e.mean(|v| v.only_exact as f64 / v.rays.max(1) as f64)),
                format!("{:.4}%", 100.0 * e.mean(|v| v.disagreement)),
                or_dash(e.flip().map(|f| format!("{f:.3}"))),
            ]);
        }
    }
    table
}

/// What the checks found.
pub(crate) fn checks(report: &PaperReport) -> TextTable {
    let head = ["scene", "caster", "cast", "levels", "pixels", "other voxel", "allowed", "verdict"];
    let mut table = TextTable::new("Answers against the reference caster, checked before timing", 3, &head);
    let decided: Vec<_> = (report.scenes.iter().flat_map(|scene| &scene.checks))
        .filter_map(|check| Some((check.agreement.pixels, check.undecided?)))
        .collect();
    if !decided.is_empty() {
        let (pixels, undecided) = decided.iter().fold((0, 0), |sum, one| (sum.0 + one.0, sum.1 + one.1));
        table.notes.push(format!(
            "Triangles on a GPU are compared with the processor's exact caster. Of their {pixels} pixels, single precision left \
             {undecided} undecided, and the processor decided these."
        ));
    }
    for scene in &report.scenes {
        for check in &scene.checks {
            let a = &check.agreement;
            table.rows.push(vec![
                scene.name.clone(),
                check.backend.name().into(),
                check.variant.title().into(),
                check.levels.to_string(),
                a.pixels.to_string(),
                a.different_voxel.to_string(),
                format!("{:.0}", (a.allowed.share * a.pixels as f64).floor()),
                if a.passed() { "ok" } else { "FAILED" }.into(),
            ]);
        }
    }
    table
}
