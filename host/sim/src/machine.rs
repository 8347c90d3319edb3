//! The closed loop: control core, process model and time.

use crate::run::{Job, Observer, Outcome, Progress};
use crate::scenario::Scenario;
use edm_servo_head::declare;
use edm_servo_head::settings::SettingError;
use std::ops::RangeInclusive;

declare! {
    /// Values of the process model.
    pub struct Process {
        /// On-time of a pulse.
        on: f32 = 160.0, (1.0, 5000.0), "generator.on_us", "us", "[R] ch. 2: 10 to 1000 us a period";
    }
}

declare! {
    /// Settings of the head.
    pub struct Head {
        /// Gap voltage to keep.
        gap_setpoint: f32 = 60.0, (1.0, 300.0), "gap.setpoint_v", "V", "[R] ch. 2: 40 to 60 V under good sparking";
        /// Notch the second harmonic as well.
        gap_second_harmonic: bool = false, (), "gap.second_harmonic", "", "[R] section 6.4: tried there, left out";
    }
}

/// Values for a run of this machine.
pub type Setup = Scenario<Process, Head>;

/// Checks the values against each other.
pub fn check(_setup: &Setup) -> Result<(), SettingError> {
    Ok(())
}

/// Depths that this stroke can bore, mm.
pub fn depth_range_mm(_setup: &Setup) -> RangeInclusive<f64> {
    0.001..=10.0
}

/// Bores a hole: one sample a servo tick to `observer`, progress at least every 100 ms of simulated time.
///
/// A fault of the head is an [`Outcome`]; an error means that the run could not be made.
pub fn bore(
    _job: &Job,
    _observer: &mut impl Observer,
    _progress: &mut dyn FnMut(&Progress),
) -> Result<Outcome, String> {
    Err("the machine is not wired yet".into())
}
