//! What an identification has found: its sums, solved ([`super::identify`]), with how far each value may be wrong.
//!
//! An uncertainty is what covers the truth in nine cases of ten at the least. It has two parts: what the residuals of the rows show,
//! times [`SPREAD`], as neighbouring residuals are alike; and a share of the value for what no residual shows, found by simulation
//! (docs/commissioning.md). Outside of every tick: the sums are solved in double precision.

use super::commissioning::Weighed;
use super::config::Axis;
use super::identify::{Stage, Summed, VOLTAGE_BITS};
use crate::servo::{Fit, GRAVITY};
use crate::units::{TICK_S, TICKS_PER_MS};
use edm_hal_shim::bridge::Drive;

/// Standard deviations by which a value may be wrong, as if residuals did not hang together.
const SPREAD: f64 = 4.0;
/// Share of each that no residual shows.
const SHARE_RESISTANCE: f64 = 0.005;
const SHARE_CONSTANT: f64 = 0.012;
/// Duty and conversion lie otherwise in the tick of a board than in that of a PC: the modelled chip finds 7 % too much.
const SHARE_INDUCTANCE: f64 = 0.08;
const SHARE_MASS: f64 = 0.02;
const SHARE_FRICTION: f64 = 0.05;

/// What codes and counts stand for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// A to a code of the current.
    amps: f64,
    /// V to a code of the bus.
    volts: f64,
    /// Counts to a metre.
    counts: f64,
}

impl Scale {
    /// Of an axis.
    pub fn of(axis: &Axis) -> Scale {
        Scale {
            amps: axis.amps_per_code.0.into(),
            volts: axis.bus_per_code.0.into(),
            counts: axis.plant.counts_per_m.into(),
        }
    }
}

/// What was found so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Identified {
    /// Winding resistance, ohm.
    pub resistance: Weighed,
    /// Winding inductance, H.
    pub inductance: Weighed,
    /// Force and back-EMF constant, N/A.
    pub constant: Weighed,
    /// Moving mass, kg.
    pub mass: Weighed,
    /// What begins to move the head in addition to the net weight, N.
    pub breakaway: Weighed,
    /// Friction while it slides, N.
    pub sliding: Weighed,
    /// Force that lifts the de-energised head, N, where it was identified.
    pub counterbalance: Weighed,
}

impl Identified {
    /// Takes what a stage has summed up; false where that does not show what it is to show.
    pub fn take(&mut self, gathered: &Summed, scale: &Scale) -> bool {
        let found = match gathered.stage {
            Stage::Sweep => gathered.normal.fit([true; 5]).and_then(|fit| self.winding(&fit, scale)),
            Stage::Motion => gathered.normal.fit([true; 5]).and_then(|fit| self.motion(&fit, scale)),
            Stage::Breakaway => {
                let fit = gathered.normal.fit([false, true, true, false, false]);
                fit.and_then(|fit| self.breakaway(&fit, scale))
            }
            _ => None,
        };
        found.is_some()
    }

    fn winding(&mut self, fit: &Fit, scale: &Scale) -> Option<()> {
        let tick = f64::from(TICK_S);
        let volts = f64::from(1u32 << VOLTAGE_BITS) * scale.volts * tick / f64::from(Drive::FULL);
        let [sum, step, moved, ..] = [0, 1, 2].map(|at| (fit.value[at] * volts, fit.deviation[at] * volts));
        let (ohm, ohm_deviation) = (sum.0 / (scale.amps * tick), sum.1 / (scale.amps * tick));
        // A sum takes the last current of a millisecond whole and the one before the first not at all; the integral half of each.
        let henry = step.0 / scale.amps + 0.5 * ohm * tick;
        let constant = moved.0 * scale.counts;
        if !(ohm > 0.0 && henry >= 0.0 && constant > 0.0) {
            return None;
        }
        self.resistance = weighed(ohm, ohm_deviation, SHARE_RESISTANCE);
        self.inductance = weighed(henry, step.1 / scale.amps, SHARE_INDUCTANCE);
        self.constant = weighed(constant, moved.1 * scale.counts, SHARE_CONSTANT);
        Some(())
    }

    fn motion(&mut self, fit: &Fit, scale: &Scale) -> Option<()> {
        let newtons = self.newtons(scale);
        // N to a coefficient of time, in ms; N s to a coefficient of twice the counts in a ms.
        let force = |at: usize| (fit.value[at] * newtons, fit.deviation[at] * newtons);
        let doubled = 2.0 * f64::from(TICKS_PER_MS) * f64::from(TICK_S);
        let (gain, gain_deviation) = force(0);
        let per_count = doubled * scale.counts * 1e-3;
        let mass = gain * per_count;
        let (sliding, sliding_deviation) = force(1);
        let (lifts, lifts_deviation) = force(2);
        if mass.is_nan() || mass <= 0.0 {
            return None;
        }
        self.mass = self.with_constant(weighed(mass, gain_deviation * per_count, SHARE_MASS));
        let friction = weighed(sliding.max(0.0), sliding_deviation, SHARE_FRICTION);
        self.sliding = self.with_constant(friction);
        // It lifts with what the motor need not: weight and, upward, its force.
        let weight = mass * f64::from(GRAVITY);
        let value = weight + lifts;
        let uncertainty = f64::from(self.mass.uncertainty) * f64::from(GRAVITY)
            + SPREAD * lifts_deviation
            + 0.5 * SHARE_FRICTION * sliding;
        self.counterbalance = Weighed { value: value as f32, uncertainty: uncertainty as f32 };
        Some(())
    }

    fn breakaway(&mut self, fit: &Fit, scale: &Scale) -> Option<()> {
        let newtons = self.newtons(scale);
        let breakaway = weighed(fit.value[1].max(0.0) * newtons, fit.deviation[1] * newtons, SHARE_FRICTION);
        self.breakaway = self.with_constant(breakaway);
        Some(())
    }

    /// N to a mean current of a code, as a sum over a millisecond.
    fn newtons(&self, scale: &Scale) -> f64 {
        f64::from(self.constant.value) * scale.amps / f64::from(TICKS_PER_MS)
    }

    /// A force is only as well known as what makes a force of a current.
    fn with_constant(&self, force: Weighed) -> Weighed {
        let share = self.constant.uncertainty / self.constant.value;
        Weighed { uncertainty: force.uncertainty + force.value * share, ..force }
    }
}

fn weighed(value: f64, deviation: f64, share: f64) -> Weighed {
    Weighed { value: value as f32, uncertainty: (SPREAD * deviation + share * value.abs()) as f32 }
}
