//! Plots: error against time, and holes against the size of triangles.

use plotters::coord::Shift;
use plotters::prelude::*;

use super::{Grid, MethodRow, VoxelReport};
use crate::text::short;
use crate::timing::least;

/// Width and height of a panel.
const PANEL: (u32, u32) = (540, 400);
/// What is drawn for an error of 0, in parts per million: an axis with a logarithm has none.
const NONE: f64 = 0.1;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn<'a> = Result<(), Box<dyn std::error::Error + 'a>>;

/// Color of a method's number.
fn color(number: usize) -> RGBColor {
    const COLORS: [RGBColor; 10] = [
        RGBColor(120, 120, 120),
        RGBColor(0, 92, 184),
        RGBColor(232, 128, 0),
        RGBColor(200, 32, 32),
        RGBColor(96, 160, 0),
        RGBColor(160, 32, 160),
        RGBColor(0, 160, 160),
        RGBColor(128, 80, 40),
        RGBColor(220, 100, 160),
        RGBColor(0, 0, 0),
    ];
    COLORS[number % COLORS.len()]
}

/// Wrong voxels of a method, in parts per million of the exact ones.
pub(crate) fn wrong_ppm(grid: &Grid, row: &MethodRow) -> f64 {
    (row.missing() + row.extra) as f64 * 1e6 / grid.voxels.max(1) as f64
}

/// Whether a method has a time that an axis with a logarithm can show.
fn is_timed(row: &MethodRow) -> bool {
    (f64::MIN_POSITIVE..f64::INFINITY).contains(&least(&row.voxelize_ms))
}

/// Missing and extra voxels of each method against its time on the device, in the finest grid of each scene.
///
/// # Errors
/// A record without scenes.
pub fn to_svg(report: &VoxelReport) -> Result<String, String> {
    let last = report.scenes.iter().filter_map(|scene| Some((scene, scene.grids.last()?)));
    // An axis needs values: a scene without any has no panel.
    let shown: Vec<_> = last.filter(|(_, grid)| grid.methods.iter().any(is_timed)).collect();
    if shown.is_empty() {
        return Err("no scene was voxelized".into());
    }
    drawn((PANEL.0 * shown.len() as u32, PANEL.1), |root| {
        for (panel, (scene, grid)) in root.split_evenly((1, shown.len())).iter().zip(&shown) {
            let rows: Vec<&MethodRow> = grid.methods.iter().filter(|row| is_timed(row)).collect();
            let points: Vec<(f64, f64)> =
                rows.iter().map(|row| (least(&row.voxelize_ms), wrong_ppm(grid, row).max(NONE))).collect();
            let far = points.iter().fold((f64::INFINITY, 0f64), |(low, high), p| (low.min(p.0), high.max(p.0)));
            let high = points.iter().fold(1.0, |high: f64, p| high.max(p.1));
            let edge = 1u32 << grid.level;
            let mut chart = ChartBuilder::on(panel)
                .caption(format!("{}, {edge} voxels, {}", scene.name, report.device.name), ("sans-serif", 14))
                .margin(10)
                .x_label_area_size(40)
                .y_label_area_size(64)
                .build_cartesian_2d((far.0 / 1.3..far.1 * 1.5).log_scale(), (NONE / 2.0..high * 2.0).log_scale())?;
            mesh(
                &mut chart,
                "milliseconds on the device (least)",
                "wrong voxels, parts per million (0 at the bottom)",
            )?;
            for (number, (row, point)) in rows.iter().zip(&points).enumerate() {
                let style = color(number).filled();
                chart.draw_series([Circle::new(*point, 5, style)])?;
                let label = EmptyElement::at(*point) + Text::new(row.letter.clone(), (7, -12), ("sans-serif", 14));
                chart.draw_series(std::iter::once(label))?;
            }
        }
        Ok(())
    })
}

/// Holes in a sheet against the size of its triangles.
///
/// # Errors
/// A record without sheets.
pub fn curve_to_svg(report: &VoxelReport) -> Result<String, String> {
    let mut letters: Vec<&str> = Vec::new();
    for point in &report.curve {
        if !letters.contains(&&point.letter[..]) {
            letters.push(&point.letter);
        }
    }
    if letters.is_empty() {
        return Err("no sheet was voxelized".into());
    }
    drawn((PANEL.0 * 3 / 2, PANEL.1), |root| {
        let most = report
            .curve
            .iter()
            .map(|point| 100.0 * point.holes as f64 / point.voxels.max(1) as f64)
            .fold(1.0, f64::max);
        let edges = report.curve.iter().map(|point| point.edge);
        let far = edges.fold((f64::INFINITY, 0f64), |(low, high), x| (low.min(x), high.max(x)));
        let mut chart = ChartBuilder::on(root)
            .caption(format!("Holes in a sheet of equal triangles, {}", report.device.name), ("sans-serif", 14))
            .margin(10)
            .x_label_area_size(40)
            .y_label_area_size(64)
            .build_cartesian_2d((far.0 / 1.2..far.1 * 1.2).log_scale(), 0.0..most * 1.1)?;
        mesh(&mut chart, "mean edge of a triangle in voxels", "voxels that no pixel was shaded for, percent")?;
        for (number, letter) in letters.iter().enumerate() {
            let points: Vec<(f64, f64)> = (report.curve.iter().filter(|point| point.letter == *letter))
                .map(|point| (point.edge, 100.0 * point.holes as f64 / point.voxels.max(1) as f64))
                .collect();
            let style = color(number);
            let line = chart.draw_series(LineSeries::new(points.iter().copied(), style.stroke_width(2)))?;
            line.label(*letter).legend(move |at| Circle::new((at.0 + 8, at.1), 4, style.filled()));
            chart.draw_series(points.iter().map(|point| Circle::new(*point, 3, style.filled())))?;
        }
        let legend = chart.configure_series_labels();
        let mut legend = legend;
        legend
            .background_style(WHITE.mix(0.8))
            .border_style(RGBColor(160, 160, 160))
            .label_font(("sans-serif", 13))
            .draw()?;
        Ok(())
    })
}

fn drawn(size: (u32, u32), draw: impl for<'a> FnOnce(&Area<'a>) -> Drawn<'a>) -> Result<String, String> {
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        root.fill(&WHITE).map_err(|e| e.to_string())?;
        draw(&root).map_err(|e| e.to_string())?;
        root.present().map_err(|e| e.to_string())?;
    }
    Ok(svg)
}

type Chart<'a, 'b, Y> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<plotters::coord::combinators::LogCoord<f64>, Y>>;

fn mesh<'b, Y>(chart: &mut Chart<'_, 'b, Y>, x: &str, y: &str) -> Drawn<'b>
where
    Y: plotters::coord::ranged1d::Ranged<ValueType = f64> + plotters::coord::ranged1d::ValueFormatter<f64>,
{
    chart
        .configure_mesh()
        .light_line_style(RGBColor(236, 236, 236))
        .bold_line_style(RGBColor(205, 205, 205))
        .x_labels(6)
        .x_desc(x)
        .y_desc(y)
        .x_label_formatter(&|x| short(*x))
        .y_label_formatter(&|y| short(*y))
        .label_style(("sans-serif", 12))
        .axis_desc_style(("sans-serif", 13))
        .draw()?;
    Ok(())
}
