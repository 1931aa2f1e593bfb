//! The error of colours and normals, and of pictures, of all octrees against their triangles.

use super::rows;
use crate::build_bench::record::BuildReport;
use crate::error::attributes::NEAR;
use crate::text::{TextTable, or_dash};

/// All errors of colours and normals.
pub(super) fn attributes(report: &BuildReport) -> TextTable {
    let head = [
        "scene",
        "octree",
        "levels",
        "rays end at",
        "normals, degrees: median",
        "90th",
        "99th",
        "colours, of 255: median",
        "90th",
        "99th",
        "elsewhere",
        "FLIP",
    ];
    let mut table = TextTable::new("Colours and normals against the triangles", 2, &head);
    table.notes = vec![
        "Normals: angle between the voxel's and the shading normal of the triangle that the ray hits, with its normal map; both are turned to \
         the viewer before, so that angles go up to 180. Colours: largest difference of the three channels between the voxel and the triangle, \
         material x vertex colour x texture at full resolution between texels, sRGB-encoded, in steps of 1/255."
            .into(),
        format!(
            "For rays that hit both within {NEAR} edges of the finest voxel, or {NEAR} footprints of a pixel if rays end at voxels of one pixel and \
             those are wider. Elsewhere: rays that hit both farther apart, which are left out: they hit different surfaces."
        ),
        "FLIP: visible difference of the shaded pictures of octree and triangles, mean over pixels and viewpoints, 0 to 1.".into(),
    ];
    for (scene, row) in rows(report) {
        for (end, errors, flip) in
            [("leaves", &row.attributes, None), ("one pixel", &row.attributes_at_pixel, row.flip_at_pixel)]
        {
            let Some(e) = errors else { continue };
            table.rows.push(vec![
                scene.name.clone(),
                format!("{}, {}", row.contours.title(), scene.mesh.title()),
                row.levels.to_string(),
                end.into(),
                format!("{:.2}", e.normals.median),
                format!("{:.2}", e.normals.p90),
                format!("{:.2}", e.normals.p99),
                format!("{:.1}", e.colors.median),
                format!("{:.1}", e.colors.p90),
                format!("{:.1}", e.colors.p99),
                format!("{:.3}%", 100.0 * e.elsewhere as f64 / e.both_hit.max(1) as f64),
                or_dash(flip.map(|flip| format!("{flip:.3}"))),
            ]);
        }
    }
    table
}
