//! Curves of error and size over the level: between levels and beyond them.

/// The level at which the error is `error`, and whether that level is extrapolated. `points` are (level, error, bytes); the
/// logarithm of the error is linear in the level between neighbours and beyond both ends.
pub(crate) fn crossing(points: &[(f64, f64, f64)], error: f64) -> Option<(f64, bool)> {
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
pub(crate) fn along(points: &[(f64, f64)], x: f64) -> Option<f64> {
    let last = points.len().checked_sub(2)?;
    let from = points[1..].iter().position(|p| x <= p.0).unwrap_or(last).min(last);
    let ((x0, y0), (x1, y1)) = (points[from], points[from + 1]);
    Some(y0 + (x - x0) / (x1 - x0) * (y1 - y0))
}

#[cfg(test)]
mod tests {
    use super::*;

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
