//! What a sweep answers, in words for the top of the page. Rules are those of [`crate::sweep_bench::answers`].

use esvo_engines::EngineId;
use esvo_scenes::SceneVariant;

use super::html::{Answered, Mark, Question};
use crate::sweep_bench::SweepReport;
use crate::sweep_bench::answers::{compared_engines, fastest, timed, triangles};
use crate::sweep_bench::errors::ErrorMeasure;
use crate::sweep_bench::record::{Cell, ExactKind, SceneSweep};
use crate::text::short;
use crate::timing::Spread;

/// The error that the first question asks for, in pixels.
const HALF: f64 = 0.5;

/// A scene of a sweep on one engine.
struct Subject<'a> {
    scene: &'a SceneSweep,
    engine: EngineId,
    /// Scene, mesh and engine in words.
    name: String,
}

/// The questions that a sweep answers, about every scene that has triangles to compare with.
pub(super) fn questions(report: &SweepReport) -> Vec<Question> {
    let engines = compared_engines(report);
    let mut subjects = Vec::new();
    for scene in report.scenes.iter().filter(|scene| scene.exact == ExactKind::Triangles) {
        for &engine in &engines {
            let mesh =
                if scene.mesh == SceneVariant::Real { String::new() } else { format!(" ({})", scene.mesh.title()) };
            let on = if engines.len() > 1 { format!(" on {engine}") } else { String::new() };
            subjects.push(Subject { scene, engine, name: format!("{}{mesh}{on}", scene.name) });
        }
    }
    if subjects.is_empty() {
        return Vec::new();
    }
    let [width, height] = report.plan.size;
    let on = if let [one] = engines[..] { format!(" on {one}, {}", report.machine.cpu) } else { String::new() };
    let ask = |id, question: String, rule: String, answer: &dyn Fn(&Subject) -> Answered| Question {
        id,
        question,
        rule,
        answers: subjects.iter().map(answer).collect(),
    };
    vec![
        ask(
            "half-pixel",
            "What settings give an error of half a pixel in the least time?".into(),
            format!(
                "Of the sweep's settings, the fastest whose depth error is at most half a pixel for 90 % of the rays that hit. Times are for \
                 a frame of {width}x{height}{on}. Octrees of more levels than the sweep has may do better: see Table 2 and the error beside it."
            ),
            &half_pixel,
        ),
        ask(
            "contours",
            "Do contours pay?".into(),
            "At equal error: for a series of errors, the fastest setting with contours against the fastest with cubes that is not \
             less exact. Errors are taken in two ways: depth (90th percentile) and FLIP, the visible difference of the pictures. \
             The last line compares octrees of as many levels."
                .into(),
            &contours_pay,
        ),
        ask(
            "triangles",
            "Where do the triangles themselves win?".into(),
            "Triangles have no error. They win below the error of the most exact octree that is at least as fast as they are.".into(),
            &triangles_win,
        ),
        ask(
            "beam",
            "What does the beam optimization save?".into(),
            "Pairs of settings that differ in the beam alone: the median of their times divided. Hits and errors are the same.".into(),
            &beam,
        ),
    ]
}

/// How much the machine was disturbed: the median over all settings of the median time over the least. `None` without times.
pub(super) fn disturbance(report: &SweepReport) -> Option<f64> {
    let cells = report.scenes.iter().flat_map(|scene| &scene.cells);
    let ratios: Vec<f64> = cells.filter_map(|cell| cell.frame_ms()).map(|ms| ms.rounds.median / ms.least).collect();
    Spread::of(&ratios).map(|spread| spread.median)
}

/// A setting in words.
pub(super) fn setting(scene: &SceneSweep, cell: &Cell) -> String {
    let Some(levels) = scene.levels(cell) else { return "the triangles themselves".into() };
    let kind = if cell.contours { "contours" } else { "cubes (no contours)" };
    let beam = if cell.beam { "beam on" } else { "beam off" };
    let end = match cell.max_voxel_pixels {
        0.0 => "rays end at leaves".to_string(),
        1.0 => "rays end at voxels of 1 pixel".into(),
        pixels => format!("rays end at voxels of {pixels} pixels"),
    };
    format!("{levels} levels, {kind}, {beam}, {end}")
}

fn megabytes(cell: &Cell) -> String {
    format!("{} MB", short(cell.memory_bytes as f64 / 1e6))
}

fn half_pixel(subject: &Subject) -> Answered {
    let Subject { scene, engine, name } = subject;
    let measure = ErrorMeasure::P90;
    let error = |cell: &Cell| measure.show(measure.of(&cell.error));
    let mut details = Vec::new();
    let (mark, answer) = match fastest(timed(scene, *engine), measure, HALF) {
        Some((cell, ms)) => {
            details.push(format!("{} ms per frame, error {}, {} of memory.", short(ms), error(cell), megabytes(cell)));
            if !timed(scene, *engine).any(|(cell, _)| !cell.contours && measure.of(&cell.error) <= HALF) {
                details.extend(
                    deepest(scene, *engine, false).map(|levels| format!("{}.", out_of_levels("Cubes", levels))),
                );
            }
            (Mark::Good, setting(scene, cell))
        }
        None => {
            let exact = timed(scene, *engine)
                .min_by(|a, b| measure.of(&a.0.error).total_cmp(&measure.of(&b.0.error)).then(a.1.total_cmp(&b.1)));
            if let Some((cell, ms)) = exact {
                let words = setting(scene, cell);
                details.push(format!(
                    "The least error is {}: {words}, {} ms, {}.",
                    error(cell),
                    short(ms),
                    megabytes(cell)
                ));
            }
            let levels = deepest(scene, *engine, true).max(deepest(scene, *engine, false)).unwrap_or_default();
            (Mark::Bad, format!("None of the sweep's octrees, of at most {levels} levels."))
        }
    };
    if let Some((cell, ms)) = triangles(scene).filter(|(cell, _)| cell.engine == *engine) {
        details.push(format!("The triangles themselves: {} ms, no error, {}.", short(ms), megabytes(cell)));
    }
    Answered { of: name.clone(), mark, answer, details }
}

/// Levels of the deepest octrees of a kind.
fn deepest(scene: &SceneSweep, engine: EngineId, contours: bool) -> Option<u32> {
    timed(scene, engine).filter(|(cell, _)| cell.contours == contours).filter_map(|(cell, _)| scene.levels(cell)).max()
}

/// What is known of a kind of octrees that does not reach an error: no more than how deep the sweep goes.
fn out_of_levels(kind: &str, levels: u32) -> String {
    format!("{kind} of at most {levels} levels do not get there, and deeper ones are not in the sweep")
}

/// The fastest setting with contours and the fastest with cubes at each target of a measure that one of them reaches.
struct AtTarget<'a> {
    target: f64,
    contours: Option<(&'a Cell, f64)>,
    cubes: Option<(&'a Cell, f64)>,
}

impl AtTarget<'_> {
    fn contours_win(&self) -> bool {
        match (self.contours, self.cubes) {
            (Some(a), Some(b)) => a.1 <= b.1,
            (with, _) => with.is_some(),
        }
    }
}

fn at_targets(scene: &SceneSweep, engine: EngineId, measure: ErrorMeasure) -> Vec<AtTarget<'_>> {
    let errors = || timed(scene, engine).map(|(cell, _)| measure.of(&cell.error));
    let (least, most) = (errors().fold(f64::INFINITY, f64::min), errors().fold(0.0, f64::max));
    let mut rows = Vec::new();
    for &target in measure.targets().iter().filter(|target| **target >= least) {
        let of =
            |contours: bool| fastest(timed(scene, engine).filter(|(c, _)| c.contours == contours), measure, target);
        rows.push(AtTarget { target, contours: of(true), cubes: of(false) });
        // Above the largest error, all targets have the same answer.
        if target >= most {
            break;
        }
    }
    rows
}

/// What a series of targets says of small errors.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Small {
    /// Contours win up to an error, and nowhere beyond.
    Wins,
    /// Only contours get there, since the sweep has no cubes of more levels.
    Open,
    /// Neither.
    No,
}

fn verdict(measure: ErrorMeasure, rows: &[AtTarget]) -> (Mark, String, Small) {
    let wins: Vec<f64> = rows.iter().filter(|row| row.contours_win()).map(|row| row.target).collect();
    let loses: Vec<f64> = rows.iter().filter(|row| !row.contours_win()).map(|row| row.target).collect();
    let mut compared = rows.iter().filter(|row| row.contours.is_some() && row.cubes.is_some());
    let beaten = !compared.clone().any(AtTarget::contours_win);
    match (wins.last(), loses.first()) {
        (None, None) => (Mark::Plain, "not measured".into(), Small::No),
        _ if compared.next().is_none() => (Mark::Plain, "open, since no error was reached by both".into(), Small::Open),
        (Some(_), None) => (Mark::Good, "yes at every error that was reached".into(), Small::Wins),
        (None, Some(_)) => (Mark::Bad, "no at every error that was reached".into(), Small::No),
        (Some(last), Some(first)) if last < first => {
            let (last, first) = (measure.show(*last), measure.show(*first));
            if beaten {
                (Mark::Mixed, format!("no from {first} on; up to {last}, only contours get there"), Small::Open)
            } else {
                (Mark::Mixed, format!("yes up to {last}, no from {first} on"), Small::Wins)
            }
        }
        _ => {
            let shown = |list: &[f64]| list.iter().map(|t| measure.show(*t)).collect::<Vec<_>>().join(", ");
            (Mark::Mixed, format!("yes at {}, no at {}", shown(&wins), shown(&loses)), Small::No)
        }
    }
}

fn contours_pay(subject: &Subject) -> Answered {
    let Subject { scene, engine, name } = subject;
    let deepest = [true, false].map(|contours| deepest(scene, *engine, contours));
    let mut details = Vec::new();
    let (mut marks, mut small) = (Vec::new(), Vec::new());
    for measure in ErrorMeasure::SHOWN {
        let rows = at_targets(scene, *engine, measure);
        let (mark, words, where_small) = verdict(measure, &rows);
        marks.push(mark);
        small.push(where_small);
        details.push(format!("By {}: {words}.", by(measure)));
        // The most exact target that either reaches, and the one at which cubes first get there.
        let both = rows.iter().find(|row| row.contours.is_some() && row.cubes.is_some());
        let first = rows.first().filter(|row| both.is_none_or(|other| other.target > row.target));
        for row in [first, both].into_iter().flatten() {
            details.push(at_one(measure, row, deepest));
        }
    }
    details.extend(equal_levels(scene, *engine));
    let answer = match (&marks[..], &small[..]) {
        ([Mark::Good, Mark::Good], _) => "Yes, at every error that was reached.",
        ([Mark::Bad, Mark::Bad], _) => "No, at no error that was reached.",
        ([Mark::Plain, Mark::Plain], [Small::Open, Small::Open]) => "Open: no error was reached by both.",
        ([Mark::Plain, Mark::Plain], _) => "Not measured.",
        (_, [Small::Wins, Small::Wins]) => "Yes where the error is small; no for coarse pictures.",
        (_, [Small::Open, Small::Open]) => "Open where the error is small; no for coarse pictures.",
        _ => "It depends on the error that counts.",
    };
    let mark = match marks[..] {
        [a, b] if a == b => a,
        _ => Mark::Mixed,
    };
    Answered { of: name.clone(), mark, answer: answer.into(), details }
}

fn by(measure: ErrorMeasure) -> &'static str {
    if measure == ErrorMeasure::Flip { "FLIP" } else { "depth error" }
}

/// `deepest`: levels of the deepest octrees with contours, and of cubes.
fn at_one(measure: ErrorMeasure, row: &AtTarget, deepest: [Option<u32>; 2]) -> String {
    let [contours, cubes] = deepest.map(Option::unwrap_or_default);
    let at = format!("Within {}", measure.show(row.target));
    let ms = |found: (&Cell, f64)| format!("{} ms, {}", short(found.1), megabytes(found.0));
    match (row.contours, row.cubes) {
        (Some(a), Some(b)) => {
            let (slower, times) = if a.1 <= b.1 { ("cubes", b.1 / a.1) } else { ("contours", a.1 / b.1) };
            format!("{at}: contours {}; cubes {}: {slower} take {} times the time.", ms(a), ms(b), short(times))
        }
        (Some(a), None) => format!("{at}: contours {}; {}.", ms(a), out_of_levels("cubes", cubes)),
        (None, Some(b)) => format!("{at}: cubes {}; {}.", ms(b), out_of_levels("contours", contours)),
        (None, None) => at,
    }
}

/// Time and error of contours over those of cubes with as many levels, the same beam and the same end of rays.
fn equal_levels(scene: &SceneSweep, engine: EngineId) -> Option<String> {
    let (mut times, mut errors) = (Vec::new(), Vec::new());
    for (with, ms) in timed(scene, engine).filter(|(cell, _)| cell.contours) {
        let twin = |cell: &Cell| {
            !cell.contours
                && cell.beam == with.beam
                && cell.max_voxel_pixels == with.max_voxel_pixels
                && scene.levels(cell) == scene.levels(with)
        };
        let Some((without, other)) = timed(scene, engine).find(|(cell, _)| twin(cell)) else { continue };
        times.push(ms / other);
        errors.push(with.error.pixels.p90 / without.error.pixels.p90);
    }
    let (time, error) = (Spread::of(&times)?.median, Spread::of(&errors)?.median);
    Some(format!(
        "At equal levels: {} times the time and {} times the depth error of cubes (median of {} pairs).",
        short(time),
        short(error),
        times.len()
    ))
}

fn triangles_win(subject: &Subject) -> Answered {
    let Subject { scene, engine, name } = subject;
    let not = |why: &str| Answered { of: name.clone(), mark: Mark::Plain, answer: why.into(), details: Vec::new() };
    let Some((own, ms)) = triangles(scene).filter(|(cell, _)| cell.engine == *engine) else {
        return not("Not measured on this engine.");
    };
    let measure = ErrorMeasure::P90;
    let error = |cell: &Cell| measure.of(&cell.error);
    let exact = timed(scene, *engine)
        .filter(|(_, other)| *other <= ms)
        .min_by(|a, b| error(a.0).total_cmp(&error(b.0)).then(a.1.total_cmp(&b.1)));
    let first = format!("Triangles: {} ms, {}.", short(ms), megabytes(own));
    let Some((cell, other)) = exact else {
        let details = vec![first];
        return Answered {
            of: name.clone(),
            mark: Mark::Plain,
            answer: "Everywhere: no octree is as fast.".into(),
            details,
        };
    };
    let answer = format!("Where the depth error must be below {}.", measure.show(error(cell)));
    let words = setting(scene, cell);
    let details = vec![
        first,
        format!("The most exact octree that is as fast: {words}: {} ms, {}.", short(other), megabytes(cell)),
    ];
    Answered { of: name.clone(), mark: Mark::Plain, answer, details }
}

fn beam(subject: &Subject) -> Answered {
    let Subject { scene, engine, name } = subject;
    let mut ratios = Vec::new();
    for (with, ms) in timed(scene, *engine).filter(|(cell, _)| cell.beam) {
        let twin = |cell: &Cell| {
            !cell.beam
                && cell.octree == with.octree
                && cell.contours == with.contours
                && cell.max_voxel_pixels == with.max_voxel_pixels
        };
        ratios.extend(timed(scene, *engine).find(|(cell, _)| twin(cell)).map(|(_, other)| ms / other));
    }
    ratios.sort_by(f64::total_cmp);
    let (Some(spread), Some(least), Some(most)) = (Spread::of(&ratios), ratios.first(), ratios.last()) else {
        return Answered { of: name.clone(), mark: Mark::Plain, answer: "Not measured.".into(), details: Vec::new() };
    };
    let answer = match spread.median {
        ratio if ratio < 0.97 => format!("{:.0} % of the time.", 100.0 * (1.0 - ratio)),
        ratio if ratio <= 1.03 => "Nothing.".into(),
        ratio => format!("It costs {:.0} % more time.", 100.0 * (ratio - 1.0)),
    };
    let details =
        vec![format!("{} pairs: {:.2} times the time, {least:.2} to {most:.2}.", ratios.len(), spread.median)];
    Answered { of: name.clone(), mark: Mark::Plain, answer, details }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sweep_bench::sample::{cell, report, triangles};

    fn ms(milliseconds: f64) -> Vec<Vec<f64>> {
        vec![vec![milliseconds / 1e3]]
    }

    fn answer(cells: Vec<Cell>, id: &str) -> Answered {
        let question = questions(&report(cells)).into_iter().find(|q| q.id == id).unwrap();
        question.answers.into_iter().next().unwrap()
    }

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
        assert_eq!(found.details[0], "3.00 ms per frame, error 0.50 px, 4.00 MB of memory.");
        assert!(found.details[1].starts_with("The triangles themselves: 2.00 ms"), "{:?}", found.details);
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
    fn contours_pay_where_they_are_faster_or_alone() {
        let small = cell(3, false, 1.0, [0.2, 0.02], ms(2.0));
        let cubes = cell(4, false, 1.0, [0.9, 0.09], ms(1.0));
        let found = answer(vec![small.clone(), cubes.clone()], "contours");
        assert_eq!(
            (found.mark, found.answer.as_str()),
            (Mark::Mixed, "Open where the error is small; no for coarse pictures.")
        );
        assert_eq!(found.details[0], "By depth error: no from 1.00 px on; up to 0.50 px, only contours get there.");
        assert!(
            found.details[1].starts_with("Within 0.25 px: contours 2.00 ms, 4.00 MB; cubes of at most "),
            "{:?}",
            found.details
        );
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
        assert_eq!(answer(vec![bad, cubes], "contours").mark, Mark::Bad);
        // At equal levels.
        let twin = cell(2, false, 1.0, [0.8, 0.09], ms(1.0));
        let found = answer(vec![small, twin], "contours");
        assert_eq!(
            found.details.last().unwrap(),
            "At equal levels: 2.00 times the time and 0.25 times the depth error of cubes (median of 1 pairs)."
        );
    }

    #[test]
    fn triangles_and_the_beam() {
        let cells =
            vec![cell(3, false, 1.0, [1.0, 0.1], ms(2.0)), cell(3, true, 1.0, [1.0, 0.1], ms(1.5)), triangles(1.0)];
        assert_eq!(answer(cells.clone(), "triangles").answer, "Everywhere: no octree is as fast.");
        assert_eq!(answer(cells.clone(), "beam").answer, "25 % of the time.");
        let slow = [cells[..2].to_vec(), vec![triangles(3.0)]].concat();
        assert_eq!(answer(slow, "triangles").answer, "Where the depth error must be below 1.00 px.");
        assert_eq!(answer(cells[..1].to_vec(), "beam").answer, "Not measured.");
    }
}
