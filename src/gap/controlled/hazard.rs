//! Hazard of ignition: rises steeply as the gap closes, and is nobody's average (src/gap/likelihood.rs).

use super::{Sensed, Variable, e_folds};
use crate::units::Volts;

/// E-folds of the hazard below its set point.
///
/// The process model's hazard goes with the third power of the gap: an e-fold is a third of the gap.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct IgnitionHazard {
    /// Set point, ignitions a second of waiting.
    pub setpoint: f32,
    /// Gap error of an e-fold.
    pub weight: Volts,
}

impl Variable for IgnitionHazard {
    fn error(&self, sensed: &Sensed<'_>) -> Option<Volts> {
        sensed.senses.hazard.map(|hazard| Volts(self.weight.0 * e_folds(self.setpoint, hazard.rate)))
    }
}
