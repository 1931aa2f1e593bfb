//! What ending rays at larger voxels costs or saves, at every error, with the spread of the rounds.

use super::{Subject, fastest};
use crate::page::html::{PageCell, PageTable};
use crate::sweep_bench::errors::ErrorMeasure;
use crate::text::short;

/// A row for each scene, measure and error that settings of both kinds reach.
pub(super) fn table(subjects: &[Subject]) -> PageTable {
    let mut rows = Vec::new();
    for (subject, measure) in subjects.iter().flat_map(|s| ErrorMeasure::SHOWN.map(|measure| (s, measure))) {
        for &target in measure.targets() {
            let of = |coarse: bool| {
                fastest(subject.timed().filter(|t| (t.cell.max_voxel_pixels > 1.0) == coarse), measure, target)
            };
            let (Some(coarse), Some(fine)) = (of(true), of(false)) else { continue };
            let outcome = if coarse.span.ties(fine.span) {
                "a tie".to_string()
            } else if coarse.span.least < fine.span.least {
                format!("finer takes {} times the time", short(fine.span.least / coarse.span.least))
            } else {
                format!("coarser takes {} times the time", short(coarse.span.least / fine.span.least))
            };
            rows.push(vec![
                PageCell::new(subject.name.clone()),
                PageCell::new(measure.title()),
                PageCell::number(format!("within {}", measure.show(target)), target, Vec::new()),
                PageCell::number(coarse.span.figures(), coarse.span.least, vec![subject.setting(coarse)]),
                PageCell::number(fine.span.figures(), fine.span.least, vec![subject.setting(fine)]),
                PageCell::new(outcome),
            ]);
        }
    }
    PageTable {
        caption: "What does a coarser termination cost or save at equal error?".into(),
        notes: vec![
            "For each error, the fastest setting whose rays end at voxels of more than one pixel, and the fastest of the others, with at most \
             this error. Milliseconds per frame, from the least of the rounds to their lower quartile; ranges that overlap are ties."
                .into(),
        ],
        head: ["scene", "error", "at most", "above 1 px, ms", "at most 1 px, ms", "which is faster"].map(Into::into).into(),
        left: 3,
        cards: false,
        rows,
    }
}
