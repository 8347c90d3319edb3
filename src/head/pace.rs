//! Which tick does what.
//!
//! Twenty ticks are a millisecond; the place of a tick in it is its *slot*. Position, velocity and the control loop belong to
//! every tick. What may take longer has slots of its own, so that no tick does two of them:
//!
//! | slot | besides the loop | why so rarely |
//! | --- | --- | --- |
//! | 0, 5, 10, 15 | *plan*: states, feed law, limits, path | the gap voltage is filtered to 200 Hz; 0.25 ms are 1.8 degrees at 20 Hz |
//! | 1 | current: I2t, back-EMF | time constants of 20 ms and more, fed with the means of all ticks |
//! | 2 | encoder: two counters, marks | deadline of tens of ms |
//! | 19 | firmware: status to the supervision | its period |
//!
//! A plan is made out of its turn in the very tick in which something urgent shows: a short, a safety input, a fault, a
//! command. States that count ticks or close a loop over the gap voltage plan in every tick.

use crate::units::{PLAN_TICKS, TICKS_PER_MS};

/// Slot of the drive's slice.
pub(super) const DRIVE: u32 = 1;
/// Slot of the encoder's slice.
pub(super) const ENCODER: u32 = 2;
const LAST: u32 = TICKS_PER_MS - 1;

/// A bit for each slot with a plan.
const PLANS: u32 = {
    let mut plans = 0;
    let mut slot = 0;
    while slot < TICKS_PER_MS {
        plans |= 1 << slot;
        slot += PLAN_TICKS;
    }
    plans
};

/// A bit for each slot in which there is more than the loop.
const BUSY: u32 = PLANS | 1 << DRIVE | 1 << ENCODER | 1 << LAST;

/// Counts down to the next slot in which there is more than the loop.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pace {
    left: u32,
    slot: u32,
}

impl Pace {
    /// The first tick is in slot 0.
    pub fn new() -> Pace {
        Pace { left: 1, slot: 0 }
    }

    /// A tick begins; whether its slot is the next busy one. [`Pace::take`] must follow if it is.
    #[inline]
    pub fn begin(&mut self) -> bool {
        self.left = self.left.wrapping_sub(1);
        self.left == 0
    }

    /// The next busy slot.
    #[inline]
    pub fn next(&self) -> u32 {
        self.slot
    }

    /// Gives the slot of this tick, and goes on to the next busy one.
    pub fn take(&mut self) -> u32 {
        let slot = self.slot;
        // The last one is busy, so that only behind it there is none.
        let later = (BUSY >> (slot & 31)) >> 1;
        self.left = if later == 0 { 1 } else { later.trailing_zeros() + 1 };
        self.slot = if later == 0 { 0 } else { slot.wrapping_add(self.left) };
        slot
    }
}

/// Whether a slot has a plan.
#[inline]
pub(super) fn plans(slot: u32) -> bool {
    PLANS >> (slot & 31) & 1 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fifth_tick_plans_and_none_of_the_others_does_more_than_one_thing() {
        let mut pace = Pace::new();
        let slots: Vec<_> = (0..40).map(|_| pace.begin().then(|| pace.take())).collect();
        let busy = [0, 1, 2, 5, 10, 15, 19];
        for (tick, slot) in (0..).zip(slots) {
            assert_eq!(slot, busy.contains(&(tick % 20)).then_some(tick % 20), "tick {tick}");
        }
        assert_eq!(busy.map(plans), [true, false, false, true, true, true, false]);
        assert_eq!([DRIVE, ENCODER, LAST], [1, 2, 19]);
    }

    #[test]
    fn the_tick_before_the_encoders_slice_and_the_one_after_the_last_know_what_comes() {
        let mut pace = Pace::new();
        for tick in 0..100 {
            assert_eq!(pace.next() == ENCODER, tick % 20 == ENCODER, "before tick {tick}");
            if pace.begin() {
                pace.take();
            }
            assert_eq!(pace.next() == 0, tick % 20 == LAST, "after tick {tick}");
        }
    }
}
