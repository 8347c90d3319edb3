//! Classes of pulses: what each one was, how often of late, and whether arcs persist.
//!
//! - *open*: not ignited when its gate closed. *Spark*: burns as a discharge does. *Arc*: burns lower, at the spot of the
//!   discharge before, which takes away little and leaves a pit. *Short*: current without voltage. *Uncertain*: there was a
//!   pulse, and what was seen of it does not tell. *No pulse*: a millisecond without one.
//!
//! [`PulseStream`] classifies every pulse by the edges of gate and comparator and by the conversions of its on-time
//! ([`Evidence`]); docs/gap-sensing.md says how often it is right.
//!
//! Arcs are *persistent* by a cumulative sum (Page, Biometrika 41, 1954), once a millisecond, of arcs a among n pulses:
//!
//! ```text
//! S <- max(0, S + a - p n)      p: supervise.arc_percent
//! ```
//!
//! S grows where arcs are more than the share p and falls back where they are less, however many pulses there are. What lies above
//! [`ARCS`] for `supervise.arc_ms` is persistent. So is a second sum above [`FEW`], with a share that is higher by 7 %, that was above
//! half of [`FEW`] for as long (several sums side by side: Lorden, Annals of Mathematical Statistics 42, 1971). The first sum with
//! `jump.arcs_percent` asks for a jump as soon as it is above [`ARCS`]. A window of 200 ms with a share above p would cross that by chance: of 1000
//! pulses the share has a standard deviation of 1.5 %.
//!
//! Whatever burns, and at whatever level: arcs are persistent as well once [`RUN`] pulses in `supervise.undelayed_ms` have burned and not one
//! among them, or open, has waited longer than an arc does. A gap that lets every pulse through at once has an arc, or a short that no
//! threshold shows.

mod class;
mod looks;
mod samples;
mod shares;
mod stream;

pub use class::{CLASSES, Class, Levels};
pub use looks::{Fit, Seen};
pub use samples::{Boundaries, Config as BoundaryConfig, Evidence};
pub use shares::{Shares, WINDOW};
pub use stream::{Counts, Pulse, PulseStream, UNSHOWN};

use crate::units::within;

/// Arcs beyond the share of `supervise.arc_percent` that are too many. With 2 % of the pulses fewer arcs than that, 25 000
/// independent pulses a second come as far, and stay there for 50 ms, once in hours (simulated). With 2 % more it takes 0.2 s at
/// 25 000 pulses a second, 0.1 s at 100 000 and 1 s at 5000: fewer pulses do not tell.
pub const ARCS: f32 = 80.0;
/// The same for the second sum, whose share is higher by 7 %. It finds what is far above `supervise.arc_percent` with few pulses:
/// 75 % for 60 takes 240 pulses with it, 530 with the first; 0.67 is the slope of the likelihood ratio of 0.75 against 0.58. With 2 % below
/// `supervise.arc_percent` both sums together come as far once in 12 h at 1000 pulses a second (simulated).
pub const FEW: f32 = 19.0;
/// Percent.
const MARKED: f32 = 7.0;
/// Pulses in a row without a wait that are too many: of a healthy gap in which one pulse in fifty waits so many come once in 10^17.
pub const RUN: u32 = 2000;

/// When arcs are persistent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Percent of the pulses that are arcs, and more. Above 100 nothing is.
    pub share: u32,
    /// For so long, ms.
    pub ms: u32,
    /// Percent of the pulses that are arcs, and more, which ask for a jump; 0: none do.
    pub jump: u32,
    /// Burning pulses without a wait among them, for so long, ms; 0: never.
    pub undelayed: u32,
}

/// What the pulses of late were.
#[derive(Clone, Debug, Default)]
pub struct Pulses {
    shares: Shares,
    /// Pulses when they were looked at last.
    last: Counts,
    /// The sums S of the [module](self): for a jump, for the fault, for the fault by few pulses.
    arcs: [f32; 3],
    /// Milliseconds in a row for which it was too large.
    above: [u32; 2],
    /// Burning pulses since one has waited, and milliseconds with some.
    run: [u32; 2],
    /// Milliseconds since it began, and pulses.
    since: u32,
    seen: u32,
    /// Arcs ask for a jump; `None` before enough was seen.
    jump: Option<bool>,
    /// Milliseconds without permission.
    off: u32,
}

impl Pulses {
    /// Pulses, and milliseconds, to have seen before a share means anything for a jump: the standard deviation of a share of
    /// 40 is 8 % at the most, and a jump has to show for a while what it was good for.
    pub const LEAST: u32 = 40;
    /// Milliseconds without permission, at most, that only interrupt the sums of the fault: a jump may take 1.4 s there and back.
    const BREAK: u32 = 2000;

    /// Classes of late.
    pub fn shares(&self) -> &Shares {
        &self.shares
    }

    /// Whether arcs ask for a jump; `None` before enough was seen to say.
    pub fn jump(&self) -> Option<bool> {
        self.jump
    }

    /// Takes the pulses of a millisecond, and whether the gap is short: that is no arc. Whether arcs are persistent. Without permission to pulse, shares and what asks for a jump begin
    /// anew. The sums of the fault do where the jump was one for arcs, which is to show what it was good for; a jump by time interrupts
    /// them, or arcs would never be persistent among jumps that follow each other soon.
    pub fn look(&mut self, config: &Config, counts: &Counts, permitted: bool, short: bool) -> bool {
        let new = counts.since(&self.last);
        self.last = *counts;
        if !permitted {
            let begins = self.off == 0 && self.jump == Some(true) || self.off >= Self::BREAK;
            let [_, many, few] = self.arcs;
            let (arcs, above, run) =
                if begins { ([0.0; 3], [0; 2], [0; 2]) } else { ([0.0, many, few], self.above, self.run) };
            *self = Pulses { last: self.last, off: self.off.saturating_add(1), arcs, above, run, ..Pulses::default() };
            return false;
        }
        self.off = 0;
        let pulses = new.total();
        let mut classes = new.classes.map(|count| count.min(u16::MAX.into()) as u16);
        if let (0, Some(none)) = (pulses, classes.get_mut(Class::NoPulse as usize)) {
            *none = 1;
        }
        self.shares.add(&classes);
        let arcs = new.classes.get(Class::Arc as usize).copied().unwrap_or(0);
        let share = config.share as f32;
        let limits = [(config.jump as f32, ARCS), (share, ARCS), (share + MARKED, FEW)];
        for (sum, (percent, many)) in self.arcs.iter_mut().zip(limits) {
            let beyond = arcs as f32 - 0.01 * percent * pulses as f32;
            // No more than twice as many: the end of persistent arcs shows soon.
            *sum = within(*sum + beyond, 0.0, 2.0 * many);
        }
        let [jump, many, few] = self.arcs;
        let [above, half] = &mut self.above;
        for (ms, above) in [(above, many > ARCS), (half, few > 0.5 * FEW)] {
            *ms = if above { ms.saturating_add(1) } else { 0 };
        }
        self.seen = self.seen.saturating_add(pulses);
        self.since = self.since.saturating_add(1);
        self.jump = (self.seen.min(self.since) >= Self::LEAST).then_some(config.jump > 0 && jump > ARCS);
        let [above, half] = self.above;
        above > config.ms || few > FEW && half > config.ms || self.runs(config.undelayed, &new, short)
    }

    /// Whether too many pulses have burned without a wait.
    fn runs(&mut self, longest: u32, new: &Counts, short: bool) -> bool {
        let burned = [Class::Spark, Class::Arc, Class::Uncertain]
            .iter()
            .fold(0u32, |sum, class| sum.wrapping_add(new.class(*class)));
        let [pulses, ms] = self.run;
        self.run = match (new.waits, burned) {
            (0, 1..) if !short => [pulses.saturating_add(burned), ms.saturating_add(1)],
            (0, _) => [pulses, ms],
            _ => [0; 2],
        };
        let [pulses, ms] = self.run;
        longest > 0 && ms >= longest && pulses >= RUN
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CONFIG: Config = Config { share: 60, ms: 50, jump: 40, undelayed: 300 };

    /// So many pulses a millisecond, of which a share in percent are arcs and the others open, evenly mixed; gives the
    /// millisecond in which arcs are found to be persistent, of 5000.
    fn found(share: u32, pulses: u32) -> Option<u32> {
        let (mut watch, mut counts) = (Pulses::default(), Counts::default());
        (1..=5000).find(|n| {
            let arcs = n * pulses * share / 100;
            counts.classes[Class::Arc as usize] = arcs;
            counts.classes[Class::Open as usize] = n * pulses - arcs;
            counts.waits = n * pulses - arcs;
            watch.look(&CONFIG, &counts, true, false)
        })
    }

    #[test]
    fn arcs_above_their_share_are_persistent_after_80_or_19_too_many_and_their_time() {
        // 33 % of the pulses are too many for the second sum: half of 19 of them, and 50 ms.
        assert!(found(100, 1).is_some_and(|ms| (77..=81).contains(&ms)));
        assert!(found(100, 100).is_some_and(|ms| (51..=52).contains(&ms)));
        // 75 % with one pulse a millisecond, 8 % too many for the second sum.
        assert!(found(75, 1).is_some_and(|ms| (230..=245).contains(&ms)));
        // 2 % too many at 25 kHz, 0.5 a millisecond.
        assert!(found(62, 25).is_some_and(|ms| (200..215).contains(&ms)));
    }

    #[test]
    fn pulses_that_burn_and_never_wait_are_persistent_at_any_level_and_one_that_waits_ends_the_run() {
        // Class, pulses a millisecond, pulses from one that waits to the next, whether the gap is short; the millisecond.
        for (class, pulses, waits, short, found) in [
            (Class::Spark, 10, 0, false, Some(300)),
            (Class::Uncertain, 10, 0, false, Some(300)),
            (Class::Spark, 1, 0, false, Some(2000)),
            (Class::Spark, 10, 2500, false, None),
            (Class::Spark, 10, 0, true, None),
            (Class::Short, 10, 0, false, None),
            (Class::Open, 10, 1, false, None),
        ] {
            let (mut watch, mut counts) = (Pulses::default(), Counts::default());
            let ms = (1..=5000u32).find(|n| {
                counts.classes[class as usize] += pulses;
                counts.waits += u32::from(waits > 0 && n * pulses % waits == 0);
                watch.look(&CONFIG, &counts, true, short)
            });
            assert_eq!(ms, found, "{class:?}, {pulses} a millisecond, {waits}");
        }
    }

    #[test]
    fn arcs_below_their_share_are_never_persistent() {
        for share in [0, 30, 50, 58, 60] {
            for pulses in [1, 5, 25, 100] {
                assert_eq!(found(share, pulses), None, "{share} %, {pulses} a millisecond");
            }
        }
    }

    /// Independent pulses, by a congruential generator (Knuth, MMIX).
    struct Chance(u64);

    impl Chance {
        /// The millisecond, of `ms`, in which arcs are persistent: `percent` of so many pulses a millisecond.
        fn found(&mut self, percent: u64, pulses: u32, ms: u32) -> Option<u32> {
            let (mut watch, mut counts) = (Pulses::default(), Counts::default());
            (1..=ms).find(|_| {
                let arcs = (0..pulses).filter(|_| self.next() % 100 < percent).count() as u32;
                counts.classes[Class::Arc as usize] += arcs;
                counts.classes[Class::Spark as usize] += pulses - arcs;
                counts.waits += pulses - arcs;
                watch.look(&CONFIG, &counts, true, false)
            })
        }

        fn next(&mut self) -> u64 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            self.0 >> 33
        }
    }

    #[test]
    fn a_share_of_two_percent_less_by_chance_is_not_persistent_in_an_hour() {
        for pulses in [1, 5, 25] {
            assert_eq!(Chance(1).found(58, pulses, 3_600_000), None, "{pulses} a millisecond");
        }
    }

    #[test]
    fn a_share_of_two_percent_more_by_chance_is_persistent_after_0_1_s_at_100_khz_0_2_s_at_25_and_1_s_at_5() {
        let mut chance = Chance(1);
        // Pulses a millisecond; the mean of 100 runs, ms.
        for (pulses, mean) in [(100, 80..=110), (25, 150..=240), (5, 600..=1200)] {
            let times: Vec<u32> = (0..100).map(|_| chance.found(62, pulses, 10_000).expect("2 % too many")).collect();
            let found = times.iter().sum::<u32>() / 100;
            assert!(mean.contains(&found), "{pulses} a millisecond: {found} ms");
            let worst = times.into_iter().max().unwrap_or_default();
            assert!(pulses < 100 || worst <= 200, "{pulses} a millisecond: {worst} ms");
        }
    }

    #[test]
    fn arcs_ask_for_a_jump_from_their_share_on_once_enough_was_seen() {
        for (config, arcs, wanted) in [
            (CONFIG, 100, Some(true)),
            (CONFIG, 50, Some(true)),
            (CONFIG, 40, Some(false)),
            (CONFIG, 30, Some(false)),
            (Config { jump: 0, ..CONFIG }, 100, Some(false)),
        ] {
            let (mut pulses, mut counts) = (Pulses::default(), Counts::default());
            for n in 1..=1000u32 {
                counts.classes[if n * arcs % 100 < arcs { Class::Arc } else { Class::Open } as usize] += 1;
                pulses.look(&config, &counts, true, false);
                assert_eq!(pulses.jump().is_some(), n >= Pulses::LEAST);
            }
            assert_eq!(pulses.jump(), wanted, "{arcs} %");
            pulses.look(&config, &counts, false, false);
            assert_eq!(pulses.jump(), None, "pulses begin anew");
        }
    }

    #[test]
    fn after_a_jump_for_arcs_and_after_two_seconds_without_permission_it_begins_anew() {
        for (config, off, anew) in [
            (Config { jump: 40, ..CONFIG }, 1, true),
            (Config { jump: 0, ..CONFIG }, 1, false),
            (Config { jump: 0, ..CONFIG }, Pulses::BREAK, false),
            (Config { jump: 0, ..CONFIG }, Pulses::BREAK + 1, true),
        ] {
            let (mut pulses, mut counts) = (Pulses::default(), Counts::default());
            let mut look = |permitted| {
                counts.classes[Class::Arc as usize] += 90;
                pulses.look(&config, &counts, permitted, false)
            };
            assert!(!(0..50).any(|_| look(true)));
            assert!(!(0..off).any(|_| look(false)));
            assert_eq!((0..50).any(|_| look(true)), !anew, "{config:?}, {off} ms");
            assert!(look(true));
        }
    }

    #[test]
    fn jumps_by_time_do_not_hide_persistent_arcs_nor_make_them() {
        // 25 kHz, 180 ms between two jumps of 20 ms.
        let run = |percent: u64, seconds: u32| {
            let (mut watch, mut counts, mut chance) = (Pulses::default(), Counts::default(), Chance(7));
            let config = Config { jump: 0, ..CONFIG };
            (1..=seconds * 1000).find(|ms| {
                let permitted = ms % 200 < 180;
                if permitted {
                    let arcs = (0..25).filter(|_| chance.next() % 100 < percent).count() as u32;
                    counts.classes[Class::Arc as usize] += arcs;
                    counts.classes[Class::Spark as usize] += 25 - arcs;
                    counts.waits += 25 - arcs;
                }
                watch.look(&config, &counts, permitted, false)
            })
        };
        let found = run(62, 10);
        assert!(found.is_some_and(|ms| ms < 1000), "{found:?}");
        assert_eq!(run(58, 3600), None);
    }

    #[test]
    fn milliseconds_without_a_pulse_are_counted_as_such() {
        let (mut pulses, mut counts) = (Pulses::default(), Counts::default());
        for new in [0, 3, 0, 2] {
            counts.classes[Class::Uncertain as usize] += new;
            pulses.look(&CONFIG, &counts, true, false);
        }
        assert_eq!(pulses.shares().counts(), [0, 0, 0, 0, 2, 5]);
    }

    proptest! {
        #[test]
        fn no_counts_make_it_fail(all: Vec<([u32; CLASSES], u32, bool, bool)>, share: u32, ms: u32) {
            let mut pulses = Pulses::default();
            let config = Config { share: share % 102, ms, ..CONFIG };
            for (classes, waits, permitted, short) in all {
                pulses.look(&config, &Counts { classes, waits, ..Counts::default() }, permitted, short);
            }
        }
    }
}
