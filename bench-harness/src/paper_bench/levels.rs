//! Deciding which octrees of the next level are built.

use std::ops::RangeInclusive;

use crate::growth::predict;
use crate::paper_bench::report::Table1Row;
use crate::system::clock::Clock;
use crate::units::GB;

/// Peak memory of a build divided by the size of its octree. Measured: 4.7 for SIBENIK without contours at 12 levels.
pub(crate) const PEAK: f64 = 5.0;
/// Growth of time and bytes from one level to the next that is believed.
pub(crate) const GROWTH: RangeInclusive<f64> = 1.5..=5.0;
/// Part of a scene's time that building may take.
const BUILD_SHARE: f64 = 0.6;

/// The cubical octree and the one with contours, in this order.
pub(crate) type Both<T> = [T; 2];

/// The limits of a build.
pub(crate) struct Limits<'a> {
    /// The scene's clock.
    pub(crate) clock: &'a Clock,
    /// Bytes that the process may hold.
    pub(crate) memory: f64,
    /// Bytes that it holds at present.
    pub(crate) held: f64,
    /// The part of `held` in bytes that is freed before building if both kinds are built again.
    pub(crate) given_back: f64,
}

/// Why the next level of each kind in `wanted` is not built; `None` if it is built. Expected time and memory follow from the
/// rows so far; a kind without rows is always built.
pub(crate) fn refusals(builds: &[Table1Row], wanted: Both<bool>, limits: &Limits) -> Both<Option<String>> {
    let expected = |contours: bool, of: fn(&Table1Row) -> f64| {
        let before: Vec<f64> = builds.iter().filter(|b| b.contours == contours).map(of).collect();
        predict(&before, GROWTH).unwrap_or(0.0)
    };
    let kinds = |wanted: Both<bool>| [false, true].into_iter().filter(move |&c| wanted[usize::from(c)]);
    let seconds: f64 = kinds(wanted).map(|c| expected(c, |b| b.seconds)).sum();
    let budget = (limits.clock.left() * BUILD_SHARE).max(0.0);
    if seconds > 0.0 && seconds > budget {
        let why = format!("building would take about {seconds:.0} s, and the time limit leaves {budget:.0} s");
        return wanted.map(|w| w.then(|| why.clone()));
    }
    let too_large = |wanted: Both<bool>, mut held: f64| {
        let mut refused = [None, None];
        for contours in kinds(wanted) {
            let bytes = expected(contours, |b| b.bytes as f64);
            let peak = held + bytes * PEAK;
            if bytes > 0.0 && peak > limits.memory {
                refused[usize::from(contours)] = Some(format!(
                    "would take about {:.1} GB of memory, and the limit is {:.1}; see --memory",
                    peak / GB,
                    limits.memory / GB
                ));
            } else {
                held += bytes;
            }
        }
        refused
    };
    let mut refused = too_large(wanted, (limits.held - limits.given_back).max(0.0));
    let rest = [0, 1].map(|k| wanted[k] && refused[k].is_none());
    if rest != wanted && rest != [false, false] {
        // Only one kind is built: the octrees of the previous level are kept for casting, so that `given_back` is not freed.
        let again = too_large(rest, limits.held);
        refused = [0, 1].map(|k| refused[k].clone().or_else(|| again[k].clone()));
    }
    refused
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(levels: u32, contours: bool, seconds: f64, megabytes: u64) -> Table1Row {
        Table1Row {
            levels,
            contours,
            contour_error: 15.0,
            color_error: 16.0,
            normal_error: 0.01,
            seconds,
            image_sha256: String::new(),
            bytes: megabytes << 20,
            voxels: 1,
            leaves: 1,
            contour_count: 0,
            far_pointers: 0,
            blocks: 1,
            kinds: Vec::new(),
            displaced_triangles: None,
        }
    }

    fn refused(builds: &[Table1Row], wanted: Both<bool>, seconds: Option<f64>, megabytes: f64) -> Both<bool> {
        let clock = Clock::start(seconds);
        let mb = f64::from(1 << 20);
        let limits = Limits { clock: &clock, memory: megabytes * mb, held: 300.0 * mb, given_back: 200.0 * mb };
        refusals(builds, wanted, &limits).map(|r| r.is_some())
    }

    #[test]
    fn the_first_level_is_always_built() {
        assert_eq!(refused(&[], [true, true], Some(0.0), 1.0), [false, false]);
    }

    #[test]
    fn memory_is_looked_at_kind_by_kind() {
        // Growth 4 and 2: 400 and 200 MB are expected.
        let builds = [row(9, false, 1.0, 25), row(9, true, 1.0, 50), row(10, false, 1.0, 100), row(10, true, 1.0, 100)];
        assert_eq!(refused(&builds, [true, true], None, 2101.0), [false, false]);
        // 100 held + 5 * 400 is too much; 300 held + 5 * 200 is not.
        assert_eq!(refused(&builds, [true, true], None, 2000.0), [true, false]);
        assert_eq!(refused(&builds, [true, true], None, 1200.0), [true, true]);
        assert_eq!(refused(&builds, [false, true], None, 1200.0), [false, false]);
    }

    #[test]
    fn time_is_looked_at_together() {
        let builds = [row(9, false, 10.0, 1), row(9, true, 10.0, 1)];
        // 84 s are expected; building may take 60 % of what is left.
        assert_eq!(refused(&builds, [true, true], Some(150.0), 1e6), [false, false]);
        assert_eq!(refused(&builds, [true, true], Some(130.0), 1e6), [true, true]);
        assert_eq!(refused(&builds, [true, false], Some(130.0), 1e6), [false, false]);
        assert_eq!(refused(&builds, [true, true], None, 1e6), [false, false]);
    }
}
