//! Plots of effects through a bit volume: error against time.

use super::plot::{Axis, Legend, Line, Plot, Point, ROOM, SIZE, coordinate, order, plain};
use crate::shadow_bench::tables::{by_effect, on_front};
use crate::shadow_bench::{ErrorRow, ShadowReport};
use crate::text::short;
use crate::timing::least;

/// No error is drawn below the least one by this factor: an axis with a logarithm has no 0.
const BELOW: f64 = 0.25;
/// Marks of voxels, from the smallest.
const SHAPES: [&str; 4] = ["circle", "square", "diamond", "triangle"];

/// A plot of each scene and effect; without those that have no times.
pub(super) fn plots(report: &ShadowReport) -> Vec<Plot> {
    let effects = report.scenes.iter().flat_map(|scene| {
        by_effect(&scene.errors).into_iter().map(|(effect, rows)| (format!("{}: {effect}", scene.name), rows))
    });
    effects.filter_map(|(title, rows)| plot(title, &rows)).collect()
}

fn plot(title: String, rows: &[&ErrorRow]) -> Option<Plot> {
    let timed: Vec<&ErrorRow> =
        rows.iter().copied().filter(|row| least(&row.ms).is_finite() && least(&row.ms) > 0.0).collect();
    let percent = |row: &ErrorRow| 100.0 * row.rmse;
    let lowest = timed.iter().map(|row| percent(row)).filter(|error| *error > 0.0).fold(f64::INFINITY, f64::min);
    let floor = if lowest.is_finite() { BELOW * lowest } else { 1.0 };
    let area = [ROOM[0], ROOM[1], SIZE[0] - ROOM[2], SIZE[1] - ROOM[3]];
    let [left, top, right, bottom] = area;
    let x = Axis::new(timed.iter().map(|row| least(&row.ms)), left, right)?;
    let y = Axis::new(timed.iter().map(|row| percent(row).max(floor)), bottom, top)?;
    let mut sizes: Vec<f64> = timed.iter().map(|row| row.voxel_cm).filter(|size| *size > 0.0).collect();
    sizes.sort_by(f64::total_cmp);
    sizes.dedup();
    let shape = |size: f64| {
        sizes.iter().position(|other| *other == size).map_or("cross", |number| SHAPES[number % SHAPES.len()])
    };
    // What most rows of a size have in common: whether their rays begin in the picture is the effect's, not a shortcut.
    let begins = timed.iter().any(|row| row.screen);
    let mut points: Vec<Point> = Vec::new();
    for row in &timed {
        let usual = row.voxel_cm > 0.0 && row.step.is_none() && row.screen == begins;
        points.push(Point {
            x: coordinate(x.at(least(&row.ms))),
            y: coordinate(y.at(percent(row).max(floor))),
            class: if !usual {
                "plain"
            } else if row.smoothed {
                "tested"
            } else {
                "wide"
            }
            .into(),
            shape: shape(row.voxel_cm),
            name: String::new(),
            tip: tip(row),
            on_front: on_front(row, &timed),
            first: false,
            range: None,
        });
    }
    order(&mut points);
    let front = points.iter().filter(|point| point.on_front).map(|point| format!("{},{}", point.x, point.y));
    let mut legend: Vec<Legend> = sizes
        .iter()
        .map(|size| Legend { class: "wide".into(), shape: shape(*size), text: format!("{} cm", plain(*size)) })
        .collect();
    if timed.iter().any(|row| row.voxel_cm == 0.0) {
        legend.push(Legend { class: "plain".into(), shape: "cross", text: "octree".into() });
    }
    Some(Plot {
        title: format!("{title}, error against time"),
        width: SIZE[0],
        height: SIZE[1],
        area,
        x_title: "milliseconds a picture, all cores, least of the rounds".into(),
        y_title: "error to the octree, percent of full light".into(),
        x_ticks: x.ticks(),
        y_ticks: y.ticks(),
        lines: vec![Line { class: "front", points: front.collect::<Vec<_>>().join(" ") }],
        half: None,
        points,
        legend,
    })
}

/// What is shown of a row.
fn tip(row: &ErrorRow) -> Vec<String> {
    let what = match (row.voxel_cm, row.step) {
        (0.0, _) => "octree".to_owned(),
        (size, None) => format!("voxels of {} cm, every voxel", plain(size)),
        (size, Some(step)) => format!("voxels of {} cm, steps of {}", plain(size), plain(step)),
    };
    let begins = if row.screen { ", begin in the picture" } else { "" };
    let smoothed = if row.smoothed { ", smoothed" } else { "" };
    vec![
        what,
        format!("rays for each pixel: {}{begins}{smoothed}", row.rays),
        format!("{} ms", short(least(&row.ms))),
        format!(
            "error {} percent to the octree, {} to the triangles; FLIP {}",
            short(100.0 * row.rmse),
            short(100.0 * row.rmse_triangles),
            short(row.flip)
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(voxel_cm: f64, ms: f64, rmse: f64) -> ErrorRow {
        ErrorRow {
            effect: "fog".into(),
            voxel_cm,
            step: None,
            rays: 4,
            screen: true,
            smoothed: false,
            ms: vec![2.0 * ms, ms],
            rmse,
            rmse_triangles: 0.5,
            flip: 0.25,
        }
    }

    #[test]
    fn settings_are_drawn_within_the_axes_and_the_best_are_joined() {
        let smoothed = ErrorRow { smoothed: true, ..row(10.0, 3.0, 0.01) };
        let steps = ErrorRow { step: Some(2.0), ..row(5.0, 8.0, 0.5) };
        let rows = [row(0.0, 9.0, 0.0), row(5.0, 4.0, 0.02), row(10.0, 2.0, 0.1), smoothed, steps, row(5.0, 0.0, 0.1)];
        let plot = plot("FLOOR: fog".into(), &rows.iter().collect::<Vec<_>>()).unwrap();
        assert_eq!(plot.title, "FLOOR: fog, error against time");
        let [left, top, right, bottom] = plot.area;
        for point in &plot.points {
            let at: [f64; 2] = [point.x.parse().unwrap(), point.y.parse().unwrap()];
            assert!((left..=right).contains(&at[0]) && (top..=bottom).contains(&at[1]), "{at:?}");
        }
        // From the left: 10 cm, smoothed, 5 cm, steps, octree. The row without a time is not there.
        let looks: Vec<_> = plot.points.iter().map(|point| (&point.class[..], point.shape, point.on_front)).collect();
        let expected = [
            ("wide", "square", true),
            ("tested", "square", true),
            ("wide", "circle", false),
            ("plain", "circle", false),
            ("plain", "cross", true),
        ];
        assert_eq!(looks, expected);
        assert_eq!(plot.lines[0].points.split(' ').count(), 3);
        // No error lies lowest.
        let y = |index: usize| plot.points[index].y.parse::<f64>().unwrap();
        assert!((0..4).all(|index| y(index) < y(4)));
        let words: Vec<_> = plot.legend.iter().map(|entry| &entry.text[..]).collect();
        assert_eq!(words, ["5 cm", "10 cm", "octree"]);
        assert_eq!(plot.points[3].tip[0], "voxels of 5 cm, steps of 2");
        assert_eq!(plot.points[1].tip[1], "rays for each pixel: 4, begin in the picture, smoothed");
    }

    #[test]
    fn without_times_there_is_no_plot() {
        assert!(plot("FLOOR: fog".into(), &[&row(5.0, 0.0, 0.1)]).is_none());
        assert!(plot("FLOOR: fog".into(), &[]).is_none());
    }
}
