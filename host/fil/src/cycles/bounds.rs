//! Bounds of the estimates: limits, which every push must keep, and targets, not all of which are met yet.

use super::report::{Figures, Measured};

/// Cycles of a servo period: 168 MHz / 20 kHz. A block of conversions comes once in each, too.
const PERIOD: u64 = 8400;
/// Tasks that are done within half of their servo period at worst, so that what interrupts them finds room.
const HALF_A_PERIOD: [&str; 2] = ["gap", "servo"];
/// Share of the processor that a push may not exceed at rest, moving, and at 100 000 pulses a second, percent: what was won is kept. What
/// moves needs room for bursts on the bus, and for plans at twice the rate in a fast motion, 7 % (docs/tick.md). How the code happens to
/// lie in the flash makes 1 % of it.
pub(super) const FULL: [f64; 3] = [48.0, 70.0, 67.0];

/// Targets of the estimated cycles: task, mean, worst.
pub type TaskBound = (&'static str, u64, u64);

/// Tasks at rest, moving, and at 100 000 pulses a second.
pub const TASKS: [&[TaskBound]; 3] =
    [&[("servo", 650, 1000), ("plan", 3000, 4200)], &[("servo", 850, 1400), ("plan", 3000, 8400)], &[]];
/// Share of the processor at rest, moving, and at 100 000 pulses a second, percent.
pub const LOAD: [Option<f64>; 3] = [Some(33.0), Some(58.0), None];
/// Share of the gap task in the same scenes, percent.
pub const GAP: [Option<f64>; 3] = [Some(18.0), None, Some(25.0)];
/// Functions and paths, cycles of a run.
pub const FUNCTIONS: &[(&str, u64)] =
    &[("encoder edge", 65), ("encoder index", 120), ("encoder overload", 100), ("gap filter", 85), ("path step", 300)];

/// A bound and what was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// What is bounded.
    pub what: String,
    /// `None`: it was not met in any scene.
    pub measured: Option<f64>,
    /// At most.
    pub bound: f64,
}

impl Finding {
    /// Whether it is kept.
    pub fn kept(&self) -> bool {
        self.measured.is_some_and(|m| m <= self.bound)
    }
}

impl std::fmt::Display for Finding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let kept = if self.kept() { "met" } else { "not met" };
        match self.measured {
            Some(m) => write!(f, "{}: {m:.1}, at most {}: {kept}", self.what, self.bound),
            None => write!(f, "{}: did not run, at most {}: {kept}", self.what, self.bound),
        }
    }
}

/// The limits, with what was measured.
pub fn limits(measured: &Measured) -> Vec<Finding> {
    let mut list = Vec::new();
    // At 100 kHz the gap task takes more than half of its period: it is reported there.
    for (n, ((name, scene), full)) in measured.scenes().into_iter().zip(FULL).enumerate() {
        for task in HALF_A_PERIOD.into_iter().filter(|_| n < 2) {
            let measured = scene.tasks.get(task).map(|f| f.worst as f64);
            list.push(Finding { what: format!("{name}: {task}, worst, cycles"), measured, bound: (PERIOD / 2) as f64 });
        }
        list.push(Finding { what: format!("{name}: load, %"), measured: Some(scene.load_percent), bound: full });
    }
    list
}

/// The targets, with what was measured.
pub fn wanted(measured: &Measured) -> Vec<Finding> {
    let mut list = Vec::new();
    for (((scene, tasks), load), gap) in measured.scenes().into_iter().zip(TASKS).zip(LOAD).zip(GAP) {
        for (task, mean, worst) in tasks {
            let found = scene.1.tasks.get(*task);
            let mut add = |what, bound: u64, figure: fn(&Figures) -> f64| {
                let what = format!("{}: {task}, {what}, cycles", scene.0);
                list.push(Finding { what, measured: found.map(figure), bound: bound as f64 });
            };
            add("mean", *mean, |f| f.mean);
            add("worst", *worst, |f| f.worst as f64);
        }
        if let Some(bound) = load {
            list.push(Finding { what: format!("{}: load, %", scene.0), measured: Some(scene.1.load_percent), bound });
        }
        if let Some(bound) = gap {
            let measured = scene.1.load.get("gap").copied();
            list.push(Finding { what: format!("{}: gap, %", scene.0), measured, bound });
        }
    }
    for (name, bound) in FUNCTIONS {
        let measured = measured.functions.get(*name).copied();
        list.push(Finding { what: format!("{name}, cycles"), measured, bound: *bound as f64 });
    }
    list
}
