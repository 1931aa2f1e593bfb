//! The tables of a sweep, from a [`SweepReport`].

use super::answers::{Answer, NOT_ANSWERED, answers};
use super::errors::{ErrorMeasure, pixels};
use super::pareto::front;
use super::record::{Cell, ExactKind, SceneSweep, SweepReport};
use crate::text::{Document, TextTable, or_dash, short};

/// The record as aligned text for a terminal: of the settings, those of the Pareto fronts and the triangles.
pub fn to_text(report: &SweepReport) -> String {
    document(report, false).to_text()
}

/// The record as Markdown, with all settings.
pub fn to_markdown(report: &SweepReport) -> String {
    document(report, true).to_markdown()
}

fn document(report: &SweepReport, all: bool) -> Document<'_> {
    let m = &report.machine;
    let [width, height] = report.plan.size;
    let mut header = vec![
        format!("{}, {} threads, {}", m.cpu, m.threads, m.os),
        format!("commit {}, {}, {} build, {:.0} s", m.commit, m.rustc, m.profile, report.seconds),
        format!("{width}x{height} pixels, up to {} views a scene, {} rounds", report.plan.views, report.plan.rounds),
    ];
    for device in &report.devices {
        let software = if device.is_software() { "software Vulkan, not a GPU: " } else { "" };
        header.push(format!("{}: {software}{} ({})", device.backend, device.name, device.detail));
    }
    let mut tables: Vec<_> = answers(report).iter().map(answer).collect();
    tables.push(octrees(report));
    tables.extend(report.scenes.iter().map(|scene| settings(report, scene, all)));
    Document {
        title: format!("esvo bench sweep, {}", m.date),
        header,
        tables,
        left_out: report.left_out.iter().map(|left| [left.what.as_str(), left.reason.as_str()]).collect(),
        credits: report.scenes.iter().map(|s| [s.name.as_str(), s.credit.as_str(), s.identity.as_str()]).collect(),
    }
}

fn answer(answer: &Answer) -> TextTable {
    let mut table = TextTable::new(answer.question, 4, &["scene", "engine", "error", "answer"]);
    table.notes.push(answer.rule.into());
    table.rows = answer.rows.iter().map(|row| row.to_vec()).collect();
    if table.rows.is_empty() {
        table.rows.push(vec!["-".into(), "-".into(), "-".into(), NOT_ANSWERED.into()]);
    }
    table
}

pub(crate) fn octrees(report: &SweepReport) -> TextTable {
    let head = ["scene", "octree", "levels", "million voxels", "memory MB", "file MB", "build s"];
    let mut table = TextTable::new("Octrees", 2, &head);
    table
        .notes
        .push("MB are 10^6 bytes. The file is uncompressed. Without seconds: the octree was in the cache.".into());
    for scene in &report.scenes {
        for row in &scene.octrees {
            let kind = if row.contours { "contours" } else { "cubical" };
            table.rows.push(vec![
                scene.name.clone(),
                kind.into(),
                row.levels.to_string(),
                format!("{:.2}", row.voxels as f64 / 1e6),
                megabytes(row.image_bytes),
                megabytes(row.file_bytes),
                or_dash(row.build_seconds.map(short)),
            ]);
        }
    }
    table
}

fn megabytes(bytes: u64) -> String {
    short(bytes as f64 / 1e6)
}

/// Whether each cell of a scene is on the front of its error and its time, among all cells or among octrees alone; of cells that were
/// not timed, and of engines that are software on the processor, none is.
pub(crate) fn fronts(report: &SweepReport, scene: &SceneSweep, measure: ErrorMeasure, among: Among) -> Vec<bool> {
    let software = |cell: &Cell| report.devices.iter().any(|d| d.backend == cell.engine && d.is_software());
    let counts = |cell: &Cell| !software(cell) && (among == Among::All || cell.octree.is_some());
    let point = |cell: &Cell| match cell.ms().filter(|_| counts(cell)) {
        Some(ms) => [ms, measure.of(&cell.error)],
        None => [f64::NAN; 2],
    };
    front(&scene.cells.iter().map(point).collect::<Vec<_>>())
}

/// What a setting competes with.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Among {
    /// Every setting, and triangles.
    All,
    /// The settings of octrees.
    Octrees,
}

pub(crate) fn settings(report: &SweepReport, scene: &SceneSweep, all: bool) -> TextTable {
    let head = [
        "engine",
        "octree",
        "levels",
        "beam",
        "ends at px",
        "front",
        "ms least",
        "ms median",
        "Mrays/s",
        "memory MB",
        "disk MB",
        "hit/miss %",
        "px median",
        "px 90 %",
        "px 99 %",
        "px max",
        "units 90 %",
        "normal ° median",
        "normal ° 90 %",
        "colour",
        "FLIP",
    ];
    let title = if all { "Settings" } else { "Settings on a Pareto front" };
    let mut table = TextTable::new(format!("{title}: {}", scene.name), 3, &head);
    let exact = match scene.exact {
        ExactKind::Triangles => "the triangles in double precision",
        ExactKind::Leaves => "the octree's own leaves, as its triangles are not known",
    };
    table.notes = vec![
        format!(
            "Errors are against {exact}. Front: d if no other octree has less depth error (90th percentile) in as little time, D if \
             triangles have not either; f and F the same for FLIP."
        ),
        "ms per frame: least is the mean over the views of the least time of each, by which settings are compared; the median over \
         the rounds has ± half the distance between the quartiles. hit/miss: rays that hit one of octree and triangles alone. px, \
         units: distance along the ray between the two hits, in footprints of a pixel and in mesh units. Normal: angle between \
         shading normals. Colour: mean absolute difference of the channels, 0 to 1."
            .into(),
    ];
    let marks = marks(report, scene);
    for (cell, mark) in scene.cells.iter().zip(marks) {
        if all || !mark.is_empty() || cell.octree.is_none() || !cell.passed() {
            table.rows.push(setting(report, scene, cell, mark));
        }
    }
    table
}

/// The fronts that each cell is on.
pub(crate) fn marks(report: &SweepReport, scene: &SceneSweep) -> Vec<String> {
    let mut marks = vec![String::new(); scene.cells.len()];
    for (measure, [octrees, all]) in ErrorMeasure::SHOWN.into_iter().zip([["d", "D"], ["f", "F"]]) {
        let among = |among| fronts(report, scene, measure, among);
        let (of_all, of_octrees) = (among(Among::All), among(Among::Octrees));
        for ((mark, of_all), of_octrees) in marks.iter_mut().zip(of_all).zip(of_octrees) {
            *mark += if of_all {
                all
            } else if of_octrees {
                octrees
            } else {
                ""
            };
        }
    }
    marks
}

fn setting(report: &SweepReport, scene: &SceneSweep, cell: &Cell, mark: String) -> Vec<String> {
    let kind = match cell.octree {
        None => "triangles",
        Some(_) if cell.contours => "contours",
        Some(_) => "cubical",
    };
    let of_octree = |text: String| if cell.octree.is_some() { text } else { "-".into() };
    let ms = cell.frame_ms();
    let timed = |show: &dyn Fn(super::record::FrameMs) -> String| match ms {
        _ if !cell.passed() => "WRONG".into(),
        Some(ms) => show(ms),
        None => "-".into(),
    };
    let error = &cell.error;
    vec![
        cell.engine.to_string(),
        kind.into(),
        or_dash(scene.levels(cell).map(|levels| levels.to_string())),
        of_octree(if cell.beam { "yes" } else { "no" }.into()),
        of_octree(cell.max_voxel_pixels.to_string()),
        mark,
        timed(&|ms| short(ms.least)),
        timed(&|ms| format!("{} ±{:.0} %", short(ms.rounds.median), ms.rounds.percent())),
        timed(&|ms| short(report.pixels() as f64 / ms.least / 1e3)),
        megabytes(cell.memory_bytes),
        megabytes(cell.disk_bytes),
        format!("{:.3}", 100.0 * error.disagreement),
        pixels(error.pixels.median),
        pixels(error.pixels.p90),
        pixels(error.pixels.p99),
        pixels(error.pixels.max),
        format!("{:.3e}", error.scene.p90),
        short(error.normal_degrees.median),
        short(error.normal_degrees.p90),
        format!("{:.4}", error.color),
        format!("{:.4}", error.flip),
    ]
}
