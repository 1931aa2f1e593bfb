//! Comparison with another esvo program that built the same octrees in the same rounds.

use super::{millions, ratio, rows};
use crate::build_bench::record::{BuildReport, BuildSample};
use crate::text::{TextTable, or_dash, short};
use crate::timing::Spread;
use crate::units::MIB;

/// All octrees that both have built.
pub(super) fn beside(report: &BuildReport) -> TextTable {
    let commit = report.beside.as_ref().map_or("unknown", |other| &other.commit);
    let head = [
        "scene",
        "octree",
        "levels",
        "rounds",
        "CPU s",
        "of the other",
        "CPU ratio",
        "seconds",
        "of the other",
        "peak MiB",
        "of the other",
        "million voxels",
        "of the other",
        "MB",
        "of the other",
    ];
    let mut table = TextTable::new(format!("Beside the program of commit {commit}"), 2, &head);
    table.notes = vec![
        "The other program built each octree right before or after ours, in turn; it has the settings of its own version. CPU s: processor time \
         of the whole process. CPU ratio: the other program's divided by ours, median over the rounds, so that ours is faster above 1."
            .into(),
        "Seconds: from the mesh in memory to the octree in its file. MB (10^6 bytes): the image.".into(),
    ];
    for (scene, row) in rows(report) {
        let Some(other) = &row.beside else { continue };
        let median = |samples: &[BuildSample], of: fn(&BuildSample) -> Option<f64>| {
            let all: Option<Vec<f64>> = samples.iter().map(of).collect();
            or_dash(all.and_then(|all| Spread::of(&all)).map(|spread| short(spread.median)))
        };
        let peak = |samples: &[BuildSample]| {
            format!("{:.0}", samples.iter().map(|s| s.peak_bytes).max().unwrap_or(0) as f64 / MIB)
        };
        let (ours, theirs) = (&row.samples[..], &other.samples[..]);
        table.rows.push(vec![
            scene.name.clone(),
            format!("{}, {}", row.contours.title(), scene.mesh.title()),
            row.levels.to_string(),
            theirs.len().to_string(),
            median(ours, |s| s.cpu_seconds),
            median(theirs, |s| s.cpu_seconds),
            or_dash(row.cpu_ratio_beside().map(|quotient| ratio(quotient, 1.0))),
            median(ours, |s| Some(s.seconds.build)),
            median(theirs, |s| Some(s.seconds.build)),
            peak(ours),
            peak(theirs),
            millions(row.build.voxels),
            millions(other.voxels),
            short(row.build.image_bytes as f64 / 1e6),
            short(other.image_bytes as f64 / 1e6),
        ]);
    }
    table
}
