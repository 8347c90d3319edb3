//! What the winding may carry: a peak at any time, a continuous current on average (I2t).

use crate::units::{Amps, Seconds};

/// Ratings of the winding.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct CurrentLimits {
    /// Largest current at any time.
    pub peak: Amps,
    /// Current that can flow continuously.
    pub continuous: Amps,
    /// Thermal time constant of the winding.
    pub thermal: Seconds,
}

/// Thermal image of the winding.
///
/// The mean square of the current, with the winding's time constant, is kept below the square of the continuous current:
/// once it gets there, only the continuous current is allowed until it has fallen by a tenth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct CurrentGuard {
    mean_square: f32,
    reduced: bool,
}

impl CurrentGuard {
    /// Takes the mean square of the current over a time that is short against the thermal one, A^2.
    pub fn update(&mut self, limits: &CurrentLimits, mean_square: f32, over: Seconds) {
        let rated = limits.continuous.0 * limits.continuous.0;
        self.mean_square += (mean_square - self.mean_square) * (over.0 / limits.thermal.0);
        self.reduced = self.mean_square >= if self.reduced { 0.9 * rated } else { rated };
    }

    /// Largest current allowed now.
    pub fn limit(&self, limits: &CurrentLimits) -> Amps {
        if self.reduced { limits.continuous } else { limits.peak }
    }

    /// Whether only the continuous current is allowed.
    pub fn reduced(&self) -> bool {
        self.reduced
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::{TICK_HZ, TICK_S};

    const TICK: Seconds = Seconds(TICK_S);
    const LIMITS: CurrentLimits = CurrentLimits { peak: Amps(3.0), continuous: Amps(1.0), thermal: Seconds(10.0) };

    fn seconds_until_reduced(current: f32) -> Option<f32> {
        let mut guard = CurrentGuard::default();
        (0..60 * TICK_HZ)
            .find(|_| {
                guard.update(&LIMITS, current * current, TICK);
                guard.limit(&LIMITS) == LIMITS.continuous
            })
            .map(|tick| tick as f32 * TICK_S)
    }

    #[test]
    fn the_continuous_current_flows_for_ever_and_the_peak_for_its_time() {
        assert_eq!(seconds_until_reduced(0.99), None);
        // 9 A2 toward 1 A2 at 10 s: -10 ln(1 - 1/9) = 1.178 s.
        let peak = seconds_until_reduced(3.0).unwrap();
        assert!((peak - 1.178).abs() < 0.05, "{peak}");
        assert!(seconds_until_reduced(-3.0).is_some());
    }

    #[test]
    fn a_reduced_winding_recovers_only_after_cooling_by_a_tenth() {
        let mut guard = CurrentGuard::default();
        while guard.limit(&LIMITS) == LIMITS.peak {
            guard.update(&LIMITS, 9.0, TICK);
        }
        let mut cooling = 0;
        while guard.limit(&LIMITS) == LIMITS.continuous {
            guard.update(&LIMITS, 0.0, TICK);
            cooling += 1;
        }
        // 10 s * ln(1 / 0.9) = 1.05 s.
        assert!((cooling as f32 * TICK_S - 1.05).abs() < 0.05);
    }
}
