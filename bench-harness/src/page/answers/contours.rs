//! Whether contours pay.

use super::{Subject, Timed, by, fastest, most_exact, out_of_levels};
use crate::page::html::{Answered, Mark};
use crate::sweep_bench::errors::ErrorMeasure;
use crate::text::short;
use crate::timing::Spread;

/// The fastest setting with contours and the fastest with cubes at a target of a measure that one of them reaches.
struct AtTarget<'a> {
    target: f64,
    contours: Option<Timed<'a>>,
    cubes: Option<Timed<'a>>,
}

/// Which is faster.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Outcome {
    Contours,
    Cubes,
    /// Their times are within the spread of their rounds.
    Tie,
    /// The other does not get there.
    OnlyContours,
    OnlyCubes,
}

impl AtTarget<'_> {
    fn outcome(&self) -> Outcome {
        match (self.contours, self.cubes) {
            (Some(a), Some(b)) if a.span.ties(b.span) => Outcome::Tie,
            (Some(a), Some(b)) if a.span.least < b.span.least => Outcome::Contours,
            (Some(_), Some(_)) => Outcome::Cubes,
            (Some(_), None) => Outcome::OnlyContours,
            (None, _) => Outcome::OnlyCubes,
        }
    }
}

fn at_targets<'a>(subject: &Subject<'a>, measure: ErrorMeasure) -> Vec<AtTarget<'a>> {
    let errors = || subject.timed().map(|t| measure.of(&t.cell.error));
    let (least, most) = (errors().fold(f64::INFINITY, f64::min), errors().fold(0.0, f64::max));
    let mut rows = Vec::new();
    for &target in measure.targets().iter().filter(|target| **target >= least) {
        let of = |contours: bool| fastest(subject.timed().filter(|t| t.cell.contours == contours), measure, target);
        rows.push(AtTarget { target, contours: of(true), cubes: of(false) });
        // Above the largest error, all targets have the same answer.
        if target >= most {
            break;
        }
    }
    rows
}

/// What a series of targets says.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Verdict {
    NotMeasured,
    /// No error was reached by both.
    Open,
    Yes,
    No,
    /// As fast wherever both get.
    Tie,
    /// Faster at the least error that both reach, slower or as fast at larger ones.
    Small,
    /// Slower or as fast wherever both get; only contours get to smaller errors.
    OnlySmall,
    Mixed,
}

impl Verdict {
    fn of(outcomes: &[Outcome]) -> Self {
        let is = |outcome| outcomes.contains(&outcome);
        let (wins, loses, ties) = (is(Outcome::Contours), is(Outcome::Cubes), is(Outcome::Tie));
        let only = is(Outcome::OnlyContours);
        let mut compared = outcomes.iter().filter(|o| !matches!(o, Outcome::OnlyContours | Outcome::OnlyCubes));
        let beyond = is(Outcome::OnlyCubes);
        match (wins, loses, ties) {
            (false, false, false) if outcomes.is_empty() => Self::NotMeasured,
            (false, false, false) => Self::Open,
            (true, false, _) if !beyond => Self::Yes,
            (false, false, true) if !only && !beyond => Self::Tie,
            (false, _, _) if only => Self::OnlySmall,
            (false, true, _) => Self::No,
            _ if !beyond && compared.next() == Some(&Outcome::Contours) => Self::Small,
            _ => Self::Mixed,
        }
    }

    fn mark(self) -> Mark {
        match self {
            Self::NotMeasured | Self::Open | Self::Tie => Mark::Plain,
            Self::Yes => Mark::Good,
            Self::No => Mark::Bad,
            Self::Small | Self::OnlySmall | Self::Mixed => Mark::Mixed,
        }
    }

    fn words(self) -> &'static str {
        match self {
            Self::NotMeasured => "not measured",
            Self::Open => "open, as no error was reached by both",
            Self::Yes => "yes, wherever both get",
            Self::No => "not faster, wherever both get",
            Self::Tie => "no difference beyond the spread of the rounds",
            Self::Small => "yes where it is small, no where it is large",
            Self::OnlySmall => "not faster where both get; only contours get to small ones",
            Self::Mixed => "at some errors and not at others",
        }
    }
}

/// Runs of targets with the same outcome: `up to 4.00 px, only contours get there; at 8.00 px, contours are faster`.
fn runs(measure: ErrorMeasure, rows: &[AtTarget]) -> String {
    let mut parts: Vec<String> = Vec::new();
    let mut start = 0;
    while start < rows.len() {
        let outcome = rows[start].outcome();
        let end = start + rows[start..].iter().take_while(|row| row.outcome() == outcome).count() - 1;
        let (first, last) = (measure.show(rows[start].target), measure.show(rows[end].target));
        let at = match (start == 0, end + 1 == rows.len()) {
            (true, true) => "everywhere".to_string(),
            (true, false) => format!("up to {last}"),
            (false, true) => format!("from {first} on"),
            (false, false) if start == end => format!("at {first}"),
            (false, false) => format!("from {first} to {last}"),
        };
        let what = match outcome {
            Outcome::Contours => "contours are faster",
            Outcome::Cubes => "cubes are faster",
            Outcome::Tie => "as fast within the spread",
            Outcome::OnlyContours => "only contours get there",
            Outcome::OnlyCubes => "only cubes get there",
        };
        parts.push(format!("{at}, {what}"));
        start = end + 1;
    }
    parts.join("; ")
}

pub(super) fn answer(subject: &Subject) -> Answered {
    let mut details = Vec::new();
    let mut verdicts = Vec::new();
    for measure in ErrorMeasure::SHOWN {
        let rows = at_targets(subject, measure);
        let outcomes: Vec<Outcome> = rows.iter().map(AtTarget::outcome).collect();
        verdicts.push(Verdict::of(&outcomes));
        if !rows.is_empty() {
            details.push(format!("By {}: {}.", by(measure), runs(measure, &rows)));
        }
        // The most exact target that either reaches, and the one at which both first get there.
        let both = rows.iter().find(|row| row.contours.is_some() && row.cubes.is_some());
        let first = rows.first().filter(|row| both.is_none_or(|other| other.target > row.target));
        for row in [first, both].into_iter().flatten() {
            details.push(at_one(subject, measure, row));
        }
    }
    details.extend(equal_levels(subject));
    let answer = match verdicts[..] {
        [a, b] if a == b => match a {
            Verdict::NotMeasured => "Not measured.".into(),
            Verdict::Open => "Open: no error was reached by both.".into(),
            Verdict::Yes => "Yes, at every error that both reach.".into(),
            Verdict::No => "No, at no error that both reach.".into(),
            Verdict::Tie => "No difference beyond the spread of the rounds.".into(),
            Verdict::Small => "Yes where the error is small; no for coarse pictures.".into(),
            Verdict::OnlySmall => {
                "Open where the error is small, as only contours get there; no for coarse pictures.".into()
            }
            Verdict::Mixed => "At some errors and not at others.".to_string(),
        },
        _ => {
            let each = ErrorMeasure::SHOWN.iter().zip(&verdicts);
            each.map(|(measure, verdict)| format!("By {}: {}.", by(*measure), verdict.words()))
                .collect::<Vec<_>>()
                .join(" ")
        }
    };
    let mark = match verdicts[..] {
        [a, b] if a.mark() == b.mark() => a.mark(),
        _ => Mark::Mixed,
    };
    Answered { of: subject.name.clone(), mark, answer, details, ..Answered::default() }
}

fn at_one(subject: &Subject, measure: ErrorMeasure, row: &AtTarget) -> String {
    let at = format!("Within {}", measure.show(row.target));
    // What the other kind reaches in no more time.
    let best = |own: Timed, contours: bool| {
        let others = subject.timed().filter(|t| t.cell.contours == contours && t.span.least <= own.span.quarter);
        most_exact(others, measure).map_or_else(String::new, |t| {
            let kind = if contours { "contours" } else { "cubes" };
            format!("; in the same time {kind} get to {} at best", measure.show(measure.of(&t.cell.error)))
        })
    };
    let alone = |own: Timed, kind: &str, other: &str, contours: bool| {
        let levels = subject.deepest(contours).unwrap_or_default();
        format!("{at}: {kind} {}; {}{}.", own.cost(), out_of_levels(other, levels), best(own, contours))
    };
    match (row.contours, row.cubes) {
        (Some(a), Some(b)) => {
            let end = if a.span.ties(b.span) {
                "as fast within the spread of their rounds".to_string()
            } else if a.span.least < b.span.least {
                format!("cubes take {} times the time", short(b.span.least / a.span.least))
            } else {
                format!("contours take {} times the time", short(a.span.least / b.span.least))
            };
            format!("{at}: contours {}; cubes {}: {end}.", a.cost(), b.cost())
        }
        (Some(a), None) => alone(a, "contours", "cubes", false),
        (None, Some(b)) => alone(b, "cubes", "contours", true),
        (None, None) => at,
    }
}

/// Time of contours over that of cubes at equal levels: the median of the pairs.
pub(super) fn time_at_equal_levels(subject: &Subject) -> Option<f64> {
    Some(Spread::of(&pairs(subject).0)?.median)
}

/// Times and errors of contours over those of cubes with as many levels, the same beam and the same end of rays.
fn pairs(subject: &Subject) -> (Vec<f64>, Vec<f64>) {
    let (mut times, mut errors) = (Vec::new(), Vec::new());
    let levels = |t: &Timed| subject.scene.levels(t.cell);
    for with in subject.timed().filter(|t| t.cell.contours) {
        let twin = |t: &Timed| {
            !t.cell.contours
                && t.cell.beam == with.cell.beam
                && t.cell.max_voxel_pixels == with.cell.max_voxel_pixels
                && levels(t) == levels(&with)
        };
        let Some(without) = subject.timed().find(twin) else { continue };
        times.push(with.span.least / without.span.least);
        errors.push(with.cell.error.pixels.p90 / without.cell.error.pixels.p90);
    }
    (times, errors)
}

fn equal_levels(subject: &Subject) -> Option<String> {
    let (times, errors) = pairs(subject);
    let (time, error) = (Spread::of(&times)?.median, Spread::of(&errors)?.median);
    Some(format!(
        "At equal levels: {} times the least time and {} times the depth error of cubes (median of {} pairs).",
        short(time),
        short(error),
        times.len()
    ))
}

#[cfg(test)]
mod tests {
    use super::super::tests::{answer, ms};
    use super::*;
    use crate::sweep_bench::sample::cell;

    #[test]
    fn contours_pay_where_they_are_faster_or_alone() {
        let small = cell(3, false, 1.0, [0.2, 0.02], ms(2.0));
        let cubes = cell(4, false, 1.0, [0.9, 0.09], ms(1.0));
        let found = answer(vec![small.clone(), cubes.clone()], "contours");
        assert!(
            found.mark == Mark::Mixed && found.answer.starts_with("Open where the error is small"),
            "{}",
            found.answer
        );
        assert_eq!(
            found.details[0],
            "By depth error: up to 0.50 px, only contours get there; from 1.00 px on, cubes are faster."
        );
        assert!(
            found.details[1].starts_with("Within 0.25 px: contours 2.00 ms, 4.00 MB; cubes of at most "),
            "{:?}",
            found.details
        );
        assert!(found.details[1].ends_with("; in the same time cubes get to 0.90 px at best."), "{:?}", found.details);
        assert!(found.details[2].ends_with("contours take 2.00 times the time."), "{:?}", found.details);
        // Contours win where both get, and lose where pictures are coarse.
        let coarse = cell(0, false, 1.0, [1.9, 0.4], ms(0.2));
        let slower = cell(4, false, 1.0, [0.9, 0.09], ms(3.0));
        let found = answer(vec![small.clone(), slower, coarse], "contours");
        assert_eq!(found.answer, "Yes where the error is small; no for coarse pictures.");
        let alone = answer(vec![small.clone()], "contours");
        assert_eq!((alone.mark, &*alone.answer), (Mark::Plain, "Open: no error was reached by both."));
        let fast = cell(3, false, 1.0, [0.2, 0.02], ms(0.5));
        assert_eq!(answer(vec![fast, cubes.clone()], "contours").mark, Mark::Good);
        let bad = cell(3, false, 1.0, [1.5, 0.2], ms(2.0));
        assert_eq!(answer(vec![bad, cubes.clone()], "contours").mark, Mark::Bad);
        // At equal levels.
        let twin = cell(2, false, 1.0, [0.8, 0.09], ms(1.0));
        let found = answer(vec![small, twin], "contours");
        assert_eq!(
            found.details.last().unwrap(),
            "At equal levels: 2.00 times the least time and 0.25 times the depth error of cubes (median of 1 pairs)."
        );
        assert_eq!(answer(Vec::new(), "contours").answer, "Not measured.");
    }

    #[test]
    fn times_within_the_spread_are_no_victory() {
        let rounds = |least: f64| [0.0, 1.0, 2.0].map(|more| vec![(least + more) / 1e3]).to_vec();
        let with = cell(3, false, 1.0, [0.2, 0.02], rounds(2.0));
        let tie = cell(4, false, 1.0, [0.2, 0.02], rounds(2.4));
        let found = answer(vec![with.clone(), tie], "contours");
        assert_eq!((found.mark, &*found.answer), (Mark::Plain, "No difference beyond the spread of the rounds."));
        assert!(found.details[1].ends_with("as fast within the spread of their rounds."), "{:?}", found.details);
        // Outside of it, they win.
        let slower = cell(4, false, 1.0, [0.2, 0.02], rounds(2.6));
        assert_eq!(answer(vec![with, slower], "contours").mark, Mark::Good);
    }

    #[test]
    fn every_series_has_a_verdict() {
        use Outcome::{Contours, Cubes, OnlyContours, OnlyCubes, Tie};
        for (outcomes, verdict) in [
            (vec![], Verdict::NotMeasured),
            (vec![OnlyContours], Verdict::Open),
            (vec![OnlyContours, Contours, Tie], Verdict::Yes),
            (vec![Contours, Cubes], Verdict::Small),
            (vec![OnlyContours, Cubes], Verdict::OnlySmall),
            (vec![OnlyContours, Tie, Cubes], Verdict::OnlySmall),
            (vec![Tie, Tie], Verdict::Tie),
            (vec![Tie, Cubes], Verdict::No),
            (vec![OnlyCubes, Cubes], Verdict::No),
            (vec![OnlyCubes, Contours], Verdict::Mixed),
            (vec![Tie, Contours, Cubes], Verdict::Mixed),
        ] {
            assert!(Verdict::of(&outcomes) == verdict, "{}", Verdict::of(&outcomes).words());
        }
    }
}
