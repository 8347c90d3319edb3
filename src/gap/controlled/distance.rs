//! Gap by charging time.

use super::{Sensed, Variable};
use crate::units::{Micrometres, Volts, within};

/// Furthest distance that is acted on, um from the set point.
const MOST: f32 = 1000.0;

/// Gap less its set point. Beyond what was calibrated the nearest gap counts: the direction is right.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct GapDistance {
    /// Set point.
    pub setpoint: Micrometres,
    /// Gap error of a micrometre.
    pub weight: Volts,
}

impl Variable for GapDistance {
    fn error(&self, sensed: &Sensed<'_>) -> Option<Volts> {
        let off = |gap: Micrometres| within(gap.0 - self.setpoint.0, -MOST, MOST);
        sensed.senses.distance.map(|charged| Volts(self.weight.0 * off(charged.gap)))
    }
}
