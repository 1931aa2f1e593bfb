//! Comparison with the paper authors' builder: builds of the same scenes, and their errors.

use esvo_scenes::SceneVariant;

use super::{millions, ratio, rows};
use crate::build_bench::peers::{Authors, Termination, TheirError};
use crate::build_bench::plan::Contours;
use crate::build_bench::record::BuildReport;
use crate::error::depth::Summary;
use crate::scene::compared_as;
use crate::text::{TextTable, short};

/// The builds that the authors' builder was measured on too.
pub(super) fn beside_authors(report: &BuildReport, authors: &Authors) -> TextTable {
    let head = [
        "scene",
        "builder",
        "levels",
        "seconds",
        "peak MiB",
        "MiB",
        "B/voxel",
        "descriptors",
        "leaves",
        "contours",
        "bytes",
        "time",
    ];
    let mut table = TextTable::new("Compared with the authors' builder", 2, &head);
    table.notes = vec![
        "Authors: ESVO 1.4 with the same mesh and settings on two threads of the same kind of machine, measured in a separate \
         run on another day. In brackets: seconds while other programs ran."
            .into(),
        "Bytes and time: theirs divided by ours, so that ours is better above 1. Counts are in millions.".into(),
    ];
    for (scene, row) in rows(report).filter(|(_, r)| r.contours == Contours::On) {
        let Some(theirs) = authors.build(compared_as(&scene.name, scene.mesh), row.levels) else { continue };
        let comparable = theirs.own_mesh == (scene.mesh == SceneVariant::Real);
        if theirs.own_mesh && !comparable {
            continue;
        }
        let ours = row.seconds();
        let build = &row.build;
        table.rows.push(vec![
            scene.name.clone(),
            format!("ours, {}", scene.mesh.title()),
            row.levels.to_string(),
            short(ours),
            format!("{:.0}", row.peak_mib()),
            short(row.mib()),
            format!("{:.2}", row.bytes_per_voxel()),
            millions(build.descriptors),
            millions(build.leaves),
            millions(build.contours),
            if theirs.own_mesh { ratio(theirs.mib, row.mib()) } else { "-".into() },
            if theirs.own_mesh { ratio(theirs.seconds, ours) } else { "-".into() },
        ]);
        let busy = theirs.seconds_busy.map_or(String::new(), |s| format!(" ({s})"));
        table.rows.push(vec![
            String::new(),
            if theirs.own_mesh { "authors" } else { "authors, another stand-in" }.into(),
            row.levels.to_string(),
            format!("{}{busy}", short(theirs.seconds)),
            format!("{:.0}", theirs.peak_mib),
            short(theirs.mib),
            format!("{:.1}", theirs.bytes_per_voxel),
            short(theirs.descriptors),
            short(theirs.leaves),
            short(theirs.contours),
            String::new(),
            String::new(),
        ]);
    }
    table
}

/// Errors of those builds.
pub(super) fn errors_beside_authors(report: &BuildReport, authors: &Authors) -> TextTable {
    let head = ["scene", "octree", "levels", "rays end at", "unit", "median", "90th", "99th", "hit/miss differ"];
    let mut table = TextTable::new("Error compared with the authors' octrees", 2, &head);
    table.notes = vec![format!(
        "Distance along the ray to the triangles, for rays that hit both. Ours: {} rays over all viewpoints. Authors: lowest to \
         highest value of two of their cameras at 512x384, measured separately. Their unit at leaves is voxels of unknown size: \
         ours are given in edges of the finest voxels and in edges of the voxel that each ray hit.",
        report.matrix.rays
    )];
    let range = |[a, b]: [f64; 2], decimals: usize| {
        if a == b { format!("{a:.decimals$}") } else { format!("{a:.decimals$} to {b:.decimals$}") }
    };
    for (scene, row) in rows(report).filter(|(s, r)| r.contours == Contours::On && s.mesh == SceneVariant::Real) {
        for (termination, error, end, unit) in [
            (Termination::None, &row.error, "leaves", "voxels"),
            (Termination::Pixel, &row.error_at_pixel, "one pixel", "pixels"),
        ] {
            let (Some(error), Some(theirs)) = (error, authors.error(&scene.name, row.levels, termination)) else {
                continue;
            };
            let ours: &[(&str, &Summary)] = match termination {
                Termination::None => &[("finest voxels", &error.voxels), ("voxels hit", &error.hit_voxels)],
                Termination::Pixel => &[(unit, &error.pixels)],
            };
            for (unit, ours) in ours {
                table.rows.push(vec![
                    scene.name.clone(),
                    "ours".into(),
                    row.levels.to_string(),
                    end.into(),
                    unit.to_string(),
                    format!("{:.3}", ours.median),
                    format!("{:.3}", ours.p90),
                    format!("{:.3}", ours.p99),
                    format!("{:.4}%", 100.0 * error.disagreement),
                ]);
            }
            let TheirError { median, p90, p99, disagreement_percent, .. } = theirs;
            table.rows.push(vec![
                String::new(),
                "authors".into(),
                row.levels.to_string(),
                end.into(),
                unit.into(),
                range(*median, 2),
                range(*p90, 2),
                range(*p99, 2),
                format!("{}%", range(*disagreement_percent, 4)),
            ]);
        }
    }
    table
}
