//! Gap by the mean charging time of the pulses of late (\[X\]; see [`charging`](crate::gap::charging)).

use crate::gap::charging::{Charged, Material};
use crate::gap::pulses::Counts;
use crate::units::CLOCK_HZ;

/// Time constants from 0 to 70 % of the open-circuit voltage, where the comparator switches: -ln(1 - 0.7).
const TIME_CONSTANTS: f32 = 1.203_973;
/// Microseconds of a core cycle, in time constants.
const US: f32 = 1e6 / CLOCK_HZ as f32 / TIME_CONSTANTS;
/// Pulses with their weights from which a mean is formed: less is what has faded.
const LEAST: f32 = 0.5;

/// Mean charging time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distance {
    /// Pulses that were charged, and their charging times, core cycles; with their weights.
    charged: f32,
    charging: f32,
}

impl Distance {
    /// Takes the pulses of a millisecond; what is remembered is multiplied by `keep` before.
    pub fn millisecond(&mut self, keep: f32, new: &Counts) {
        self.charged = keep * self.charged + new.charged as f32;
        self.charging = keep * self.charging + new.charging as f32;
    }

    /// The gap; `None` where no pulse is remembered.
    pub fn gap(&self, material: &Material) -> Option<Charged> {
        (self.charged >= LEAST).then(|| material.gap(self.charging / self.charged * US))
    }
}
