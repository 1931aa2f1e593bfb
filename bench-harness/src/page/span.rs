//! The time of a setting as a range, and which times are ties. Answers, tables and plots of the page show no other statistic without its name.

use crate::sweep_bench::record::Cell;
use crate::text::short;

/// What a range of time is, for the rules below answers and tables.
pub(super) const RULE: &str = "Each time is a range: from the least time of all rounds, by which settings are ranked since other programs \
                               can only add to it, to the lower quartile of the rounds. Where ranges overlap, settings are ties: they \
                               are within the spread of their rounds.";

/// Milliseconds per frame of a setting.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Span {
    /// The mean over the views of the least time of each.
    pub(super) least: f64,
    /// A quarter of the rounds take at most this.
    pub(super) quarter: f64,
}

impl Span {
    /// `None`: it was not timed.
    pub(super) fn of(cell: &Cell) -> Option<Self> {
        let ms = cell.frame_ms()?;
        Some(Self { least: ms.least, quarter: ms.rounds.lower_quartile.max(ms.least) })
    }

    /// Whether this and another cannot be told apart.
    pub(super) fn ties(self, other: Self) -> bool {
        self.least <= other.quarter && other.least <= self.quarter
    }

    /// The ends, or the one number that both are.
    fn ends(self) -> (String, Option<String>) {
        let [least, quarter] = [self.least, self.quarter].map(short);
        let upper = (least != quarter).then_some(quarter);
        (least, upper)
    }

    /// `32.6 to 40.2 ms`.
    pub(super) fn words(self) -> String {
        match self.ends() {
            (least, Some(quarter)) => format!("{least} to {quarter} ms"),
            (least, None) => format!("{least} ms"),
        }
    }

    /// `32.6–40.2`, for a column.
    pub(super) fn figures(self) -> String {
        match self.ends() {
            (least, Some(quarter)) => format!("{least}–{quarter}"),
            (least, None) => least,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sweep_bench::sample::cell;

    #[test]
    fn ranges_that_overlap_are_ties() {
        let span = |seconds: &[f64]| {
            Span::of(&cell(0, false, 1.0, [1.0, 0.1], seconds.iter().map(|s| vec![s / 1e3]).collect())).unwrap()
        };
        let (a, b, c) = (span(&[10.0, 14.0, 18.0]), span(&[12.0, 13.0, 30.0]), span(&[12.01, 13.0, 30.0]));
        assert_eq!((a.words().as_str(), a.figures().as_str()), ("10.0 to 12.0 ms", "10.0–12.0"));
        assert!(a.ties(b) && b.ties(a) && a.ties(a));
        assert!(!a.ties(c) && !c.ties(a));
        assert_eq!(span(&[3.0]).words(), "3.00 ms");
    }
}
