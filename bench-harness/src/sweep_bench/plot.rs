//! Plots of error against time, as SVG.

use esvo_engines::EngineId;
use plotters::prelude::*;

use super::errors::ErrorMeasure;
use super::record::{Cell, SceneSweep, SweepReport};
use super::tables::{Among, fronts};
use crate::text::short;

/// Width and height of a plot.
const SIZE: (u32, u32) = (1120, 520);
/// Errors below that of the most exact octree by this factor are drawn there: an axis with a logarithm has no 0, and that of triangles would
/// leave no room for the others.
const BELOW: f64 = 0.25;
/// Background, and the text on it.
const PAPER: RGBColor = WHITE;

/// One plot of a scene: depth error (90th percentile) and FLIP against milliseconds per frame, every setting a point; the Pareto
/// front of octrees as a dark line, whose points have levels and termination, and that with triangles as a light one. `Err` says what cannot be drawn.
///
/// # Errors
/// No setting was timed.
pub fn to_svg(report: &SweepReport, scene: &SceneSweep) -> Result<String, String> {
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        draw(&root, report, scene).map_err(|e| e.to_string())?;
        root.present().map_err(|e| e.to_string())?;
    }
    Ok(svg)
}

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;
type Drawn<'a> = Result<(), Box<dyn std::error::Error + 'a>>;

fn draw<'a>(root: &Area<'a>, report: &SweepReport, scene: &SceneSweep) -> Drawn<'a> {
    root.fill(&PAPER)?;
    let [width, height] = report.plan.size;
    let title = format!("{}: error against time, {width}x{height}, {}", scene.name, report.machine.cpu);
    let root = root.titled(&title, ("sans-serif", 18))?;
    for (panel, measure) in root.split_evenly((1, 2)).iter().zip(ErrorMeasure::SHOWN) {
        draw_panel(panel, report, scene, measure)?;
    }
    Ok(())
}

/// What a point looks like, and its name in the legend.
#[derive(Clone, PartialEq)]
struct Series {
    engine: EngineId,
    kind: Kind,
    beam: bool,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Triangles,
    Cubical,
    Contours,
}

impl Series {
    fn of(cell: &Cell) -> Self {
        let kind = match cell.octree {
            None => Kind::Triangles,
            Some(_) if cell.contours => Kind::Contours,
            Some(_) => Kind::Cubical,
        };
        Self { engine: cell.engine, kind, beam: cell.beam }
    }

    /// Its name; `error` says the error of triangles, which may be drawn above it.
    fn title(&self, error: &str) -> String {
        let beam = if self.beam { ", beam" } else { "" };
        match self.kind {
            Kind::Triangles => format!("triangles: {error}"),
            Kind::Cubical => format!("{}: cubical{beam}", self.engine),
            Kind::Contours => format!("{}: contours{beam}", self.engine),
        }
    }

    /// Blue for cubes, red for contours; lighter on GPUs. The beam fills the point.
    fn style(&self) -> ShapeStyle {
        let color = match (self.kind, self.engine) {
            (Kind::Triangles, _) => BLACK,
            (Kind::Cubical, EngineId::Cpu | EngineId::Reference) => RGBColor(0, 92, 184),
            (Kind::Contours, EngineId::Cpu | EngineId::Reference) => RGBColor(200, 32, 32),
            (Kind::Cubical, EngineId::Wgpu) => RGBColor(0, 160, 160),
            (Kind::Contours, EngineId::Wgpu) => RGBColor(232, 128, 0),
            (Kind::Cubical, EngineId::Ash) => RGBColor(96, 160, 0),
            (Kind::Contours, EngineId::Ash) => RGBColor(160, 32, 160),
            (Kind::Cubical, EngineId::Own(_)) => RGBColor(128, 128, 128),
            (Kind::Contours, EngineId::Own(_)) => RGBColor(128, 80, 40),
        };
        if self.beam || self.kind == Kind::Triangles { color.filled() } else { color.stroke_width(1) }
    }
}

fn draw_panel<'a>(panel: &Area<'a>, report: &SweepReport, scene: &SceneSweep, measure: ErrorMeasure) -> Drawn<'a> {
    let of_octrees = scene.cells.iter().filter(|cell| cell.octree.is_some()).map(|cell| measure.of(&cell.error));
    let least = of_octrees.filter(|error| *error > 0.0).fold(f64::INFINITY, f64::min);
    let floor = if least.is_finite() { BELOW * least } else { 1e-4 };
    let error = |cell: &Cell| measure.of(&cell.error).max(floor);
    let timed: Vec<(usize, f64, f64)> =
        (scene.cells.iter().enumerate()).filter_map(|(index, cell)| Some((index, cell.ms()?, error(cell)))).collect();
    if timed.is_empty() {
        return Err("no setting was timed".into());
    }
    let range = |of: &dyn Fn(&(usize, f64, f64)) -> f64| {
        let values = timed.iter().map(of);
        let (low, high) = values.fold((f64::INFINITY, 0f64), |(low, high), x| (low.min(x), high.max(x)));
        // Room for the points at the edges, and a range that is not empty.
        low / 1.3..high * 1.3
    };
    let mut chart = ChartBuilder::on(panel)
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(64)
        .build_cartesian_2d(range(&|p| p.1).log_scale(), range(&|p| p.2).log_scale())?;
    let unit = if measure == ErrorMeasure::Flip { "" } else { " in pixels" };
    chart
        .configure_mesh()
        .light_line_style(RGBColor(236, 236, 236))
        .bold_line_style(RGBColor(205, 205, 205))
        .x_labels(5)
        .x_desc("milliseconds per frame (least)")
        .y_desc(format!("{}{unit}", measure.title()))
        .x_label_formatter(&|x| short(*x))
        .y_label_formatter(&|y| plain(*y))
        .label_style(("sans-serif", 13))
        .axis_desc_style(("sans-serif", 14))
        .draw()?;

    let on_front = |among| {
        let on = fronts(report, scene, measure, among);
        let mut line: Vec<_> = timed.iter().filter(|(index, ..)| on[*index]).copied().collect();
        line.sort_by(|a, b| a.1.total_cmp(&b.1));
        line
    };
    // That of all settings is light where that of octrees alone goes on.
    let line = on_front(Among::Octrees);
    for (line, color) in [(&on_front(Among::All), RGBColor(190, 190, 190)), (&line, RGBColor(90, 90, 90))] {
        chart.draw_series(LineSeries::new(line.iter().map(|p| (p.1, p.2)), color.stroke_width(1)))?;
    }

    let mut series: Vec<Series> = Vec::new();
    for (index, ..) in &timed {
        let this = Series::of(&scene.cells[*index]);
        if !series.contains(&this) {
            series.push(this);
        }
    }
    for this in series {
        let style = this.style();
        let own = scene.cells.iter().find(|cell| Series::of(cell) == this).map_or(0.0, |cell| measure.of(&cell.error));
        let title = this.title(&measure.show(own));
        let points = timed.iter().filter(|(index, ..)| Series::of(&scene.cells[*index]) == this);
        if this.kind == Kind::Triangles {
            let marks = points.map(|p| TriangleMarker::new((p.1, p.2), 6, style));
            let drawn = chart.draw_series(marks)?.label(&title);
            drawn.legend(move |at| TriangleMarker::new((at.0 + 8, at.1), 6, style));
        } else {
            let marks = points.map(|p| Circle::new((p.1, p.2), 4, style));
            let drawn = chart.draw_series(marks)?.label(&title);
            drawn.legend(move |at| Circle::new((at.0 + 8, at.1), 4, style));
        }
    }
    // Names of the points on the front, above and below the line in turn.
    for (number, (index, x, y)) in line.iter().enumerate() {
        let cell = &scene.cells[*index];
        let Some(levels) = scene.levels(cell) else { continue };
        let text = format!("{levels}/{}px", cell.max_voxel_pixels);
        let offset = if number % 2 == 0 { (6, -14) } else { (-44, 8) };
        let label = EmptyElement::at((*x, *y)) + Text::new(text, offset, ("sans-serif", 11));
        chart.draw_series(std::iter::once(label))?;
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(PAPER.mix(0.8))
        .border_style(RGBColor(160, 160, 160))
        .label_font(("sans-serif", 12))
        .draw()?;
    Ok(())
}

/// A tick of an axis.
fn plain(y: f64) -> String {
    if y < 0.01 { format!("{y:.0e}") } else { short(y) }
}
