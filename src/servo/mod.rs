//! Position and velocity loops of one axis, and what the winding may carry.
//!
//! The loops work in encoder counts and in *duty*, the signed share of the bus voltage, positive toward the work. Gains
//! are built from the plant and two bandwidths (see [`Gains::build`]); [`AxisLoop`] is the state.

mod axis;
mod current;
mod emf;
mod pid;
mod presliding;
mod regress;

use crate::units::{larger, smaller, within};

pub use axis::{AxisLoop, GRAVITY, Gains, Plant, Tuning};
pub use current::{CurrentGuard, CurrentLimits};
pub use emf::{BackEmf, DriveMeans};
pub use pid::{Output, Pid, PidGains};
pub use presliding::{Config as PreslidingConfig, Presliding};
pub use regress::{Fit, Normal, WIDTH};

/// The duties allowed at this tick, both included. It contains zero, but for a fault's reaction: that never holds with less
/// than the weight.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Window {
    /// Lowest duty.
    pub low: f32,
    /// Highest duty, not below the lowest.
    pub high: f32,
}

impl Window {
    /// The same duty both ways.
    pub fn symmetric(limit: f32) -> Window {
        Window { low: -limit, high: limit }
    }

    /// What both windows allow.
    pub fn and(self, other: Window) -> Window {
        Window { low: larger(self.low, other.low), high: smaller(self.high, other.high) }
    }

    /// The nearest allowed duty.
    pub fn clamp(self, duty: f32) -> f32 {
        within(duty, self.low, self.high)
    }
}
