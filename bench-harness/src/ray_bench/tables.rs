//! The tables of `esvo bench rays`, from a [`RayReport`].

use esvo_core::DeviceKind;

use super::{EngineRow, RayReport};
use crate::text::{Document, TextTable, short};

/// The record as aligned text for a terminal.
pub fn to_text(report: &RayReport) -> String {
    document(report).to_text()
}

/// The record as Markdown.
pub fn to_markdown(report: &RayReport) -> String {
    document(report).to_markdown()
}

/// All tables, in the order of printing.
pub(crate) fn tables(report: &RayReport) -> Vec<TextTable> {
    vec![sets(report), rates(report), costs(report), agreement(report)]
}

fn document(report: &RayReport) -> Document<'_> {
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
    let failed = |row: &'_ EngineRow| row.error.is_some();
    Document {
        title: format!("esvo bench rays, {}", m.date),
        header,
        tables: tables(report),
        left_out: (report.engines.iter().filter(|row| failed(row)))
            .map(|row| [row.name.as_str(), row.error.as_deref().unwrap_or_default()])
            .collect(),
        credits: vec![[&report.scene, &report.credit, &report.identity]],
    }
}

fn sets(report: &RayReport) -> TextTable {
    let mut table = TextTable::new("Rays", 1, &["rays", "number", "calls", "hit"]);
    let [width, height] = report.size;
    table.notes = vec![
        format!(
            "{}, {} levels with contours, {:.1} M voxels. The picture shows {} at {width}x{height}; its rays end at voxels of \
             one pixel, all others at leaves only.",
            report.scene,
            report.levels,
            report.voxels as f64 / 1e6,
            report.view
        ),
        "Shadow rays go from the picture's hits to a lamp in the middle of the root cube. Rays of ambient occlusion go from the hits into \
         the hemisphere around the normal, a twentieth of the diagonal of the mesh's bounds far; those of the diffuse bounce have no end. \
         Incoherent rays start anywhere in the bounds of the mesh, go in any direction and have no end."
            .into(),
    ];
    for set in &report.sets {
        let share = 100.0 * set.hits as f64 / set.rays.max(1) as f64;
        table.rows.push(vec![set.name.clone(), set.rays.to_string(), set.calls.to_string(), format!("{share:.1} %")]);
    }
    table
}

/// A table with a column for each set, and the cells that `show` makes of an engine and the index of a set.
fn by_engine(report: &RayReport, title: &str, show: impl Fn(&EngineRow, usize) -> Option<String>) -> TextTable {
    let head: Vec<&str> = ["engine"].into_iter().chain(report.sets.iter().map(|set| set.name.as_str())).collect();
    let mut table = TextTable::new(title, 1, &head);
    for row in report.engines.iter().filter(|row| !row.cells.is_empty()) {
        let cells = (0..report.sets.len()).map(|set| show(row, set).unwrap_or_else(|| "-".into()));
        table.rows.push([row.name.clone()].into_iter().chain(cells).collect());
    }
    table
}

fn rates(report: &RayReport) -> TextTable {
    let mut table = by_engine(report, "Millions of rays per second", |row, set| {
        let spread = row.cells.get(set)?.mrays(report.sets[set].rays)?;
        let percent = spread.percent();
        // Rates of lists that are cast one by one can be small.
        let median = if spread.median < 0.1 { format!("{:.4}", spread.median) } else { short(spread.median) };
        Some(format!("{median} ±{percent:.0} %"))
    });
    table.notes.push(
        "From the call to the last hit in memory. Median over the rounds, ± half the distance between the quartiles."
            .into(),
    );
    table
}

fn costs(report: &RayReport) -> TextTable {
    let mut table = by_engine(report, "Time per ray, that of the picture being 1", |row, set| {
        let rate = |set: usize| Some(row.cells.get(set)?.mrays(report.sets[set].rays)?.median);
        Some(short(rate(0)? / rate(set)?))
    });
    table.notes.push("On the same engine.".into());
    table
}

fn agreement(report: &RayReport) -> TextTable {
    let mut table = by_engine(report, "Rays that end elsewhere than the reference's", |row, set| {
        let found = row.cells.get(set)?.agreement;
        let failed = if found.passed() { "" } else { ", NOT ALLOWED" };
        Some(format!("{} ({:.1e}){failed}", found.different_voxel, found.largest_t_difference))
    });
    table.notes.push("In brackets: the largest difference of t among the others, in lengths of the direction.".into());
    table
}
