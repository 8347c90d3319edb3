//! Two thresholds of the average voltage: feed above the one, retreat below the other, hold between, a step in each period
//! (\[G\]: 2TAV, section on conventional strategies; with no band between them 1TAV, which always moves).
//!
//! The upper threshold is the gap setpoint. \[G\] averages over the off-time as well: `gap.average` = plain is that.

use super::period::Period;
use super::{Answer, FeedLaw, View};
use crate::units::{MicrometresPerSecond, Volts};

/// Decides once a period, and keeps that until the next.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TwoThresholds {
    /// Path velocity, either way.
    rate: MicrometresPerSecond,
    /// Upper threshold less lower one.
    band: Volts,
    /// Period, servo ticks.
    period: u32,
}

/// What is decided for the period.
#[derive(Clone, Copy, Debug, Default)]
pub struct Decided {
    period: Period,
    velocity: f32,
}

impl TwoThresholds {
    /// Law that moves at `rate`, holds down to `band` below the setpoint, and decides every `period` servo ticks (at least one).
    pub fn new(rate: MicrometresPerSecond, band: Volts, period: u32) -> Self {
        TwoThresholds { rate, band, period: period.max(1) }
    }
}

impl FeedLaw for TwoThresholds {
    type State = Decided;
    const BY_ERROR: bool = true;

    fn act(&self, state: &mut Decided, view: &View<'_>) -> Answer {
        if state.period.begins(self.period, view.ticks) {
            let error = view.error.0;
            state.velocity = if error >= 0.0 {
                self.rate.0
            } else if error < -self.band.0 {
                -self.rate.0
            } else {
                0.0
            };
        }
        Answer::feed(state.velocity)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feed::acts;

    fn velocities(band: f32, period: u32, errors: &[f32]) -> Vec<f32> {
        let (law, mut state) =
            (TwoThresholds::new(MicrometresPerSecond(10.0), Volts(band), period), Decided::default());
        errors.iter().map(|error| acts(&law, &mut state, *error, 5)).collect()
    }

    #[test]
    fn it_feeds_above_the_upper_threshold_retreats_below_the_lower_and_holds_between() {
        let errors = [30.0, 0.0, -0.1, -20.0, -20.1, -60.0];
        assert_eq!(velocities(20.0, 5, &errors), [10.0, 10.0, 0.0, 0.0, -10.0, -10.0]);
    }

    #[test]
    fn without_a_band_it_always_moves() {
        assert_eq!(velocities(0.0, 5, &[0.1, 0.0, -0.1, -60.0]), [10.0, 10.0, -10.0, -10.0]);
    }

    #[test]
    fn what_is_decided_lasts_a_period() {
        assert_eq!(
            velocities(20.0, 15, &[1.0, -60.0, -60.0, -60.0, 9.0, 9.0]),
            [10.0, 10.0, 10.0, -10.0, -10.0, -10.0]
        );
    }
}
