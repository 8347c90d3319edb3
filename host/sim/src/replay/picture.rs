//! A replay as a picture: the voltages, the classes of pulses, the notch.

use super::recording::Recording;
use super::{NAMED, Replay, Row, name};
use crate::plot::panels::{BLUE, BROWN, Curve, GREEN, GREY, INK, ORANGE, PURPLE, Panel, line, range};
use plotters::style::RGBColor;

/// Most columns of a curve: about one a pixel.
const COLUMNS: usize = 1500;

fn curve(label: &str, colour: RGBColor, rows: &[Row], value: impl Fn(&Row) -> Option<f64>) -> Curve {
    line(label, colour, 1, rows.iter().filter_map(|row| Some((row.t_s, value(row)?))).collect())
}

/// The same, with a band from the smallest to the largest of what a column has, when there are more rows than columns.
fn banded(label: &str, colour: RGBColor, rows: &[Row], value: impl Fn(&Row) -> f32) -> Curve {
    let each = rows.len().div_ceil(COLUMNS).max(1);
    let (mut means, mut band) = (Vec::new(), Vec::new());
    for rows in rows.chunks(each) {
        let values = || rows.iter().map(|row| f64::from(value(row)));
        let t_s = rows[rows.len() / 2].t_s;
        means.push((t_s, values().sum::<f64>() / rows.len() as f64));
        band.push((t_s, values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max)));
    }
    let band = if each > 1 { band } else { Vec::new() };
    Curve { band, ..line(label, colour, 1, means) }
}

fn panel(name: &'static str, curves: Vec<Curve>) -> Panel {
    let values = curves.iter().flat_map(|curve| {
        let band = curve.band.iter().flat_map(|(_, low, high)| [*low, *high]);
        curve.line.iter().map(|(_, y)| *y).chain(band)
    });
    Panel { name, y: range(values), curves }
}

/// Draws a replay as SVG.
///
/// # Errors
/// When it cannot be drawn.
pub fn draw(replay: &Replay, recording: &Recording, title: &str) -> Result<String, String> {
    let rows = replay.rows.as_slice();
    let (first, last) = (rows.first().map_or(0.0, |row| row.t_s), rows.last().map_or(1.0, |row| row.t_s));
    let voltages = vec![
        banded("decimated", GREY, rows, |row| row.decimated_v),
        banded("low-pass", ORANGE, rows, |row| row.lowpass_v),
        banded("filtered", BLUE, rows, |row| row.filtered_v),
        Curve { dashed: true, ..banded("tracking notch", GREEN, rows, |row| row.followed_v) },
    ];
    let mut panels = vec![panel("Gap voltage, V", voltages)];
    if replay.classified {
        let colours = [GREEN, BLUE, ORANGE, INK, PURPLE];
        let shares = NAMED.into_iter().zip(colours);
        let shares = shares.map(|(class, colour)| curve(name(class), colour, rows, |row| row.percent(class)));
        panels.push(Panel { name: "Share of pulses in 200 ms, %", y: -4.0..104.0, curves: shares.collect() });
        let count = |class| move |row: &Row| Some(row.classes.iter().filter(|other| **other == class).count() as f64);
        let ended =
            NAMED.into_iter().zip(colours).map(|(class, colour)| curve(name(class), colour, rows, count(class)));
        panels.push(panel("Pulses that ended, per tick", ended.collect()));
    }
    let notch = curve("notch", BROWN, rows, |row| Some(row.notch_hz.into()));
    panels.push(panel("Tracking notch, Hz", vec![notch]));
    let more =
        format!("{:.4} s of {:.0} kS/s, one value a servo tick of 50 µs", recording.seconds(), recording.rate / 1e3);
    crate::plot::panels(&format!("Replay: {title}"), &more, &(first..last.max(first + 1e-6)), &panels)
}
