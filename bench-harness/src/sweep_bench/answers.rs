//! The questions that a sweep answers, in words, by rules that are the same for every sweep.
//!
//! Only the data of one engine that cast all settings are compared with each other. Times are least milliseconds per frame. "At equal
//! error" means: the fastest setting with an error of at most a given target; the targets are fixed. What the data cannot tell is said.

use esvo_engines::EngineId;

use super::errors::ErrorMeasure;
use super::record::{Cell, ExactKind, SceneSweep, SweepReport};
use crate::curve::{along, crossing};
use crate::text::short;

/// What is said where the data do not answer a question.
pub(crate) const NOT_ANSWERED: &str = "not answered by this sweep";

/// A question and its answers.
#[derive(Clone, PartialEq, Debug)]
pub struct Answer {
    /// The question.
    pub question: &'static str,
    /// How the answer was found.
    pub rule: &'static str,
    /// Scene, engine, measure and what is found; empty if nothing can be said of any scene.
    pub rows: Vec<[String; 4]>,
}

/// All questions with their answers.
pub fn answers(report: &SweepReport) -> Vec<Answer> {
    let engines = compared_engines(report);
    let all = |answer: &dyn Fn(&SceneSweep, EngineId, ErrorMeasure) -> Vec<String>| {
        let mut rows = Vec::new();
        for scene in report.scenes.iter().filter(|scene| scene.exact == ExactKind::Triangles) {
            for &engine in &engines {
                for measure in ErrorMeasure::SHOWN {
                    let found = answer(scene, engine, measure);
                    let found = if found.is_empty() { vec![NOT_ANSWERED.to_string()] } else { found };
                    let row = |line| [scene.name.clone(), engine.to_string(), measure.title().to_string(), line];
                    rows.extend(found.into_iter().map(row));
                }
            }
        }
        rows
    };
    vec![
        Answer {
            question: "How many levels do contours save at equal error?",
            rule: "At the finest termination, without the beam: the level at which cubical octrees have the error of an octree with \
                   contours, interpolated between levels in the logarithm of the error; bytes in memory likewise. No value is \
                   extrapolated.",
            rows: all(&levels_saved),
        },
        Answer {
            question: "What does the beam optimization save?",
            rule: "Pairs of settings that differ in the beam alone: their times divided, median over the pairs; and how much the error \
                   changes at most.",
            rows: all(&beam_pairs),
        },
        Answer {
            question: "What do contours cost or save at equal error?",
            rule: "For each target, the fastest setting with contours and the fastest cubical one with at most this error.",
            rows: all(&|scene, engine, measure| {
                feature(scene, engine, measure, "contours", "cubes", |cell| cell.contours)
            }),
        },
        Answer {
            question: "What does a coarser termination cost or save at equal error?",
            rule: "For each target, the fastest setting whose rays end at voxels of more than one pixel, and the fastest of the others, with \
                   at most this error.",
            rows: all(&|scene, engine, measure| {
                feature(scene, engine, measure, "above 1 px", "at most 1 px", |cell| cell.max_voxel_pixels > 1.0)
            }),
        },
        Answer {
            question: "Where do triangles win?",
            rule: "Triangles have no error worth the name. They win for errors below that of the most exact octree setting that is at \
                   least as fast.",
            rows: all(&triangles_win),
        },
    ]
}

/// Engines that cast all settings: not those that cast the subset for software.
pub(crate) fn compared_engines(report: &SweepReport) -> Vec<EngineId> {
    report.devices.iter().filter(|device| !device.is_software()).map(|device| device.backend).collect()
}

/// The settings of an engine that were timed, without triangles.
pub(crate) fn timed(scene: &SceneSweep, engine: EngineId) -> impl Iterator<Item = (&Cell, f64)> {
    let cells = scene.cells.iter().filter(move |cell| cell.engine == engine && cell.octree.is_some());
    cells.filter_map(|cell| Some((cell, cell.ms()?)))
}

/// The triangles and their time.
pub(crate) fn triangles(scene: &SceneSweep) -> Option<(&Cell, f64)> {
    let cell = scene.cells.iter().find(|cell| cell.octree.is_none())?;
    Some((cell, cell.ms()?))
}

/// The fastest of some settings with at most this error.
pub(crate) fn fastest<'a>(
    cells: impl Iterator<Item = (&'a Cell, f64)>,
    measure: ErrorMeasure,
    target: f64,
) -> Option<(&'a Cell, f64)> {
    cells.filter(|(cell, _)| measure.of(&cell.error) <= target).min_by(|a, b| a.1.total_cmp(&b.1))
}

fn levels_saved(scene: &SceneSweep, engine: EngineId, measure: ErrorMeasure) -> Vec<String> {
    let finest =
        scene.cells.iter().filter(|c| c.octree.is_some()).map(|c| c.max_voxel_pixels).fold(f32::INFINITY, f32::min);
    let curve = |contours: bool| {
        let plain = |cell: &&Cell| {
            cell.engine == engine
                && !cell.beam
                && cell.contours == contours
                && cell.max_voxel_pixels == finest
                && cell.passed()
        };
        let point = |cell: &Cell| {
            let row = &scene.octrees[cell.octree?];
            Some((f64::from(row.levels), measure.of(&cell.error), row.image_bytes as f64))
        };
        let mut points: Vec<_> = scene.cells.iter().filter(plain).filter_map(point).filter(|p| p.1 > 0.0).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    };
    let (cubical, contours) = (curve(false), curve(true));
    let Some(deepest) = cubical.last() else { return Vec::new() };
    let bytes: Vec<_> = cubical.iter().map(|p| (p.0, p.2.log2())).collect();
    let mut lines = Vec::new();
    for (levels, error, own) in contours {
        let start = format!("{levels} levels with contours have {}", measure.show(error));
        let line = match crossing(&cubical, error) {
            Some((other, false)) => {
                let ratio = along(&bytes, other).map_or(f64::NAN, |b| b.exp2() / own);
                format!(
                    "{start}, as {other:.1} cubical levels: {:+.1} levels, {} times the bytes",
                    other - levels,
                    short(ratio)
                )
            }
            _ if error < cubical.iter().map(|p| p.1).fold(f64::INFINITY, f64::min) => format!(
                "{start}, less than the deepest cubical octree ({} at {} levels): more than {:+} levels; how many is {NOT_ANSWERED}",
                measure.show(deepest.1),
                deepest.0,
                deepest.0 - levels
            ),
            _ => format!("{start}, more than all cubical octrees: {NOT_ANSWERED}"),
        };
        lines.push(line);
    }
    lines
}

fn beam_pairs(scene: &SceneSweep, engine: EngineId, measure: ErrorMeasure) -> Vec<String> {
    let mut lines = Vec::new();
    for contours in [false, true] {
        let (mut ratios, mut change) = (Vec::new(), 0f64);
        for (with, ms) in timed(scene, engine).filter(|(cell, _)| cell.beam && cell.contours == contours) {
            let twin = |cell: &Cell| Cell { beam: true, ..key(cell) } == key(with);
            let Some((without, other)) = timed(scene, engine).find(|(cell, _)| !cell.beam && twin(cell)) else {
                continue;
            };
            ratios.push(ms / other);
            let (a, b) = (measure.of(&with.error), measure.of(&without.error));
            change = change.max((a - b).abs());
        }
        ratios.sort_by(f64::total_cmp);
        let (Some(least), Some(most)) = (ratios.first(), ratios.last()) else { continue };
        let median = crate::timing::Spread::of(&ratios).map_or(f64::NAN, |spread| spread.median);
        let kind = if contours { "with contours" } else { "cubical" };
        lines.push(format!(
            "{kind}, the beam takes {median:.2} times the time ({least:.2} to {most:.2}, {} pairs), and changes the error by at most {}",
            ratios.len(),
            measure.show(change)
        ));
    }
    lines
}

/// A cell with its settings alone.
fn key(cell: &Cell) -> Cell {
    Cell {
        memory_bytes: 0,
        disk_bytes: 0,
        agreement: None,
        error: Default::default(),
        seconds: Vec::new(),
        ..cell.clone()
    }
}

fn feature(
    scene: &SceneSweep,
    engine: EngineId,
    measure: ErrorMeasure,
    name: &str,
    other: &str,
    has: impl Fn(&Cell) -> bool,
) -> Vec<String> {
    let errors = || timed(scene, engine).map(|(cell, _)| measure.of(&cell.error));
    let (least, most) = (errors().fold(f64::INFINITY, f64::min), errors().fold(0.0, f64::max));
    let mut lines = Vec::new();
    // Above the largest error, all targets have the same answer.
    let mut done = false;
    for &target in measure.targets().iter().filter(|target| **target >= least) {
        if done {
            break;
        }
        done = target >= most;
        let with = fastest(timed(scene, engine).filter(|(cell, _)| has(cell)), measure, target);
        let without = fastest(timed(scene, engine).filter(|(cell, _)| !has(cell)), measure, target);
        let show = |(cell, ms): (&Cell, f64)| {
            format!("{} ms, {} MB ({})", short(ms), short(cell.memory_bytes as f64 / 1e6), scene.setting(cell))
        };
        let at = format!("within {}", measure.show(target));
        lines.push(match (with, without) {
            (Some(a), Some(b)) => {
                format!("{at}, {name} take {:.2} times the time of {other}: {}, not {}", a.1 / b.1, show(a), show(b))
            }
            (Some(a), None) => format!("{at}, only {name}: {}", show(a)),
            (None, Some(b)) => format!("{at}, only {other}: {}", show(b)),
            (None, None) => continue,
        });
    }
    if least.is_finite() {
        lines.insert(0, format!("below {}: {NOT_ANSWERED}, as no octree has so small an error", measure.show(least)));
    }
    lines
}

fn triangles_win(scene: &SceneSweep, engine: EngineId, measure: ErrorMeasure) -> Vec<String> {
    // Triangles are cast by the processor: other engines are not compared with it.
    let Some((triangles, ms)) = triangles(scene).filter(|(cell, _)| cell.engine == engine) else { return Vec::new() };
    let own = format!("triangles take {} ms and {:.1} MB", short(ms), triangles.memory_bytes as f64 / 1e6);
    let error = |cell: &Cell| measure.of(&cell.error);
    let exact = |cells: &mut dyn Iterator<Item = (&'_ Cell, f64)>| {
        cells
            .min_by(|a, b| error(a.0).total_cmp(&error(b.0)).then(a.1.total_cmp(&b.1)))
            .map(|(cell, ms)| (cell.clone(), ms))
    };
    let Some((finest, _)) = exact(&mut timed(scene, engine)) else { return Vec::new() };
    let line = match exact(&mut timed(scene, engine).filter(|(_, other)| *other <= ms)) {
        None => format!("{own}, and are faster than every octree: they win at every error"),
        Some((cell, other)) => {
            let end = if error(&cell) <= error(&finest) { "; no octree of this sweep is more exact" } else { "" };
            format!(
                "{own}; they win below {}, where the most exact octree that is as fast ends: {} ms, {:.1} MB ({}){end}",
                measure.show(error(&cell)),
                short(other),
                cell.memory_bytes as f64 / 1e6,
                scene.setting(&cell)
            )
        }
    };
    vec![line]
}

#[cfg(test)]
mod tests {
    use super::super::sample::{cell, report, triangles};
    use super::*;

    /// Octrees of 5 to 8 levels: cubes halve the error with each level, contours have a quarter of it. Every level takes 1 ms more, the
    /// beam saves a quarter, and 2 pixels save half and double the error.
    fn cells() -> Vec<Cell> {
        let mut cells = Vec::new();
        for octree in 0..8 {
            for beam in [false, true] {
                for pixels in [1.0, 2.0] {
                    let level = (octree / 2) as i32;
                    let error = 8.0 * 0.5f64.powi(level) * if octree % 2 == 1 { 0.25 } else { 1.0 } * f64::from(pixels);
                    let ms = f64::from(1 + level) * if beam { 0.75 } else { 1.0 } / f64::from(pixels);
                    cells.push(cell(octree, beam, pixels, [error, error / 100.0], vec![vec![ms / 1e3]]));
                }
            }
        }
        cells
    }

    fn depth(cells: Vec<Cell>, question: &str) -> Vec<String> {
        let found = answers(&report(cells)).into_iter().find(|answer| answer.question.contains(question)).unwrap();
        assert!(found.rows.iter().all(|row| row[0] == "SIBENIK" && row[1] == "cpu"));
        found.rows.into_iter().filter(|row| row[2].contains("90th")).map(|[.., line]| line).collect()
    }

    #[test]
    fn levels_are_saved_between_known_levels_only() {
        let lines = depth(cells(), "How many levels");
        assert_eq!(lines.len(), 4);
        assert!(
            lines[0].contains("5 levels with contours have 2.00 px, as 7.0 cubical levels: +2.0 levels, 16.0 times"),
            "{lines:?}"
        );
        assert!(lines[1].contains("as 8.0 cubical levels: +2.0 levels"), "{lines:?}");
        assert!(
            lines[2].contains("less than the deepest cubical octree (1.00 px at 8 levels): more than +1 levels; how many is not answered"),
            "{lines:?}"
        );
        // Contours without cubes to compare with.
        let contours = cells().into_iter().filter(|c| c.contours).collect();
        assert_eq!(depth(contours, "How many levels"), [NOT_ANSWERED]);
    }

    #[test]
    fn the_beam_is_compared_in_pairs() {
        let lines = depth(cells(), "beam optimization");
        assert_eq!(lines.len(), 2, "{lines:?}");
        assert!(
            lines[0].starts_with("cubical, the beam takes 0.75 times the time (0.75 to 0.75, 8 pairs)"),
            "{lines:?}"
        );
        assert!(lines[0].ends_with("changes the error by at most 0.00 px"), "{lines:?}");
        let mut changed = cells();
        changed.iter_mut().filter(|c| c.beam && c.contours).for_each(|c| c.error.pixels.p90 += 0.5);
        assert!(depth(changed, "beam optimization")[1].ends_with("at most 0.50 px"));
        let without = cells().into_iter().filter(|c| !c.beam).collect();
        assert_eq!(depth(without, "beam optimization"), [NOT_ANSWERED]);
    }

    #[test]
    fn features_are_compared_at_equal_error() {
        let lines = depth(cells(), "What do contours");
        assert_eq!(lines[0], "below 0.25 px: not answered by this sweep, as no octree has so small an error");
        // Within 0.25 px: contours at 8 levels and 1 px, with the beam 3 ms; no cubes.
        assert!(lines[1].starts_with("within 0.25 px, only contours: 3.00 ms"), "{lines:?}");
        // Within 1 px: contours at 7 levels and 2 px take 1.125 ms, cubes at 8 levels and 1 px take 3 ms.
        assert!(lines[3].starts_with("within 1.00 px, contours take 0.38 times the time of cubes"), "{lines:?}");
        // Within 16 px: everything; more would be the same.
        assert!(lines.len() == 8 && lines[7].starts_with("within 16.0 px"), "{lines:?}");
        let fine = depth(cells().into_iter().filter(|c| c.octree < Some(2)).collect(), "What do contours");
        assert!(fine[0].starts_with("below 2.00 px: not answered by this sweep"), "{fine:?}");
        let coarser = depth(cells(), "coarser termination");
        // Within 2 px: 1 px at 5 levels with contours, 0.75 ms; 2 px at 6 levels, 0.75 ms.
        assert!(coarser[4].contains("above 1 px take 1.00 times the time of at most 1 px"), "{coarser:?}");
    }

    #[test]
    fn triangles_win_below_an_error() {
        let with = |ms: f64| depth([cells(), vec![triangles(ms)]].concat(), "triangles win");
        // The most exact octree in 1.2 ms: contours, 7 levels, beam, 2 px: 1.125 ms and 1 px; at 1 px 5 levels have 2 px.
        let lines = with(1.2);
        assert!(
            lines[0].contains("triangles take 1.20 ms") && lines[0].contains("they win below 1.00 px"),
            "{lines:?}"
        );
        assert!(with(0.1)[0].contains("they win at every error"));
        assert!(
            with(100.0)[0].contains("they win below 0.25 px")
                && with(100.0)[0].contains("no octree of this sweep is more exact")
        );
        assert_eq!(depth(cells(), "triangles win"), [NOT_ANSWERED]);
    }

    #[test]
    fn software_gpus_and_leaves_are_not_compared() {
        let mut report = report(cells());
        report.scenes[0].exact = ExactKind::Leaves;
        assert!(answers(&report).iter().all(|answer| answer.rows.is_empty()));
    }
}
