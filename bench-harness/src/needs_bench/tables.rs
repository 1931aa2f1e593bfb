//! The tables of `esvo bench needs`, from a [`NeedsReport`].

use esvo_core::reference::MAX_SCALE;

use super::{Case, NeedsReport, Unread, Variant};
use crate::text::{Document, TextTable, short};

/// Bytes of a frame of a kernel's stack: the parent's slot, and the `t` at which the ray leaves it.
pub(crate) const BYTES_PER_FRAME: u32 = 8;

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
    let mut tables = vec![octrees(report), bytes(report), unread(report)];
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
        left_out: report.left_out.iter().map(|left| [&*left.what, &*left.reason]).collect(),
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
    let head = ["scene", "levels", "voxels", "rays end at", "contours", "far pointers", "sizes"];
    let mut table = TextTable::new("What octree and rays need", 4, &head);
    for case in &report.cases {
        let mut row = title(case);
        row.extend([case.needs.contours, case.needs.far_pointers, case.needs.sizes].map(yes));
        table.rows.push(row);
    }
    table
}

/// The cases with an octree of their own: that rays end otherwise changes no byte.
fn each_octree(report: &NeedsReport) -> impl Iterator<Item = &Case> {
    report.cases.iter().filter(|case| !case.needs.sizes)
}

fn megabytes(bytes: u64) -> String {
    short(bytes as f64 / 1e6)
}

fn bytes(report: &NeedsReport) -> TextTable {
    let head = ["scene", "levels", "voxels", "file", "image", "upload", "stack, all frames", "stack, as needed"];
    let mut table = TextTable::new("Bytes", 3, &head);
    table.notes = vec![
        "File and image, in MB, have colours and normals. Upload: descriptors, far pointers and contours, which are all that a caster \
         reads. Stack: bytes of a ray in a GPU kernel, for octrees of any depth and for this one."
            .into(),
    ];
    for case in each_octree(report) {
        let mut row = title(case)[..3].to_vec();
        row.extend([case.file_bytes, case.image_bytes, case.upload_bytes].map(megabytes));
        row.extend([MAX_SCALE, case.levels].map(|frames| (frames * BYTES_PER_FRAME).to_string()));
        table.rows.push(row);
    }
    table
}

fn unread(report: &NeedsReport) -> TextTable {
    let head = ["scene", "levels", "voxels", "upload", "halves for contours", "headers", "gaps", "share of the upload"];
    let mut table = TextTable::new("What is not left out although nothing needs it", 3, &head);
    table.notes = [
        "Bytes of the upload that no caster reads, in MB: the half of each descriptor that is about contours, where there are none; page \
         headers and info sections; unused slots. They are kept because the bytes of a file are those that a caster reads.",
        "Of code: packets of the processor follow far pointers, test sizes and have all frames, whatever the octree needs; they test once for \
         all rays of a packet. Every caster counts the iterations of a ray, 4 of the 16 bytes of a hit. The text of a GPU kernel contains \
         all, behind constants that are false; the driver's compiler leaves it out.",
    ]
    .map(String::from)
    .to_vec();
    for case in each_octree(report).filter(|case| case.upload_bytes > 0) {
        let Unread { contour_halves, headers, gaps } = case.unread;
        let mut row = title(case)[..3].to_vec();
        row.extend([case.upload_bytes, contour_halves, headers, gaps].map(megabytes));
        let share = (contour_halves + headers + gaps) as f64 / case.upload_bytes as f64;
        row.push(format!("{:.1} %", 100.0 * share));
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
