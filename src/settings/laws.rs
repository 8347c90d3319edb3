//! What each feed law takes of the settings.

use super::Settings;
use super::build::ticks;
use crate::feed::{FixedRate, IncrementByError, RateByError, TwoThresholds};
use crate::units::{MicrometresPerSecond, Volts};

impl From<&Settings> for FixedRate {
    fn from(settings: &Settings) -> Self {
        FixedRate { rate: MicrometresPerSecond(settings.fixed_rate) }
    }
}

impl From<&Settings> for RateByError {
    fn from(settings: &Settings) -> Self {
        RateByError::new(
            MicrometresPerSecond(settings.standard_velocity),
            Volts(settings.standard_error),
            MicrometresPerSecond(settings.rate_clamp),
        )
    }
}

impl From<&Settings> for IncrementByError {
    fn from(settings: &Settings) -> Self {
        IncrementByError::new(settings.feed_gain, ticks(settings.feed_period_ms))
    }
}

impl From<&Settings> for TwoThresholds {
    fn from(settings: &Settings) -> Self {
        TwoThresholds::new(
            MicrometresPerSecond(settings.threshold_rate),
            Volts(settings.threshold_band),
            ticks(settings.threshold_period_ms),
        )
    }
}
