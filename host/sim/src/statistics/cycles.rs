//! Servo cycles and shorts as \[G\] counts them.
//!
//! A *cycle* is 100 ms; it is short when at least nine tenths of its pulses were (section 2.3), and the short rate is the share of
//! cycles that were. A *short* lasts from a millisecond all of whose pulses were shorts until one in which another pulse came;
//! milliseconds without pulses go by. A retreat within one short is long beyond 5 um (eq. 9: more than five retreats of 1 um
//! within one consecutive short). All of it while the head erodes or goes back from a short.

use super::retreats::{CYCLE_MS, LONG_UM};
use crate::millisecond::{Millisecond, Phase};
use crate::process::Pulses;

/// Share of short pulses at which a cycle is short.
const SHORT_SHARE: f64 = 0.9;

/// Counts cycles and shorts.
#[derive(Debug, Default)]
pub struct Cycles {
    /// Pulses until the last millisecond, and at the begin of the cycle.
    before: Pulses,
    begun: Pulses,
    ms: u32,
    cycles: u64,
    short_cycles: u64,
    /// Deepest point since the short began, um, and whether it has led to a long retreat.
    short: Option<(f64, bool)>,
    shorts: u64,
    long_retreats: u64,
}

impl Cycles {
    /// Takes the newest millisecond.
    pub fn add(&mut self, ms: &Millisecond) {
        let pulses = ms.pulses.since(&self.before);
        self.before = ms.pulses;
        if !matches!(ms.phase, Phase::Eroding | Phase::Retreating) {
            (self.ms, self.begun, self.short) = (0, ms.pulses, None);
            return;
        }
        self.ms += 1;
        if self.ms == CYCLE_MS {
            let cycle = ms.pulses.since(&self.begun);
            self.cycles += 1;
            let short = cycle.total() > 0 && cycle.short as f64 >= SHORT_SHARE * cycle.total() as f64;
            self.short_cycles += u64::from(short);
            (self.ms, self.begun) = (0, ms.pulses);
        }
        if pulses.total() > pulses.short {
            self.short = None;
        } else if pulses.short > 0 && self.short.is_none() {
            self.short = Some((ms.position_um.max, false));
            self.shorts += 1;
        }
        if let Some((deepest_um, long)) = &mut self.short {
            *deepest_um = deepest_um.max(ms.position_um.max);
            if !*long && *deepest_um - ms.position_um.min > LONG_UM {
                *long = true;
                self.long_retreats += 1;
            }
        }
    }

    /// Share of cycles that were short; `None` without any.
    pub fn short_ratio(&self) -> Option<f64> {
        (self.cycles > 0).then(|| self.short_cycles as f64 / self.cycles as f64)
    }

    /// Shorts of whole milliseconds so far.
    pub fn shorts(&self) -> u64 {
        self.shorts
    }

    /// Those from which the electrode moved back by more than 5 um before they ended.
    pub fn long_retreats(&self) -> u64 {
        self.long_retreats
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::millisecond::Gatherer;
    use crate::run::Sample;

    /// Milliseconds in which so many sparks and shorts came, with the electrode where it was at their end.
    fn counted(all: &[(u64, u64, f64)]) -> Cycles {
        let (mut cycles, mut gatherer, mut pulses) = (Cycles::default(), Gatherer::default(), Pulses::default());
        for (spark, short, position_um) in all {
            pulses = Pulses { spark: pulses.spark + spark, short: pulses.short + short, ..pulses };
            for _ in 0..20 {
                let sample = Sample { position_um: *position_um, pulses, state: "eroding", ..Sample::default() };
                if let Some(ms) = gatherer.add(&sample) {
                    cycles.add(&ms);
                }
            }
        }
        cycles
    }

    #[test]
    fn a_cycle_is_short_when_nine_tenths_of_its_pulses_are() {
        let ninety = [[(0, 10, 0.0); 90].as_slice(), &[(10, 0, 0.0); 10]].concat();
        let less = [[(0, 10, 0.0); 89].as_slice(), &[(10, 0, 0.0); 11]].concat();
        assert_eq!(counted(&[ninety.as_slice(), &less].concat()).short_ratio(), Some(0.5));
        assert_eq!(counted(&ninety[..99]).short_ratio(), None);
        assert_eq!(counted(&[(0, 0, 0.0); 100]).short_ratio(), Some(0.0), "no pulse is no short");
    }

    #[test]
    fn a_retreat_is_long_beyond_5_um_within_one_short() {
        let long = counted(&[(5, 0, 10.0), (0, 5, 10.0), (0, 5, 8.0), (0, 0, 6.0), (0, 5, 4.9), (5, 0, 4.0)]);
        assert_eq!((long.shorts(), long.long_retreats()), (1, 1));
        let five = counted(&[(0, 5, 10.0), (0, 5, 5.0), (5, 0, 4.0)]);
        assert_eq!((five.shorts(), five.long_retreats()), (1, 0));
        // A spark between them: two shorts, each with a short way.
        let two = counted(&[(0, 5, 10.0), (0, 5, 7.0), (1, 4, 6.0), (0, 5, 6.0), (0, 5, 3.0), (5, 0, 3.0)]);
        assert_eq!((two.shorts(), two.long_retreats()), (2, 0));
    }
}
