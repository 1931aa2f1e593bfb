//! The tables of `esvo bench needs`, from a [`NeedsReport`].

use super::{Case, NeedsReport, Variant};
use crate::text::{Document, TextTable, short};

/// The record as aligned text for a terminal.
pub fn to_text(report: &NeedsReport) -> String {
    document(report).to_text()
}

/// The record as Markdown.
pub fn to_markdown(report: &NeedsReport) -> String {
    document(report).to_markdown()
}

/// All tables, in the order of printing.
pub(crate) fn tables(report: &NeedsReport) -> Vec<TextTable> {
    let mut tables = vec![octrees(report)];
    tables.extend((0..report.engines.len()).map(|engine| times(report, engine)));
    tables
}

fn document(report: &NeedsReport) -> Document<'_> {
    let m = &report.machine;
    let mut header = vec![
        format!("{}, {} threads, {}", m.cpu, m.threads, m.os),
        format!("commit {}, {}, {} build, {:.0} s", m.commit, m.rustc, m.profile, report.seconds),
    ];
    header
        .extend(report.engines.iter().map(|row| format!("{}: {} ({})", row.name, row.device.name, row.device.detail)));
    Document {
        title: format!("esvo bench needs, {}", m.date),
        header,
        tables: tables(report),
        left_out: Vec::new(),
        credits: report
            .credits
            .iter()
            .map(|row| row.each_ref().map(String::as_str))
            .map(|[a, b, c]| [a, b, c])
            .collect(),
    }
}

fn yes(needed: bool) -> String {
    if needed { "needed" } else { "-" }.into()
}

fn title(case: &Case) -> Vec<String> {
    let kind = if case.needs.contours { "contours" } else { "cubes" };
    let end = if case.needs.sizes { "one pixel" } else { "leaves" };
    vec![case.scene.clone(), case.levels.to_string(), kind.into(), end.into()]
}

fn octrees(report: &NeedsReport) -> TextTable {
    let head = ["scene", "levels", "voxels", "rays end at", "contours", "far pointers", "sizes", "file MB", "cast MB"];
    let mut table = TextTable::new("What octree and rays need", 4, &head);
    table.notes =
        vec!["File: with colours and normals. Cast: descriptors, far pointers and contours in memory.".into()];
    for case in &report.cases {
        let mut row = title(case);
        row.extend([case.needs.contours, case.needs.far_pointers, case.needs.sizes].map(yes));
        row.extend([case.file_bytes, case.image_bytes].map(|bytes| short(bytes as f64 / 1e6)));
        table.rows.push(row);
    }
    table
}

fn times(report: &NeedsReport, engine: usize) -> TextTable {
    let head: Vec<&str> = ["scene", "levels", "voxels", "rays end at"]
        .into_iter()
        .chain(Variant::ALL.map(Variant::name))
        .chain(["other hits"])
        .collect();
    let mut table = TextTable::new(format!("Milliseconds per view, {}", report.engines[engine].name), 4, &head);
    let [width, height] = report.size;
    table.notes = vec![format!(
        "{width}x{height}. Median over the rounds ± half the distance between the quartiles; in brackets the time divided by that \
         with everything in. Nothing is left out that is needed."
    )];
    for case in &report.cases {
        let cell = |variant| case.cells.iter().find(|cell| cell.engine == engine && cell.variant == variant);
        let views = case.rays as f64 / f64::from(width * height);
        let all = cell(Variant::Everything).and_then(|cell| cell.milliseconds());
        let mut row = title(case);
        row.extend(Variant::ALL.map(|variant| {
            let (Some(time), Some(all)) = (cell(variant).and_then(|cell| cell.milliseconds()), all) else {
                return if variant.differs(case.needs) { "same code" } else { "needed" }.into();
            };
            let text = format!("{} ±{:.0} %", short(time.median / views), time.percent());
            if variant == Variant::Everything { text } else { format!("{text} ({:.3})", time.median / all.median) }
        }));
        let other: u64 =
            case.cells.iter().filter(|cell| cell.engine == engine).map(|cell| cell.agreement.different_voxel).sum();
        row.push(other.to_string());
        table.rows.push(row);
    }
    table
}
