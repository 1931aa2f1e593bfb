//! Settings for an error of half a pixel.

use super::{Subject, Timed, fastest, most_exact, out_of_levels};
use crate::page::html::{Answered, Mark};
use crate::sweep_bench::errors::ErrorMeasure;

/// The error that is asked for, in pixels.
const HALF: f64 = 0.5;
/// Ties that are listed; the others are counted.
const LISTED: usize = 6;
const MEASURE: ErrorMeasure = ErrorMeasure::P90;

fn error(timed: Timed) -> f64 {
    MEASURE.of(&timed.cell.error)
}

pub(super) fn answer(subject: &Subject) -> Answered {
    let mut answered = match fastest(subject.timed(), MEASURE, HALF) {
        Some(best) => reached(subject, best),
        None => not_reached(subject),
    };
    if let Some(triangles) = subject.triangles() {
        answered.details.push(format!("The triangles themselves: {}, no error.", triangles.cost()));
    }
    answered
}

fn reached(subject: &Subject, best: Timed) -> Answered {
    let within = subject.timed().filter(|t| error(*t) <= HALF);
    let (mut ties, mut others): (Vec<Timed>, Vec<Timed>) = within.partition(|t| t.span.ties(best.span));
    ties.sort_by(|a, b| a.span.least.total_cmp(&b.span.least));
    others.sort_by(|a, b| a.span.least.total_cmp(&b.span.least));
    let shown = |t: &Timed| {
        let flip = ErrorMeasure::Flip.show(t.cell.error.flip);
        format!("{}, error {}, FLIP {flip}, {}", t.span.words(), MEASURE.show(error(*t)), t.megabytes())
    };
    let setting = subject.setting(best);
    let (answer, mut details, mut choices) = match ties.len() {
        0 | 1 => (setting, vec![format!("{}.", shown(&best))], Vec::new()),
        n => (
            format!(
                "Any of {n} settings, a tie: these {n} are within the spread of their rounds. Least time: {setting}"
            ),
            Vec::new(),
            ties.iter().take(LISTED).map(|t| format!("{}: {}", subject.setting(*t), shown(t))).collect(),
        ),
    };
    if ties.len() > LISTED {
        choices.push(format!("and {} more, in the table of all settings", ties.len() - LISTED));
    }
    if let Some(next) = others.first() {
        details.push(format!("The next, outside of the spread: {}: {}.", subject.setting(*next), shown(next)));
    }
    if !subject.timed().any(|t| !t.cell.contours && error(t) <= HALF) {
        details.extend(subject.deepest(false).map(|levels| format!("{}.", out_of_levels("Cubes", levels))));
    }
    Answered { of: subject.name.clone(), mark: Mark::Good, answer, details, choices, ..Answered::default() }
}

fn not_reached(subject: &Subject) -> Answered {
    let mut details = Vec::new();
    if let Some(exact) = most_exact(subject.timed(), MEASURE) {
        let words = subject.setting(exact);
        details.push(format!("The least error is {}: {words}, {}.", MEASURE.show(error(exact)), exact.cost()));
    }
    let levels = subject.deepest(true).max(subject.deepest(false)).unwrap_or_default();
    let answer = format!("None of the sweep's octrees, of at most {levels} levels.");
    Answered { of: subject.name.clone(), mark: Mark::Bad, answer, details, ..Answered::default() }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{answer, ms};
    use super::*;
    use crate::sweep_bench::sample::{cell, triangles};

    #[test]
    fn half_a_pixel_is_reached_by_the_fastest() {
        let mut cells = vec![
            cell(1, false, 1.0, [2.0, 0.1], ms(1.0)),
            cell(3, true, 1.0, [0.5, 0.1], ms(3.0)),
            cell(5, false, 1.0, [0.2, 0.1], ms(4.0)),
            cell(4, false, 1.0, [0.4, 0.1], ms(5.0)),
            triangles(2.0),
        ];
        let found = answer(cells.clone(), "half-pixel");
        assert_eq!(found.answer, "6 levels, contours, beam on, rays end at voxels of 1 pixel");
        assert_eq!(found.details[0], "3.00 ms, error 0.50 px, FLIP 0.100, 4.00 MB.");
        assert!(
            found.details[1].starts_with("The next, outside of the spread: 7 levels, contours"),
            "{:?}",
            found.details
        );
        assert!(found.details[2].starts_with("The triangles themselves: 2.00 ms"), "{:?}", found.details);
        assert_eq!(found.choices, [""; 0]);
        cells.retain(|cell| cell.error.pixels.p90 > 0.5 || cell.octree.is_none());
        let found = answer(cells, "half-pixel");
        assert!(found.mark == Mark::Bad && found.answer.starts_with("None of the sweep's"), "{}", found.answer);
        assert!(
            found.details[0].starts_with("The least error is 2.00 px: 5 levels, contours, beam off"),
            "{:?}",
            found.details
        );
    }

    #[test]
    fn ties_are_said_and_listed() {
        let rounds = |least: f64| [0.0, 1.0, 2.0, 3.0, 9.0].map(|more| vec![(least + more) / 1e3]).to_vec();
        let at = |levels: usize, least: f64| cell(levels, false, 1.0, [0.4, 0.1], rounds(least));
        // Lower quartiles are 1 ms above: 3.0 and 3.9 tie, 4.1 does not.
        let found = answer(vec![at(1, 3.0), at(3, 3.9), at(5, 4.1)], "half-pixel");
        assert!(
            found.answer.starts_with("Any of 2 settings, a tie: these 2 are within the spread"),
            "{}",
            found.answer
        );
        assert_eq!(found.choices.len(), 2);
        assert!(
            found.choices[1].starts_with("6 levels, contours") && found.choices[1].contains(": 3.90 to 4.90 ms, error")
        );
        assert!(found.details[0].contains("7 levels"), "{:?}", found.details);
        let many = (0..9).map(|_| at(1, 3.0)).collect();
        assert_eq!(answer(many, "half-pixel").choices.last().unwrap(), "and 3 more, in the table of all settings");
    }
}
