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

/// Counts the slots.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pace {
    /// Slot of the tick before.
    slot: u32,
}

impl Pace {
    /// The first tick is in slot 0.
    pub fn new() -> Pace {
        Pace { slot: TICKS_PER_MS - 1 }
    }

    /// Slot of the tick to come.
    #[inline]
    pub fn next(&self) -> u32 {
        if self.slot < TICKS_PER_MS - 1 { self.slot + 1 } else { 0 }
    }

    /// A tick begins; gives its slot.
    #[inline]
    pub fn begin(&mut self) -> u32 {
        self.slot = self.next();
        self.slot
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
        let slots: Vec<u32> = (0..40).map(|_| pace.begin()).collect();
        assert_eq!(slots, (0..20).chain(0..20).collect::<Vec<_>>());
        let planning: Vec<u32> = (0..20).filter(|slot| plans(*slot)).collect();
        assert_eq!(planning, [0, 5, 10, 15]);
        assert!(!plans(DRIVE) && !plans(ENCODER) && !plans(TICKS_PER_MS - 1) && DRIVE != ENCODER);
    }
}
