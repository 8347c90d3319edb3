//! Which tick does what.
//!
//! Twenty ticks are a millisecond; the place of a tick in it is its *slot*. Position, velocity and the control loop belong to
//! every tick. What may take longer has slots of its own, so that no tick does two of them:
//!
//! | slot | besides the loop | why so rarely |
//! | --- | --- | --- |
//! | 0, 5, 10, 15 | *plan*: states, feed law, limits, path | the gap voltage is filtered to 200 Hz; 0.25 ms are 1.8 degrees at 20 Hz |
//! | 1 | *look*: I2t, back-EMF; encoder: two counters, marks | time constants of 20 ms and more, fed with the means of all ticks; deadlines of tens of ms |
//! | 1, then | firmware: status to the supervision | its period |
//!
//! A plan is made out of its turn in the very tick in which something urgent shows: a short, a safety input, a fault, a
//! command. States that count ticks or close a loop over the gap voltage plan in every tick.

use crate::units::{PLAN_TICKS, TICKS_PER_MS};

/// Slot of the look at drive and encoder.
pub(super) const LOOK: u32 = 1;

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
const BUSY: u32 = PLANS | 1 << LOOK;

/// Counts down to the next slot in which there is more than the loop.
#[derive(Clone, Copy, Debug)]
pub(super) struct Schedule {
    left: u32,
    slot: u32,
}

impl Schedule {
    /// The first tick is in slot 0.
    pub fn new() -> Schedule {
        Schedule { left: 1, slot: 0 }
    }

    /// A tick begins; whether its slot is the next busy one. [`Schedule::take`] must follow if it is.
    #[inline]
    pub fn begin(&mut self) -> bool {
        self.left = self.left.wrapping_sub(1);
        self.left == 0
    }

    /// The tick to come is in the next busy slot.
    #[inline]
    pub fn is_due(&self) -> bool {
        self.left == 1
    }

    /// The next busy slot.
    #[inline]
    pub fn next(&self) -> u32 {
        self.slot
    }

    /// The tick under way had the look.
    pub fn has_looked(&self) -> bool {
        (self.slot, self.left) == (PLAN_TICKS, PLAN_TICKS - LOOK)
    }

    /// Gives the slot of this tick, and goes on to the next busy one.
    pub fn take(&mut self) -> u32 {
        let slot = self.slot;
        let later = (BUSY >> (slot & 31)) >> 1;
        self.left = if later == 0 { TICKS_PER_MS.saturating_sub(slot) } else { later.trailing_zeros() + 1 };
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
    fn every_fifth_tick_plans_and_one_other_looks() {
        let mut schedule = Schedule::new();
        let slots: Vec<_> = (0..40).map(|_| schedule.begin().then(|| schedule.take())).collect();
        let busy = [0, 1, 5, 10, 15];
        for (tick, slot) in (0..).zip(slots) {
            assert_eq!(slot, busy.contains(&(tick % 20)).then_some(tick % 20), "tick {tick}");
        }
        assert_eq!(busy.map(plans), [true, false, true, true, true]);
    }

    #[test]
    fn the_tick_before_the_look_knows_and_the_look_itself_does() {
        let mut schedule = Schedule::new();
        for tick in 0..100 {
            assert_eq!(schedule.next() == LOOK, tick % 20 == LOOK, "before tick {tick}");
            if schedule.begin() {
                schedule.take();
            }
            assert_eq!(schedule.has_looked(), tick % 20 == LOOK, "after tick {tick}");
        }
    }
}
