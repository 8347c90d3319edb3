//! Spark frequency: sparks a second, by their number, and by the time since the newest one.
//!
//! The generator of \[L\] gives the control a square wave whose frequency stands for the mean sparking voltage: the more sparks,
//! the narrower the gap. Here the sparks themselves are counted. A frequency that is only counted follows the end of its signal as
//! slowly as it forgets. Therefore it is never more than what could have been silent for so long: [`MISSING`] over the time since the
//! newest spark. One over that time would be too little: at 3000 sparks a second one millisecond in twenty has none by chance.

use crate::gap::pulses::{Class, Counts};
use crate::units::{larger, smaller};

/// Mean periods without a spark after which sparks are missing: independent sparks stay away as long in one of 400 000 periods,
/// e^-13 (Poisson).
pub const MISSING: f32 = 13.0;
/// Seconds of a millisecond.
const MS: f32 = 1e-3;
/// Weight of the time from which a frequency is formed, ms: less is what has faded.
const LEAST: f32 = 0.5;

/// Sparks of late.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SparkFrequency {
    /// Sparks, and milliseconds, with their weights.
    sparks: f32,
    ms: f32,
    /// Milliseconds since the newest spark, and the frequency then, 1/s.
    since: u32,
    then: f32,
    /// Milliseconds since the newest pulse.
    quiet: f32,
}

impl SparkFrequency {
    /// Takes the pulses of a millisecond; what is remembered is multiplied by `keep` before.
    ///
    /// A spark is a discharge with an ignition delay. Where no comparator shows the delay, it is one of the class.
    pub fn millisecond(&mut self, keep: f32, new: &Counts) {
        let sparks = new.ignited.max(new.class(Class::Spark));
        self.sparks = keep * self.sparks + sparks as f32;
        self.ms = keep * self.ms + 1.0;
        self.quiet = if new.total() > 0 { 1.0 } else { keep * self.quiet };
        if sparks > 0 {
            self.since = 0;
            self.then = self.counted();
        } else {
            self.since = self.since.saturating_add(1);
        }
    }

    fn counted(&self) -> f32 {
        self.sparks / larger(self.ms * MS, MS)
    }

    /// Sparks a second; `None` where no pulse is remembered.
    pub fn rate(&self) -> Option<f32> {
        let most = if self.since > 0 { MISSING / (self.since as f32 * MS) } else { f32::INFINITY };
        (self.quiet >= LEAST).then(|| smaller(self.counted(), most))
    }

    /// No spark for longer than `MISSING` periods, though there are pulses.
    pub fn is_missing(&self) -> bool {
        self.quiet >= LEAST && self.since as f32 * MS * self.then > MISSING
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KEEP: f32 = 0.9;

    fn new(sparks: u32, open: u32) -> Counts {
        let mut counts = Counts { ignited: sparks, ..Counts::default() };
        counts.classes[Class::Open as usize] = open;
        counts.classes[Class::Uncertain as usize] = sparks;
        counts
    }

    #[test]
    fn sparks_are_counted_whether_their_class_is_certain_or_not() {
        let mut frequency = SparkFrequency::default();
        (0..100).for_each(|_| frequency.millisecond(KEEP, &new(3, 2)));
        assert!(frequency.rate().is_some_and(|rate| (rate - 3000.0).abs() < 1.0));
        let mut by_class = SparkFrequency::default();
        let mut counts = Counts::default();
        counts.classes[Class::Spark as usize] = 3;
        (0..100).for_each(|_| by_class.millisecond(KEEP, &counts));
        assert_eq!(by_class.rate(), frequency.rate());
    }

    #[test]
    fn a_frequency_never_stands_still_where_sparks_stay_away() {
        // One spark in 10 ms, on average and evenly; and three in each.
        for (sparks, every) in [(1, 10), (3, 1)] {
            let mut frequency = SparkFrequency::default();
            (0..1000).for_each(|n| frequency.millisecond(0.99, &new(if n % every == 0 { sparks } else { 0 }, 5)));
            assert!(!frequency.is_missing());
            let mut last = f32::INFINITY;
            for ms in 1..=200u32 {
                frequency.millisecond(0.99, &new(0, 5));
                let rate = frequency.rate().unwrap();
                assert!(rate < last && rate <= MISSING * 1000.0 / ms as f32, "{ms}: {rate}");
                // What limits it is that sparks are missing, and nothing else.
                assert!(frequency.is_missing() || rate == frequency.counted(), "{ms}: {rate}");
                last = rate;
            }
            assert!(frequency.is_missing() && (every > 1 || last < 0.2 * frequency.counted()), "{last}");
            frequency.millisecond(0.99, &new(1, 5));
            assert!(!frequency.is_missing());
        }
    }

    #[test]
    fn a_millisecond_without_a_spark_is_no_dip_of_the_frequency() {
        use rand::{RngExt, SeedableRng};
        use rand_xoshiro::Xoshiro256PlusPlus;
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
        for (sparks, pulses) in [(3, 5), (1, 5), (6, 10)] {
            let mut frequency = SparkFrequency::default();
            let (mut least, mut silent) = (f32::INFINITY, 0);
            for ms in 0..60_000u32 {
                let sparked = (0..pulses).filter(|_| rng.random_range(0..pulses) < sparks).count() as u32;
                silent += u32::from(sparked == 0);
                frequency.millisecond(0.99, &new(sparked, pulses - sparked));
                if ms > 1000 {
                    least = least.min(frequency.rate().unwrap() / (1000 * sparks) as f32);
                }
            }
            // 199 ms count alike: less than 200 sparks deviate by 7 % rms, and five times as much is no chance.
            assert!(least > 0.65 && silent > 0, "{sparks} of {pulses}: {least}, {silent}");
        }
    }

    #[test]
    fn without_pulses_nothing_is_known_and_nothing_is_missing() {
        let mut frequency = SparkFrequency::default();
        assert_eq!((frequency.rate(), frequency.is_missing()), (None, false));
        (0..100).for_each(|_| frequency.millisecond(KEEP, &new(3, 2)));
        (0..100).for_each(|_| frequency.millisecond(KEEP, &Counts::default()));
        assert_eq!((frequency.rate(), frequency.is_missing()), (None, false));
    }
}
