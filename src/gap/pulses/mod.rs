//! Classes of pulses: what each one was, how often of late, and whether arcs stay.
//!
//! - *open*: not ignited when it was looked at. *Spark*: burns as a discharge does. *Arc*: burns lower, at the spot of the
//!   discharge before, which takes away little and leaves a pit. *Short*: current without voltage. *No pulse*: nothing was to
//!   be looked at. *Uncertain*: there was a pulse, and what was seen of it does not tell.
//!
//! What the head goes by is one look into a pulse: current and voltage that the reflex's converter finds when the blanking is over
//! (2 us, or three time constants of the charging gap). A spark has an ignition delay, so most are open then; an arc has none
//! and burns already. The head looks once a millisecond at the newest pulse: a sample of the pulses, 200 in 200 ms.
//!
//! A discharge that is over before the blanking (a small capacitor's) is uncertain, arc or not.
//!
//! [`Samples`] tells a pulse by all conversions of its on-time, and by comparators and current where there are any. The head
//! does not use it yet; docs/gap-sensing.md has what it was measured to tell.

mod class;
mod samples;
mod shares;

pub use class::{CLASSES, Class, Levels, PulseSample};
pub use samples::{Boundaries, Config as SamplesConfig, Evidence, Samples};
pub use shares::{Shares, WINDOW};

use edm_hal_shim::reflex::PulseCounts;

/// When arcs are persistent, and how pulses are told apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// How.
    pub levels: Levels,
    /// Percent of the pulses seen in [`WINDOW`] ms that are arcs, and more. Above 100 nothing is.
    pub share: u32,
    /// For so long, ms.
    pub ms: u32,
    /// Percent of them that are arcs, and more, which ask for a jump; 0: none do.
    pub jump: u32,
}

/// What the pulses of late were.
#[derive(Clone, Debug, Default)]
pub struct Pulses {
    shares: Shares,
    /// Edges and conversions at the look before.
    last: [u8; 2],
    /// Looks in a row at which arcs had more than their share.
    above: u32,
    /// Arcs ask for a jump; `None` before enough was seen.
    jump: Option<bool>,
}

impl Pulses {
    /// Pulses to have seen in [`WINDOW`] ms before a share of them means anything: the standard deviation of a share of
    /// 40 is 8 % at the most.
    pub const LEAST: u32 = 40;

    /// Classes of late.
    pub fn shares(&self) -> &Shares {
        &self.shares
    }

    /// Whether arcs ask for a jump; `None` before enough was seen to say.
    pub fn jump(&self) -> Option<bool> {
        self.jump
    }

    /// Looks at the newest pulse, once a millisecond. Whether arcs have had more than their share for their time; without
    /// permission to pulse everything begins anew.
    pub fn look(&mut self, config: &Config, counts: PulseCounts, permitted: bool) -> bool {
        let [edges, conversions] = core::mem::replace(&mut self.last, [counts.edges, counts.conversions]);
        if !permitted {
            (self.above, self.shares, self.jump) = (0, Shares::default(), None);
            return false;
        }
        let class = if counts.conversions != conversions {
            config.levels.class(PulseSample::of(counts.newest))
        } else if counts.edges != edges {
            Class::Uncertain
        } else {
            Class::NoPulse
        };
        let mut look = [0; CLASSES];
        if let Some(count) = look.get_mut(class as usize) {
            *count = 1;
        }
        self.shares.add(&look);
        let [open, spark, arcs, short, _, uncertain] = self.shares.counts().map(u32::from);
        let seen = open + spark + arcs + short + uncertain;
        let more = |share| seen >= Self::LEAST && arcs * 100 > share * seen;
        self.jump = (seen >= Self::LEAST).then(|| config.jump > 0 && more(config.jump));
        let above = more(config.share);
        self.above = if above { self.above.saturating_add(1) } else { 0 };
        self.above > config.ms
    }
}

#[cfg(test)]
mod tests {
    use super::class::tests::LEVELS;
    use super::*;
    use proptest::prelude::*;

    const CONFIG: Config = Config { levels: LEVELS, share: 60, ms: 50, jump: 40 };

    /// Looks, of which a share in percent finds an arc and the others a pulse that has not ignited, one at a rate per look;
    /// gives the look at which arcs are found to stay, of 2000.
    fn found(share: u32, conversions: impl Fn(u32) -> u32) -> Option<u32> {
        let mut pulses = Pulses::default();
        // Evenly mixed.
        (1..=2000).find(|n| {
            let arc = n * share / 100 != (n - 1) * share / 100;
            let count = conversions(*n) as u8;
            let newest = if arc { [2600, 690] } else { [2050, 1410] };
            let counts =
                PulseCounts { edges: count.wrapping_mul(2), conversions: count, newest, ..PulseCounts::default() };
            pulses.look(&CONFIG, counts, true)
        })
    }

    #[test]
    fn nothing_but_arcs_are_found_when_their_time_is_over_and_enough_were_seen() {
        // 40 pulses, and 50 ms more.
        assert_eq!(found(100, |n| n), Some(40 + 50));
        // A pulse in four looks.
        assert_eq!(found(100, |n| n / 4), Some(160 + 50));
    }

    #[test]
    fn a_share_below_the_limit_is_never_found_and_one_above_is() {
        for share in [0, 26, 30, 50, 59, 60] {
            assert_eq!(found(share, |n| n), None, "{share} %");
        }
        for share in [62, 70, 90] {
            assert!(found(share, |n| n).is_some_and(|n| n <= WINDOW as u32 + 50), "{share} %");
        }
    }

    #[test]
    fn arcs_ask_for_a_jump_from_their_share_on_once_enough_was_seen() {
        for (config, arcs, wanted) in [
            (CONFIG, 100, Some(true)),
            (CONFIG, 41, Some(true)),
            (CONFIG, 40, Some(false)),
            (Config { jump: 0, ..CONFIG }, 100, Some(false)),
        ] {
            let mut pulses = Pulses::default();
            for n in 1..=200u32 {
                let newest = if n <= 2 * arcs { [2600, 690] } else { [2050, 1410] };
                let counts = PulseCounts { edges: n as u8, conversions: n as u8, newest, ..PulseCounts::default() };
                pulses.look(&config, counts, true);
                assert_eq!(pulses.jump().is_some(), n >= Pulses::LEAST);
            }
            assert_eq!(pulses.jump(), wanted, "{arcs} %");
            pulses.look(&config, PulseCounts::default(), false);
            assert_eq!(pulses.jump(), None, "pulses begin anew");
        }
    }

    #[test]
    fn arcs_of_which_few_were_seen_are_none() {
        // 39 in 200 ms.
        assert_eq!(found(100, |n| n * 39 / 200), None);
        assert_eq!(found(100, |_| 0), None);
    }

    #[test]
    fn without_permission_it_begins_anew() {
        let mut pulses = Pulses::default();
        let mut look = |n: u8, permitted| {
            let counts = PulseCounts { edges: n, conversions: n, newest: [2600, 690], ..PulseCounts::default() };
            pulses.look(&CONFIG, counts, permitted)
        };
        assert!(!(1..90).any(|n| look(n, true)));
        assert!(!look(90, false));
        assert!(!(91..180).any(|n| look(n, true)));
        assert!(look(180, true));
    }

    #[test]
    fn pulses_that_are_not_converted_are_uncertain_and_none_are_no_pulse() {
        let mut pulses = Pulses::default();
        for edges in [2, 4, 4, 4] {
            pulses.look(&CONFIG, PulseCounts { edges, ..PulseCounts::default() }, true);
        }
        assert_eq!(pulses.shares().counts(), [0, 0, 0, 0, 2, 2]);
    }

    proptest! {
        #[test]
        fn no_counts_make_it_fail(all: Vec<(u8, u8, u16, u16, bool)>, share: u32, ms: u32) {
            let mut pulses = Pulses::default();
            let config = Config { share: share % 102, ms, ..CONFIG };
            for (edges, conversions, current, voltage, permitted) in all {
                let newest = [current, voltage];
                pulses.look(&config, PulseCounts { edges, conversions, newest, ..PulseCounts::default() }, permitted);
                let looks = pulses.shares().counts().iter().map(|count| u32::from(*count)).sum::<u32>();
                prop_assert!(looks <= WINDOW as u32);
            }
        }
    }
}
