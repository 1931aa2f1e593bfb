//! All builds: seconds, memory, counts, bytes.

use super::{millions, rows};
use crate::build_bench::record::BuildReport;
use crate::build_summary::BuildSeconds;
use crate::text::{TextTable, or_dash, short};
use crate::units::MIB;

/// One row for each octree.
pub(super) fn builds(report: &BuildReport) -> TextTable {
    let head = [
        "scene",
        "octree",
        "levels",
        "triangles",
        "seconds",
        "CPU s",
        "builds",
        "import",
        "prepare",
        "voxelize",
        "write",
        "peak MiB",
        "of import",
        "descriptors",
        "leaves",
        "contours",
        "MiB",
        "B/voxel",
    ];
    let mut table = TextTable::new("Builds", 2, &head);
    table.notes = vec![
        "Seconds: from the mesh in memory to the octree in its file, median ± half the distance between the quartiles. Prepare, \
         voxelize and write (placing and writing blocks) are parts of them; import is not. CPU s: processor time of the whole \
         process, user and system, import included."
            .into(),
        "Triangles: in millions, after displacement. SIBENIK-D is displaced in cells of two finest voxels, and displacing \
         counts as import."
            .into(),
        "Peak MiB: most memory that the process ever held. Of import: most memory up to the end of the import. Descriptors, \
         leaf voxels and contours are in millions."
            .into(),
        "MiB (2^20 bytes): the image, which a caster needs in memory. Bytes per voxel count all voxels.".into(),
    ];
    for (scene, row) in rows(report) {
        let seconds = row.spread(|s| s.seconds.build);
        let phase = |of: fn(&BuildSeconds) -> f64| short(row.spread(|s| of(&s.seconds)).median);
        table.rows.push(vec![
            scene.name.clone(),
            format!("{}, {}", row.contours.title(), scene.mesh.title()),
            row.levels.to_string(),
            millions(row.build.triangles),
            format!("{} ±{:.0}%", short(seconds.median), seconds.percent()),
            or_dash(row.cpu_seconds().map(|cpu| format!("{} ±{:.0}%", short(cpu.median), cpu.percent()))),
            row.samples.len().to_string(),
            phase(|s| s.import),
            phase(|s| s.prepare),
            phase(|s| s.voxelize),
            phase(|s| s.write),
            format!("{:.0}", row.peak_mib()),
            format!("{:.0}", row.build.import_peak_bytes as f64 / MIB),
            millions(row.build.descriptors),
            millions(row.build.leaves),
            millions(row.build.contours),
            short(row.mib()),
            format!("{:.2}", row.bytes_per_voxel()),
        ]);
    }
    table
}
