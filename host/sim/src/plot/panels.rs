//! What the panels show: signals, colours, ranges.

use super::Picture;
use super::buckets::{Bucket, Known};
use super::shares::{STACKED, Shares};
use crate::millisecond::Span;
use plotters::style::RGBColor;
use std::ops::Range;

pub(crate) const BLUE: RGBColor = RGBColor(0x1b, 0x5e, 0x9e);
pub(crate) const BROWN: RGBColor = RGBColor(0x8a, 0x5a, 0x2b);
pub(crate) const GREY: RGBColor = RGBColor(0x9a, 0xa5, 0xb1);
pub(crate) const INK: RGBColor = RGBColor(0x24, 0x2c, 0x35);
pub(crate) const ORANGE: RGBColor = RGBColor(0xe0, 0x6c, 0x00);
pub(crate) const GREEN: RGBColor = RGBColor(0x1e, 0x80, 0x4b);
pub(crate) const RED: RGBColor = RGBColor(0xc2, 0x18, 0x07);
pub(crate) const PURPLE: RGBColor = RGBColor(0x6d, 0x3f, 0xa0);

/// How opaque a band behind a line is, and an area without one.
pub(crate) const BAND: f64 = 0.25;
const AREA: f64 = 0.65;

/// A signal in a panel.
#[derive(Debug)]
pub(crate) struct Curve {
    pub label: String,
    pub colour: RGBColor,
    pub width: u32,
    pub dashed: bool,
    pub line: Vec<(f64, f64)>,
    /// Time, smallest, largest.
    pub band: Vec<(f64, f64, f64)>,
    /// How opaque the band is, 0..=1.
    pub opaque: f64,
}

/// A diagram in the making.
#[derive(Debug)]
pub(crate) struct Panel {
    pub name: &'static str,
    /// From bottom to top.
    pub y: Range<f64>,
    pub curves: Vec<Curve>,
}

/// A plain line.
pub(crate) fn line(label: &str, colour: RGBColor, width: u32, line: Vec<(f64, f64)>) -> Curve {
    Curve { label: label.into(), colour, width, dashed: false, line, band: Vec::new(), opaque: BAND }
}

/// A line of means in a band from smallest to largest.
fn banded(label: &str, colour: RGBColor, columns: &[Bucket], signal: impl Fn(&Bucket) -> Span) -> Curve {
    Curve {
        band: columns.iter().map(|c| (c.t_s, signal(c).min, signal(c).max)).collect(),
        ..line(label, colour, 1, columns.iter().map(|c| (c.t_s, signal(c).mean)).collect())
    }
}

fn of(columns: &[Bucket], signal: impl Fn(&Bucket) -> f64) -> Vec<(f64, f64)> {
    columns.iter().map(|c| (c.t_s, signal(c))).collect()
}

/// From the smallest to the largest value with a margin; never empty.
pub(crate) fn range(values: impl Iterator<Item = f64>) -> Range<f64> {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for x in values.filter(|x| x.is_finite()) {
        low = low.min(x);
        high = high.max(x);
    }
    if low > high {
        return 0.0..1.0;
    }
    let margin = ((high - low) * 0.06).max(high.abs().max(low.abs()) * 1e-3).max(1e-6);
    low - margin..high + margin
}

/// Range of a signal while eroding, if it ever did: seeking from afar must not flatten the rest.
fn working(columns: &[Bucket], signal: impl Fn(&Bucket) -> Span) -> Range<f64> {
    let any = columns.iter().any(Bucket::eroding);
    let chosen = columns.iter().filter(|c| c.eroding() || !any);
    range(chosen.flat_map(|c| [signal(c).min, signal(c).max]))
}

/// Where the curves are drawn from.
#[derive(Clone, Copy, Debug)]
pub(super) struct View<'a> {
    pub picture: &'a Picture,
    pub columns: &'a [Bucket],
    pub shares: &'a Shares,
    /// The first surface, um.
    pub first_surface_um: f64,
}

impl View<'_> {
    /// The panels of the whole run.
    pub fn whole(&self) -> Vec<Panel> {
        let volts = self.columns.iter().flat_map(|c| [c.filtered_v.max, c.setpoint_v, 0.0]);
        let gap = working(self.columns, |c| c.gap_um);
        let duty = working(self.columns, |c| c.duty);
        let mut panels = vec![
            self.depth("Depth, mm", 1e-3),
            Panel { name: "Gap voltage, V", y: range(volts), curves: self.voltages() },
        ];
        panels.extend(self.sensed());
        panels.extend([self.gap(gap.start.min(0.0)..gap.end), self.dirt(), self.duty(duty)]);
        panels
    }

    /// The panels of the close-up: nearer in every direction, and with the voltage as it was measured.
    pub fn close_up(&self) -> Vec<Panel> {
        let columns = self.columns;
        let volts = columns.iter().flat_map(|c| [c.filtered_v.min, c.filtered_v.max, c.setpoint_v, c.gap_v.mean]);
        let mut voltages = vec![line("measured", GREY, 1, of(columns, |c| c.gap_v.mean))];
        voltages.extend(self.voltages());
        let mut panels =
            vec![self.depth("Depth, µm", 1.0), Panel { name: "Gap voltage, V", y: range(volts), curves: voltages }];
        panels.extend(self.sensed());
        panels.extend([self.gap(working(columns, |c| c.gap_um)), self.dirt(), self.duty(working(columns, |c| c.duty))]);
        panels
    }

    /// What the head makes of the pulses. The distance only where it was known in the run.
    fn sensed(&self) -> Vec<Panel> {
        let mut panels =
            vec![self.classes(), self.hazard(), self.known("Sparks a millisecond, sensed", BLUE, |c| c.frequency)];
        if self.picture.run.all().iter().any(|c| c.distance.is_known()) {
            panels.push(self.known("Gap by charging time, sensed, µm", GREEN, |c| c.distance));
        }
        panels
    }

    /// Shares of all pulses, one above the other.
    fn classes(&self) -> Panel {
        let colours = [GREEN, BLUE, GREY, ORANGE, RED];
        let mut curves: Vec<Curve> = STACKED
            .into_iter()
            .zip(colours)
            .map(|(class, colour)| Curve {
                opaque: AREA,
                ..line(&format!("{class:?}").to_lowercase(), colour, 1, Vec::new())
            })
            .collect();
        let mut seen = [false; STACKED.len()];
        for window in self.shares.all() {
            // Without a pulse there is a gap in the stack.
            let shares = window.percent().unwrap_or([f64::NAN; STACKED.len()]);
            seen.iter_mut().zip(shares).for_each(|(seen, share)| *seen |= share > 0.0);
            let mut below = 0.0;
            for (curve, share) in curves.iter_mut().zip(shares) {
                curve.band.extend([window.time.0, window.time.1].map(|t| (t, below, below + share)));
                below += share;
            }
        }
        let mut seen = seen.into_iter();
        curves.retain(|_| seen.next().unwrap_or(false));
        Panel { name: "Pulses, sensed, % of all", y: 0.0..100.0, curves }
    }

    /// Hazard of ignition in a band of its standard deviation.
    fn hazard(&self) -> Panel {
        let bounds = |c: &Bucket| (c.hazard.value - c.hazard.deviation, c.hazard.value + c.hazard.deviation);
        let mut panel = self.known("Hazard ± standard deviation, sensed, 1/ms", PURPLE, |c| c.hazard);
        let curve = self.columns.iter().map(|c| match c.hazard.is_known() {
            true => (c.t_s, bounds(c).0, bounds(c).1),
            false => (c.t_s, f64::NAN, f64::NAN),
        });
        if let Some(only) = panel.curves.first_mut() {
            only.band = curve.collect();
        }
        panel
    }

    /// A quantity where it is known. A hundredth of its values at either end does not decide the scale.
    fn known(&self, name: &'static str, colour: RGBColor, quantity: impl Fn(&Bucket) -> Known) -> Panel {
        let value = |c: &Bucket| if quantity(c).is_known() { quantity(c).value } else { f64::NAN };
        let any = self.columns.iter().any(Bucket::eroding);
        let chosen = self.columns.iter().filter(|c| (c.eroding() || !any) && quantity(c).is_known());
        let mut values: Vec<f64> = chosen
            .flat_map(|c| [quantity(c).value - quantity(c).deviation, quantity(c).value + quantity(c).deviation])
            .collect();
        values.sort_by(f64::total_cmp);
        let cut = values.len() / 100;
        let y = range(values.get(cut..values.len() - cut).unwrap_or(&[]).iter().copied());
        Panel { name, y, curves: vec![line("", colour, 1, of(self.columns, value))] }
    }

    /// Depth grows downward, as it does on the machine; below the surface is work.
    fn depth(&self, name: &'static str, unit: f64) -> Panel {
        let depth = |um: f64| (um - self.first_surface_um) * unit;
        let electrode = |c: &Bucket| {
            let Span { mean, min, max } = c.position_um;
            Span { mean: depth(mean), min: depth(min), max: depth(max) }
        };
        let moves = working(self.columns, electrode);
        let bottom = self.columns.iter().map(|c| depth(c.surface_um));
        let Range { start: up, end: down } = range(bottom.chain([moves.start, moves.end]));
        let surface = of(self.columns, |c| depth(c.surface_um));
        let band = surface.iter().map(|(t, y)| (*t, *y, down)).collect();
        let work = Curve { band, ..line("bottom of the hole", BROWN, 2, surface) };
        let electrode = Curve { width: 2, ..banded("electrode", BLUE, self.columns, electrode) };
        Panel { name, y: down..up, curves: vec![work, electrode] }
    }

    fn gap(&self, y: Range<f64>) -> Panel {
        Panel { name: "Gap, µm", y, curves: vec![banded("gap", GREEN, self.columns, |c| c.gap_um)] }
    }

    /// Debris and damage by arcs.
    fn dirt(&self) -> Panel {
        let (debris, damage) = (of(self.columns, |c| c.debris), of(self.columns, |c| c.damage));
        let y = range(debris.iter().chain(&damage).map(|(_, y)| *y).chain([0.0]));
        let curves = vec![line("debris", BROWN, 1, debris), line("damage by arcs", INK, 1, damage)];
        Panel { name: "Debris (1: 5 %), arc damage", y, curves }
    }

    fn duty(&self, y: Range<f64>) -> Panel {
        Panel { name: "Duty (positive drives down)", y, curves: vec![banded("duty", PURPLE, self.columns, |c| c.duty)] }
    }

    fn voltages(&self) -> Vec<Curve> {
        let within = |t: &f64| match (self.columns.first(), self.columns.last()) {
            (Some(first), Some(last)) => (first.time().0..=last.time().1).contains(t),
            _ => false,
        };
        let means = self.picture.means.all().iter().copied().filter(|(t, _)| within(t)).collect();
        let label = format!("{} ms mean", self.picture.means.window_ms());
        let mut wanted = line("set point", INK, 2, of(self.columns, |c| c.setpoint_v));
        // The head has no setpoint before it found the work.
        wanted.line.retain(|(_, volts)| *volts > 0.0);
        wanted.dashed = true;
        vec![banded("filtered", BLUE, self.columns, |c| c.filtered_v), line(&label, ORANGE, 2, means), wanted]
    }
}
