//! Table 1 and Table 2 as comma-separated values: one line for each figure.

use esvo_core::DeviceKind;

use crate::paper_bench::figures::{Rate, RateCell, SizeRow, rates, sizes};
use crate::paper_bench::matrix::Variant;
use crate::paper_bench::paper::Paper;
use crate::paper_bench::report::PaperReport;
use crate::text::csv_field;

/// The columns.
const HEAD: [&str; 18] = [
    "table",
    "scene",
    "mesh",
    "triangles",
    "engine",
    "device",
    "cast",
    "levels",
    "width",
    "height",
    "quantity",
    "unit",
    "passed",
    "value",
    "lower_quartile",
    "upper_quartile",
    "paper",
    "ratio",
];

/// One line: a figure and what it is of. What does not apply is empty.
#[derive(Default)]
struct Line<'a> {
    table: u32,
    scene: &'a str,
    mesh: &'a str,
    triangles: Option<u64>,
    engine: &'a str,
    device: &'a str,
    cast: &'a str,
    levels: Option<u32>,
    size: Option<[u32; 2]>,
    quantity: &'a str,
    unit: &'a str,
    passed: Option<bool>,
    value: Option<f64>,
    quartiles: Option<[f64; 2]>,
    paper: Option<f64>,
}

impl Line<'_> {
    fn text(&self) -> String {
        fn shown(x: Option<impl ToString>) -> String {
            x.map_or(String::new(), |x| x.to_string())
        }
        let fields: [String; HEAD.len()] = [
            self.table.to_string(),
            csv_field(self.scene),
            csv_field(self.mesh),
            shown(self.triangles),
            self.engine.into(),
            self.device.into(),
            self.cast.into(),
            shown(self.levels),
            shown(self.size.map(|s| s[0])),
            shown(self.size.map(|s| s[1])),
            self.quantity.into(),
            self.unit.into(),
            shown(self.passed),
            shown(self.value),
            shown(self.quartiles.map(|q| q[0])),
            shown(self.quartiles.map(|q| q[1])),
            shown(self.paper),
            shown(self.value.zip(self.paper).map(|(own, paper)| own / paper)),
        ];
        fields.join(",") + "\n"
    }
}

/// Every figure of Table 1 and Table 2 with the paper's and the ratio, after a line with the names of the columns. Numbers are as they
/// were computed. Times of engines whose answers are wrong are empty, as are the paper's figures where they are not compared.
pub fn to_csv(report: &PaperReport) -> String {
    let paper = Paper::figures();
    let mut out = HEAD.join(",") + "\n";
    for row in sizes(report, &paper) {
        table1(&row, &mut out);
    }
    for device in &report.devices {
        let kind = match device.kind {
            DeviceKind::Cpu => "cpu",
            DeviceKind::Gpu => "gpu",
            DeviceKind::SoftwareGpu => "software-gpu",
        };
        for row in rates(report, &paper, device) {
            for cell in &row.cells {
                let levels = row.levels.filter(|_| cell.variant != Variant::Triangles);
                let line = || Line {
                    table: 2,
                    scene: &row.scene,
                    mesh: row.mesh.title(),
                    engine: device.backend.name(),
                    device: kind,
                    cast: cell.variant.title(),
                    levels,
                    size: Some(row.size),
                    ..Line::default()
                };
                table2(cell, &line, &mut out);
            }
            if let Some(spread) = row.filter {
                let line = Line {
                    table: 2,
                    scene: &row.scene,
                    mesh: row.mesh.title(),
                    engine: device.backend.name(),
                    device: kind,
                    cast: "filter",
                    levels: row.levels,
                    size: Some(row.size),
                    quantity: "filter time",
                    unit: "ms",
                    value: Some(spread.median),
                    quartiles: Some([spread.lower_quartile, spread.upper_quartile]),
                    ..Line::default()
                };
                out += &line.text();
            }
        }
    }
    out
}

fn table1(row: &SizeRow, out: &mut String) {
    for (&levels, cell) in &row.cells {
        let paper = row.paper.get(&levels);
        let largest = row.largest().is_some_and(|(largest, _)| largest == levels);
        let line = |quantity, unit, value, paper| Line {
            table: 1,
            scene: &row.scene,
            mesh: row.mesh.title(),
            triangles: Some(row.triangles),
            cast: row.kind(),
            levels: Some(levels),
            quantity,
            unit,
            value: Some(value),
            paper,
            ..Line::default()
        };
        *out += &line("memory", "MiB", cell.mib, paper.map(|p| p[0])).text();
        *out += &line("build time", "s", cell.seconds, paper.map(|p| p[1])).text();
        // The paper has it of its largest octree alone.
        let theirs = row.paper_bytes.map(|(bytes, _)| bytes).filter(|_| largest);
        *out += &line("bytes per voxel", "B", cell.bytes_per_voxel(), theirs).text();
    }
}

fn table2<'a>(cell: &RateCell, line: &dyn Fn() -> Line<'a>, out: &mut String) {
    let (passed, spread) = match cell.rate {
        Rate::Absent => return,
        Rate::Wrong => (false, None),
        Rate::Measured(spread) => (true, Some(spread)),
    };
    let rate = Line {
        quantity: "rate",
        unit: "Mrays/s",
        passed: Some(passed),
        value: spread.map(|s| s.median),
        quartiles: spread.map(|s| [s.lower_quartile, s.upper_quartile]),
        paper: cell.paper,
        ..line()
    };
    *out += &rate.text();
    let [median, p99] = [0, 1].map(|index| cell.error.map(|error| error[index]));
    let level = cell.hit_level;
    for (quantity, unit, value) in
        [("depth error median", "px", median), ("depth error p99", "px", p99), ("mean level hit", "", level)]
    {
        if value.is_some() {
            *out += &Line { quantity, unit, value, ..line() }.text();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_has_every_column() {
        let line = Line { table: 1, scene: "A, \"b\"", value: Some(3.0), paper: Some(2.0), ..Line::default() };
        assert_eq!(line.text(), "1,\"A, \"\"b\"\"\",,,,,,,,,,,,3,,,2,1.5\n");
        assert_eq!(Line::default().text().matches(',').count(), HEAD.len() - 1);
    }
}
