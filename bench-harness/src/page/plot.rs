//! A plot, which the template draws, and that of error against time of the settings of a scene.

use esvo_engines::EngineId;

use super::answers::setting;
use super::span::Span;
use crate::sweep_bench::SweepReport;
use crate::sweep_bench::errors::ErrorMeasure;
use crate::sweep_bench::record::{Cell, SceneSweep};
use crate::sweep_bench::tables::{Among, fronts};
use crate::text::short;

/// Size of a plot, and the room for axes: left, top, right, bottom.
pub(super) const SIZE: [f64; 2] = [620.0, 400.0];
pub(super) const ROOM: [f64; 4] = [58.0, 14.0, 14.0, 46.0];
/// Errors below that of the most exact octree by this factor are drawn there: an axis with a logarithm has no 0.
const BELOW: f64 = 0.25;

/// A plot.
pub(super) struct Plot {
    pub(super) title: String,
    pub(super) width: f64,
    pub(super) height: f64,
    /// The area between the axes: left, top, right, bottom.
    pub(super) area: [f64; 4],
    pub(super) x_title: String,
    pub(super) y_title: String,
    pub(super) x_ticks: Vec<Tick>,
    pub(super) y_ticks: Vec<Tick>,
    /// Lines behind the points.
    pub(super) lines: Vec<Line>,
    /// Where half a pixel is.
    pub(super) half: Option<String>,
    pub(super) points: Vec<Point>,
    pub(super) legend: Vec<Legend>,
}

/// A line.
pub(super) struct Line {
    /// `front`: a Pareto front. `series`: points of one kind, with the class of those that have not the ink's color.
    pub(super) class: &'static str,
    /// Points, as SVG has them.
    pub(super) points: String,
}

/// A tick of an axis.
pub(super) struct Tick {
    pub(super) at: String,
    pub(super) text: String,
}

/// A setting.
pub(super) struct Point {
    pub(super) x: String,
    pub(super) y: String,
    pub(super) class: String,
    pub(super) shape: &'static str,
    /// What is written beside it; empty: nothing.
    pub(super) name: String,
    /// Lines of what is shown when it is pointed at.
    pub(super) tip: Vec<String>,
    pub(super) on_front: bool,
    /// Whether the tabulator key goes to it: to one point of a plot, from which arrow keys go on.
    pub(super) first: bool,
    /// Of settings on the front, how far to the right the range of their times goes.
    pub(super) range: Option<String>,
}

/// An entry of the legend.
pub(super) struct Legend {
    pub(super) class: String,
    pub(super) shape: &'static str,
    pub(super) text: String,
}

/// An axis with a logarithm.
pub(super) struct Axis {
    low: f64,
    high: f64,
    from: f64,
    to: f64,
}

impl Axis {
    /// An axis from a coordinate of the picture to another, with room for these values; `None` if none is above 0.
    pub(super) fn new(values: impl Iterator<Item = f64>, from: f64, to: f64) -> Option<Self> {
        let values = values.filter(|v| *v > 0.0 && v.is_finite());
        let (low, high) = values.fold((f64::INFINITY, 0f64), |(low, high), v| (low.min(v), high.max(v)));
        // Room for the points at the edges, and a range that is not empty.
        (low <= high).then(|| Self { low: (low / 1.25).ln(), high: (high * 1.25).ln(), from, to })
    }

    /// The coordinate of a value.
    pub(super) fn at(&self, value: f64) -> f64 {
        self.from + (value.ln() - self.low) / (self.high - self.low) * (self.to - self.from)
    }

    /// 1, 2 and 5 times powers of ten; of ranges of many decades the powers alone.
    pub(super) fn ticks(&self) -> Vec<Tick> {
        let decades = (self.high - self.low) / std::f64::consts::LN_10;
        let steps: &[f64] = if decades > 3.5 { &[1.0] } else { &[1.0, 2.0, 5.0] };
        let first = (self.low / std::f64::consts::LN_10).floor() as i32;
        let last = (self.high / std::f64::consts::LN_10).ceil() as i32;
        let values = (first..=last).flat_map(|power| steps.iter().map(move |step| step * 10f64.powi(power)));
        let inside = values.filter(|value| (self.low..=self.high).contains(&value.ln()));
        // Long numbers would reach the title of the axis.
        let text = |value: f64| if value >= 1e5 { format!("{value:e}") } else { plain(value) };
        inside.map(|value| Tick { at: coordinate(self.at(value)), text: text(value) }).collect()
    }
}

/// Puts points from the left to the right, as arrow keys go through them.
pub(super) fn order(points: &mut [Point]) {
    let position = |point: &Point| point.x.parse::<f64>().unwrap_or_default();
    points.sort_by(|a, b| position(a).total_cmp(&position(b)));
    if let Some(first) = points.first_mut() {
        first.first = true;
    }
}

/// A coordinate as SVG has it.
pub(super) fn coordinate(x: f64) -> String {
    format!("{x:.1}")
}

/// A number without trailing zeros.
pub(super) fn plain(value: f64) -> String {
    if value < 1e-3 && value != 0.0 { format!("{value:.0e}") } else { format!("{}", (value * 1e6).round() / 1e6) }
}

/// The plots of a scene, by depth error and by FLIP; none if nothing was timed.
pub(super) fn plots(report: &SweepReport, scene: &SceneSweep) -> Vec<Plot> {
    ErrorMeasure::SHOWN.iter().filter_map(|measure| plot(report, scene, *measure)).collect()
}

fn plot(report: &SweepReport, scene: &SceneSweep, measure: ErrorMeasure) -> Option<Plot> {
    let of_octrees = scene.cells.iter().filter(|cell| cell.octree.is_some()).map(|cell| measure.of(&cell.error));
    let least = of_octrees.filter(|error| *error > 0.0).fold(f64::INFINITY, f64::min);
    let floor = if least.is_finite() { BELOW * least } else { 1e-4 };
    let timed: Vec<(usize, &Cell, Span, f64)> = (scene.cells.iter().enumerate())
        .filter_map(|(index, cell)| Some((index, cell, Span::of(cell)?, measure.of(&cell.error).max(floor))))
        .collect();
    let on = fronts(report, scene, measure, Among::Octrees);
    let [left, top, right, bottom] = [ROOM[0], ROOM[1], SIZE[0] - ROOM[2], SIZE[1] - ROOM[3]];
    let ends = timed.iter().filter(|p| on[p.0]).map(|p| p.2.quarter);
    let x = Axis::new(timed.iter().map(|p| p.2.least).chain(ends), left, right)?;
    let y = Axis::new(timed.iter().map(|p| p.3), bottom, top)?;
    let mut front: Vec<_> = timed.iter().filter(|(index, ..)| on[*index]).collect();
    front.sort_by(|a, b| a.2.least.total_cmp(&b.2.least));
    let place = |p: &(usize, &Cell, Span, f64)| format!("{},{}", coordinate(x.at(p.2.least)), coordinate(y.at(p.3)));
    let mut legend: Vec<Legend> = Vec::new();
    let mut points: Vec<Point> = Vec::new();
    for (index, cell, span, error) in &timed {
        let (class, shape) = look(cell);
        if !legend.iter().any(|known| known.class == class && known.shape == shape) {
            legend.push(Legend { class: class.clone(), shape, text: series(report, cell) });
        }
        let median = cell.frame_ms().map_or(0.0, |ms| ms.rounds.median);
        points.push(Point {
            x: coordinate(x.at(span.least)),
            y: coordinate(y.at(*error)),
            class,
            shape,
            name: String::new(),
            tip: vec![
                setting(scene, cell),
                format!("{} by {} (median {} ms)", span.words(), engine(report, cell), short(median)),
                format!("{} {}", measure.title(), measure.show(measure.of(&cell.error))),
                format!("{} MB", short(cell.memory_bytes as f64 / 1e6)),
            ],
            on_front: on[*index],
            first: false,
            range: on[*index].then(|| coordinate(x.at(span.quarter) - x.at(span.least))),
        });
    }
    order(&mut points);
    let half = (measure == ErrorMeasure::P90).then(|| y.at(0.5)).filter(|at| (top..=bottom).contains(at));
    let unit = if measure == ErrorMeasure::Flip { "" } else { ", pixels" };
    Some(Plot {
        title: format!("{}: {} against time", scene.name, measure.title()),
        width: SIZE[0],
        height: SIZE[1],
        area: [left, top, right, bottom],
        x_title: "milliseconds per frame, least of the rounds".into(),
        y_title: format!("{}{unit}", measure.title()),
        x_ticks: x.ticks(),
        y_ticks: y.ticks(),
        lines: vec![Line { class: "front", points: front.into_iter().map(place).collect::<Vec<_>>().join(" ") }],
        half: half.map(coordinate),
        points,
        legend,
    })
}

/// Class and shape of a point. Colour tells the kind; shape the engine; the beam fills it.
fn look(cell: &Cell) -> (String, &'static str) {
    let shape = match cell.engine {
        _ if cell.octree.is_none() => "triangle",
        EngineId::Cpu | EngineId::Reference => "circle",
        EngineId::Wgpu => "square",
        EngineId::Ash => "diamond",
        EngineId::Own(_) => "cross",
    };
    let kind = match cell.octree {
        None => "tri",
        Some(_) if cell.contours => "con",
        Some(_) => "cub",
    };
    (format!("{kind}{}", if cell.beam || cell.octree.is_none() { " beam" } else { "" }), shape)
}

/// The engine of a setting; `wgpu, software` on a driver that runs on the processor.
pub(super) fn engine(report: &SweepReport, cell: &Cell) -> String {
    let software = report.devices.iter().any(|d| d.backend == cell.engine && d.is_software());
    format!("{}{}", cell.engine, if software { ", software" } else { "" })
}

fn series(report: &SweepReport, cell: &Cell) -> String {
    let engine = engine(report, cell);
    let beam = if cell.beam { ", beam" } else { "" };
    match cell.octree {
        None => "triangles (no error)".into(),
        Some(_) if cell.contours => format!("{engine}: contours{beam}"),
        Some(_) => format!("{engine}: cubes{beam}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sweep_bench::sample::{cell, report, triangles};

    #[test]
    fn points_are_within_the_axes_and_the_front_is_drawn() {
        let ms = |ms: f64| vec![vec![ms / 1e3]];
        let report = report(vec![
            cell(1, false, 1.0, [2.0, 0.1], ms(1.0)),
            cell(2, true, 1.0, [3.0, 0.2], ms(8.0)),
            cell(3, true, 1.0, [0.25, 0.05], ms(10.0)),
            cell(4, true, 1.0, [0.25, 0.05], Vec::new()),
            triangles(2.0),
        ]);
        let plots = plots(&report, &report.scenes[0]);
        assert_eq!(plots.len(), 2);
        let plot = &plots[0];
        assert_eq!(plot.points.len(), 4, "what was not timed is not drawn");
        let [left, top, right, bottom] = plot.area;
        for point in &plot.points {
            let at: [f64; 2] = [point.x.parse().unwrap(), point.y.parse().unwrap()];
            assert!((left..=right).contains(&at[0]) && (top..=bottom).contains(&at[1]), "{at:?}");
        }
        assert_eq!(plot.lines[0].points.split(' ').count(), 2);
        assert_eq!(plot.points.iter().filter(|point| point.range.is_some()).count(), 2);
        assert!(plot.half.is_some() && plots[1].half.is_none());
        assert_eq!(plot.legend.len(), 4);
        let none = super::plots(
            &report,
            &crate::sweep_bench::record::SceneSweep { cells: Vec::new(), ..report.scenes[0].clone() },
        );
        assert!(none.is_empty());
    }

    #[test]
    fn ticks_are_round_numbers() {
        let axis = Axis::new([1.0, 40.0].into_iter(), 0.0, 100.0).unwrap();
        let texts: Vec<_> = axis.ticks().into_iter().map(|tick| tick.text).collect();
        assert_eq!(texts, ["1", "2", "5", "10", "20", "50"]);
        let wide = Axis::new([0.001, 1000.0].into_iter(), 0.0, 100.0).unwrap();
        assert!(wide.ticks().iter().all(|tick| tick.text.trim_matches(['0', '.']) == "1"));
        let large = Axis::new([1e2, 1e7].into_iter(), 0.0, 100.0).unwrap();
        let texts: Vec<_> = large.ticks().into_iter().map(|tick| tick.text).collect();
        assert_eq!(texts, ["100", "1000", "10000", "1e5", "1e6", "1e7"]);
        assert!(Axis::new(std::iter::empty(), 0.0, 1.0).is_none());
    }
}
