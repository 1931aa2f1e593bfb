//! A sweep as comma-separated values: one line for each setting.

use super::errors::ErrorMeasure;
use super::record::{Cell, SceneSweep, SweepReport};
use super::tables::{Among, fronts};
use crate::error::depth::Summary;
use crate::text::csv_field;

/// The columns.
const HEAD: [&str; 37] = [
    "scene",
    "engine",
    "octree",
    "levels",
    "beam",
    "max_voxel_pixels",
    "width",
    "height",
    "ms_least",
    "ms_median",
    "mrays_per_s",
    "memory_bytes",
    "disk_bytes",
    "front_depth",
    "front_flip",
    "passed",
    "rays",
    "both_hit",
    "holes",
    "too_many",
    "strange",
    "disagreement",
    "pixels_median",
    "pixels_p90",
    "pixels_p99",
    "pixels_mean",
    "pixels_max",
    "units_median",
    "units_p90",
    "units_p99",
    "units_mean",
    "units_max",
    "normal_degrees_median",
    "normal_degrees_p90",
    "normal_degrees_p99",
    "color",
    "flip",
];

/// All settings of all scenes, after a line with the names of the columns. Numbers are as they were computed; those of settings
/// that were not timed are empty.
pub fn to_csv(report: &SweepReport) -> String {
    let mut out = HEAD.join(",") + "\n";
    for scene in &report.scenes {
        let [depth, flip] = ErrorMeasure::SHOWN.map(|measure| fronts(report, scene, measure, Among::All));
        for ((cell, depth), flip) in scene.cells.iter().zip(depth).zip(flip) {
            out += &(line(report, scene, cell, [depth, flip]).join(",") + "\n");
        }
    }
    out
}

fn line(report: &SweepReport, scene: &SceneSweep, cell: &Cell, [depth, flip]: [bool; 2]) -> Vec<String> {
    let kind = match cell.octree {
        None => "triangles",
        Some(_) if cell.contours => "contours",
        Some(_) => "cubical",
    };
    let ms = cell.frame_ms();
    let number = |x: Option<f64>| x.map_or(String::new(), |x| x.to_string());
    let error = &cell.error;
    let [width, height] = report.plan.size;
    let mut line = vec![
        csv_field(&scene.name),
        cell.engine.to_string(),
        kind.into(),
        scene.levels(cell).map_or(String::new(), |levels| levels.to_string()),
        cell.beam.to_string(),
        cell.max_voxel_pixels.to_string(),
        width.to_string(),
        height.to_string(),
        number(ms.map(|ms| ms.least)),
        number(ms.map(|ms| ms.rounds.median)),
        number(ms.map(|ms| report.pixels() as f64 / ms.least / 1e3)),
        cell.memory_bytes.to_string(),
        cell.disk_bytes.to_string(),
        depth.to_string(),
        flip.to_string(),
        cell.passed().to_string(),
    ];
    line.extend([error.rays, error.both_hit, error.holes, error.too_many, error.strange].map(|n| n.to_string()));
    line.push(error.disagreement.to_string());
    let all = |s: &Summary| [s.median, s.p90, s.p99, s.mean, s.max].map(|x| x.to_string());
    line.extend(all(&error.pixels));
    line.extend(all(&error.scene));
    line.extend(all(&error.normal_degrees).into_iter().take(3));
    line.extend([error.color, error.flip].map(|x| x.to_string()));
    line
}

#[cfg(test)]
mod tests {
    use super::super::sample::{cell, report};
    use super::*;

    #[test]
    fn every_line_has_every_column() {
        let mut report =
            report(vec![cell(0, true, 2.0, [0.5, 0.1], vec![vec![0.002]]), cell(0, false, 2.0, [0.5, 0.1], vec![])]);
        let text = to_csv(&report);
        let lines: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
        assert_eq!(lines.len(), 3);
        assert!(lines.iter().all(|line| line.len() == HEAD.len()), "{text}");
        let column = |name: &str| HEAD.iter().position(|head| *head == name).unwrap();
        assert_eq!((lines[1][column("ms_least")], lines[2][column("ms_least")]), ("2", ""));
        assert_eq!((lines[1][column("pixels_p90")], lines[1][column("flip")]), ("0.5", "0.1"));
        assert_eq!((lines[1][column("front_flip")], lines[2][column("front_flip")]), ("true", "false"));
        report.scenes[0].name = "A: \"b\", c".into();
        assert!(to_csv(&report).contains("\n\"A: \"\"b\"\", c\",cpu"));
    }
}
