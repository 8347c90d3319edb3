//! The picture of a scenario: a bar a law, a panel a metric, as \[G\] figures 11, 14 and 16 have them.

use super::summary::{Comparison, Entry};
use plotters::prelude::*;

const SIZE: (u32, u32) = (1500, 900);
const INK: RGBColor = RGBColor(0x22, 0x2a, 0x33);
const BAR: RGBColor = RGBColor(0x3b, 0x6e, 0xa8);
const PANELS: [(&str, &str, f64); 6] = [
    ("machining_time_s", "Time, s", 1.0),
    ("discharges_per_100um", "Discharges per 100 um, thousands", 1e-3),
    ("ldr_short", "Long retreats within a short", 1.0),
    ("short_cycle_ratio", "Short cycles, %", 100.0),
    ("arc_ratio", "Arcs, %", 100.0),
    ("servo_rms_mm_s", "Servo, mm/s rms", 1.0),
];

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
    let root = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
    let drawn = root.fill(&WHITE).and_then(|()| {
        let title = format!("{scenario}: {variant} (simulated; bars: mean and 95 % confidence interval over seeds)");
        let body = root.titled(&title, ("sans-serif", 24).into_font().color(&INK))?;
        for (area, (metric, name, factor)) in body.split_evenly((2, 3)).iter().zip(PANELS) {
            panel(area, laws, metric, name, factor)?;
        }
        Ok(())
    });
    drawn.map_err(|error| error.to_string())?;
    drop(root);
    Ok(svg)
}

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;
type PlotResult<'a> = Result<(), DrawingAreaErrorKind<<SVGBackend<'a> as DrawingBackend>::ErrorType>>;

fn panel<'a>(area: &Area<'a>, laws: &[&Entry], metric: &str, name: &str, factor: f64) -> PlotResult<'a> {
    let means: Vec<_> = laws.iter().map(|law| law.metric(metric)).collect();
    let ends = means.iter().flatten().map(|mean| (mean.of + mean.ci95.unwrap_or(0.0)) * factor);
    let top = ends.fold(0.0f64, f64::max).max(1e-6) * 1.08;
    let mut chart = ChartBuilder::on(area)
        .margin(14)
        .caption(name, ("sans-serif", 18).into_font().color(&INK))
        .x_label_area_size(44)
        .y_label_area_size(56)
        .build_cartesian_2d(-0.5..laws.len() as f64 - 0.5, 0.0..top)?;
    let law = |x: &f64| {
        let at = x.round();
        let whole = (x - at).abs() < 1e-6 && at >= 0.0;
        whole.then(|| laws.get(at as usize)).flatten().map_or(String::new(), |law| law.law.replace("_by_error", ""))
    };
    chart
        .configure_mesh()
        .disable_x_mesh()
        .x_labels(laws.len() * 2 + 1)
        .x_label_formatter(&law)
        .label_style(("sans-serif", 13).into_font().color(&INK))
        .draw()?;
    for (at, mean) in means.iter().enumerate().filter_map(|(at, mean)| Some((at as f64, (*mean)?))) {
        let (of, half) = (mean.of * factor, mean.ci95.unwrap_or(0.0) * factor);
        chart.draw_series([Rectangle::new([(at - 0.32, 0.0), (at + 0.32, of)], BAR.filled())])?;
        chart.draw_series([PathElement::new([(at, (of - half).max(0.0)), (at, of + half)], INK.stroke_width(2))])?;
    }
    Ok(())
}
