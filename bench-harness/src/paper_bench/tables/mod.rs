//! The tables of `esvo bench`, from a [`PaperReport`]: the paper's Table 1 and Table 2, errors and checks.

mod answers;
mod csv;
mod latex;
mod table1;
mod table2;

use crate::paper_bench::figures::sizes;
use crate::paper_bench::matrix::Variant;
use crate::paper_bench::paper::Paper;
use crate::paper_bench::report::PaperReport;
use crate::text::{Document, TextTable};
pub(crate) use answers::{checks, errors};
pub use csv::to_csv;
pub use latex::to_latex;
use table1::table1;
pub(crate) use table1::{bytes_by_kind, fits};
pub(crate) use table2::device_title;
use table2::table2;

/// Every table of a report, in the order of printing.
pub fn tables(report: &PaperReport) -> Vec<TextTable> {
    let paper = Paper::figures();
    let mut tables = vec![table1(report, &paper), fits(&sizes(report, &paper)), bytes_by_kind(report)];
    tables.extend(report.devices.iter().map(|device| table2(report, &paper, device)));
    tables.push(errors(report));
    tables.push(checks(report));
    tables.retain(|t| !t.rows.is_empty());
    tables
}

/// All tables as aligned text for a terminal.
pub fn to_text(report: &PaperReport) -> String {
    document(report).to_text()
}

/// All tables as Markdown.
pub fn to_markdown(report: &PaperReport) -> String {
    let mut out = document(report).to_markdown();
    for (scene, picture) in report.scenes.iter().flat_map(|s| s.pictures.iter().map(move |p| (s, p))) {
        out += &format!("\n![{}, {}]({picture})\n", scene.name, scene.mesh.title());
    }
    out
}

fn document(report: &PaperReport) -> Document<'_> {
    Document {
        title: format!("esvo bench, {}", report.machine.date),
        header: header(report),
        tables: tables(report),
        left_out: report.left_out.iter().map(|l| [&*l.what, &*l.reason]).collect(),
        credits: report.scenes.iter().map(|s| [&*s.name, &*s.credit, &*s.identity]).collect(),
    }
}

fn header(report: &PaperReport) -> Vec<String> {
    let m = &report.machine;
    let mut lines = vec![
        format!("{}, {} threads, {} MiB, {}", m.cpu, m.threads, m.memory_mb, m.os),
        format!(
            "commit {}, {}, {} build, matrix `{}`, {:.0} s",
            m.commit, m.rustc, m.profile, report.matrix.name, report.seconds
        ),
    ];
    for device in &report.devices {
        lines.push(format!("{}: {}", device.backend.name(), device_title(device)));
    }
    for slowed in &report.slowed {
        lines.push(format!(
            "SLOWED on purpose: {} takes {} % longer, to test esvo bench compare",
            slowed.engine, slowed.percent
        ));
    }
    lines.extend(report.failures().map(|(scene, check)| {
        let a = &check.agreement;
        let (what, theirs) = if check.variant == Variant::Triangles {
            ("triangle", "the exact caster")
        } else {
            ("voxel", "the reference caster")
        };
        let why = if a.pixels > 0 && a.share() <= a.allowed.share && a.other_size == 0 {
            let (most, allowed) = (a.largest_t_difference, a.allowed.t);
            format!("t is off by up to {most:.2e} from that of {theirs}, more than {allowed:.2e}")
        } else {
            format!("{} of {} pixels show another {what} than {theirs}", a.different_voxel, a.pixels)
        };
        format!("FAILED: {scene}, {}, {}: {why}", check.backend.name(), check.variant.title())
    }));
    lines
}
