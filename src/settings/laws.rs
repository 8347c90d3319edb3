//! What each feed law, and each controlled variable, takes of the settings.

use super::Settings;
use super::build::ticks;
use crate::feed::{
    FixedRate, GapRatio, IncrementByError, MinimumVariance, ObservedGap, PulseControl, PulseCounts, RateByError,
    SparkFrequency, TwoThresholds,
};
use crate::gap::controlled::{Frequency, GapDistance, GapVoltage, IgnitionHazard};
use crate::units::{Micrometres, MicrometresPerSecond, Seconds, Volts};

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

impl From<&Settings> for PulseCounts {
    fn from(settings: &Settings) -> Self {
        let closed_ms = settings.pulses_closed_ms;
        PulseCounts::new(
            Micrometres(settings.pulses_step),
            ticks(settings.pulses_period_ms),
            [settings.pulses_short_percent, settings.pulses_open_percent].map(|percent| percent / 100.0),
            settings.pulses_discharges,
            if closed_ms > 0.0 { ticks(closed_ms) } else { 0 },
        )
    }
}

impl From<&Settings> for PulseControl {
    fn from(settings: &Settings) -> Self {
        PulseControl::new(
            settings.into(),
            settings.direction_weight,
            settings.shorts_periods as usize,
            [settings.direction_limit, settings.shorts_limit_percent / 100.0],
            Seconds(settings.long_off_time_us * 1e-6),
            ticks(settings.long_off_ms),
        )
    }
}

impl From<&Settings> for MinimumVariance {
    fn from(settings: &Settings) -> Self {
        MinimumVariance::new(
            Micrometres(settings.distance_setpoint),
            settings.forgetting,
            ticks(settings.variance_period_ms),
        )
    }
}

impl From<&Settings> for SparkFrequency {
    fn from(settings: &Settings) -> Self {
        SparkFrequency { setpoint: settings.frequency_setpoint, rate: MicrometresPerSecond(settings.frequency_rate) }
    }
}

impl From<&Settings> for GapRatio {
    fn from(settings: &Settings) -> Self {
        GapRatio::new(
            settings.ratio_open_percent / 100.0,
            settings.ratio_weight,
            MicrometresPerSecond(settings.ratio_gain),
            settings.ratio_integral_ms * 1e-3,
            ticks(settings.ratio_period_ms),
        )
    }
}

impl From<&Settings> for ObservedGap {
    fn from(settings: &Settings) -> Self {
        ObservedGap::new(
            Micrometres(settings.observed_gap),
            settings.hazard_setpoint,
            settings.observed_gain,
            settings.observed_caution,
            [settings.observed_noise, settings.observed_drift],
            settings.observed_lost * 1e-2,
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
