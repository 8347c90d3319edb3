//! The sheet: where the panels lie, and how they are drawn.

use super::buckets::{Bucket, SHADED};
use super::panels::{BAND, BLUE, Curve, INK, Panel, View};
use super::shares::Shares;
use super::{CLOSE_SHARES_MS, Picture, SHARES};
use crate::millisecond::Phase;
use crate::report::Report;
use crate::run::RowOutcome;
use edm_gcode::Program;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::ops::Range;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type PlotResult<'a> = Result<(), DrawingAreaErrorKind<<SVGBackend<'a> as DrawingBackend>::ErrorType>>;

const WIDTH: u32 = 1600;
/// Height of a panel.
const PANEL: u32 = 215;
const HEAD: u32 = 112;
const FOOT: u32 = 54;
const LEFT_COLUMN: u32 = 960;
/// Width of the column in which a path is drawn.
const PATH_COLUMN: u32 = 600;
pub(super) const PALE: RGBColor = RGBColor(0x66, 0x70, 0x7a);
pub(super) const GRID: RGBColor = RGBColor(0xe4, 0xe8, 0xec);

/// Draws the picture as SVG.
pub(super) fn draw(picture: &Picture, report: &Report, title: &str, path: Option<&Program>) -> Result<String, String> {
    let mut svg = String::new();
    let run = picture.run.all();
    let first_surface_um = run.first().map_or(0.0, |column| column.surface_um);
    let whole = View { picture, columns: &run, shares: &picture.shares, first_surface_um }.whole();
    let size = (WIDTH + path.map_or(0, |_| PATH_COLUMN), HEAD + FOOT + PANEL * whole.len() as u32);
    let root = SVGBackend::with_string(&mut svg, size).into_drawing_area();
    let drawn = root.fill(&WHITE).and_then(|()| {
        let (sheet, beside) = root.split_horizontally(WIDTH);
        heading(&sheet, report, title)?;
        on(&sheet, picture, &run, &whole, &report.rows)?;
        path.map_or(Ok(()), |path| path_column(&beside, picture, path))
    });
    drawn.map_err(|error| error.to_string())?;
    drop(root);
    Ok(svg)
}

/// Draws panels over one time as SVG, under a title and a line that says more.
pub(super) fn panels(title: &str, more: &str, time: &Range<f64>, panels: &[Panel]) -> Result<String, String> {
    let mut svg = String::new();
    let root = SVGBackend::with_string(&mut svg, (WIDTH, HEAD + 260 * panels.len() as u32)).into_drawing_area();
    let drawn = root.fill(&WHITE).and_then(|()| {
        let (head, body) = root.split_vertically(HEAD);
        text(&head, title, (24, 16), 27.0, INK, true)?;
        text(&head, more, (24, 52), 15.0, PALE, false)?;
        stack(&body, time, &Marks::default(), panels)
    });
    drawn.map_err(|error| error.to_string())?;
    drop(root);
    Ok(svg)
}

/// The requested path, and the path of the head while it worked: from above and from the side.
fn path_column<'a>(area: &Area<'a>, picture: &Picture, path: &Program) -> PlotResult<'a> {
    let (head, body) = area.split_vertically(HEAD);
    text(&head, &format!("The path: {}", path.name), (64, 86), 17.0, INK, true)?;
    let (_, height) = body.dim_in_pixel();
    let (above, side) = body.split_vertically(height / 2);
    let first_surface_um = picture.run.all().first().map_or(0.0, |column| column.surface_um);
    let track = picture.track.all().iter();
    let gone: Vec<[f64; 3]> =
        track.map(|[down, x, y]| [(down - first_surface_um) * 1e-3, x * 1e-3, y * 1e-3]).collect();
    view(&above, "From above: Y over X, mm", |[_, x, y]| (x, y), path, &gone)?;
    view(&side, "From the side: Z over X, mm", |[down, x, _]| (x, -down), path, &gone)
}

/// Both in one scale, so that a circle is one.
fn view<'a>(
    area: &Area<'a>,
    name: &'static str,
    look: impl Fn([f64; 3]) -> (f64, f64),
    path: &Program,
    gone: &[[f64; 3]],
) -> PlotResult<'a> {
    let (asked, gone): (Vec<_>, Vec<_>) =
        (path.outline.iter().copied().map(&look).collect(), gone.iter().copied().map(&look).collect());
    let extent = |values: &mut dyn Iterator<Item = f64>| {
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
    };
    let (left, right) = extent(&mut asked.iter().map(|point| point.0));
    let (low, high) = extent(&mut asked.iter().map(|point| point.1));
    let (width, height) = area.dim_in_pixel();
    let (width, height) = (f64::from(width - 84), f64::from(height - 30 - FOOT));
    // A tenth of margin; not less than 0.1 um altogether.
    let scale = ((right - left) / width).max((high - low) / height).max(1e-4 / width) * 1.1;
    let around = |low: f64, high: f64, pixels: f64| {
        let (middle, half) = ((low + high) / 2.0, scale * pixels / 2.0);
        middle - half..middle + half
    };
    let (across, up) = (around(left, right, width), around(low, high, height));
    let mut chart = ChartBuilder::on(area)
        .margin_top(30)
        .margin_right(20)
        .set_label_area_size(LabelAreaPosition::Left, 64)
        .set_label_area_size(LabelAreaPosition::Bottom, FOOT)
        .build_cartesian_2d(across.clone(), up.clone())?;
    let number = |x: &f64| format!("{}", (x * 1e5).round() / 1e5 + 0.0);
    let labels = ("sans-serif", 17).into_font().color(&PALE);
    let mut mesh = chart.configure_mesh();
    mesh.max_light_lines(0).bold_line_style(GRID).axis_style(PALE).label_style(labels);
    mesh.x_labels(5).y_labels(7).x_label_formatter(&number).y_label_formatter(&number).draw()?;
    let curve = |label: &str, colour, width, dashed, line: &[(f64, f64)]| {
        let line = line.to_vec();
        Curve { label: label.into(), colour, width, dashed, line, band: Vec::new(), opaque: BAND }
    };
    // What lies beside the path, a retreat or the way to the work, is not why it is drawn.
    let gone: Vec<_> = gone.into_iter().filter(|(x, y)| across.contains(x) && up.contains(y)).collect();
    let curves = vec![curve("electrode", BLUE, 2, false, &gone), curve("requested", INK, 1, true, &asked)];
    for Curve { colour, width, dashed, line, .. } in &curves {
        let style = colour.stroke_width(*width);
        if *dashed {
            chart.draw_series(DashedLineSeries::new(line.clone(), 9, 6, style))?;
        } else {
            chart.draw_series([PathElement::new(line.clone(), style)])?;
        }
    }
    legend(area, &Panel { name, y: 0.0..1.0, curves })
}

/// What lies behind the curves of all panels.
#[derive(Default)]
struct Marks {
    /// Stretches of time with a phase, and how much of it they are.
    shades: Vec<(Range<f64>, Phase, u8)>,
    /// Where a row of a technology table begins, and its name.
    rows: Vec<(f64, String)>,
}

fn on<'a>(root: &Area<'a>, picture: &Picture, run: &[Bucket], whole: &[Panel], rows: &[RowOutcome]) -> PlotResult<'a> {
    let (head, body) = root.split_vertically(HEAD);
    let (left, right) = body.split_horizontally(LEFT_COLUMN);
    text(&head, "The whole run", (64, 86), 17.0, INK, true)?;
    shade_legend(&head)?;
    column(&left, run, whole, rows)?;
    let (_, height) = body.dim_in_pixel();
    text(&left, "lines: means, bands: smallest to largest", (64, height as i32 - 18), 13.0, PALE, false)?;
    text(&right, "sensed: what the head knows", (400, height as i32 - 18), 13.0, PALE, false)?;
    let close_up: Vec<Bucket> = picture.close_up.kept.iter().map(Bucket::from).collect();
    let (Some(first), Some(last)) = (close_up.first(), close_up.last()) else {
        return text(&right, "No undisturbed second of eroding", (64, 40), 15.0, PALE, false);
    };
    let heading = format!("One second of eroding, from {:.1} to {:.1} s", first.time().0, last.time().1);
    text(&head, &heading, (LEFT_COLUMN as i32 + 64, 86), 17.0, INK, true)?;
    let mut shares = Shares::new(CLOSE_SHARES_MS, SHARES);
    picture.close_up.kept.iter().for_each(|ms| shares.add(ms));
    let first_surface_um = run.first().map_or(0.0, |column| column.surface_um);
    let view = View { picture, columns: &close_up, shares: &shares, first_surface_um };
    column(&right, &close_up, &view.close_up(), &[])
}

fn heading<'a>(area: &Area<'a>, report: &Report, title: &str) -> PlotResult<'a> {
    text(area, &format!("Simulated bore: {title}"), (24, 16), 27.0, INK, true)?;
    let depth = |mm: Option<f64>| mm.map_or("unknown".into(), |mm| format!("{mm:.3} mm"));
    let (hole, electrode) = (depth(report.hole_depth_mm), depth(report.depth_mm));
    let end = if report.completed { String::new() } else { format!(" (stopped: {})", report.stop_reason) };
    let mut words = vec![
        format!("scenario {}, seed {}", report.scenario, report.seed),
        format!(
            "hole {hole}, electrode {electrode} of {:.3} mm{end} in {:.1} s",
            report.target_depth_mm, report.sim_time_s
        ),
    ];
    if let (Some(mean), Some(error)) = (report.gap_voltage_v.mean, report.gap_voltage_v.rms_error_100ms) {
        words.push(format!("gap voltage {mean:.1} V, error {error:.1} V rms"));
    }
    if let Some(ripple) = report.position_pp_um_median {
        words.push(format!("position ripple {ripple:.1} µm"));
    }
    text(area, &words.join("  ·  "), (24, 52), 15.0, PALE, false)
}

/// What the shading means, at the right end of the left column's heading.
fn shade_legend<'a>(area: &Area<'a>) -> PlotResult<'a> {
    let mut x = LEFT_COLUMN as i32 - 20;
    for (phase, name) in SHADED.into_iter().zip(["waiting", "seeking", "retreating", "fault"]).rev() {
        x -= width(name, 14.0, false);
        text(area, name, (x, 88), 14.0, PALE, false)?;
        x -= 26;
        area.draw(&Rectangle::new([(x, 88), (x + 20, 101)], shade(phase, 1.0).filled()))?;
        x -= 18;
    }
    Ok(())
}

fn shade(phase: Phase, share: f64) -> RGBAColor {
    let colour = match phase {
        Phase::Eroding | Phase::Idle => RGBColor(0x9a, 0xa5, 0xb1),
        Phase::Seeking => RGBColor(0x4f, 0xa3, 0xe0),
        Phase::Retreating => RGBColor(0xf2, 0x9d, 0x38),
        Phase::Fault => RGBColor(0xd6, 0x27, 0x28),
    };
    // What lasts shows by its width; what does not has to by its strength.
    let floor = if matches!(phase, Phase::Retreating | Phase::Fault) { 0.2 } else { 0.06 };
    colour.mix(floor + 0.24 * share)
}

/// Columns of the same shade next to each other, as one stretch of time.
fn shades(columns: &[Bucket]) -> Vec<(Range<f64>, Phase, u8)> {
    let mut stretches: Vec<(Range<f64>, Phase, u8)> = Vec::new();
    for column in columns {
        // The most disturbing phase shows, in four strengths.
        let shares = column.share.into_iter().zip(SHADED).rev();
        let Some((share, phase)) = shares.into_iter().find(|(share, _)| *share > 0.0) else { continue };
        let strength = (share * 4.0).ceil() as u8;
        let (from, to) = column.time();
        match stretches.last_mut() {
            Some((time, p, s)) if *p == phase && *s == strength && from - time.end < 1e-9 => time.end = to,
            _ => stretches.push((from..to, phase, strength)),
        }
    }
    stretches
}

fn column<'a>(area: &Area<'a>, columns: &[Bucket], panels: &[Panel], rows: &[RowOutcome]) -> PlotResult<'a> {
    let time = match (columns.first(), columns.last()) {
        (Some(first), Some(last)) => first.time().0..last.time().1,
        _ => 0.0..1.0,
    };
    let rows = rows.iter().map(|row| (row.from_s, row.name.clone())).collect();
    stack(area, &time, &Marks { shades: shades(columns), rows }, panels)
}

/// Draws panels, one below the other, over the same time.
fn stack<'a>(area: &Area<'a>, time: &Range<f64>, marks: &Marks, panels: &[Panel]) -> PlotResult<'a> {
    let (_, height) = area.dim_in_pixel();
    // The lowest panel is higher by the labels of the time axis, so that all diagrams are of the same height.
    let each = (height + 8 - FOOT) / panels.len().max(1) as u32;
    let mut rest = area.clone();
    for (i, panel) in panels.iter().enumerate() {
        let lowest = i + 1 == panels.len();
        let (this, below) = if lowest {
            (rest.clone(), None)
        } else {
            let (a, b) = rest.split_vertically(each);
            (a, Some(b))
        };
        diagram(&this, time, marks, panel, (i == 0, lowest))?;
        rest = below.unwrap_or(rest);
    }
    Ok(())
}

fn diagram<'a>(
    area: &Area<'a>,
    time: &Range<f64>,
    marks: &Marks,
    panel: &Panel,
    (first, lowest): (bool, bool),
) -> PlotResult<'a> {
    let number = |x: &f64| format!("{}", (x * 1e4).round() / 1e4 + 0.0);
    let time_label = |t: &f64| if lowest { number(t) } else { String::new() };
    let labels = ("sans-serif", 17).into_font().color(&PALE);
    let mut chart = ChartBuilder::on(area)
        .margin_top(30)
        .margin_right(20)
        .set_label_area_size(LabelAreaPosition::Left, 64)
        .margin_bottom(if lowest { 6 } else { 0 })
        .set_label_area_size(LabelAreaPosition::Bottom, if lowest { FOOT - 6 } else { 8 })
        .build_cartesian_2d(time.clone(), panel.y.clone())?;
    let (low, high) = (panel.y.start.min(panel.y.end), panel.y.start.max(panel.y.end));
    // A retreat of milliseconds in a run of minutes would be too thin to see.
    let least = (time.end - time.start) / 500.0;
    for (stretch, phase, strength) in &marks.shades {
        let wider = ((least - (stretch.end - stretch.start)) / 2.0).max(0.0);
        let stretch = (stretch.start - wider).max(time.start)..(stretch.end + wider).min(time.end);
        let colour = shade(*phase, f64::from(*strength) / 4.0).filled();
        chart.draw_series([Rectangle::new([(stretch.start, low), (stretch.end, high)], colour)])?;
    }
    let mut mesh = chart.configure_mesh();
    mesh.max_light_lines(0).bold_line_style(GRID).axis_style(PALE).label_style(labels);
    mesh.x_labels(9).y_labels(5).x_label_formatter(&time_label).y_label_formatter(&number);
    if lowest {
        mesh.x_desc("time, s");
    }
    mesh.axis_desc_style(("sans-serif", 18).into_font().color(&INK)).draw()?;
    for (from, name) in &marks.rows {
        let (bottom, top) = ((*from, panel.y.start), (*from, panel.y.end));
        chart.draw_series([PathElement::new([bottom, top], PALE.stroke_width(1))])?;
        if first {
            let font = ("sans-serif", 17).into_font().color(&INK);
            chart.draw_series([EmptyElement::at(top) + Text::new(name.clone(), (4, 3), font)])?;
        }
    }
    for curve in &panel.curves {
        let inside = |(t, y): &(f64, f64)| (*t, y.clamp(low, high));
        // What is not a number is a gap.
        for band in curve.band.split(|(_, min, max)| !(min + max).is_finite()).filter(|band| !band.is_empty()) {
            let upper = band.iter().map(|(t, _, max)| inside(&(*t, *max)));
            let lower = band.iter().rev().map(|(t, min, _)| inside(&(*t, *min)));
            let outline: Vec<_> = upper.chain(lower).collect();
            chart.draw_series([Polygon::new(outline, curve.colour.mix(curve.opaque))])?;
        }
        let style = curve.colour.stroke_width(curve.width);
        for line in within(&curve.line, low, high) {
            if curve.dashed {
                chart.draw_series(DashedLineSeries::new(line, 9, 6, style))?;
            } else {
                chart.draw_series([PathElement::new(line, style)])?;
            }
        }
    }
    legend(area, panel)
}

/// The parts of a line that lie within the diagram, each as far as its edge.
fn within(line: &[(f64, f64)], low: f64, high: f64) -> Vec<Vec<(f64, f64)>> {
    let inside = |(_, y): &(f64, f64)| (low..=high).contains(y);
    let mut parts: Vec<Vec<(f64, f64)>> = vec![Vec::new()];
    for (i, point) in line.iter().enumerate() {
        let near = [i.wrapping_sub(1), i + 1].into_iter().any(|i| line.get(i).is_some_and(inside));
        match parts.last_mut() {
            Some(part) if inside(point) || near && point.1.is_finite() => {
                part.push((point.0, point.1.clamp(low, high)))
            }
            Some(part) if part.is_empty() => {}
            _ => parts.push(Vec::new()),
        }
    }
    parts.retain(|part| part.len() > 1);
    parts
}

/// Name of the panel and its curves, above the diagram.
fn legend<'a>(area: &Area<'a>, panel: &Panel) -> PlotResult<'a> {
    text(area, panel.name, (64, 9), 15.0, INK, true)?;
    let mut x = 64 + width(panel.name, 15.0, true) + 16;
    // A single curve is named by its panel.
    for Curve { label, colour, width: thick, dashed, line, opaque, .. } in
        panel.curves.iter().filter(|_| panel.curves.len() > 1)
    {
        let swatch = colour.stroke_width(thick + 1);
        if line.is_empty() {
            area.draw(&Rectangle::new([(x, 11), (x + 21, 23)], colour.mix(*opaque).filled()))?;
        }
        let pieces = if *dashed { vec![(0, 8), (13, 21)] } else { vec![(0, 21)] };
        for (from, to) in pieces {
            area.draw(&PathElement::new([(x + from, 17), (x + to, 17)], swatch))?;
        }
        text(area, label, (x + 26, 10), 14.0, PALE, false)?;
        x += 26 + width(label, 14.0, false) + 12;
    }
    Ok(())
}

/// About as wide as a text gets in a wide sans-serif font, pixels: an SVG does not know its reader's font.
pub(super) fn width(words: &str, pixels: f64, bold: bool) -> i32 {
    (words.chars().count() as f64 * pixels * if bold { 0.64 } else { 0.57 }).round() as i32
}

pub(super) fn text<'a>(
    area: &Area<'a>,
    words: &str,
    at: (i32, i32),
    pixels: f64,
    colour: RGBColor,
    bold: bool,
) -> PlotResult<'a> {
    // The SVG backend divides sizes by 1.24.
    let style = if bold { FontStyle::Bold } else { FontStyle::Normal };
    let font = ("sans-serif", pixels * 1.24).into_font().style(style).color(&colour);
    area.draw(&Text::new(words.to_owned(), at, font.pos(Pos::new(HPos::Left, VPos::Top))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_cut_where_it_leaves_the_diagram() {
        let line = [0.0, 0.5, 9.0, 9.0, 9.0, 0.5, -3.0].map(|y| (y, y));
        let ys: Vec<Vec<f64>> =
            within(&line, 0.0, 1.0).iter().map(|part| part.iter().map(|(_, y)| *y).collect()).collect();
        assert_eq!(ys, [vec![0.0, 0.5, 1.0], vec![1.0, 0.5, 0.0]]);
        let with_a_gap = [(0.0, 0.5), (1.0, 0.5), (2.0, f64::NAN), (3.0, 0.5), (4.0, 0.5)];
        assert_eq!(within(&with_a_gap, 0.0, 1.0), [with_a_gap[..2].to_vec(), with_a_gap[3..].to_vec()]);
        assert!(within(&[], 0.0, 1.0).is_empty());
    }
}
