//! Plots: error against time of each effect.

use plotters::coord::Shift;
use plotters::prelude::*;

use super::tables::{by_effect, on_front};
use super::{ErrorRow, ShadowReport};
use crate::text::short;
use crate::timing::least;

/// Width and height of a panel.
const PANEL: (u32, u32) = (620, 420);
/// What is drawn for an error of 0, in percent: an axis with a logarithm has none.
const NONE: f64 = 0.01;

type Drawn<'a> = Result<(), Box<dyn std::error::Error + 'a>>;

/// Color of a voxel's edge, or of the octree.
fn color(number: usize) -> RGBColor {
    const COLORS: [RGBColor; 6] = [
        RGBColor(0, 0, 0),
        RGBColor(0, 92, 184),
        RGBColor(0, 150, 90),
        RGBColor(232, 128, 0),
        RGBColor(200, 32, 32),
        RGBColor(160, 32, 160),
    ];
    COLORS[number % COLORS.len()]
}

/// The plots of a record: the name of a file and its content, one for each scene and effect.
pub fn to_svg(report: &ShadowReport) -> Vec<(String, String)> {
    let mut plots = Vec::new();
    for scene in &report.scenes {
        for (effect, rows) in by_effect(&scene.errors) {
            let title = format!("{}: {effect}", scene.name);
            let mut svg = String::new();
            let drawn = {
                let root = SVGBackend::with_string(&mut svg, PANEL).into_drawing_area();
                draw(&root, &title, &rows).is_ok()
            };
            if drawn {
                plots.push((format!("{}.svg", crate::system::machine::slug(&title)), svg));
            }
        }
    }
    plots
}

fn draw<'a>(root: &DrawingArea<SVGBackend<'a>, Shift>, title: &str, rows: &[&ErrorRow]) -> Drawn<'a> {
    root.fill(&WHITE)?;
    let point = |row: &ErrorRow| (least(&row.ms), (100.0 * row.rmse).max(NONE));
    let points: Vec<_> = rows.iter().map(|row| point(row)).collect();
    let range = |of: fn(&(f64, f64)) -> f64| {
        points.iter().map(of).fold((f64::INFINITY, 0f64), |(low, high), x| (low.min(x), high.max(x)))
    };
    let (x, y) = (range(|p| p.0), range(|p| p.1));
    let mut chart = ChartBuilder::on(root)
        .caption(title, ("sans-serif", 15))
        .margin(10)
        .x_label_area_size(40)
        .y_label_area_size(60)
        .build_cartesian_2d((x.0 / 1.3..x.1 * 1.3).log_scale(), (y.0 / 1.3..y.1 * 1.3).log_scale())?;
    chart
        .configure_mesh()
        .light_line_style(RGBColor(236, 236, 236))
        .bold_line_style(RGBColor(205, 205, 205))
        .x_desc("milliseconds a picture, all cores (least)")
        .y_desc("error to the octree, percent of full light")
        .x_label_formatter(&|x| short(*x))
        .y_label_formatter(&|y| short(*y))
        .label_style(("sans-serif", 12))
        .axis_desc_style(("sans-serif", 13))
        .draw()?;
    let mut sizes: Vec<f64> = rows.iter().map(|row| row.voxel_cm).collect();
    sizes.sort_by(f64::total_cmp);
    sizes.dedup();
    for (number, size) in sizes.iter().enumerate() {
        let style = color(if *size == 0.0 { 0 } else { number.max(1) });
        let of_size: Vec<_> = rows.iter().filter(|row| row.voxel_cm == *size).collect();
        let label = if *size == 0.0 { "octree".to_owned() } else { format!("{size} cm") };
        let shape = |row: &&&ErrorRow| {
            let fill = if row.smoothed { style.filled() } else { style.stroke_width(1) };
            Circle::new(point(row), 4, fill)
        };
        let series = chart.draw_series(of_size.iter().map(shape))?;
        series.label(label).legend(move |at| Circle::new((at.0 + 8, at.1), 4, style.filled()));
    }
    let mut front: Vec<_> = rows.iter().filter(|row| on_front(row, rows)).map(|row| point(row)).collect();
    front.sort_by(|a, b| a.0.total_cmp(&b.0));
    chart.draw_series(LineSeries::new(front, RGBColor(120, 120, 120).stroke_width(1)))?;
    let mut legend = chart.configure_series_labels();
    legend
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.8))
        .border_style(RGBColor(160, 160, 160))
        .label_font(("sans-serif", 12))
        .draw()?;
    root.present()?;
    Ok(())
}
