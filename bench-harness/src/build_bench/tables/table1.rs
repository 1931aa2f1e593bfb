//! The paper's Table 1: octree levels against memory and time.

use super::millions;
use crate::build_bench::plan::{BuildMatrix, Contours};
use crate::build_bench::record::{BuildReport, BuildRow, Limit};
use crate::paper_bench::paper::Paper;
use crate::scene::compared_as;
use crate::text::{TextTable, or_dash, short};

/// The levels of the paper's Table 1.
const TABLE1_LEVELS: [u32; 7] = [10, 11, 12, 13, 14, 15, 16];

/// The paper's Table 1: levels against MiB, seconds, voxels and bytes per voxel.
pub(super) fn table1(report: &BuildReport, paper: &Paper) -> TextTable {
    let mut head = vec!["scene".to_string(), "octree".into(), "figure".into()];
    head.extend(TABLE1_LEVELS.map(|l| l.to_string()));
    let title = "Table 1: limit on octree levels against memory and time";
    let mut table = TextTable { head, left: 3, ..TextTable::new(title, 3, &[]) };
    table.notes = vec![
        "MiB (2^20 bytes), seconds, millions of voxels (leaves and others), bytes per voxel.".into(),
        "> 8 GB, > 20 min and the like: not built, because the growth of the last two levels predicts that the file or the build \
         exceeds that limit; the list \"Left out\" has the prediction. -: not in the matrix."
            .into(),
        format!(
            "Paper: built on {}, with contours. Its meshes differ slightly from ours, and its MB are read as MiB.",
            paper.machine.cpu
        ),
    ];
    type Figure = (&'static str, fn(&BuildRow) -> String);
    let figures: [Figure; 4] = [
        ("MiB", |r| short(r.mib())),
        ("seconds", |r| short(r.seconds())),
        ("voxels", |r| millions(r.build.voxels)),
        ("B/voxel", |r| format!("{:.2}", r.bytes_per_voxel())),
    ];
    for scene in &report.scenes {
        for contours in [Contours::On, Contours::Off] {
            if !TABLE1_LEVELS.iter().any(|&l| scene.row(contours, l).is_some()) {
                continue;
            }
            for (name, figure) in figures {
                let octree = format!("{}, {}", contours.title(), scene.mesh.title());
                let mut row = vec![scene.name.clone(), octree, name.into()];
                let stopped = |l| scene.stopped(contours, l).map(|s| limit_cell(s.limit, &report.matrix));
                row.extend(TABLE1_LEVELS.map(|l| or_dash(scene.row(contours, l).map(figure).or_else(|| stopped(l)))));
                table.rows.push(row);
            }
        }
        let known = compared_as(&scene.name, scene.mesh);
        if TABLE1_LEVELS.iter().any(|&l| paper.build(known, l).is_some()) {
            for (index, name) in ["MiB", "seconds"].into_iter().enumerate() {
                let mut row = vec![scene.name.clone(), "contours, paper".into(), name.into()];
                let figure = |l| paper.build(known, l).map(|both| short(<[f64; 2]>::from(both)[index]));
                row.extend(TABLE1_LEVELS.map(|l| or_dash(figure(l))));
                table.rows.push(row);
            }
        }
    }
    table
}

/// A cell for an octree that a limit did not allow.
fn limit_cell(limit: Limit, matrix: &BuildMatrix) -> String {
    match limit {
        Limit::Memory => format!("> {} GB memory", matrix.memory_gb),
        Limit::Disk => format!("> {} GB", matrix.disk_gb),
        Limit::Build if matrix.build_limit_seconds >= 120.0 => {
            format!("> {} min", (matrix.build_limit_seconds / 6.0).round() / 10.0)
        }
        Limit::Build => format!("> {} s", matrix.build_limit_seconds),
        Limit::Run => "no time left".into(),
        Limit::Failed => "failed".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::report;
    use super::*;

    #[test]
    fn cells_say_why_they_have_no_figure() {
        let report = report();
        let table = table1(&report, &Paper::figures());
        let cells = |row: usize| table.rows[row][2..].join(" | ");
        let rest = ["> 20 min"; 5].join(" | ");
        assert_eq!(cells(1), format!("seconds | 2.00 | 700 | {rest}"));
        assert_eq!(cells(4), format!("MiB | 191 | {}", ["> 8 GB"; 6].join(" | ")));
    }

    #[test]
    fn cells_name_the_limit() {
        let mut matrix =
            BuildMatrix { disk_gb: 8.0, memory_gb: 4.0, build_limit_seconds: 1200.0, ..BuildMatrix::default_run() };
        let cells = [Limit::Disk, Limit::Memory, Limit::Build, Limit::Failed].map(|l| limit_cell(l, &matrix));
        assert_eq!(cells, ["> 8 GB", "> 4 GB memory", "> 20 min", "failed"]);
        matrix.build_limit_seconds = 30.0;
        assert_eq!(limit_cell(Limit::Build, &matrix), "> 30 s");
    }
}
