//! Spark frequency.

use super::{Sensed, Variable, e_folds};
use crate::units::Volts;

/// E-folds of the spark frequency below its set point.
///
/// It saturates where every pulse sparks: the set point has to lie below the pulse frequency. What is too close ends in shorts, which
/// are no sparks: the reflex and the retreat answer those.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Frequency {
    /// Set point, sparks a second.
    pub setpoint: f32,
    /// Gap error of an e-fold.
    pub weight: Volts,
}

impl Variable for Frequency {
    fn error(&self, sensed: &Sensed<'_>) -> Option<Volts> {
        sensed.senses.frequency.map(|rate| Volts(self.weight.0 * e_folds(self.setpoint, rate)))
    }
}
