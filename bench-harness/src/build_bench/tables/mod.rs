//! The tables of `esvo bench build`, from a [`BuildReport`]: the paper's Table 1 and comparisons with the authors' builder.

mod attributes;
mod authors;
mod beside;
mod builds;
mod errors;
mod saved;
mod table1;

use super::peers::Authors;
use super::record::{BuildReport, BuildRow, SceneBuilds};
use crate::paper_bench::paper::Paper;
use crate::text::{Document, TextTable, short};
use attributes::attributes;
use authors::beside_authors;
use beside::beside;
use builds::builds;
use errors::errors;
use saved::saved;
use table1::table1;

/// Every table of a report, in the order of printing.
fn tables(report: &BuildReport) -> Vec<TextTable> {
    let (paper, authors) = (Paper::figures(), Authors::figures());
    let mut tables = beside_authors(report, &authors);
    tables.extend([
        builds(report),
        beside(report),
        table1(report, &paper),
        saved(report),
        errors(report),
        attributes(report),
    ]);
    tables.retain(|t| !t.rows.is_empty());
    tables
}

/// All tables as aligned text for a terminal.
pub fn to_text(report: &BuildReport) -> String {
    document(report).to_text()
}

/// All tables as Markdown.
pub fn to_markdown(report: &BuildReport) -> String {
    document(report).to_markdown()
}

fn document(report: &BuildReport) -> Document<'_> {
    Document {
        title: format!("esvo bench build, {}", report.machine.date),
        header: header(report),
        tables: tables(report),
        left_out: report.left_out.iter().map(|l| [&*l.what, &*l.reason]).collect(),
        credits: report.scenes.iter().map(|s| [&*s.name, &*s.credit, &*s.identity]).collect(),
    }
}

fn header(report: &BuildReport) -> Vec<String> {
    let m = &report.machine;
    let samples = report.scenes.iter().flat_map(|s| &s.rows).flat_map(|r| &r.samples);
    let load = samples.map(|s| s.load).fold(0.0, f64::max);
    let mut lines = vec![
        format!("{}, {} threads, {} MiB, {}", m.cpu, m.threads, m.memory_mb, m.os),
        format!(
            "commit {}, {}, {} build, matrix `{}`, {:.0} s",
            m.commit, m.rustc, m.profile, report.matrix.name, report.seconds
        ),
        format!(
            "limits: {} GB (10^9 bytes) of memory, {} GB of disk, {:.0} s for each build",
            report.matrix.memory_gb, report.matrix.disk_gb, report.matrix.build_limit_seconds
        ),
    ];
    if !report.complete {
        lines.push("not finished: the run was stopped, and these are the rows that it had measured".into());
    }
    if load > 1.5 {
        lines.push(format!(
            "the machine was not idle: its load before a build was up to {load:.1}; seconds are too long"
        ));
    }
    lines
}

/// All octrees with their scenes.
pub(super) fn rows(report: &BuildReport) -> impl Iterator<Item = (&SceneBuilds, &BuildRow)> {
    report.scenes.iter().flat_map(|s| s.rows.iter().map(move |r| (s, r)))
}

/// A count in millions, without a unit.
pub(super) fn millions(count: u64) -> String {
    short(count as f64 / 1e6)
}

/// Theirs over ours, as `1.50 x`.
pub(super) fn ratio(theirs: f64, ours: f64) -> String {
    format!("{} x", short(theirs / ours))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::build_bench::record::tests::row;
    use crate::build_bench::{BuildMatrix, Contours, Limit, SCHEMA, SceneBuilds, Stopped};
    use crate::system::machine::Machine;
    use esvo_scenes::SceneVariant;

    /// A report of one scene, with made-up figures.
    pub(super) fn report() -> BuildReport {
        let stopped = |contours, levels, limit| Stopped { contours, levels, limit, why: "would".into() };
        let scene = SceneBuilds {
            name: "SIBENIK-D".into(),
            mesh: SceneVariant::Real,
            triangles: 73_564,
            identity: "verified".into(),
            credit: "somebody".into(),
            views: Vec::new(),
            size: [4, 3],
            rows: vec![
                row(10, Contours::On, [2.0, 0.1, 0.2]),
                row(10, Contours::Off, [1.5, 0.2, 0.2]),
                row(11, Contours::On, [700.0, 0.2, 0.2]),
            ],
            saved: Vec::new(),
            stopped: vec![stopped(Contours::Off, 11, Limit::Disk), stopped(Contours::On, 12, Limit::Build)],
        };
        BuildReport {
            schema: SCHEMA,
            machine: Machine::detect(),
            matrix: BuildMatrix::full_run(),
            scenes: vec![scene],
            left_out: Vec::new(),
            seconds: 1.0,
            complete: false,
            beside: None,
        }
    }

    #[test]
    fn a_report_that_is_not_finished_says_so_and_is_read_again() {
        let report = report();
        assert!(to_text(&report).contains("not finished"));
        let again: BuildReport = serde_json::from_str(&report.to_json()).unwrap();
        assert_eq!(again, report);
        assert!(!to_text(&BuildReport { complete: true, ..again }).contains("not finished"));
    }
}
