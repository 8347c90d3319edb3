//! Gates: what is measured, what it should be, and what came of it.

use edm_sim::plot::Figure;
use std::fmt;

/// What kind of gate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Published, and fitted to.
    Calibration,
    /// Must hold.
    Physics,
    /// Published, and never fitted: one that is not met says what the model cannot do.
    Validation,
    /// Without a bound.
    Figure,
}

/// What a value should be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wanted {
    /// No more than this.
    AtMost(f64),
    /// No less.
    AtLeast(f64),
    /// Between two.
    Between(f64, f64),
    /// Whatever it is.
    Anything,
}

impl Wanted {
    fn has(self, value: f64) -> bool {
        match self {
            Wanted::AtMost(most) => value <= most,
            Wanted::AtLeast(least) => value >= least,
            Wanted::Between(least, most) => (least..=most).contains(&value),
            Wanted::Anything => true,
        }
    }
}

/// A bound with what matters of it.
struct Bound(f64);

impl fmt::Display for Bound {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            little if little != 0.0 && little.abs() < 1e-3 => write!(f, "{little:e}"),
            third if third.fract() != 0.0 => write!(f, "{}", (third * 1e3).round() / 1e3),
            whole => write!(f, "{whole}"),
        }
    }
}

impl fmt::Display for Wanted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Wanted::AtMost(most) => write!(f, "<= {}", Bound(most)),
            Wanted::AtLeast(least) => write!(f, ">= {}", Bound(least)),
            Wanted::Between(least, most) => write!(f, "{} .. {}", Bound(least), Bound(most)),
            Wanted::Anything => Ok(()),
        }
    }
}

/// A gate and what came of it.
#[derive(Clone, Debug)]
pub struct Gate {
    /// What is measured, with its unit.
    pub name: String,
    /// What kind.
    pub kind: Kind,
    /// What was found.
    pub value: f64,
    /// What it should be.
    pub wanted: Wanted,
    /// Whether it is.
    pub pass: bool,
    /// What belongs to it: spread, neighbours, what it hangs on.
    pub note: String,
    /// Diagrams of the value beside what it hangs on.
    pub figures: Vec<Figure>,
}

impl Gate {
    pub fn new(kind: Kind, name: impl Into<String>, value: f64, wanted: Wanted, note: impl Into<String>) -> Gate {
        let (pass, figures) = (wanted.has(value), Vec::new());
        Gate { name: name.into(), kind, value, wanted, pass, note: note.into(), figures }
    }

    pub fn drawn(mut self, figures: impl IntoIterator<Item = Figure>) -> Gate {
        self.figures.extend(figures);
        self
    }

    /// A value without a bound.
    pub fn figure(name: impl Into<String>, value: f64, note: impl Into<String>) -> Gate {
        Gate::new(Kind::Figure, name, value, Wanted::Anything, note)
    }

    /// Whether it is known not to be met.
    pub fn is_open(&self) -> bool {
        OPEN.contains(&self.name.as_str())
    }

    /// Whether its test fails: it has to be met and is not, or it is open and is met all the same.
    pub fn fails(&self) -> bool {
        let must = matches!(self.kind, Kind::Calibration | Kind::Physics);
        if self.is_open() { self.pass } else { must && !self.pass }
    }
}

impl fmt::Display for Gate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let met = match (self.pass, self.is_open()) {
            (true, false) => "met",
            (true, true) => "MET, although it is said to be open",
            (false, true) => "open",
            (false, false) => "NOT MET",
        };
        let value = self.value;
        let value = if value != 0.0 && value.abs() < 1e-3 { format!("{value:.1e}") } else { format!("{value:.3}") };
        write!(f, "{met}: {value} (wanted {}) {}: {}", self.wanted, self.name, self.note)
    }
}

/// Gates that are known not to be met: docs/process-model.md has their values.
const OPEN: [&str; 3] = [
    "2 mm deep, flushing: too much at 1 MPa: slower than the best by, %",
    "5 mm deep, flushing: too much at 1 MPa: slower than the best by, %",
    "plain RC, 100 nF, 1.5 of the least resistance: arcs, % of pulses",
];
