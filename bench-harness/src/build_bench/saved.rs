//! Levels saved by contours: the cubical error curve over the level is interpolated at the error of the octree with contours.

use super::plan::Contours;
use super::record::{BuildRow, Measure, SavedLevels};
use crate::curve::{along, crossing};

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
}
