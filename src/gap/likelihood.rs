//! How readily the gap ignites: ignitions over waiting time.
//!
//! While a pulse waits it ignites at a *hazard*, so many times a second of waiting, which rises steeply as the gap closes. Delays
//! are exponential then (Laue), and pulses whose gate closes first are *censored*: all that they tell is how long they waited.
//! The likeliest hazard is the number of ignitions over the time that all pulses waited, open ones included
//! (Cox and Oakes, Analysis of Survival Data, 1984, chapter 3), and its variance is hazard^2 / ignitions at best (Cramer-Rao).
//! To leave open pulses out, or to average the delays of those that ignited, would be wrong by as much as there are open ones.
//!
//! Older pulses count less: with every pulse what is remembered is multiplied by 1 - 1/memory. Then the variance is
//! hazard^2 (sum of w^2) / (sum of w)^2 over the ignitions with their weights w: after long the same as of 2 memory - 1
//! pulses that count alike.
//!
//! Waiting is timed by captures, not in conversions: at 100 kHz a gate is open for two or three of these.

use crate::dsp::{OutOfRange, in_range};
use crate::units::{CLOCK_HZ, Micrometres, larger};

/// Shortest waiting that a hazard is reckoned from, clock ticks: ignitions without any say that it is beyond what is timed.
const SHORTEST: f32 = 1.0;
/// Smallest hazard that a gap is reckoned from, 1/s.
const SMALLEST: f32 = 1e-3;

/// Hazard of ignition, of the newest pulses.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Likelihood {
    /// What is left of a weight after a pulse, and of its square.
    keep: f32,
    keep_squared: f32,
    /// Sum of the weights of the pulses that ignited, and of their squares.
    ignitions: f32,
    squares: f32,
    /// Waiting with its weights, clock ticks.
    waited: f32,
}

/// A hazard as it is known.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Hazard {
    /// Ignitions a second of waiting.
    pub rate: f32,
    /// Variance of the rate over its square: 0.01 is a standard deviation of 10 %.
    pub variance: f32,
}

impl Likelihood {
    /// Remembers so many pulses, 1..=100 000.
    pub fn new(memory: f32) -> Result<Likelihood, OutOfRange> {
        let keep = 1.0 - 1.0 / in_range("pulses remembered", memory, 1.0, 100_000.0)?;
        Ok(Likelihood { keep, keep_squared: keep * keep, ignitions: 0.0, squares: 0.0, waited: 0.0 })
    }

    /// One more pulse: how long it waited, ticks of the core clock, and whether it ignited then.
    #[inline]
    pub fn pulse(&mut self, waited: u32, ignited: bool) {
        let one = if ignited { 1.0 } else { 0.0 };
        self.ignitions = self.keep * self.ignitions + one;
        self.squares = self.keep_squared * self.squares + one;
        self.waited = self.keep * self.waited + waited as f32;
    }

    /// The hazard, with its variance; `None` while no ignition is remembered.
    pub fn hazard(&self) -> Option<Hazard> {
        // Less is what has faded.
        if self.ignitions < 0.5 {
            return None;
        }
        let rate = self.ignitions * CLOCK_HZ as f32 / larger(self.waited, SHORTEST);
        Some(Hazard { rate, variance: self.squares / (self.ignitions * self.ignitions) })
    }
}

/// Gap by hazard: the hazard goes with a power of the gap's inverse. Taken at a known gap; it drifts with debris.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Curve {
    /// A gap,
    gap: f32,
    /// the hazard there, 1/s,
    rate: f32,
    /// and one over the power.
    inverse: f32,
}

impl Curve {
    /// Power by which the hazard rises as the gap closes, in the process model (docs/process-model.md, equation 1; fitted there).
    pub const POWER: f32 = 3.0;

    /// Hazard 0.001..=10^9 /s at a gap of 1..=1000 um, and the power, 1..=10.
    pub fn new(gap: Micrometres, rate: f32, power: f32) -> Result<Curve, OutOfRange> {
        Ok(Curve {
            gap: in_range("gap of the known hazard (um)", gap.0, 1.0, 1000.0)?,
            rate: in_range("hazard at that gap (1/s)", rate, 1e-3, 1e9)?,
            inverse: 1.0 / in_range("power of the hazard", power, 1.0, 10.0)?,
        })
    }

    /// Gap of this hazard, and the standard deviation that it has by the variance of the hazard, to first order; not for a tick.
    pub fn gap(&self, hazard: &Hazard) -> (Micrometres, Micrometres) {
        let gap = self.gap * libm::powf(self.rate / larger(hazard.rate, SMALLEST), self.inverse);
        (Micrometres(gap), Micrometres(gap * self.inverse * libm::sqrtf(larger(hazard.variance, 0.0))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const US: u32 = CLOCK_HZ / 1_000_000;

    #[test]
    fn open_pulses_count_by_the_time_that_they_waited() {
        let mut likelihood = Likelihood::new(100_000.0).unwrap();
        assert_eq!(likelihood.hazard(), None);
        likelihood.pulse(100 * US, false);
        assert_eq!(likelihood.hazard(), None);
        likelihood.pulse(50 * US, true);
        likelihood.pulse(50 * US, true);
        let hazard = likelihood.hazard().unwrap();
        assert!((hazard.rate - 10_000.0).abs() < 1.0, "{hazard:?}");
        assert!((hazard.variance - 0.5).abs() < 1e-4, "{hazard:?}");
    }

    #[test]
    fn what_is_older_than_the_memory_is_forgotten() {
        let mut likelihood = Likelihood::new(50.0).unwrap();
        (0..1000).for_each(|_| likelihood.pulse(10 * US, true));
        (0..500).for_each(|_| likelihood.pulse(100 * US, true));
        let hazard = likelihood.hazard().unwrap();
        assert!((hazard.rate / 10_000.0 - 1.0).abs() < 1e-3, "{hazard:?}");
        // As of 99 pulses that count alike.
        assert!((hazard.variance * 99.0 - 1.0).abs() < 1e-3, "{hazard:?}");
        (0..1000).for_each(|_| likelihood.pulse(100 * US, false));
        assert_eq!(likelihood.hazard(), None);
    }

    #[test]
    fn a_gap_follows_from_its_hazard_with_a_third_of_its_uncertainty() {
        let curve = Curve::new(Micrometres(50.0), 10_000.0, Curve::POWER).unwrap();
        for (rate, um) in [(10_000.0, 50.0), (80_000.0, 25.0), (1250.0, 100.0)] {
            let (gap, deviation) = curve.gap(&Hazard { rate, variance: 0.09 });
            assert!((gap.0 - um).abs() < 1e-3 && (deviation.0 - 0.1 * um).abs() < 1e-3, "{gap:?} {deviation:?}");
        }
        assert!(curve.gap(&Hazard { rate: 0.0, variance: 0.0 }).0.0.is_finite());
    }

    #[test]
    fn what_is_out_of_range_is_named() {
        for memory in [0.9, 100_001.0, f32::NAN] {
            assert_eq!(Likelihood::new(memory).unwrap_err().name, "pulses remembered");
        }
        assert_eq!(Curve::new(Micrometres(0.0), 1.0, 3.0).unwrap_err().name, "gap of the known hazard (um)");
        assert_eq!(Curve::new(Micrometres(50.0), 0.0, 3.0).unwrap_err().name, "hazard at that gap (1/s)");
        assert_eq!(Curve::new(Micrometres(50.0), 1.0, 0.0).unwrap_err().name, "power of the hazard");
    }

    proptest! {
        #[test]
        fn no_pulses_make_it_fail(memory in 1f32..100_000.0, pulses: Vec<(u32, bool)>) {
            let mut likelihood = Likelihood::new(memory).unwrap();
            for (waited, ignited) in pulses {
                likelihood.pulse(waited, ignited);
                if let Some(hazard) = likelihood.hazard() {
                    prop_assert!(hazard.rate.is_finite() && hazard.variance.is_finite() && hazard.variance > 0.0);
                }
            }
        }
    }
}
