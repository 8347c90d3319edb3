//! What a gate found as a diagram, for whoever draws it.

use super::Mean;
use serde::Serialize;

/// Curves over one axis.
#[derive(Clone, Debug, Serialize)]
pub struct Figure {
    /// What it shows.
    pub name: String,
    /// Name of the x axis, with its unit.
    pub x: &'static str,
    /// Name of the y axis, with its unit.
    pub y: &'static str,
    /// Whether x is logarithmic.
    pub log: bool,
    /// Names of x = 0, 1, 2 and so on, where x is no number.
    pub places: Vec<String>,
    /// The curves.
    pub curves: Vec<Curve>,
    /// Where the gate ends, on y.
    pub limits: Vec<(String, f64)>,
    /// Published values, on x.
    pub marks: Vec<(String, f64)>,
}

/// A curve of a figure.
#[derive(Clone, Debug, Serialize)]
pub struct Curve {
    /// Name.
    pub name: String,
    /// Whether these values are published; simulated otherwise.
    pub published: bool,
    /// x, y and the standard error of y.
    pub points: Vec<[f64; 3]>,
}

impl Figure {
    pub(super) fn new(name: impl Into<String>, x: &'static str, y: &'static str) -> Figure {
        let (places, curves, limits, marks) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Figure { name: name.into(), x, y, log: false, places, curves, limits, marks }
    }

    pub(super) fn log(self) -> Figure {
        Figure { log: true, ..self }
    }

    /// x are places with these names.
    pub(super) fn places<'a>(self, names: impl IntoIterator<Item = &'a str>) -> Figure {
        Figure { places: names.into_iter().map(str::to_owned).collect(), ..self }
    }

    pub(super) fn curve(mut self, name: impl Into<String>, points: impl IntoIterator<Item = (f64, Mean)>) -> Figure {
        let points = points.into_iter().map(|(x, y)| [x, y.of, y.error]).collect();
        self.curves.push(Curve { name: name.into(), published: false, points });
        self
    }

    /// A curve whose scatter is unknown or does not show.
    pub(super) fn line(self, name: impl Into<String>, points: impl IntoIterator<Item = (f64, f64)>) -> Figure {
        self.curve(name, points.into_iter().map(|(x, of)| (x, Mean { of, error: 0.0 })))
    }

    pub(super) fn published(mut self, name: impl Into<String>, points: impl IntoIterator<Item = (f64, f64)>) -> Figure {
        let points = points.into_iter().map(|(x, y)| [x, y, 0.0]).collect();
        self.curves.push(Curve { name: name.into(), published: true, points });
        self
    }

    pub(super) fn limit(mut self, name: impl Into<String>, y: f64) -> Figure {
        self.limits.push((name.into(), y));
        self
    }

    pub(super) fn mark(mut self, name: impl Into<String>, x: f64) -> Figure {
        self.marks.push((name.into(), x));
        self
    }
}
