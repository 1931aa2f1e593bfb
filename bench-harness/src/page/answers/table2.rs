//! What Table 2 says of a question that a sweep answers: at levels and sizes of pictures that the sweep does not have, the answer may be another.

use super::{Subject, Timed, fastest, most_exact};
use crate::page::html::{Answered, Mark};
use crate::page::machines::OnMachine;
use crate::page::verdicts::listed;
use crate::paper_bench::matrix::Variant;
use crate::paper_bench::report::SceneReport;
use crate::records::Record;
use crate::sweep_bench::errors::ErrorMeasure;
use crate::text::short;
use crate::timing::Spread;

/// The error that is asked for, in pixels.
const HALF: f64 = 0.5;
const MEASURE: ErrorMeasure = ErrorMeasure::P90;
/// Times within this factor are as fast: most of Table 2 has no spread.
const SAME: f64 = 1.03;

/// Octrees of one level of a scene in a record with Table 2.
pub(super) struct Beside<'a> {
    /// The record in words.
    record: String,
    levels: u32,
    scene: &'a SceneReport,
    subject_engine: esvo_engines::EngineId,
}

/// The rows of Table 2 about a scene, those of each level once: by the newest record that has it.
pub(super) fn beside<'a>(
    machine: &'a OnMachine<'a>,
    name: &str,
    identity: &str,
    engine: esvo_engines::EngineId,
) -> Vec<Beside<'a>> {
    let mut rows: Vec<Beside> = Vec::new();
    for one in &machine.found {
        let Record::Paper(report) = &one.record else { continue };
        for scene in report.scenes.iter().filter(|scene| scene.name == name && scene.identity == identity) {
            let of_engine = scene.times.iter().filter(|cell| cell.backend == engine && cell.mrays.is_some());
            let Some(levels) = of_engine.map(|cell| cell.levels).max().filter(|levels| *levels > 0) else { continue };
            if !rows.iter().any(|row| row.levels == levels) {
                rows.push(Beside { record: machine.name_of(one), levels, scene, subject_engine: engine });
            }
        }
    }
    rows.sort_by_key(|row| row.levels);
    rows
}

impl Beside<'_> {
    /// Millions of rays per second.
    fn rate(&self, variant: Variant, size: [u32; 2]) -> Option<Spread> {
        self.scene.time(self.subject_engine, variant, size)?.mrays
    }

    /// The 90th percentile of the depth error in pixels, mean over the views; it was measured at one size of pictures only.
    fn error(&self, variant: Variant, size: [u32; 2]) -> Option<f64> {
        let is = |row: &&crate::paper_bench::report::ErrorRow| {
            row.variant == variant && row.levels == self.levels && row.size == size
        };
        Some(self.scene.errors.iter().find(is)?.mean(|view| view.pixels.p90))
    }

    /// Rays per second of one variant over those of another.
    fn ratio(&self, one: Variant, other: Variant, size: [u32; 2]) -> Option<f64> {
        Some(self.rate(one, size)?.median / self.rate(other, size)?.median)
    }

    /// `Table 2 at 10 levels (esvo bench of 2026-11-27, one round, so without spread)`.
    fn title(&self) -> String {
        let rounds = self.scene.times.iter().map(|cell| cell.samples.seconds.len()).max().unwrap_or_default();
        let rounds = if rounds == 1 { "one round, so without spread".into() } else { format!("{rounds} rounds") };
        format!("Table 2 at {} levels ({}, {rounds})", self.levels, self.record)
    }

    fn sizes(&self) -> Vec<[u32; 2]> {
        let mut sizes: Vec<[u32; 2]> = self.scene.times.iter().map(|cell| cell.size).collect();
        sizes.sort_unstable();
        sizes.dedup();
        sizes
    }
}

const OCTREES: [Variant; 3] = [Variant::Cubical, Variant::Contours, Variant::Beam];

fn named(variant: Variant) -> &'static str {
    match variant {
        Variant::Triangles => "triangles",
        Variant::Cubical => "cubes",
        Variant::Contours => "contours",
        Variant::Beam => "contours with the beam",
    }
}

/// Adds to the answer of a question what Table 2 says.
pub(super) fn add(question: &str, subject: &Subject, answered: &mut Answered) {
    for row in &subject.beside {
        let said = match question {
            "half-pixel" => half_pixel(row, subject, answered),
            "contours" => contours(row, subject),
            "triangles" => triangles(row, subject),
            "beam" => beam(row, subject),
            _ => None,
        };
        answered.details.extend(said);
    }
}

fn otherwise(otherwise: bool) -> &'static str {
    if otherwise { " says otherwise" } else { "" }
}

/// Times of two records are not compared: each is held against the triangles of its own.
fn half_pixel(row: &Beside, subject: &Subject, answered: &mut Answered) -> Option<String> {
    let error = |variant: &Variant| row.error(*variant, subject.size).unwrap_or(f64::INFINITY);
    let rate = |variant: &Variant| row.rate(*variant, subject.size).map_or(0.0, |spread| spread.median);
    let timed = || OCTREES.into_iter().filter(|variant| rate(variant) > 0.0 && error(variant).is_finite());
    let own = fastest(subject.timed(), MEASURE, HALF);
    let within = timed().filter(|variant| error(variant) <= HALF);
    let Some(best) = within.max_by(|a, b| rate(a).total_cmp(&rate(b))) else {
        let exact = timed().min_by(|a, b| error(a).total_cmp(&error(b)))?;
        let words = format!("{}: none either; {} get to {}.", row.title(), named(exact), MEASURE.show(error(&exact)));
        return own.is_none().then_some(words);
    };
    if own.is_none() && answered.mark == Mark::Bad {
        answered.mark = Mark::Mixed;
        answered.answer = format!("{} Table 2 has one of {} levels.", answered.answer, row.levels);
    }
    let ratio = row.ratio(Variant::Triangles, best, subject.size);
    let swept = own.zip(subject.triangles()).map(|(own, triangles)| own.span.least / triangles.span.least);
    let against = match (ratio, swept) {
        (Some(ratio), Some(swept)) => format!(
            ", in {} times the time of the triangles there; the sweep's setting takes {} times that of its own",
            short(ratio),
            short(swept)
        ),
        (Some(ratio), None) => format!(", in {} times the time of the triangles there", short(ratio)),
        _ => String::new(),
    };
    let error = MEASURE.show(error(&best));
    Some(format!("{}{}: {} have an error of {error}{against}.", row.title(), otherwise(own.is_none()), named(best)))
}

fn contours(row: &Beside, subject: &Subject) -> Option<String> {
    let time = row.ratio(Variant::Cubical, Variant::Contours, subject.size)?;
    let errors = row.error(Variant::Contours, subject.size).zip(row.error(Variant::Cubical, subject.size));
    let error = errors.map(|(own, cubes)| {
        format!(
            ", and have {} times their depth error ({} and {})",
            short(own / cubes),
            MEASURE.show(own),
            MEASURE.show(cubes)
        )
    });
    let own = super::contours::time_at_equal_levels(subject);
    let against = own.is_some_and(|own| opposite(own, time));
    Some(format!(
        "{}{}: at equal levels contours take {} times the time of cubes{}.",
        row.title(),
        otherwise(against),
        short(time),
        error.unwrap_or_default()
    ))
}

/// Whether one ratio of times is a gain and the other a loss.
fn opposite(a: f64, b: f64) -> bool {
    let side = |ratio: f64| (ratio > SAME) as i32 - (ratio < 1.0 / SAME) as i32;
    side(a) * side(b) < 0
}

fn triangles(row: &Beside, subject: &Subject) -> Option<String> {
    let own = subject.triangles()?;
    let faster =
        |variant: &Variant| row.ratio(*variant, Variant::Triangles, subject.size).is_some_and(|ratio| ratio >= 1.0);
    row.rate(Variant::Triangles, subject.size)?;
    let errors = OCTREES.into_iter().filter(faster);
    let errors = errors.filter_map(|variant| Some((variant, row.error(variant, subject.size)?)));
    let best = errors.min_by(|a, b| a.1.total_cmp(&b.1));
    let error = |t: Timed| MEASURE.of(&t.cell.error);
    let swept = most_exact(subject.timed().filter(|t| t.span.least <= own.span.least), MEASURE);
    Some(match best {
        Some((variant, at)) => format!(
            "{}{}: {} cast {} times the rays of triangles per second, with an error of {}.",
            row.title(),
            otherwise(swept.is_none_or(|swept| at < error(swept))),
            named(variant),
            short(row.ratio(variant, Variant::Triangles, subject.size)?),
            MEASURE.show(at)
        ),
        None => {
            let best = OCTREES.into_iter().filter_map(|v| row.ratio(v, Variant::Triangles, subject.size));
            let best = best.fold(0.0, f64::max);
            // Octrees of the sweep with fewer levels may well be as fast.
            let same = swept.is_some_and(|t| subject.scene.levels(t.cell).is_some_and(|levels| levels >= row.levels));
            format!(
                "{}{}: no octree is as fast as the triangles; the best casts {} times their rays per second.",
                row.title(),
                otherwise(same),
                short(best)
            )
        }
    })
}

fn beam(row: &Beside, subject: &Subject) -> Option<String> {
    let sizes = row.sizes();
    let at = |size: &[u32; 2]| row.ratio(Variant::Contours, Variant::Beam, *size);
    let timed = sizes.iter().filter_map(|size| Some((size, at(size)?))).enumerate();
    let each: Vec<String> = timed
        .map(|(index, ([width, height], ratio))| {
            let times = if index == 0 { " times the time" } else { "" };
            format!("{}{times} at {width}x{height}", short(ratio))
        })
        .collect();
    let own = super::features::beam_ratio(subject);
    let against = own.is_some_and(|own| sizes.iter().filter_map(at).any(|ratio| opposite(own, ratio)));
    let each: Vec<&str> = each.iter().map(String::as_str).collect();
    (!each.is_empty()).then(|| {
        let says = if against { " says otherwise at some sizes" } else { "" };
        format!("{}{says}: with the beam, contours take {}.", row.title(), listed(&each))
    })
}
