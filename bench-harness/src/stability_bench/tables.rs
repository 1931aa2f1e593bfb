//! The tables of `esvo bench stability`, from a [`StabilityReport`].

use esvo_core::DeviceKind;

use super::{Cell, StabilityReport};
use crate::text::{Document, TextTable};

/// The record as aligned text for a terminal.
pub fn to_text(report: &StabilityReport) -> String {
    document(report).to_text()
}

/// The record as Markdown.
pub fn to_markdown(report: &StabilityReport) -> String {
    document(report).to_markdown()
}

/// All tables, in the order of printing.
pub(crate) fn tables(report: &StabilityReport) -> Vec<TextTable> {
    vec![by_octree(report), by_kind(report), symmetries(report), engines(report), meshes(report), controls(report)]
}

fn document(report: &StabilityReport) -> Document<'_> {
    let m = &report.machine;
    let mut header = vec![
        format!("{}, {} threads, {}", m.cpu, m.threads, m.os),
        format!("commit {}, {}, {} build, {:.0} s", m.commit, m.rustc, m.profile, report.seconds),
    ];
    for row in &report.engines {
        let Some(device) = &row.device else { continue };
        let software = device.kind == DeviceKind::SoftwareGpu;
        let software = if software { "software Vulkan, not a GPU: " } else { "" };
        header.push(format!("{}: {software}{} ({})", row.name, device.name, device.detail));
    }
    let failures = report.failures();
    let untested: Vec<_> =
        report.engines.iter().filter(|row| row.error.is_some()).map(|row| row.name.as_str()).collect();
    if !untested.is_empty() {
        header.push(format!("NOT TESTED: {}", untested.join(", ")));
    }
    header.push(if failures == 0 { "nothing failed".into() } else { format!("{failures} FAILED") });
    Document {
        title: format!("esvo bench stability, {}", m.date),
        header,
        tables: tables(report),
        left_out: (report.engines.iter())
            .filter_map(|row| row.error.as_deref().map(|error| [row.name.as_str(), error]))
            .collect(),
        credits: Vec::new(),
    }
}

/// A sum of cells.
struct Sum<'a> {
    cases: u64,
    hits: u64,
    failures: u64,
    iterations: u64,
    /// With the largest error, or the first with a failure.
    worst: Option<&'a Cell>,
}

impl<'a> Sum<'a> {
    fn of(cells: impl Iterator<Item = &'a Cell>) -> Self {
        let mut sum = Self { cases: 0, hits: 0, failures: 0, iterations: 0, worst: None };
        for cell in cells {
            sum.cases += cell.cases;
            sum.hits += cell.hits;
            sum.failures += cell.failures;
            sum.iterations = sum.iterations.max(cell.iterations);
            let rank = |cell: &Cell| (cell.failures > 0, cell.worst);
            if sum.worst.is_none_or(|worst| rank(cell) > rank(worst)) {
                sum.worst = Some(cell);
            }
        }
        sum
    }

    fn cells(&self) -> Vec<String> {
        let share = 100.0 * self.hits as f64 / self.cases.max(1) as f64;
        let case = self.worst.and_then(|cell| cell.worst_case.clone()).unwrap_or_default();
        vec![
            self.cases.to_string(),
            format!("{share:.0} %"),
            self.failures.to_string(),
            format!("{:.3}", self.worst.map_or(0.0, |cell| cell.worst)),
            case,
        ]
    }
}

fn by_octree(report: &StabilityReport) -> TextTable {
    let head = [
        "octree",
        "what is hard",
        "levels",
        "voxels",
        "rays",
        "hit",
        "failed",
        "worst error / bound",
        "case",
        "iterations",
        "bound",
    ];
    let mut table = TextTable::new("Octrees", 2, &head);
    table.notes = vec![
        "Hits of the reference caster against an oracle in double precision: the right voxel but for ties within the bound, no miss of what \
         is certainly hit, t within a derived bound, no more iterations than a derived bound. The case can be cast again: `esvo bench stability --replay CASE`."
            .into(),
    ];
    for set in &report.sets {
        let sum = Sum::of(report.cells.iter().filter(|cell| cell.set == set.name));
        let mut row = vec![set.name.clone(), set.about.clone(), set.levels.to_string(), set.voxels.to_string()];
        row.extend(sum.cells());
        row.extend([sum.iterations.to_string(), set.most_iterations.to_string()]);
        table.rows.push(row);
    }
    table
}

fn by_kind(report: &StabilityReport) -> TextTable {
    let head = ["rays", "number", "hit", "failed", "worst error / bound", "case"];
    let mut table = TextTable::new("Rays", 1, &head);
    table.notes = vec!["The same by kind of rays.".into()];
    let mut kinds: Vec<&str> = Vec::new();
    for cell in &report.cells {
        if !kinds.contains(&cell.kind.as_str()) {
            kinds.push(&cell.kind);
        }
    }
    for kind in kinds {
        let mut row = vec![kind.to_owned()];
        row.extend(Sum::of(report.cells.iter().filter(|cell| cell.kind == kind)).cells());
        table.rows.push(row);
    }
    table
}

fn symmetries(report: &StabilityReport) -> TextTable {
    let mut table = TextTable::new("Symmetries and leaks", 1, &["octree", "rays", "other voxel by a tie", "failed"]);
    table.notes = vec![
        "Octrees of cubes mirrored and with their axes exchanged, and rays with them: the voxel is the image of the voxel, but where \
         spans of voxels begin together within the bounds. The last row: rays from within a closed shell to its corners, edges \
         and faces, none of which may miss."
            .into(),
    ];
    for row in &report.symmetries {
        let numbers = [row.cases, row.ties, row.failures].map(|number| number.to_string());
        table.rows.push([vec![row.set.clone()], numbers.to_vec()].concat());
    }
    let (cases, misses) = (report.leaks.cases, report.leaks.misses);
    table.rows.push(vec!["a closed shell of 7 levels".into(), cases.to_string(), "-".into(), misses.to_string()]);
    table
}

fn engines(report: &StabilityReport) -> TextTable {
    let head = ["engine", "first that failed", "rays", "pixels", "other hits", "failed"];
    let mut table = TextTable::new("Engines", 2, &head);
    table.notes = vec![
        "Against the hits of the reference caster, voxel and every bit of t. Where a shading language allows other roundings, other hits \
         are judged by the oracle."
            .into(),
    ];
    for row in &report.engines {
        let first = row.first.clone().unwrap_or_else(|| "-".into());
        let numbers = [row.rays, row.pixels, row.different, row.wrong].map(|number| number.to_string());
        table.rows.push([vec![row.name.clone(), first], numbers.to_vec()].concat());
    }
    table
}

fn meshes(report: &StabilityReport) -> TextTable {
    let head = ["mesh", "what is hard", "contours", "levels", "rays", "holes", "beside", "farthest / diagonal"];
    let mut table = TextTable::new("Meshes", 3, &head);
    table.notes = vec![
        "Rays that hit the triangles, in double precision, hit the octree that was built of them, not behind (`holes`); and every hit is \
         within a voxel's diagonal of a triangle (`beside`)."
            .into(),
    ];
    for row in &report.meshes {
        table.rows.push(vec![
            row.name.clone(),
            row.about.clone(),
            if row.contours { "yes" } else { "no" }.into(),
            row.levels.to_string(),
            row.rays.to_string(),
            row.holes.to_string(),
            row.beside.to_string(),
            format!("{:.3}", row.worst),
        ]);
    }
    table
}

fn controls(report: &StabilityReport) -> TextTable {
    let mut table = TextTable::new("Mistakes on purpose", 2, &["mistake", "must be caught by", "hits", "caught"]);
    table.notes = vec!["Hits that were made wrong. A mistake of which nothing is caught fails the run.".into()];
    for control in &report.controls {
        let by = if control.by == "oracle" { "the oracle" } else { "the comparison of engines" };
        table.rows.push(vec![control.what.clone(), by.into(), control.cases.to_string(), control.caught.to_string()]);
    }
    table
}
