//! Curves of what was found, for whoever draws them.

/// Curves over one axis.
#[derive(Clone, Debug)]
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
#[derive(Clone, Debug)]
pub struct Curve {
    /// Name.
    pub name: String,
    /// Whether these values are published; simulated otherwise.
    pub published: bool,
    /// x, y and the standard error of y.
    pub points: Vec<[f64; 3]>,
}

impl Figure {
    /// No curve yet.
    pub fn new(name: impl Into<String>, x: &'static str, y: &'static str) -> Figure {
        let (places, curves, limits, marks) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Figure { name: name.into(), x, y, log: false, places, curves, limits, marks }
    }

    /// x is logarithmic.
    pub fn log(self) -> Figure {
        Figure { log: true, ..self }
    }

    /// x are places with these names.
    pub fn places<'a>(self, names: impl IntoIterator<Item = &'a str>) -> Figure {
        Figure { places: names.into_iter().map(str::to_owned).collect(), ..self }
    }

    /// A simulated curve: over x, y with its standard error.
    pub fn curve<Y: Into<(f64, f64)>>(
        mut self,
        name: impl Into<String>,
        points: impl IntoIterator<Item = (f64, Y)>,
    ) -> Figure {
        let points = points.into_iter().map(|(x, y)| (x, y.into())).map(|(x, (y, error))| [x, y, error]).collect();
        self.curves.push(Curve { name: name.into(), published: false, points });
        self
    }

    /// A curve whose scatter is unknown or does not show.
    pub fn line(self, name: impl Into<String>, points: impl IntoIterator<Item = (f64, f64)>) -> Figure {
        self.curve(name, points.into_iter().map(|(x, y)| (x, (y, 0.0))))
    }

    /// Published values.
    pub fn published(mut self, name: impl Into<String>, points: impl IntoIterator<Item = (f64, f64)>) -> Figure {
        let points = points.into_iter().map(|(x, y)| [x, y, 0.0]).collect();
        self.curves.push(Curve { name: name.into(), published: true, points });
        self
    }

    /// A limit on y.
    pub fn limit(mut self, name: impl Into<String>, y: f64) -> Figure {
        self.limits.push((name.into(), y));
        self
    }

    /// A published value on x.
    pub fn mark(mut self, name: impl Into<String>, x: f64) -> Figure {
        self.marks.push((name.into(), x));
        self
    }
}
