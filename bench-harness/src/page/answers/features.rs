//! Where triangles win, and what the beam saves.

use super::{Subject, Timed, most_exact};
use crate::page::html::Answered;
use crate::page::span::Span;
use crate::sweep_bench::errors::ErrorMeasure;
use crate::timing::Spread;

const MEASURE: ErrorMeasure = ErrorMeasure::P90;

fn plain(subject: &Subject, answer: impl Into<String>, details: Vec<String>) -> Answered {
    Answered { of: subject.name.clone(), answer: answer.into(), details, ..Answered::default() }
}

pub(super) fn triangles_win(subject: &Subject) -> Answered {
    let Some(own) = subject.triangles() else {
        return plain(subject, "Not measured on this engine.", Vec::new());
    };
    let error = |t: Timed| MEASURE.show(MEASURE.of(&t.cell.error));
    let within = |ms: f64| most_exact(subject.timed().filter(|t| t.span.least <= ms), MEASURE);
    let mut details = vec![format!("Triangles: {}.", own.cost())];
    let octree = |t: Timed| format!("{}: {}, error {}.", subject.setting(t), t.cost(), error(t));
    let strict = within(own.span.least);
    let answer = match strict {
        Some(exact) => {
            details.push(format!("The most exact octree that is as fast: {}", octree(exact)));
            format!("Where the depth error must be below {}.", error(exact))
        }
        None => "Everywhere: no octree is as fast.".into(),
    };
    let loose = within(own.span.quarter).filter(|t| strict.is_none_or(|s| error(s) != error(*t)));
    details.extend(loose.map(|t| format!("Within the spread of the triangles' rounds: {}", octree(t))));
    plain(subject, answer, details)
}

/// Times with the beam over those without: the median of the pairs.
pub(super) fn beam_ratio(subject: &Subject) -> Option<f64> {
    let ratios: Vec<f64> = beam_pairs(subject).iter().map(|[with, without]| with.least / without.least).collect();
    Some(Spread::of(&ratios)?.median)
}

/// Settings that differ in the beam alone.
fn beam_pairs(subject: &Subject) -> Vec<[Span; 2]> {
    let mut pairs: Vec<[Span; 2]> = Vec::new();
    for with in subject.timed().filter(|t| t.cell.beam) {
        let twin = |t: &Timed| {
            !t.cell.beam
                && t.cell.octree == with.cell.octree
                && t.cell.contours == with.cell.contours
                && t.cell.max_voxel_pixels == with.cell.max_voxel_pixels
        };
        pairs.extend(subject.timed().find(twin).map(|without| [with.span, without.span]));
    }
    pairs
}

pub(super) fn beam(subject: &Subject) -> Answered {
    let pairs = beam_pairs(subject);
    let mut ratios: Vec<f64> = pairs.iter().map(|[with, without]| with.least / without.least).collect();
    ratios.sort_by(f64::total_cmp);
    let (Some(spread), Some(least), Some(most)) = (Spread::of(&ratios), ratios.first(), ratios.last()) else {
        return plain(subject, "Not measured.", Vec::new());
    };
    let ties = pairs.iter().filter(|[a, b]| a.ties(*b)).count();
    let faster = pairs.iter().filter(|[a, b]| !a.ties(*b) && a.least < b.least).count();
    let slower = pairs.len() - ties - faster;
    // A sign test of the pairs that are no ties, by the normal approximation of the binomial.
    let one_sided = faster.abs_diff(slower) as f64 > 1.96 * ((faster + slower) as f64).sqrt();
    let [low, high] = interval(&ratios);
    let answer = match spread.median {
        _ if low <= 1.0 && high >= 1.0 && !one_sided => "Nothing that can be told from noise.".into(),
        _ if low <= 1.0 && high >= 1.0 => {
            let [first, second] = if slower > faster { ["costs", "saves"] } else { ["saves", "costs"] };
            let [many, few] = [slower.max(faster), slower.min(faster)];
            format!("It {first} time in {many} of {} pairs and {second} it in {few}; the others are ties.", pairs.len())
        }
        ratio if (0.97..=1.03).contains(&ratio) => "Nothing.".into(),
        ratio if ratio < 1.0 => format!("{:.0} % of the time.", 100.0 * (1.0 - ratio)),
        ratio => format!("It costs {:.0} % more time.", 100.0 * (ratio - 1.0)),
    };
    let details = vec![format!(
        "{} pairs: {:.2} times the time in the middle (95 %: {low:.2} to {high:.2}; all pairs: {least:.2} to {most:.2}). Within the \
         spread of their rounds: {ties}; faster with the beam: {faster}, slower: {slower}.",
        ratios.len(),
        spread.median,
    )];
    plain(subject, answer, details)
}

/// The interval that holds the median with 95 %, by the ranks of ascending values: the number of values below the median is binomial, here
/// by its normal approximation. Of few values, all of them.
fn interval(sorted: &[f64]) -> [f64; 2] {
    let n = sorted.len() as f64;
    let low = ((n - 1.96 * n.sqrt()) / 2.0).floor().max(0.0) as usize;
    [sorted[low], sorted[sorted.len() - 1 - low]]
}

#[cfg(test)]
mod tests {
    use super::super::tests::{answer, ms};
    use super::*;
    use crate::sweep_bench::sample::{cell, triangles};

    #[test]
    fn triangles_and_the_beam() {
        let cells =
            vec![cell(3, false, 1.0, [1.0, 0.1], ms(2.0)), cell(3, true, 1.0, [1.0, 0.1], ms(1.5)), triangles(1.0)];
        assert_eq!(answer(cells.clone(), "triangles").answer, "Everywhere: no octree is as fast.");
        assert_eq!(answer(cells.clone(), "beam").answer, "25 % of the time.");
        let slow = [cells[..2].to_vec(), vec![triangles(3.0)]].concat();
        assert_eq!(answer(slow, "triangles").answer, "Where the depth error must be below 1.00 px.");
        assert_eq!(answer(cells[..1].to_vec(), "beam").answer, "Not measured.");
        // Rounds of the triangles that take longer than the octree.
        let rounds = Vec::from([1.0, 1.8, 1.8].map(|ms| vec![ms / 1e3]));
        let near = [cells[..2].to_vec(), vec![crate::sweep_bench::record::Cell { seconds: rounds, ..triangles(1.0) }]];
        let near = answer(near.concat(), "triangles");
        assert_eq!(near.answer, "Everywhere: no octree is as fast.");
        assert_eq!(near.details.len(), 1, "the quartile is 1.4 ms: {:?}", near.details);
    }

    #[test]
    fn a_beam_that_helps_here_and_hurts_there_saves_nothing() {
        let mut cells = Vec::new();
        for (octree, ratio) in [0.5, 0.9, 1.1, 2.0].into_iter().enumerate() {
            cells.push(cell(octree, false, 1.0, [1.0, 0.1], ms(1.0)));
            cells.push(cell(octree, true, 1.0, [1.0, 0.1], ms(ratio)));
        }
        let found = answer(cells, "beam");
        assert_eq!(found.answer, "Nothing that can be told from noise.");
        assert!(found.details[0].ends_with("faster with the beam: 2, slower: 2."), "{:?}", found.details);
    }

    #[test]
    fn pairs_that_are_no_ties_count_if_they_go_one_way() {
        let rounds = |least: f64| [0.0, 1.0, 2.0].map(|more| vec![(least + more) / 1e3]).to_vec();
        let pairs = |times: [f64; 3]| {
            let mut cells = Vec::new();
            for octree in 0..7 {
                for (pixels, with) in [1.0, 2.0, 4.0].into_iter().zip(times) {
                    cells.push(cell(octree, false, pixels, [1.0, 0.1], rounds(10.0)));
                    cells.push(cell(octree, true, pixels, [1.0, 0.1], rounds(with)));
                }
            }
            answer(cells, "beam").answer
        };
        // Ties a little below 1, and a third of the pairs on one side.
        assert_eq!(pairs([9.9, 9.9, 20.0]), "It costs time in 7 of 21 pairs and saves it in 0; the others are ties.");
        assert_eq!(pairs([10.1, 10.1, 5.0]), "It saves time in 7 of 21 pairs and costs it in 0; the others are ties.");
        // On both sides.
        assert_eq!(pairs([9.9, 5.0, 20.0]), "Nothing that can be told from noise.");
    }

    #[test]
    fn the_interval_of_a_median() {
        let values: Vec<f64> = (0..40).map(f64::from).collect();
        assert_eq!(interval(&values), [13.0, 26.0]);
        assert_eq!(interval(&[1.0]), [1.0, 1.0]);
        assert_eq!(interval(&[1.0, 2.0]), [1.0, 2.0]);
    }
}
