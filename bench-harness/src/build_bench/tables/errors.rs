//! The error of all octrees against their triangles.

use super::rows;
use crate::build_bench::record::BuildReport;
use crate::error::depth::DepthError;
use crate::text::TextTable;

/// All errors.
pub(super) fn errors(report: &BuildReport) -> TextTable {
    let head = [
        "scene",
        "octree",
        "levels",
        "rays end at",
        "voxels: median",
        "90th",
        "99th",
        "pixels: median",
        "90th",
        "99th",
        "holes",
        "hit/miss differ",
    ];
    let mut table = TextTable::new("Error against the triangles", 2, &head);
    table.notes = vec![
        format!(
            "Distance along the ray between octree and triangles, for rays that hit both, in edges of the finest voxel and in \
             footprints of a pixel; about {} rays per scene, over all its viewpoints.",
            report.matrix.rays
        ),
        "Holes: rays that hit a triangle but no voxel. Hit/miss: holes and rays that hit a voxel but no triangle. Rays pass \
         through cut-outs of the mesh."
        .into(),
    ];
    for (scene, row) in rows(report) {
        for (end, error) in [("leaves", &row.error), ("one pixel", &row.error_at_pixel)] {
            let Some(e) = error else { continue };
            let share = |count: u64, e: &DepthError| format!("{:.4}%", 100.0 * count as f64 / e.rays.max(1) as f64);
            table.rows.push(vec![
                scene.name.clone(),
                format!("{}, {}", row.contours.title(), scene.mesh.title()),
                row.levels.to_string(),
                end.into(),
                format!("{:.3}", e.voxels.median),
                format!("{:.3}", e.voxels.p90),
                format!("{:.3}", e.voxels.p99),
                format!("{:.3}", e.pixels.median),
                format!("{:.3}", e.pixels.p90),
                format!("{:.3}", e.pixels.p99),
                share(e.only_exact, e),
                share(e.only_exact + e.only_octree + e.strange, e),
            ]);
        }
    }
    table
}
