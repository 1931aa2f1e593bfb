//! Levels saved by contours: the cubical error curve over the level is interpolated at the error of the octree with contours.

use super::plan::Contours;
use super::record::{BuildRow, Measure, SavedLevels};

/// The levels saved by each octree with contours, for each measure. Empty unless there are two cubical octrees to compare with.
pub(crate) fn saved(rows: &[BuildRow]) -> Vec<SavedLevels> {
    Measure::ALL.into_iter().flat_map(|measure| saved_by(rows, measure)).collect()
}

fn saved_by(rows: &[BuildRow], measure: Measure) -> Vec<SavedLevels> {
    let point = |row: &BuildRow| {
        let error = measure.of(&row.error.as_ref()?.scene);
        (error > 0.0).then_some((f64::from(row.levels), error, row.build.image_bytes as f64))
    };
    let of = |kind: Contours| {
        let mut points: Vec<_> = rows.iter().filter(|r| r.contours == kind).filter_map(point).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    };
    let cubical = of(Contours::Off);
    let found = |(levels, error, bytes): (f64, f64, f64)| {
        let (cubical_levels, extrapolated) = crossing(&cubical, error)?;
        let log_bytes: Vec<_> = cubical.iter().map(|p| (p.0, p.2.log2())).collect();
        Some(SavedLevels {
            measure,
            levels: levels as u32,
            error,
            bytes,
            cubical_levels,
            cubical_bytes: along(&log_bytes, cubical_levels)?.exp2(),
            extrapolated,
        })
    };
    of(Contours::On).into_iter().filter_map(found).collect()
}

/// The level at which the error is `error`, and whether that level is extrapolated. `points` are (level, error, bytes); the
/// logarithm of the error is linear in the level between neighbours and beyond both ends.
fn crossing(points: &[(f64, f64, f64)], error: f64) -> Option<(f64, bool)> {
    let target = error.log2();
    let logs: Vec<(f64, f64)> = points.iter().map(|p| (p.0, p.1.log2())).collect();
    let last = logs.len().checked_sub(2)?;
    let inside = logs.windows(2).position(|w| w[0].1 >= target && target >= w[1].1);
    let from = inside.unwrap_or(if target > logs[0].1 { 0 } else { last });
    let ((l0, e0), (l1, e1)) = (logs[from], logs[from + 1]);
    // An error that does not fall with the level cannot be extrapolated.
    (e0 > e1).then(|| (l0 + (e0 - target) / (e0 - e1) * (l1 - l0), inside.is_none()))
}

/// The value at `x` of a line through points with ascending `x`, linear between neighbours and beyond both ends.
fn along(points: &[(f64, f64)], x: f64) -> Option<f64> {
    let last = points.len().checked_sub(2)?;
    let from = points[1..].iter().position(|p| x <= p.0).unwrap_or(last).min(last);
    let ((x0, y0), (x1, y1)) = (points[from], points[from + 1]);
    Some(y0 + (x - x0) / (x1 - x0) * (y1 - y0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build_bench::record::tests::row;
    use crate::error::depth::{DepthError, Summary};

    #[test]
    fn levels_are_saved_by_every_measure_on_its_own() {
        let with = |levels, contours, errors: [f64; 3]| {
            let [median, p90, p99] = errors;
            let scene = Summary { median, p90, p99, ..Summary::default() };
            let error = Some(DepthError { scene, ..DepthError::default() });
            BuildRow { error, ..row(levels, contours, [1.0, 4f64.powi(levels as i32 - 8), 1.0]) }
        };
        let mut rows = vec![with(8, Contours::Off, [1.0, 2.0, 4.0]), with(8, Contours::On, [0.125, 0.5, 4.0])];
        assert_eq!(saved(&rows), [], "one cubical octree is no trend");
        rows.push(with(9, Contours::Off, [0.5, 1.0, 2.0]));
        rows.push(with(10, Contours::Off, [0.25, 0.5, 1.0]));
        let found: Vec<_> = saved(&rows).iter().map(|s| (s.measure, s.cubical_levels, s.extrapolated)).collect();
        assert_eq!(found, [(Measure::Median, 11.0, true), (Measure::P90, 10.0, false), (Measure::P99, 8.0, false)]);
        assert!((saved(&rows)[0].cubical_bytes / 64e9 - 1.0).abs() < 1e-9);
    }

    /// Errors that halve and bytes that quadruple with every level.
    const HALVING: [(f64, f64, f64); 3] = [(8.0, 1.0, 1e6), (9.0, 0.5, 4e6), (10.0, 0.25, 16e6)];

    #[test]
    fn between_levels_and_beyond() {
        assert_eq!(crossing(&HALVING, 0.5), Some((9.0, false)));
        assert_eq!(crossing(&HALVING, 2f64.powf(-1.25)), Some((9.25, false)));
        assert_eq!(crossing(&HALVING, 1.0 / 32.0), Some((13.0, true)));
        assert_eq!(crossing(&HALVING, 4.0), Some((6.0, true)));
        assert_eq!(crossing(&HALVING[..1], 0.5), None);
        assert_eq!(crossing(&[(8.0, 1.0, 1.0), (9.0, 1.0, 1.0)], 0.5), None);
    }

    #[test]
    fn bytes_follow_the_level() {
        let logs = HALVING.map(|p| (p.0, p.2.log2()));
        for (level, bytes) in [(8.0, 1e6), (8.5, 2e6), (10.0, 16e6), (12.0, 256e6), (7.0, 0.25e6)] {
            assert!((along(&logs, level).unwrap().exp2() / bytes - 1.0).abs() < 1e-12, "{level}");
        }
        assert_eq!(along(&logs[..1], 8.0), None);
    }
}
