//! The tables of `esvo bench format`, from a [`FormatReport`].

use super::{FormatReport, Timed};
use crate::text::{TextTable, short};

/// The record as aligned text for a terminal.
pub fn to_text(report: &FormatReport) -> String {
    let mut parts = vec![header(report).join("\n") + "\n"];
    parts.extend(tables(report).iter().map(TextTable::to_text));
    parts.join("\n")
}

/// The record as Markdown.
pub fn to_markdown(report: &FormatReport) -> String {
    let mut out = format!("# esvo bench format, {}\n\n", report.machine.date);
    for line in header(report) {
        out += &format!("- {line}\n");
    }
    for table in tables(report) {
        out += &format!("\n{}", table.to_markdown());
    }
    out
}

fn header(report: &FormatReport) -> Vec<String> {
    let m = &report.machine;
    vec![
        format!("{}, one of {} threads, {}", m.cpu, m.threads, m.os),
        format!("commit {}, {}, {} build, {:.0} s", m.commit, m.rustc, m.profile, report.seconds),
        "Files are in the page cache. MB are 10^6 bytes. Each figure is that of the best run, followed by the median."
            .into(),
    ]
}

/// Megabytes per second of the best run, and their median.
fn rates(bytes: u64, time: &Timed) -> [String; 2] {
    [time.best(), time.median()].map(|seconds| short(megabytes(bytes) / seconds))
}

fn megabytes(bytes: u64) -> f64 {
    bytes as f64 / 1e6
}

fn tables(report: &FormatReport) -> Vec<TextTable> {
    vec![octrees(report), storage(report), validation(report), access(report)]
}

fn octrees(report: &FormatReport) -> TextTable {
    let head = ["octree", "from", "levels", "voxels", "descriptors", "contours", "blocks", "MB"];
    let mut table = TextTable::new("Octrees", 2, &head);
    for row in &report.octrees {
        let counts = [row.levels.into(), row.voxels, row.descriptors, row.contours, row.blocks];
        let mut cells = vec![row.name.clone(), row.source.clone()];
        cells.extend(counts.iter().map(u64::to_string));
        cells.push(short(megabytes(row.image_bytes)));
        table.rows.push(cells);
    }
    table
}

fn storage(report: &FormatReport) -> TextTable {
    let head = ["stored", "MB", "bytes per voxel", "of raw", "write MB/s", "median", "read MB/s", "median"];
    let mut table = TextTable::new("Storage", 1, &head);
    let (Some(octree), Some(raw)) = (report.octrees.first(), report.storage.first()) else { return table };
    table.notes.push(format!("The octree with {}.", octree.name));
    table.notes.push(
        "MB/s count bytes of the image in memory. Writing is to memory; reading is block by block, with checksums. \
         Parts: blocks in parts by level, as streams of fields, each compressed by itself (spec 4.3, 4.4)."
            .into(),
    );
    for row in &report.storage {
        let [write, write_median] = rates(octree.image_bytes, &row.write);
        let [read, read_median] = rates(octree.image_bytes, &row.read);
        table.rows.push(vec![
            match (row.zstd, row.parts) {
                (None, _) => "raw".into(),
                (Some(level), false) => format!("zstd {level}"),
                (Some(level), true) => format!("parts, zstd {level}"),
            },
            short(megabytes(row.file_bytes)),
            format!("{:.2}", row.bytes_per_voxel),
            format!("{:.0} %", 100.0 * row.file_bytes as f64 / raw.file_bytes as f64),
            write,
            write_median,
            read,
            read_median,
        ]);
    }
    table
}

fn validation(report: &FormatReport) -> TextTable {
    let mut table = TextTable::new("Validation", 1, &["file", "MB", "seconds", "median", "MB/s", "median"]);
    table.notes.push("All rules of the specification, including checksums. \"Checksums alone\": opening the file by mapping and comparing \
         the checksums of its blocks, as casters do on loading."
            .into());
    for row in &report.validation {
        let [best, median] = rates(row.file_bytes, &row.time);
        let seconds = [row.time.best(), row.time.median()].map(|s| format!("{s:.3}"));
        let [shortest, usual] = seconds;
        table.rows.push(vec![row.name.clone(), short(megabytes(row.file_bytes)), shortest, usual, best, median]);
    }
    table
}

fn access(report: &FormatReport) -> TextTable {
    let large = &report.large;
    let head = ["what", "ms", "median", "bytes read", "reads", "pages of 4 KiB"];
    let mut table = TextTable::new("A large file", 1, &head);
    table.notes.push(format!(
        "{} MB, {} blocks of {} kB on average, {} objects: copies of the first octree.",
        short(megabytes(large.file_bytes)),
        large.blocks,
        short(large.file_bytes as f64 / 1e3 / large.blocks.max(1) as f64),
        large.objects
    ));
    table.notes.push(
        "Pages of the mapped file: those that the system has mapped, including neighbours that it maps too.".into(),
    );
    let count = |n: Option<u64>| n.map_or("-".into(), |n| n.to_string());
    for row in &large.access {
        table.rows.push(vec![
            row.what.clone(),
            format!("{:.3}", row.time.best() * 1e3),
            format!("{:.3}", row.time.median() * 1e3),
            count(row.bytes),
            count(row.reads),
            count(row.pages),
        ]);
    }
    table
}
