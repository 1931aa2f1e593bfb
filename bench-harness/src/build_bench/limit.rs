//! Deciding whether the next level of a scene is built.

use super::plan::{BuildMatrix, Contours};
use super::record::{BuildRow, Limit};
use crate::growth::predict;
use crate::text::short;
use crate::units::GB;

/// Why the next level of an octree is not built: its expected disk, memory or time exceeds a limit. Expectations follow the
/// growth of the last two levels. `rows` are the scene's rows so far; `left` is the rest of the run's time in seconds. The first
/// level of a kind is always built while time is left.
pub(crate) fn refusal(rows: &[BuildRow], kind: Contours, matrix: &BuildMatrix, left: f64) -> Option<(Limit, String)> {
    if left <= 0.0 {
        return Some((Limit::Run, "the time limit of the run is reached".into()));
    }
    let expected = |of: fn(&BuildRow) -> f64| {
        let before: Vec<f64> = rows.iter().filter(|r| r.contours == kind).map(of).collect();
        predict(&before, 1.0..=f64::INFINITY)
    };
    let disk = expected(|r| r.build.file_bytes as f64)?;
    if disk > matrix.disk_gb * GB {
        let why = format!("would take about {} GB of disk, and the limit is {}", short(disk / GB), matrix.disk_gb);
        return Some((Limit::Disk, why));
    }
    // The mesh needs the same memory at every level; the rest grows.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build_bench::record::tests::row;

    fn limits() -> BuildMatrix {
        BuildMatrix { disk_gb: 8.0, memory_gb: 4.0, build_limit_seconds: 1200.0, ..BuildMatrix::default_run() }
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
}
