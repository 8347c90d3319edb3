//! Figures of what was found: panels beside and below each other, each with axes of its own.

use super::panels::{BLUE, GREEN, INK, ORANGE, PURPLE, range};
use super::sheet::{GRID, PALE, text, width};
use super::{Curve, Figure};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::ops::Range;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type PlotResult<'a> = Result<(), DrawingAreaErrorKind<<SVGBackend<'a> as DrawingBackend>::ErrorType>>;

const PANEL: (u32, u32) = (540, 370);
const HEAD: u32 = 64;
/// Name of the panel and two rows of its legend.
const TOP: u32 = 76;
const LEFT: u32 = 66;
/// Left of the name of the y axis, half of which is drawn outside its area.
const MARGIN: u32 = 14;
/// Where the names in a panel begin.
const NAMES: i32 = (LEFT + MARGIN) as i32;
const COLOURS: [RGBColor; 4] = [BLUE, ORANGE, GREEN, PURPLE];
/// Points beyond which a curve shows its line alone.
const DOTTED: usize = 25;

/// Draws them as SVG, under a title and a line that says more.
pub(super) fn draw(title: &str, more: &str, of: &[Figure]) -> Result<String, String> {
    let columns = match of.len() {
        0 | 1 => 1,
        2 | 4 => 2,
        _ => 3,
    };
    let rows = of.len().div_ceil(columns);
    let mut svg = String::new();
    // A single panel is narrower than its title.
    let wide = (PANEL.0 * columns as u32).max(720);
    let root = SVGBackend::with_string(&mut svg, (wide, HEAD + PANEL.1 * rows as u32)).into_drawing_area();
    let drawn = root.fill(&WHITE).and_then(|()| {
        let (head, body) = root.split_vertically(HEAD);
        text(&head, title, (20, 12), 20.0, INK, true)?;
        text(&head, more, (20, 40), 13.0, PALE, false)?;
        for (area, figure) in body.split_evenly((rows, columns)).iter().zip(of) {
            panel(area, figure)?;
        }
        Ok(())
    });
    drawn.map_err(|error| error.to_string())?;
    drop(root);
    Ok(svg)
}

fn panel<'a>(area: &Area<'a>, figure: &Figure) -> PlotResult<'a> {
    let scale = |x: f64| if figure.log { x.log10() } else { x };
    let points = || figure.curves.iter().flat_map(|curve| &curve.points).filter(|point| point[1].is_finite());
    let across = if figure.places.is_empty() {
        range(points().map(|point| scale(point[0])))
    } else {
        -0.5..figure.places.len() as f64 - 0.5
    };
    let ends = points().flat_map(|&[_, y, error]| [y - error, y + error]);
    let up = range(ends.chain(figure.limits.iter().map(|limit| limit.1)).chain([0.0]));

    let mut chart = ChartBuilder::on(area)
        .margin_top(TOP)
        .margin_left(MARGIN)
        .margin_right(18)
        .margin_bottom(6)
        .set_label_area_size(LabelAreaPosition::Left, LEFT)
        .set_label_area_size(LabelAreaPosition::Bottom, 48)
        .build_cartesian_2d(across.clone(), up.clone())?;
    let at = |x: &f64| across_label(figure, &across, *x);
    let number = |y: &f64| format!("{}", (y * 1e4).round() / 1e4 + 0.0);
    let labels = ("sans-serif", if figure.places.len() > 5 { 14 } else { 16 }).into_font().color(&PALE);
    let mut mesh = chart.configure_mesh();
    mesh.max_light_lines(0).bold_line_style(GRID).axis_style(PALE).label_style(labels);
    mesh.x_desc(figure.x).y_desc(figure.y).axis_desc_style(("sans-serif", 17).into_font().color(&INK));
    let places = if figure.places.is_empty() { 8 } else { 2 * figure.places.len() + 1 };
    mesh.x_labels(places).y_labels(6).x_label_formatter(&at).y_label_formatter(&number).draw()?;

    let small = ("sans-serif", 15).into_font().color(&PALE);
    for (name, y) in &figure.limits {
        chart.draw_series(DashedLineSeries::new([(across.start, *y), (across.end, *y)], 2, 4, INK.stroke_width(1)))?;
        // Above the line, unless that is the top.
        let below = *y > up.start + 0.9 * (up.end - up.start);
        let pos = Pos::new(HPos::Right, if below { VPos::Top } else { VPos::Bottom });
        chart.draw_series([Text::new(name.clone(), (across.end, *y), small.pos(pos))])?;
    }
    for (name, x) in &figure.marks {
        let x = scale(*x);
        chart.draw_series(DashedLineSeries::new([(x, up.start), (x, up.end)], 2, 4, INK.stroke_width(1)))?;
        let pos = Pos::new(HPos::Left, VPos::Top);
        chart.draw_series([Text::new(format!(" {name}"), (x, up.end), small.pos(pos))])?;
    }
    for (curve, colour) in figure.curves.iter().zip(colours(figure)) {
        let line: Vec<(f64, f64)> = curve.points.iter().map(|point| (scale(point[0]), point[1])).collect();
        if !curve.published && figure.places.is_empty() {
            chart.draw_series([PathElement::new(line.clone(), colour.stroke_width(2))])?;
        }
        for &[x, y, error] in curve.points.iter().filter(|point| point[2] > 0.0) {
            let bar = vec![(scale(x), y - error), (scale(x), y + error)];
            chart.draw_series([PathElement::new(bar, colour.stroke_width(2))])?;
        }
        if curve.points.len() <= DOTTED {
            let size = if curve.published { 5 } else { 4 };
            chart.draw_series(line.iter().map(|&at| Circle::new(at, size, colour.filled())))?;
        }
    }
    legend(area, figure)
}

/// Published values are black; the others have a colour each.
fn colours(figure: &Figure) -> impl Iterator<Item = RGBColor> {
    let mut next = COLOURS.into_iter().cycle();
    figure.curves.iter().map(move |curve| if curve.published { INK } else { next.next().unwrap_or(BLUE) })
}

fn across_label(figure: &Figure, across: &Range<f64>, x: f64) -> String {
    let near = x.round();
    let whole = (x - near).abs() < 1e-6;
    if !figure.places.is_empty() {
        return figure.places.get(near.max(0.0) as usize).filter(|_| whole && near >= 0.0).cloned().unwrap_or_default();
    }
    match (figure.log, across.end - across.start > 2.0) {
        (true, true) if !whole => String::new(),
        (true, _) => {
            let value = 10f64.powf(x);
            let unit = 10f64.powf(value.log10().floor() - 1.0);
            format!("{}", ((value / unit).round() * unit * 1e6).round() / 1e6)
        }
        (false, _) => format!("{}", (x * 1e4).round() / 1e4 + 0.0),
    }
}

/// Name of the panel, and below it its curves.
fn legend<'a>(area: &Area<'a>, figure: &Figure) -> PlotResult<'a> {
    text(area, &figure.name, (NAMES, 8), 14.0, INK, true)?;
    let (mut x, mut y) = (NAMES, 31);
    for (Curve { name, published, .. }, colour) in figure.curves.iter().zip(colours(figure)) {
        let wide = 26 + width(name, 13.0, false) + 12;
        if x + wide > PANEL.0 as i32 && x > NAMES {
            (x, y) = (NAMES, y + 20);
        }
        if *published {
            area.draw(&Circle::new((x + 10, y + 7), 5, colour.filled()))?;
        } else {
            area.draw(&PathElement::new([(x, y + 7), (x + 20, y + 7)], colour.stroke_width(3)))?;
        }
        text(area, name, (x + 26, y), 13.0, PALE, false)?;
        x += wide;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure(log: bool) -> Figure {
        Figure {
            name: "of a test".into(),
            x: "gap, um",
            y: "time, s",
            log,
            places: Vec::new(),
            curves: vec![
                Curve {
                    name: "simulated".into(),
                    published: false,
                    points: vec![[1.0, 2.0, 0.1], [100.0, f64::NAN, 0.0]],
                },
                Curve { name: "[X]".into(), published: true, points: vec![[10.0, 3.0, 0.0]] },
            ],
            limits: vec![("gate".into(), 5.0)],
            marks: Vec::new(),
        }
    }

    #[test]
    fn a_figure_names_its_axes_its_curves_and_its_limit() {
        let svg = draw("title", "more", &[figure(true)]).unwrap();
        for words in ["title", "more", "of a test", "gap, um", "time, s", "simulated", "[X]", "gate"] {
            assert!(svg.contains(words), "{words}");
        }
    }

    #[test]
    fn decades_are_labelled_and_places_have_their_names() {
        let log = figure(true);
        assert_eq!(across_label(&log, &(-1.0..3.0), 2.0), "100");
        assert_eq!(across_label(&log, &(-1.0..3.0), 0.5), "");
        assert_eq!(across_label(&log, &(0.0..1.5), 0.5), "3.2");
        let places = Figure { places: vec!["FC".into(), "1TAV".into()], ..figure(false) };
        assert_eq!(across_label(&places, &(-0.5..1.5), 1.0), "1TAV");
        assert_eq!(across_label(&places, &(-0.5..1.5), 0.5), "");
        assert_eq!(across_label(&places, &(-0.5..1.5), -0.5), "");
    }
}
