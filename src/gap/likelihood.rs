//! How readily the gap ignites: ignitions over waiting time.
//!
//! While a pulse waits it ignites at a *hazard*, so many times a second of waiting, which rises steeply as the gap closes. Delays
//! are exponential then (Laue), and pulses whose gate closes first are *censored*: all that they tell is how long they waited.
//! The likeliest hazard is the number of ignitions over the time that all pulses waited, open ones included
//! (Cox and Oakes, Analysis of Survival Data, 1984, chapter 3), and its variance is hazard^2 / ignitions at best (Cramer-Rao).
//! To leave open pulses out, or to average the delays of those that ignited, would be wrong by as much as there are open ones.
//!
//! Older pulses count less: with every step, of one pulse or of a millisecond's, what is remembered is multiplied by
//! 1 - 1/memory. Then the variance is hazard^2 (sum of w^2) / (sum of w)^2 over the ignitions with their weights w: after long the
//! same as of 2 memory - 1 steps that count alike.
//!
//! Waiting is timed by captures, not in conversions: at 100 kHz a gate is open for two or three of these.

use crate::dsp::{OutOfRange, in_range};
use crate::units::{CLOCK_HZ, Micrometres, larger};

/// Shortest waiting that a hazard is reckoned from, clock ticks: ignitions without any say that it is beyond what is timed.
const SHORTEST: f32 = 1.0;
/// Waiting from which a hazard is formed where nothing ignited, clock ticks: 10 us.
const LEAST: f32 = 1e-5 * CLOCK_HZ as f32;
/// Weight of an ignition that has faded.
const FADED: f32 = 0.5;
/// Smallest hazard that a gap is reckoned from, 1/s.
const SMALLEST: f32 = 1e-3;

/// Hazard of ignition, of the newest pulses.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Likelihood {
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
    /// Takes a step: how long its pulses waited, ticks of the core clock, and how many of them ignited. What is remembered is
    /// multiplied by `keep` before, 0..=1.
    #[inline]
    pub fn step(&mut self, keep: f32, waited: u32, ignited: u32) {
        let ignited = ignited as f32;
        self.ignitions = keep * self.ignitions + ignited;
        self.squares = keep * keep * self.squares + ignited;
        self.waited = keep * self.waited + waited as f32;
    }

    /// The hazard, with its variance; `None` while no ignition is remembered.
    pub fn hazard(&self) -> Option<Hazard> {
        // Less is what has faded.
        if self.ignitions < FADED {
            return None;
        }
        let rate = self.ignitions * CLOCK_HZ as f32 / larger(self.waited, SHORTEST);
        Some(Hazard { rate, variance: self.squares / (self.ignitions * self.ignitions) })
    }

    /// The hazard of pulses that waited and have not ignited: half an ignition (the estimate by Jeffreys' prior for none, whose
    /// variance is twice its square); `None` while no waiting is remembered.
    pub fn rare(&self) -> Option<Hazard> {
        let waited = self.waited;
        (waited >= LEAST).then(|| Hazard { rate: FADED * CLOCK_HZ as f32 / larger(waited, SHORTEST), variance: 2.0 })
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
        let mut likelihood = Likelihood::default();
        assert_eq!((likelihood.hazard(), likelihood.rare()), (None, None));
        likelihood.step(1.0, 100 * US, 0);
        assert_eq!(likelihood.hazard(), None);
        assert!(likelihood.rare().is_some_and(|hazard| (hazard.rate - 5000.0).abs() < 1.0));
        likelihood.step(1.0, 100 * US, 2);
        let hazard = likelihood.hazard().unwrap();
        assert!((hazard.rate - 10_000.0).abs() < 1.0, "{hazard:?}");
        assert!((hazard.variance - 0.5).abs() < 1e-4, "{hazard:?}");
    }

    #[test]
    fn what_is_older_than_the_memory_is_forgotten() {
        let mut likelihood = Likelihood::default();
        const KEEP: f32 = 1.0 - 1.0 / 50.0;
        (0..1000).for_each(|_| likelihood.step(KEEP, 10 * US, 1));
        (0..500).for_each(|_| likelihood.step(KEEP, 100 * US, 1));
        let hazard = likelihood.hazard().unwrap();
        assert!((hazard.rate / 10_000.0 - 1.0).abs() < 1e-3, "{hazard:?}");
        // As of 99 pulses that count alike.
        assert!((hazard.variance * 99.0 - 1.0).abs() < 1e-3, "{hazard:?}");
        (0..1000).for_each(|_| likelihood.step(KEEP, 100 * US, 0));
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
        assert_eq!(Curve::new(Micrometres(0.0), 1.0, 3.0).unwrap_err().name, "gap of the known hazard (um)");
        assert_eq!(Curve::new(Micrometres(50.0), 0.0, 3.0).unwrap_err().name, "hazard at that gap (1/s)");
        assert_eq!(Curve::new(Micrometres(50.0), 1.0, 0.0).unwrap_err().name, "power of the hazard");
    }

    proptest! {
        #[test]
        fn no_pulses_make_it_fail(keep in 0f32..1.0, pulses: Vec<(u32, u32)>) {
            let mut likelihood = Likelihood::default();
            for (waited, ignited) in pulses {
                likelihood.step(keep, waited, ignited);
                for hazard in [likelihood.hazard(), likelihood.rare()].into_iter().flatten() {
                    prop_assert!(hazard.rate.is_finite() && hazard.variance.is_finite() && hazard.variance > 0.0);
                }
            }
        }
    }
}
