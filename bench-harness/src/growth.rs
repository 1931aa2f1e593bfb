//! What the next level of an octree is expected to take.

use std::ops::RangeInclusive;

/// Growth of time and bytes from one level to the next if only one level is known: surfaces quadruple.
pub(crate) const FIRST_GROWTH: f64 = 4.2;

/// What the next level takes, from what the levels before it took: the last value times its growth over the one before, or
/// times [`FIRST_GROWTH`] if only one level is known. The growth is limited to `range`. `None` without a level.
pub(crate) fn predict(before: &[f64], range: RangeInclusive<f64>) -> Option<f64> {
    let last = *before.last()?;
    let growth = match before {
        [.., a, b] if *a > 0.0 => (b / a).clamp(*range.start(), *range.end()),
        _ => FIRST_GROWTH,
    };
    Some(last * growth)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_two_levels_say_what_the_next_one_takes() {
        assert_eq!(predict(&[], 1.0..=f64::INFINITY), None);
        assert_eq!(predict(&[2.0], 1.0..=f64::INFINITY), Some(8.4));
        assert_eq!(predict(&[1.0, 2.0, 6.0], 1.0..=f64::INFINITY), Some(18.0));
        assert_eq!(predict(&[3.0, 2.0], 1.0..=f64::INFINITY), Some(2.0));
    }

    #[test]
    fn growth_is_limited() {
        assert_eq!(predict(&[1.0, 2.0, 6.0], 1.5..=5.0), Some(18.0));
        assert_eq!(predict(&[1.0, 100.0], 1.5..=5.0), Some(500.0));
        assert_eq!(predict(&[3.0, 2.0], 1.5..=5.0), Some(3.0));
    }
}
