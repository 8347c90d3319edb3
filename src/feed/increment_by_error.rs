//! Increment by error: at a fixed period, an increment in proportion to the error (\[R\] section 6.7.3; the default).
//!
//! Each axis' share of the move is not this law's business: the path gives every axis its share of the one coordinate.

use super::FeedLaw;
use crate::units::{MicrometresPerSecond, Volts};

/// Samples the error once a period and spreads the increment over it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct IncrementByError {
    /// Path velocity per volt of error, um/s per V: the increment divided by the period.
    per_volt: f32,
    /// Period, servo ticks.
    period: u32,
    left: u32,
    velocity: f32,
}

impl IncrementByError {
    /// Law with a velocity of `per_volt` um/s for each volt of error, sampled every `period` servo ticks (at least one).
    pub fn new(per_volt: f32, period: u32) -> Self {
        IncrementByError { per_volt, period: period.max(1), left: 0, velocity: 0.0 }
    }
}

impl FeedLaw for IncrementByError {
    fn velocity(&mut self, error: Volts, ticks: u32) -> MicrometresPerSecond {
        self.left = self.left.saturating_sub(ticks);
        if self.left == 0 {
            self.left = self.period;
            self.velocity = error.0 * self.per_volt;
        }
        MicrometresPerSecond(self.velocity)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_increment_of_a_period_is_fixed_at_its_start() {
        let mut law = IncrementByError::new(20.0, 3);
        let errors = [2.0, 9.0, 9.0, -1.0, 9.0, 9.0, 0.5];
        let velocities = errors.map(|error| law.velocity(Volts(error), 1).0);
        assert_eq!(velocities, [40.0, 40.0, 40.0, -20.0, -20.0, -20.0, 10.0]);
    }

    #[test]
    fn a_period_that_ends_between_two_calls_lasts_until_the_second() {
        let mut law = IncrementByError::new(20.0, 7);
        let velocities = [1.0, 2.0, 3.0, 4.0].map(|error| law.velocity(Volts(error), 5).0);
        assert_eq!(velocities, [20.0, 20.0, 60.0, 60.0]);
    }

    #[test]
    fn a_period_of_one_tick_follows_every_error() {
        let mut law = IncrementByError::new(20.0, 1);
        assert_eq!([1.0, -1.0, 0.0].map(|error| law.velocity(Volts(error), 1).0), [20.0, -20.0, 0.0]);
    }
}
