//! The picture of a scenario: a bar a law, a panel a metric, after \[G\] figures 11, 14 and 16.

use super::summary::{Comparison, Entry};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Width, height of what is not a law, and of each law.
const WIDTH: u32 = 1300;
const FRAME: u32 = 110;
const LAW: u32 = 24;
/// Width of the names.
const NAMES: u32 = 230;
const INK: RGBColor = RGBColor(0x22, 0x2a, 0x33);
const BAR: RGBColor = RGBColor(0x3b, 0x6e, 0xa8);
const PANELS: [(&str, &str, f64); 3] =
    [("machining_time_s", "Time, s", 1.0), ("arc_ratio", "Arcs, %", 100.0), ("short_ratio", "Shorts, %", 100.0)];

/// File name and SVG of each variant and scenario.
///
/// # Errors
/// When one cannot be drawn.
pub fn draw(comparison: &Comparison) -> Result<Vec<(String, String)>, String> {
    let plain = |text: &str| text.replace(|c: char| !c.is_ascii_alphanumeric(), "-").replace("--", "-");
    let one = |group: (&str, &str)| {
        let laws: Vec<&Entry> = comparison.laws(group).collect();
        Ok((format!("{}.{}.svg", plain(group.1), plain(group.0)), sheet(group, &laws)?))
    };
    comparison.groups().into_iter().map(one).collect()
}

fn sheet((variant, scenario): (&str, &str), laws: &[&Entry]) -> Result<String, String> {
    let mut svg = String::new();
    let root = SVGBackend::with_string(&mut svg, (WIDTH, FRAME + LAW * laws.len() as u32)).into_drawing_area();
    let drawn = root.fill(&WHITE).and_then(|()| {
        let title = format!("{scenario}: {variant} (simulated; bars: mean and 95 % confidence interval over seeds)");
        let body = root.titled(&title, ("sans-serif", 24).into_font().color(&INK))?;
        let wide = (WIDTH - NAMES) / PANELS.len() as u32;
        let mut rest = body;
        for (n, (metric, name, factor)) in PANELS.into_iter().enumerate() {
            let names = if n == 0 { NAMES } else { 0 };
            let (area, right) = rest.split_horizontally(wide + names);
            panel(&area, laws, names, metric, name, factor)?;
            rest = right;
        }
        Ok(())
    });
    drawn.map_err(|error| error.to_string())?;
    drop(root);
    Ok(svg)
}

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;
type PlotResult<'a> = Result<(), DrawingAreaErrorKind<<SVGBackend<'a> as DrawingBackend>::ErrorType>>;

fn panel<'a>(area: &Area<'a>, laws: &[&Entry], names: u32, metric: &str, name: &str, factor: f64) -> PlotResult<'a> {
    let means: Vec<_> = laws.iter().map(|law| law.metric(metric)).collect();
    let ends = means.iter().flatten().map(|mean| (mean.of + mean.ci95.unwrap_or(0.0)) * factor);
    let top = ends.fold(0.0f64, f64::max).max(1e-6) * 1.08;
    let last = laws.len() as f64 - 0.5;
    // The first law on top.
    let mut chart = ChartBuilder::on(area)
        .margin(10)
        .caption(name, ("sans-serif", 18).into_font().color(&INK))
        .x_label_area_size(26)
        .y_label_area_size(names)
        .build_cartesian_2d(0.0..top, last..-0.5)?;
    chart
        .configure_mesh()
        .disable_y_mesh()
        .x_labels(6)
        .y_labels(0)
        .label_style(("sans-serif", 13).into_font().color(&INK))
        .draw()?;
    for (at, mean) in means.iter().enumerate().filter_map(|(at, mean)| Some((at as f64, (*mean)?))) {
        let (of, half) = (mean.of * factor, mean.ci95.unwrap_or(0.0) * factor);
        chart.draw_series([Rectangle::new([(0.0, at - 0.34), (of, at + 0.34)], BAR.filled())])?;
        chart.draw_series([PathElement::new([((of - half).max(0.0), at), (of + half, at)], INK.stroke_width(2))])?;
    }
    if names > 0 {
        let left = chart.plotting_area().get_pixel_range().0.start;
        let style = ("sans-serif", 14).into_font().color(&INK).pos(Pos::new(HPos::Right, VPos::Center));
        for (at, law) in laws.iter().enumerate() {
            let (_, y) = chart.backend_coord(&(0.0, at as f64));
            area.draw(&Text::new(law.law.clone(), area_coord(area, (left - 8, y)), style.clone()))?;
        }
    }
    Ok(())
}

/// A pixel of the picture as one of an area.
fn area_coord(area: &Area<'_>, (x, y): (i32, i32)) -> (i32, i32) {
    let (columns, rows) = area.get_pixel_range();
    (x - columns.start, y - rows.start)
}
