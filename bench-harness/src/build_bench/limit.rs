//! Where the ladder of a scene's levels ends, and why.

use serde::{Deserialize, Serialize};

use super::plan::{BuildMatrix, Contours};
use super::record::BuildRow;
use crate::text::{GB, short};

/// Growth from one level to the next where only one level is known: surfaces quadruple.
const FIRST_GROWTH: f64 = 4.2;

/// Why a scene has no octree of a kind from some level on.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct Stopped {
    /// Of which kind.
    pub contours: Contours,
    /// The first level that is not there.
    pub levels: u32,
    /// What ended it.
    pub limit: Limit,
    /// The same in words, with figures.
    pub why: String,
}

/// What ends a ladder.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Limit {
    /// Memory of a build.
    Memory,
    /// Disk for the file.
    Disk,
    /// Seconds of one build.
    Build,
    /// Seconds of the run.
    Run,
    /// The build failed.
    Failed,
}

impl Limit {
    /// As a cell of a table says it.
    pub(crate) fn cell(self, matrix: &BuildMatrix) -> String {
        match self {
            Self::Memory => format!("> {} GB memory", matrix.memory_gb),
            Self::Disk => format!("> {} GB", matrix.disk_gb),
            Self::Build if matrix.build_limit_seconds >= 120.0 => {
                format!("> {} min", (matrix.build_limit_seconds / 6.0).round() / 10.0)
            }
            Self::Build => format!("> {} s", matrix.build_limit_seconds),
            Self::Run => "no time left".into(),
            Self::Failed => "failed".into(),
        }
    }
}

/// Why the next level of a kind is not built: what it is expected to take, from the growth of the last two levels, exceeds
/// a limit. `rows` are those of the scene, `left` the seconds that the run has left. What no level is known of is built.
pub(crate) fn refusal(rows: &[BuildRow], kind: Contours, matrix: &BuildMatrix, left: f64) -> Option<(Limit, String)> {
    if left <= 0.0 {
        return Some((Limit::Run, "the time limit of the run has come".into()));
    }
    let expected = |of: fn(&BuildRow) -> f64| {
        let before: Vec<f64> = rows.iter().filter(|r| r.contours == kind).map(of).collect();
        next(&before)
    };
    let disk = expected(|r| r.build.file_bytes as f64)?;
    if disk > matrix.disk_gb * GB {
        let why = format!("would take about {} GB of disk, and the limit is {}", short(disk / GB), matrix.disk_gb);
        return Some((Limit::Disk, why));
    }
    // The mesh is held at every level; what comes on top of it grows.
    let import = rows.iter().map(|r| r.build.import_peak_bytes).max().unwrap_or(0) as f64;
    let memory = import + expected(|r| r.build.peak_bytes.saturating_sub(r.build.import_peak_bytes) as f64)?;
    if memory > matrix.memory_gb * GB {
        let why =
            format!("would take about {} GB of memory, and the limit is {}", short(memory / GB), matrix.memory_gb);
        return Some((Limit::Memory, why));
    }
    let seconds = expected(|r| r.build.seconds.import + r.build.seconds.build)?;
    if seconds > matrix.build_limit_seconds {
        let limit = matrix.build_limit_seconds;
        let why = format!("would take about {seconds:.0} s, and the limit of one build is {limit:.0} s");
        return Some((Limit::Build, why));
    }
    let why = || format!("would take about {seconds:.0} s, and the time limit of the run leaves {left:.0} s");
    (seconds > left).then(|| (Limit::Run, why()))
}

/// What the next level is expected to take: the last one times its growth over the one before. What shrinks is taken to
/// stay.
fn next(before: &[f64]) -> Option<f64> {
    let last = *before.last()?;
    let growth = match before {
        [.., a, b] if *a > 0.0 => (b / a).max(1.0),
        _ => FIRST_GROWTH,
    };
    Some(last * growth)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build_bench::record::tests::row;

    fn limits() -> BuildMatrix {
        BuildMatrix { disk_gb: 8.0, memory_gb: 4.0, build_limit_seconds: 1200.0, ..BuildMatrix::default_run() }
    }

    #[test]
    fn the_last_two_levels_say_what_the_next_one_takes() {
        assert_eq!(next(&[]), None);
        assert_eq!(next(&[2.0]), Some(8.4));
        assert_eq!(next(&[1.0, 2.0, 6.0]), Some(18.0));
        assert_eq!(next(&[3.0, 2.0]), Some(2.0));
    }

    #[test]
    fn a_ladder_ends_before_the_level_that_is_too_much() {
        let refused = |rows: &[BuildRow], left| refusal(rows, Contours::Off, &limits(), left).map(|r| r.0);
        // Seconds, file and peak, in GB.
        let ladder = |last: [f64; 3]| {
            [row(12, Contours::Off, [10.0, 0.5, 0.5]), row(13, Contours::Off, last), row(13, Contours::On, [1e4; 3])]
        };
        assert_eq!(refused(&[], 1.0), None, "the first level is built");
        assert_eq!(refused(&[], 0.0), Some(Limit::Run));
        assert_eq!(refused(&ladder([40.0, 1.9, 0.6]), f64::INFINITY), None);
        assert_eq!(refused(&ladder([40.0, 2.1, 0.6]), f64::INFINITY), Some(Limit::Disk));
        assert_eq!(refused(&ladder([40.0, 1.9, 1.5]), f64::INFINITY), Some(Limit::Memory));
        assert_eq!(refused(&ladder([110.0, 1.9, 0.6]), f64::INFINITY), Some(Limit::Build));
        assert_eq!(refused(&ladder([40.0, 1.9, 0.6]), 159.0), Some(Limit::Run));
        assert_eq!(refused(&ladder([40.0, 1.9, 0.6]), 161.0), None);
    }

    #[test]
    fn cells_name_the_limit() {
        let mut matrix = limits();
        let cells = [Limit::Disk, Limit::Memory, Limit::Build, Limit::Failed].map(|l| l.cell(&matrix));
        assert_eq!(cells, ["> 8 GB", "> 4 GB memory", "> 20 min", "failed"]);
        matrix.build_limit_seconds = 30.0;
        assert_eq!(Limit::Build.cell(&matrix), "> 30 s");
    }
}
