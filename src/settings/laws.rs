//! What each feed law, and each controlled variable, takes of the settings.

use super::Settings;
use super::build::ticks;
use crate::feed::{FixedRate, IncrementByError, RateByError, TwoThresholds};
use crate::gap::controlled::{Frequency, GapDistance, GapVoltage, IgnitionHazard};
use crate::units::{Micrometres, MicrometresPerSecond, Volts};

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

impl From<&Settings> for GapVoltage {
    fn from(_: &Settings) -> Self {
        GapVoltage
    }
}

impl From<&Settings> for IgnitionHazard {
    fn from(settings: &Settings) -> Self {
        IgnitionHazard { setpoint: settings.hazard_setpoint, weight: Volts(settings.hazard_weight) }
    }
}

impl From<&Settings> for GapDistance {
    fn from(settings: &Settings) -> Self {
        GapDistance { setpoint: Micrometres(settings.distance_setpoint), weight: Volts(settings.distance_weight) }
    }
}

impl From<&Settings> for Frequency {
    fn from(settings: &Settings) -> Self {
        Frequency { setpoint: settings.frequency_setpoint, weight: Volts(settings.frequency_weight) }
    }
}
