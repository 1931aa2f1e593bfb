//! The tables of `esvo bench serve`, from a [`ServeReport`].

use super::{ServeReport, ServedFile};
use crate::text::{TextTable, short};

/// The record as aligned text for a terminal.
pub fn to_text(report: &ServeReport) -> String {
    let mut parts = vec![header(report).join("\n") + "\n"];
    parts.extend(tables(report).iter().map(TextTable::to_text));
    parts.join("\n")
}

/// The record as Markdown.
pub fn to_markdown(report: &ServeReport) -> String {
    let mut out = format!("# esvo bench serve, {}\n\n", report.machine.date);
    for line in header(report) {
        out += &format!("- {line}\n");
    }
    for table in tables(report) {
        out += &format!("\n{}", table.to_markdown());
    }
    out
}

fn header(report: &ServeReport) -> Vec<String> {
    let m = &report.machine;
    let [width, height] = report.size;
    vec![
        format!("{}, {} threads, {}", m.cpu, m.threads, m.os),
        format!("commit {}, {}, {} build, {:.0} s", m.commit, m.rustc, m.profile, report.seconds),
        format!(
            "A server on the loopback device: {} ms before each answer, {} Mbit/s. {}, {width}x{height}.",
            report.delay_ms, report.mbit, report.camera
        ),
        "MB are 10^6 bytes. \"16 px\": rays end at voxels of 16 pixels; \"leaves\": at leaves only.".into(),
    ]
}

fn megabytes(bytes: u64) -> String {
    short(bytes as f64 / 1e6)
}

fn count(number: Option<u64>) -> String {
    number.map_or("-".into(), |number| number.to_string())
}

fn tables(report: &ServeReport) -> Vec<TextTable> {
    let mut all = vec![summary(report)];
    all.extend(report.served.iter().map(of_file));
    all
}

/// What there is to read for each picture, one column for each file.
fn summary(report: &ServeReport) -> TextTable {
    let names: Vec<String> = report.served.iter().map(|file| format!("{}, {}", file.name, file.stored)).collect();
    let mut head = vec!["picture"];
    head.extend(names.iter().map(String::as_str));
    let mut table = TextTable::new("MB / requests / seconds, from the address on", 1, &head);
    table.notes.push(
        "The head, or the tables, included. No seconds: it was not read, as that would take too long; what it needs follows from the tables."
            .into(),
    );
    let mut whats: Vec<&str> = Vec::new();
    for row in report.served.iter().flat_map(|file| &file.rows) {
        if !whats.contains(&&row.what[..]) {
            whats.push(&row.what);
        }
    }
    for what in whats {
        let mut cells = vec![what.to_owned()];
        cells.extend(report.served.iter().map(|file| {
            file.rows.iter().find(|row| row.what == what).map_or("-".into(), |row| {
                let seconds = row.seconds.map_or("-".into(), short);
                format!("{} / {} / {seconds}", megabytes(row.bytes), count(row.requests))
            })
        }));
        table.rows.push(cells);
    }
    table
}

fn of_file(file: &ServedFile) -> TextTable {
    let head =
        ["picture", "MB", "requests", "seconds", "% of the file", "octree MB", "pixels that differ", "one level less"];
    let mut table = TextTable::new(format!("{}, {}", file.name, file.stored), 1, &head);
    table.notes.push(format!(
        "{} levels, {} voxels, {} MB; head of {} bytes.",
        file.levels,
        file.voxels,
        megabytes(file.file_bytes),
        file.head_bytes
    ));
    for row in &file.rows {
        table.rows.push(vec![
            row.what.clone(),
            megabytes(row.bytes),
            count(row.requests),
            row.seconds.map_or("-".into(), short),
            format!("{:.2}", 100.0 * row.bytes as f64 / file.file_bytes.max(1) as f64),
            row.octree_bytes.map_or("-".into(), megabytes),
            count(row.different),
            count(row.control),
        ]);
    }
    table
}
