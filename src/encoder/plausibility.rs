//! Whether the encoder can be believed: two counters compared, illegal transitions rationed.
//!
//! The edge decoder and the timer watch the same lines. They are compared once a millisecond, a *look*. They are read one after
//! the other, and an edge may fall in between: such a difference is gone at the next look. One that stays means that one of
//! them has lost or made up counts, and no one knows which: the position is no longer to be trusted.
//!
//! One illegal transition may be a disturbance; many say that the lines are broken, noisy or too fast. Where both counters
//! are wired each of them also leaves a lasting difference of two counts, unless the next one happens to undo it.

use core::fmt;
use edm_hal_shim::encoder::RawCount;

/// What is still believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PlausibilityLimits {
    /// Largest lasting difference between the counters, counts.
    pub difference: u32,
    /// Looks in a row that a larger difference may last.
    pub difference_looks: u32,
    /// Illegal transitions within a window that are only counted.
    pub illegal: u32,
    /// Length of a window, looks. Windows follow each other; nearly twice [`PlausibilityLimits::illegal`] across the border
    /// of two pass.
    pub illegal_looks: u32,
}

impl Default for PlausibilityLimits {
    /// One count, so that one lost edge pair (two counts) shows; two looks, so that edges in flight must have been there three
    /// times in a row, 1 ms apart; ten illegal transitions a second. Assumed.
    fn default() -> Self {
        PlausibilityLimits { difference: 1, difference_looks: 2, illegal: 10, illegal_looks: 1000 }
    }
}

/// Why the encoder is not believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum EncoderFault {
    /// The counters have drifted apart and stay so.
    Disagreement {
        /// Counts of the counter in use less those of the other, since the start.
        difference: i32,
    },
    /// Too many illegal transitions in this window.
    IllegalTransitions {
        /// How many so far.
        seen: u32,
    },
}

impl fmt::Display for EncoderFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            EncoderFault::Disagreement { difference } => write!(f, "encoder counters differ by {difference} counts"),
            EncoderFault::IllegalTransitions { seen } => write!(f, "{seen} illegal encoder transitions"),
        }
    }
}

impl core::error::Error for EncoderFault {}

/// Watches one encoder.
#[derive(Clone, Debug)]
pub struct Plausibility {
    limits: PlausibilityLimits,
    /// Count in use less the other at the start.
    offset: Option<u32>,
    apart_looks: u32,
    /// Illegal transitions at the newest look, and how many of them in this window.
    illegal: u32,
    illegal_seen: u32,
    window_looks: u32,
}

impl Plausibility {
    /// `illegal` is the decoder's number of illegal transitions so far.
    pub fn new(limits: PlausibilityLimits, illegal: u32) -> Self {
        Plausibility { limits, offset: None, apart_looks: 0, illegal, illegal_seen: 0, window_looks: 0 }
    }

    /// Takes a look's readings: the counter in use, the other where it is wired, and the decoder's number of illegal
    /// transitions. The counters are taken to agree at the first reading of both. `Err` for as long as it is so; a
    /// disagreement goes before illegal transitions.
    pub fn look(&mut self, used: RawCount, other: Option<RawCount>, illegal: u32) -> Result<(), EncoderFault> {
        let rate = self.count_illegal(illegal);
        if let Some(other) = other {
            self.compare(used.count, other.count)?;
        }
        rate
    }

    fn compare(&mut self, used: u32, other: u32) -> Result<(), EncoderFault> {
        let apart = used.wrapping_sub(other);
        let difference = apart.wrapping_sub(*self.offset.get_or_insert(apart)) as i32;
        if difference.unsigned_abs() <= self.limits.difference {
            self.apart_looks = 0;
            return Ok(());
        }
        self.apart_looks = self.apart_looks.saturating_add(1);
        if self.apart_looks > self.limits.difference_looks {
            Err(EncoderFault::Disagreement { difference })
        } else {
            Ok(())
        }
    }

    fn count_illegal(&mut self, illegal: u32) -> Result<(), EncoderFault> {
        if self.window_looks >= self.limits.illegal_looks {
            self.window_looks = 0;
            self.illegal_seen = 0;
        }
        self.window_looks = self.window_looks.saturating_add(1);
        let new = illegal.wrapping_sub(self.illegal);
        self.illegal = illegal;
        self.illegal_seen = self.illegal_seen.saturating_add(new);
        let seen = self.illegal_seen;
        if seen > self.limits.illegal { Err(EncoderFault::IllegalTransitions { seen }) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: PlausibilityLimits =
        PlausibilityLimits { difference: 1, difference_looks: 20, illegal: 10, illegal_looks: 1000 };

    fn at(count: u32) -> RawCount {
        RawCount { count, ..RawCount::default() }
    }

    #[test]
    fn counters_that_start_apart_agree_as_long_as_they_move_together() {
        let mut watch = Plausibility::new(LIMITS, 0);
        for moved in 0..100_000u32 {
            let used = moved.wrapping_mul(250).wrapping_sub(17);
            assert_eq!(watch.look(at(used), Some(at(used.wrapping_add(123_456))), 0), Ok(()));
        }
    }

    #[test]
    fn a_difference_that_lasts_longer_than_allowed_is_a_disagreement_until_it_is_gone() {
        for difference in [2, -2, 1_000_000, -1_000_000] {
            let mut watch = Plausibility::new(LIMITS, 0);
            let used = 5u32.wrapping_add_signed(difference);
            assert_eq!(watch.look(at(5), Some(at(5)), 0), Ok(()));
            for _ in 0..LIMITS.difference_looks {
                assert_eq!(watch.look(at(used), Some(at(5)), 0), Ok(()));
            }
            for _ in 0..3 {
                assert_eq!(watch.look(at(used), Some(at(5)), 0), Err(EncoderFault::Disagreement { difference }));
            }
            assert_eq!(watch.look(at(5), Some(at(5)), 0), Ok(()));
        }
    }

    #[test]
    fn edges_in_flight_come_and_go() {
        let mut watch = Plausibility::new(LIMITS, 0);
        for tick in 0..10_000 {
            let in_flight = if tick % (LIMITS.difference_looks + 1) == 0 { 0 } else { 7 };
            assert_eq!(watch.look(at(tick * 15), Some(at(tick * 15 + in_flight)), 0), Ok(()), "tick {tick}");
        }
    }

    #[test]
    fn the_tolerated_difference_may_last_for_ever() {
        let mut watch = Plausibility::new(LIMITS, 0);
        assert_eq!(watch.look(at(0), Some(at(0)), 0), Ok(()));
        for _ in 0..10_000 {
            assert_eq!(watch.look(at(LIMITS.difference), Some(at(0)), 0), Ok(()));
        }
    }

    #[test]
    fn illegal_transitions_are_reported_above_their_rate_and_not_at_it() {
        // The decoder's number wraps in between.
        let start = 4u32.wrapping_neg();
        for (per_window, reported) in [(LIMITS.illegal, false), (LIMITS.illegal + 1, true)] {
            let mut watch = Plausibility::new(LIMITS, start);
            for window in 0..3 {
                let mut result = Ok(());
                for tick in 0..LIMITS.illegal_looks {
                    let illegal = start.wrapping_add(window * per_window + (tick + 1).min(per_window));
                    result = watch.look(at(0), None, illegal);
                }
                let seen = per_window;
                assert_eq!(result, if reported { Err(EncoderFault::IllegalTransitions { seen }) } else { Ok(()) });
            }
        }
    }

    #[test]
    fn an_illegal_transition_on_the_border_of_two_windows_is_counted() {
        let mut watch = Plausibility::new(LIMITS, 0);
        for _ in 0..LIMITS.illegal_looks {
            assert_eq!(watch.look(at(0), None, 0), Ok(()));
        }
        let seen = LIMITS.illegal + 1;
        assert_eq!(watch.look(at(0), None, seen), Err(EncoderFault::IllegalTransitions { seen }));
    }

    #[test]
    fn a_disagreement_goes_before_illegal_transitions() {
        let mut watch = Plausibility::new(LIMITS, 0);
        assert_eq!(watch.look(at(0), Some(at(0)), 0), Ok(()));
        for _ in 0..LIMITS.difference_looks {
            assert_eq!(watch.look(at(2), Some(at(0)), 11), Err(EncoderFault::IllegalTransitions { seen: 11 }));
        }
        assert_eq!(watch.look(at(2), Some(at(0)), 11), Err(EncoderFault::Disagreement { difference: 2 }));
    }
}
