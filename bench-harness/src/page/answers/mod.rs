//! What a sweep answers, in words for the top of the page. Rules are those of [`crate::sweep_bench::answers`]; times are ranges, and
//! ties are said: see [`super::span`]. Each answer says what it holds for, and `table2.rs` adds what Table 2 says of it at other levels and sizes.

mod contours;
mod features;
mod half_pixel;
mod table2;
mod termination;

use esvo_engines::EngineId;
use esvo_scenes::SceneVariant;

use super::html::{Answered, PageTable, Question};
use super::machines::OnMachine;
use super::span::{self, Span};
use crate::sweep_bench::SweepReport;
use crate::sweep_bench::answers::compared_engines;
use crate::sweep_bench::errors::ErrorMeasure;
use crate::sweep_bench::record::{Cell, ExactKind, SceneSweep};
use crate::text::short;
use crate::timing::Spread;

/// What stands beside the sweep's figures in its answers.
const BESIDE: &str = "Answers are the sweep's alone, and hold for its engine, size of pictures and levels, which each names. Lines that begin \
                      with Table 2 are by another record, with octrees of other levels.";

/// A scene of a sweep on one engine.
struct Subject<'a> {
    scene: &'a SceneSweep,
    engine: EngineId,
    /// Scene, mesh and engine in words.
    name: String,
    /// Width and height of the pictures.
    size: [u32; 2],
    /// What its answers hold for.
    scope: String,
    /// The same scene in Table 2, by levels.
    beside: Vec<table2::Beside<'a>>,
}

/// A setting that was timed.
#[derive(Clone, Copy)]
struct Timed<'a> {
    cell: &'a Cell,
    span: Span,
}

impl<'a> Subject<'a> {
    /// The settings of octrees that were timed.
    fn timed(&self) -> impl Iterator<Item = Timed<'a>> + use<'a> {
        let engine = self.engine;
        let cells = self.scene.cells.iter().filter(move |cell| cell.engine == engine && cell.octree.is_some());
        cells.filter_map(|cell| Some(Timed { cell, span: Span::of(cell)? }))
    }

    /// The triangles, if this engine cast them.
    fn triangles(&self) -> Option<Timed<'a>> {
        let cell = self.scene.cells.iter().find(|cell| cell.octree.is_none() && cell.engine == self.engine)?;
        Some(Timed { cell, span: Span::of(cell)? })
    }

    /// Levels of the deepest octrees of a kind.
    fn deepest(&self, contours: bool) -> Option<u32> {
        self.timed().filter(|t| t.cell.contours == contours).filter_map(|t| self.scene.levels(t.cell)).max()
    }

    fn setting(&self, timed: Timed) -> String {
        setting(self.scene, timed.cell)
    }
}

impl Timed<'_> {
    fn megabytes(self) -> String {
        format!("{} MB", short(self.cell.memory_bytes as f64 / 1e6))
    }

    /// `32.6 to 40.2 ms, 38.8 MB`.
    fn cost(self) -> String {
        format!("{}, {}", self.span.words(), self.megabytes())
    }
}

/// The fastest of some settings with at most this error.
fn fastest<'a>(cells: impl Iterator<Item = Timed<'a>>, measure: ErrorMeasure, target: f64) -> Option<Timed<'a>> {
    cells.filter(|t| measure.of(&t.cell.error) <= target).min_by(|a, b| a.span.least.total_cmp(&b.span.least))
}

/// The most exact of some settings; of equal ones the fastest.
fn most_exact<'a>(cells: impl Iterator<Item = Timed<'a>>, measure: ErrorMeasure) -> Option<Timed<'a>> {
    let key = |t: &Timed| (measure.of(&t.cell.error), t.span.least);
    cells.min_by(|a, b| {
        let (a, b) = (key(a), key(b));
        a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
    })
}

/// What is known of a kind of octrees that does not reach an error: no more than how deep the sweep goes.
fn out_of_levels(kind: &str, levels: u32) -> String {
    format!("{kind} of at most {levels} levels do not get there, and deeper ones are not in the sweep")
}

fn by(measure: ErrorMeasure) -> &'static str {
    if measure == ErrorMeasure::Flip { "FLIP" } else { "depth error" }
}

/// The scenes that have triangles to compare with, each on every engine that cast all settings.
fn subjects<'a>(report: &'a SweepReport, machine: &'a OnMachine<'a>) -> Vec<Subject<'a>> {
    let engines = compared_engines(report);
    let mut subjects = Vec::new();
    for scene in report.scenes.iter().filter(|scene| scene.exact == ExactKind::Triangles) {
        for &engine in &engines {
            let mesh =
                if scene.mesh == SceneVariant::Real { String::new() } else { format!(" ({})", scene.mesh.title()) };
            let on = if engines.len() > 1 { format!(" on {engine}") } else { String::new() };
            let beside = table2::beside(machine, &scene.name, &scene.identity, engine);
            let (scope, size) = (scope(report, scene, engine), report.plan.size);
            subjects.push(Subject { scene, engine, name: format!("{}{mesh}{on}", scene.name), size, scope, beside });
        }
    }
    subjects
}

/// What the answers about a scene hold for: `cpu (AVX2, 8 lanes, 2 threads), 512x384, octrees of 5 to 8 levels`.
fn scope(report: &SweepReport, scene: &SceneSweep, engine: EngineId) -> String {
    let device = report.devices.iter().find(|device| device.backend == engine);
    let detail = device.map_or_else(String::new, |device| format!(" ({})", device.detail));
    let [width, height] = report.plan.size;
    let levels = scene.octrees.iter().map(|octree| octree.levels);
    let levels = match (levels.clone().min(), levels.max()) {
        (Some(a), Some(b)) if a != b => format!(", octrees of {a} to {b} levels"),
        (Some(a), _) => format!(", octrees of {a} levels"),
        _ => String::new(),
    };
    format!("{engine}{detail}, {width}x{height}{levels}")
}

/// What the page shows of a sweep's answers on demand: times with their spread. No rows: no scene has triangles to compare with.
pub(super) fn termination(report: &SweepReport, machine: &OnMachine) -> PageTable {
    termination::table(&subjects(report, machine))
}

/// The questions that a sweep answers, about every scene that has triangles to compare with.
pub(super) fn questions(report: &SweepReport, machine: &OnMachine) -> Vec<Question> {
    let engines = compared_engines(report);
    let subjects = subjects(report, machine);
    if subjects.is_empty() {
        return Vec::new();
    }
    let [width, height] = report.plan.size;
    let names: Vec<String> = engines.iter().map(ToString::to_string).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let on = format!(" by {}", super::verdicts::listed(&names));
    let ask = |id, question: &str, rule: String, answer: &dyn Fn(&Subject) -> Answered| Question {
        id,
        question: question.into(),
        machine: machine.name.clone(),
        rule,
        answers: (subjects.iter())
            .map(|subject| {
                let mut answered = Answered { scope: subject.scope.clone(), ..answer(subject) };
                table2::add(id, subject, &mut answered);
                answered
            })
            .collect(),
        table: None,
    };
    let rounds = report.plan.rounds;
    vec![
        ask(
            "half-pixel",
            "What settings give an error of half a pixel in the least time?",
            format!(
                "Of the sweep's settings, the fastest whose depth error is at most half a pixel for 90 % of the rays that hit. Times are \
                 for a frame of {width}x{height}{on}, of {rounds} rounds. {} {}",
                span::RULE,
                BESIDE
            ),
            &half_pixel::answer,
        ),
        ask(
            "contours",
            "Do contours pay?",
            format!(
                "At equal error: for a series of errors, the fastest setting with contours against the fastest with cubes that is not less \
                 exact; within the spread of their rounds they are as fast. Errors are taken in two ways: depth error (90th percentile) and \
                 FLIP, the visible difference of the pictures. Octrees of as many levels are compared in a line of its own. {BESIDE}"
            ),
            &contours::answer,
        ),
        ask(
            "triangles",
            "Where do the triangles themselves win?",
            format!(
                "Triangles have no error. They win below the error of the most exact octree whose least time is not above theirs. {BESIDE}"
            ),
            &features::triangles_win,
        ),
        ask(
            "beam",
            &format!("What does the beam optimization save, in pictures of {width}x{height}?"),
            format!(
                "For pictures of {width}x{height} only; Table 2 has other sizes. Pairs of settings that differ in the beam alone: the \
                 median of their least times divided. It is told from noise if 1 is outside of the interval that holds the median with 95 %, by \
                 the ranks of the ratios, or if pairs that are no ties go one way (sign test, 95 %). Hits and errors are the same. {BESIDE}"
            ),
            &features::beam,
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
    format!("{levels} levels, {kind}, {beam}, {}", end(cell))
}

/// Where rays end.
fn end(cell: &Cell) -> String {
    match cell.max_voxel_pixels {
        0.0 => "rays end at leaves".to_string(),
        1.0 => "rays end at voxels of 1 pixel".into(),
        pixels => format!("rays end at voxels of {pixels} pixels"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sweep_bench::sample::report;

    pub(super) fn ms(milliseconds: f64) -> Vec<Vec<f64>> {
        vec![vec![milliseconds / 1e3]]
    }

    pub(super) fn answer(cells: Vec<Cell>, id: &str) -> Answered {
        let machine = OnMachine { name: "example, 2 threads".into(), id: String::new(), found: Vec::new() };
        let question = questions(&report(cells), &machine).into_iter().find(|q| q.id == id).unwrap();
        assert_eq!(question.machine, "example, 2 threads");
        question.answers.into_iter().next().unwrap()
    }
}
