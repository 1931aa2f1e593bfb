//! Pareto fronts.

/// For each point, of which both coordinates should be small: whether it is on the Pareto front, that is, whether no other point is
/// at most as large in both and smaller in one. Equal points are on the front together. Points with a coordinate that is NaN are not
/// on it.
pub fn front(points: &[[f64; 2]]) -> Vec<bool> {
    let beats = |a: &[f64; 2], b: &[f64; 2]| a[0] <= b[0] && a[1] <= b[1] && a != b;
    let known = |point: &[f64; 2]| !point.iter().any(|x| x.is_nan());
    points.iter().map(|point| known(point) && !points.iter().any(|other| beats(other, point))).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_known_front() {
        let points = [[1.0, 9.0], [2.0, 9.0], [2.0, 4.0], [3.0, 5.0], [5.0, 1.0], [5.0, 1.0], [0.5, f64::NAN]];
        assert_eq!(front(&points), [true, false, true, false, true, true, false]);
        assert_eq!(front(&[]), [false; 0]);
    }

    proptest! {
        /// Of the points in order of the first coordinate, those of the front have an ever smaller second one; every other point is
        /// beaten by one of the front.
        #[test]
        fn fronts_fall_and_beat_the_rest(points in prop::collection::vec([0..9u8, 0..9u8], 0..40)) {
            let points: Vec<_> = points.iter().map(|p| p.map(f64::from)).collect();
            let on = front(&points);
            let mut chosen: Vec<_> = points.iter().zip(&on).filter(|(_, on)| **on).map(|(p, _)| *p).collect();
            chosen.sort_by(|a, b| a.partial_cmp(b).unwrap());
            chosen.dedup();
            prop_assert!(chosen.windows(2).all(|w| w[0][0] < w[1][0] && w[0][1] > w[1][1]));
            prop_assert_eq!(chosen.is_empty(), points.is_empty());
            for (point, _) in points.iter().zip(&on).filter(|(_, on)| !**on) {
                prop_assert!(chosen.iter().any(|c| c[0] <= point[0] && c[1] <= point[1] && c != point));
            }
        }
    }
}
