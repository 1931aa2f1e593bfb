//! Plots of voxelization: wrong voxels against time, and holes against the size of triangles.

use super::plot::{Axis, Legend, Line, Plot, Point, ROOM, SIZE, coordinate, order, plain};
use crate::text::short;
use crate::timing::least;
use crate::voxel_bench::plot::wrong_ppm;
use crate::voxel_bench::{CurvePoint, Grid, MethodRow, SceneVoxels, VoxelReport};

/// 0 is drawn below the least error by this factor: an axis with a logarithm has no 0.
const BELOW: f64 = 0.25;

/// A plot of each scene in its finest grid, and one of the sheets; without those that have nothing to show.
pub(super) fn plots(report: &VoxelReport) -> Vec<Plot> {
    let of_scenes = report.scenes.iter().filter_map(|scene| errors(scene, scene.grids.last()?));
    of_scenes.chain(holes(report)).collect()
}

/// What is drawn for an error: itself, or what stands for 0.
fn drawn(errors: impl Iterator<Item = f64>) -> impl Fn(f64) -> f64 {
    let least = errors.filter(|error| *error > 0.0).fold(f64::INFINITY, f64::min);
    let floor = if least.is_finite() { BELOW * least } else { 1.0 };
    move |error| error.max(floor)
}

fn errors(scene: &SceneVoxels, grid: &Grid) -> Option<Plot> {
    let timed: Vec<(&MethodRow, f64, f64)> = (grid.methods.iter())
        .map(|row| (row, least(&row.voxelize_ms), wrong_ppm(grid, row)))
        .filter(|(_, ms, _)| ms.is_finite() && *ms > 0.0)
        .collect();
    let drawn = drawn(timed.iter().map(|method| method.2));
    let [left, top, right, bottom] = area();
    let x = Axis::new(timed.iter().map(|method| method.1), left, right)?;
    let y = Axis::new(timed.iter().map(|method| drawn(method.2)), bottom, top)?;
    let mut points: Vec<Point> = Vec::new();
    for &(row, ms, wrong) in &timed {
        let (class, shape) = look(&row.letter);
        // On the front: no other method is as good in both, and better in one.
        let beaten = timed.iter().any(|o| o.1 <= ms && o.2 <= wrong && (o.1 < ms || o.2 < wrong));
        points.push(Point {
            x: coordinate(x.at(ms)),
            y: coordinate(y.at(drawn(wrong))),
            class: class.into(),
            shape,
            name: row.letter.clone(),
            tip: vec![
                format!("{} {}", row.letter, row.name),
                format!(
                    "{} ms on the device, {} to list voxels, {} on the processor",
                    short(ms),
                    short(least(&row.compact_ms)),
                    short(least(&row.host_ms))
                ),
                format!(
                    "{} parts per million wrong: {} cracks, {} holes, {} extra",
                    plain(wrong),
                    row.cracks,
                    row.holes,
                    row.extra
                ),
            ],
            on_front: !beaten,
            first: false,
            range: None,
        });
    }
    order(&mut points);
    let front = points.iter().filter(|point| point.on_front).map(|point| format!("{},{}", point.x, point.y));
    Some(Plot {
        title: format!("{} in a grid of {}^3: wrong voxels against time", scene.name, 1u32 << grid.level),
        width: SIZE[0],
        height: SIZE[1],
        area: area(),
        x_title: "milliseconds on the device, least of the rounds".into(),
        y_title: "wrong voxels, parts per million (none: lowest)".into(),
        x_ticks: x.ticks(),
        y_ticks: y.ticks(),
        lines: vec![Line { class: "front", points: front.collect::<Vec<_>>().join(" ") }],
        half: None,
        points,
        legend: legend(timed.iter().map(|(row, ..)| (&row.letter[..], Some(&row.name[..])))),
    })
}

fn holes(report: &VoxelReport) -> Option<Plot> {
    let percent = |point: &CurvePoint| 100.0 * point.holes as f64 / point.voxels.max(1) as f64;
    let drawn = drawn(report.curve.iter().map(percent));
    let [left, top, right, bottom] = area();
    let x = Axis::new(report.curve.iter().map(|point| point.edge), left, right)?;
    let y = Axis::new(report.curve.iter().map(|point| drawn(percent(point))), bottom, top)?;
    let mut letters: Vec<&str> = Vec::new();
    for point in &report.curve {
        if !letters.contains(&&point.letter[..]) {
            letters.push(&point.letter);
        }
    }
    let (mut points, mut lines): (Vec<Point>, Vec<Line>) = (Vec::new(), Vec::new());
    for letter in &letters {
        let (class, shape) = look(letter);
        let mut line: Vec<String> = Vec::new();
        for point in report.curve.iter().filter(|point| point.letter == *letter) {
            let at = [coordinate(x.at(point.edge)), coordinate(y.at(drawn(percent(point))))];
            line.push(at.join(","));
            let [x, y] = at;
            points.push(Point {
                x,
                y,
                class: class.into(),
                shape,
                name: String::new(),
                tip: vec![
                    format!("method {letter}, triangles with edges of {} voxels", short(point.edge)),
                    format!("{} percent holes: {} of {} voxels", plain(percent(point)), point.holes, point.voxels),
                    format!("{} are missing with the cracks", point.missing),
                ],
                on_front: false,
                first: false,
                range: None,
            });
        }
        lines.push(Line { class: if class == "wide" { "series wide" } else { "series" }, points: line.join(" ") });
    }
    order(&mut points);
    Some(Plot {
        title: "Holes in a sheet of equal triangles".into(),
        width: SIZE[0],
        height: SIZE[1],
        area: area(),
        x_title: "mean edge of a triangle in voxels".into(),
        y_title: "voxels without a pixel, percent (none: lowest)".into(),
        x_ticks: x.ticks(),
        y_ticks: y.ticks(),
        lines,
        half: None,
        points,
        legend: legend(letters.iter().map(|letter| (*letter, None))),
    })
}

fn area() -> [f64; 4] {
    [ROOM[0], ROOM[1], SIZE[0] - ROOM[2], SIZE[1] - ROOM[3]]
}

/// Class and shape of a method's points. Color tells which pixels are shaded: those with a sample in the triangle, or all that it touches,
/// or these with a test of the voxels.
fn look(letter: &str) -> (&'static str, &'static str) {
    match letter {
        "a" => ("plain", "circle"),
        "b" => ("plain", "square"),
        "e4" => ("plain", "diamond"),
        "e8" => ("plain", "cross"),
        "c" => ("wide", "circle"),
        "c'" => ("wide", "square"),
        "f" => ("wide", "diamond"),
        "d" => ("tested", "circle"),
        "f+" => ("tested", "diamond"),
        "g" => ("tested", "square"),
        _ => ("plain", "triangle"),
    }
}

fn legend<'a>(methods: impl Iterator<Item = (&'a str, Option<&'a str>)>) -> Vec<Legend> {
    let entry = |(letter, name): (&str, Option<&str>)| {
        let (class, shape) = look(letter);
        Legend { class: class.into(), shape, text: [letter, name.unwrap_or_default()].join(" ").trim_end().into() }
    };
    methods.map(entry).collect()
}

#[cfg(test)]
mod tests {
    use esvo_core::{Device, DeviceKind};

    use super::*;
    use crate::system::machine::Machine;
    use crate::voxel_bench::{SCHEMA, VoxelBenchOptions};

    fn row(letter: &str, ms: f64, holes: u64) -> MethodRow {
        MethodRow {
            letter: letter.into(),
            name: format!("method-{letter}"),
            tested: letter == "g",
            voxels: 1000 - holes,
            cracks: 0,
            holes,
            extra: 0,
            beyond_bound: 0,
            undecided: 0,
            fragments: 0,
            voxelize_ms: vec![2.0 * ms, ms],
            compact_ms: vec![0.5],
            host_ms: vec![0.25],
            bytes: 0,
            tiles: 1,
            tiles_of_grid: 1,
        }
    }

    fn report(methods: Vec<MethodRow>) -> VoxelReport {
        let grid = Grid { level: 5, voxels: 1000, exact_ms: vec![9.0], build_ms: 20.0, mean_edge: 2.0, methods };
        let scene = SceneVoxels {
            name: "FLOOR".into(),
            identity: String::new(),
            credit: String::new(),
            triangles: 7,
            grids: vec![Grid { level: 4, ..grid.clone() }, grid],
        };
        let point = |edge: f64, letter: &str, holes: u64| CurvePoint {
            edge,
            letter: letter.into(),
            voxels: 100,
            missing: 50,
            holes,
        };
        VoxelReport {
            schema: SCHEMA,
            machine: Machine::detect(),
            options: VoxelBenchOptions::default(),
            device: Device { name: "d".into(), kind: DeviceKind::SoftwareGpu, detail: String::new() },
            left_out: Vec::new(),
            scenes: vec![scene],
            curve: vec![point(0.5, "b", 40), point(2.0, "b", 10), point(0.5, "c", 0), point(2.0, "c", 0)],
            pictures: Vec::new(),
            seconds: 1.0,
        }
    }

    #[test]
    fn methods_are_drawn_within_the_axes_and_the_best_are_joined() {
        let plots = plots(&report(vec![row("a", 1.0, 400), row("b", 2.0, 500), row("g", 4.0, 0), row("d", 8.0, 0)]));
        assert_eq!(plots.len(), 2);
        for plot in &plots {
            let [left, top, right, bottom] = plot.area;
            for point in &plot.points {
                let at: [f64; 2] = [point.x.parse().unwrap(), point.y.parse().unwrap()];
                assert!((left..=right).contains(&at[0]) && (top..=bottom).contains(&at[1]), "{at:?}");
            }
            assert_eq!(plot.points.iter().filter(|point| point.first).count(), 1);
        }
        let errors = &plots[0];
        assert_eq!(errors.title, "FLOOR in a grid of 32^3: wrong voxels against time");
        let names = |on_front: bool| -> String {
            errors.points.iter().filter(|point| point.on_front == on_front).map(|point| &point.name[..]).collect()
        };
        assert_eq!((names(true), names(false)), ("ag".into(), "bd".into()));
        assert_eq!(errors.lines[0].points.split(' ').count(), 2);
        assert!(errors.points[0].tip[2].contains("400000 parts per million wrong: 0 cracks, 400 holes"));
        // No error lies lowest: at the same height as the other method that has none, and below all others.
        let y = |name: &str| errors.points.iter().find(|point| point.name == name).unwrap().y.parse::<f64>().unwrap();
        assert!(y("g") == y("d") && y("g") > y("a") && y("a") > y("b"));
        let holes = &plots[1];
        assert_eq!((holes.points.len(), holes.lines.len(), holes.legend.len()), (4, 2, 2));
        assert_eq!(holes.lines.iter().map(|line| line.class).collect::<Vec<_>>(), ["series", "series wide"]);
    }

    #[test]
    fn without_times_and_sheets_there_is_no_plot() {
        let empty = VoxelReport { curve: Vec::new(), ..report(vec![row("a", 0.0, 400)]) };
        assert!(plots(&empty).is_empty());
        // The files beside a record neither.
        assert!(crate::voxel_bench::to_svg(&empty).is_err() && crate::voxel_bench::curve_to_svg(&empty).is_err());
        assert!(crate::voxel_bench::to_svg(&report(Vec::new())).is_err());
        assert!(crate::voxel_bench::to_svg(&report(vec![row("a", 1.0, 0)])).unwrap().contains("FLOOR"));
    }
}
