//! Increment by error: at a fixed period, an increment in proportion to the error (\[R\] section 6.7.3; the default).
//!
//! Each axis' share of the move is not this law's business: the path gives every axis its share of the one coordinate.

use super::period::Period;
use super::{Answer, FeedLaw, View};

/// Samples the error once a period and spreads the increment over it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct IncrementByError {
    /// Path velocity per volt of error, um/s per V: the increment divided by the period.
    per_volt: f32,
    /// Period, servo ticks.
    period: u32,
}

/// What is fixed for the period.
#[derive(Clone, Copy, Debug, Default)]
pub struct Increment {
    period: Period,
    velocity: f32,
}

impl IncrementByError {
    /// Law with a velocity of `per_volt` um/s for each volt of error, sampled every `period` servo ticks (at least one).
    pub fn new(per_volt: f32, period: u32) -> Self {
        IncrementByError { per_volt, period: period.max(1) }
    }
}

impl FeedLaw for IncrementByError {
    type State = Increment;
    const BY_ERROR: bool = true;

    fn act(&self, state: &mut Increment, view: &View<'_>) -> Answer {
        if state.period.begins(self.period, view.ticks) {
            state.velocity = view.error.0 * self.per_volt;
        }
        Answer::feed(state.velocity)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feed::acts;

    #[test]
    fn the_increment_of_a_period_is_fixed_at_its_start() {
        let (law, mut state) = (IncrementByError::new(20.0, 3), Increment::default());
        let errors = [2.0, 9.0, 9.0, -1.0, 9.0, 9.0, 0.5];
        let velocities = errors.map(|error| acts(&law, &mut state, error, 1));
        assert_eq!(velocities, [40.0, 40.0, 40.0, -20.0, -20.0, -20.0, 10.0]);
    }

    #[test]
    fn a_period_that_ends_between_two_calls_lasts_until_the_second() {
        let (law, mut state) = (IncrementByError::new(20.0, 7), Increment::default());
        let velocities = [1.0, 2.0, 3.0, 4.0].map(|error| acts(&law, &mut state, error, 5));
        assert_eq!(velocities, [20.0, 20.0, 60.0, 60.0]);
    }

    #[test]
    fn a_period_of_one_tick_follows_every_error() {
        let (law, mut state) = (IncrementByError::new(20.0, 1), Increment::default());
        assert_eq!([1.0, -1.0, 0.0].map(|error| acts(&law, &mut state, error, 1)), [20.0, -20.0, 0.0]);
    }
}
