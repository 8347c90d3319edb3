//! Filtered gap voltage.

use super::{Sensed, Variable};
use crate::units::Volts;

/// Gap voltage less its set point.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct GapVoltage;

impl Variable for GapVoltage {
    fn error(&self, sensed: &Sensed<'_>) -> Option<Volts> {
        sensed.setpoint.map(|setpoint| Volts(sensed.gap.filtered.0 - setpoint.0))
    }
}
