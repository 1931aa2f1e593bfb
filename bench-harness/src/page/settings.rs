//! The settings of a sweep as a table: time, error and verdict first, so that they are seen without scrolling.

use esvo_scenes::SceneVariant;

use super::html::{PageCell, PageTable};
use super::span::Span;
use crate::sweep_bench::SweepReport;
use crate::sweep_bench::errors::{ErrorMeasure, pixels};
use crate::sweep_bench::record::{Cell, ExactKind, SceneSweep};
use crate::sweep_bench::tables::marks;
use crate::text::short;

/// Headings; the first is that of the row.
const HEAD: [&str; 17] = [
    "setting",
    "time, ms",
    "depth error 90 %, px",
    "hits",
    "FLIP",
    "front",
    "memory, MB",
    "median of rounds, ms",
    "Mrays/s by least time",
    "error median, px",
    "error 99 %, px",
    "error max, px",
    "error 90 %, mesh units",
    "hit/miss, %",
    "normal 90 %, °",
    "colour",
    "on disk, MB",
];

/// The settings of a scene: all, or those on a Pareto front, the triangles, and those that are wrong.
pub(super) fn settings(report: &SweepReport, scene: &SceneSweep, all: bool) -> PageTable {
    let exact = match scene.exact {
        ExactKind::Triangles => "the exact answer (the triangles in double precision)",
        ExactKind::Leaves => "the octree's own leaves, as its triangles are not known",
    };
    let mesh = if scene.mesh == SceneVariant::Real { String::new() } else { format!(" ({})", scene.mesh.title()) };
    let title = if all { "All settings" } else { "Settings on a Pareto front" };
    let marks = marks(report, scene);
    let shown = |cell: &Cell, mark: &str| all || !mark.is_empty() || cell.octree.is_none() || !cell.passed();
    let rows = scene.cells.iter().zip(&marks).filter(|(cell, mark)| shown(cell, mark));
    let rows = rows.map(|(cell, mark)| row(report, scene, cell, mark)).collect();
    PageTable {
        caption: format!("{title}: {}{mesh}", scene.name),
        notes: vec![
            format!(
                "Time: milliseconds per frame, from the least of {} rounds to their lower quartile; ranges that overlap are ties. Depth error \
                 against {exact}. Hits: whether they are the reference's; WRONG ones are not timed.",
                report.plan.rounds
            ),
            "Front: d if no other octree has less depth error in as little time, D if triangles have not either; f and F the same for FLIP. \
             hit/miss: rays that hit one of octree and triangles alone. Normal: angle between shading normals. Colour: mean absolute \
             difference of the channels, 0 to 1."
                .into(),
        ],
        head: HEAD.map(Into::into).into(),
        left: 1,
        cards: false,
        rows,
    }
}

fn row(report: &SweepReport, scene: &SceneSweep, cell: &Cell, mark: &str) -> Vec<PageCell> {
    let error = &cell.error;
    let number = |text: String, value: f64| PageCell::number(text, value, Vec::new());
    let megabytes = |bytes: u64| number(short(bytes as f64 / 1e6), bytes as f64);
    let span = Span::of(cell);
    let absent = || PageCell { text: "–".into(), ..PageCell::default() };
    let time = |show: &dyn Fn(Span) -> (String, f64)| match span {
        Some(span) => {
            let (text, value) = show(span);
            number(text, value)
        }
        None => absent(),
    };
    let median = cell.frame_ms().map_or_else(absent, |ms| {
        number(format!("{} ±{:.0} %", short(ms.rounds.median), ms.rounds.percent()), ms.rounds.median)
    });
    let mrays = |span: Span| report.pixels() as f64 / span.least / 1e3;
    vec![
        setting(report, scene, cell),
        time(&|span| (span.figures(), span.least)),
        number(pixels(error.pixels.p90), error.pixels.p90),
        match cell.agreement {
            _ if !cell.passed() => PageCell::new("WRONG"),
            Some(_) => PageCell { class: "good", ..PageCell::new("right") },
            None => absent(),
        },
        number(ErrorMeasure::Flip.show(error.flip), error.flip),
        PageCell::new(mark),
        megabytes(cell.memory_bytes),
        median,
        time(&|span| (short(mrays(span)), mrays(span))),
        number(pixels(error.pixels.median), error.pixels.median),
        number(pixels(error.pixels.p99), error.pixels.p99),
        number(pixels(error.pixels.max), error.pixels.max),
        number(units(error.scene.p90), error.scene.p90),
        number(format!("{:.3}", 100.0 * error.disagreement), error.disagreement),
        number(short(error.normal_degrees.p90), error.normal_degrees.p90),
        number(format!("{:.4}", error.color), error.color),
        megabytes(cell.disk_bytes),
    ]
}

/// Mesh units, which may be of any size.
fn units(value: f64) -> String {
    if value >= 0.1 || value == 0.0 { short(value) } else { format!("{value:.2e}") }
}

/// The cell that names the row: octree, beam, where rays end, and engine.
fn setting(report: &SweepReport, scene: &SceneSweep, cell: &Cell) -> PageCell {
    let engine = super::plot::engine(report, cell);
    let Some(levels) = scene.levels(cell) else {
        return PageCell { small: vec![engine], sort: String::new(), ..PageCell::new("triangles") };
    };
    let kind = if cell.contours { "contours" } else { "cubes" };
    let beam = if cell.beam { "beam" } else { "no beam" };
    // Sorted by levels, then by the rest.
    let sort = format!("{levels:02} {kind} {beam} {:06.2} {engine}", cell.max_voxel_pixels);
    let end = match cell.max_voxel_pixels {
        0.0 => "ends at leaves".to_string(),
        pixels => format!("ends at {pixels} px"),
    };
    PageCell {
        text: format!("{levels} levels, {kind}"),
        sort,
        small: vec![format!("{beam}, {end}"), engine],
        class: "",
    }
}
