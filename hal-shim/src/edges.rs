//! Which conversions of a block lie inside the generator's on-time.
//!
//! The gate's edges are stamped by a timer that runs in phase with the conversions and stored by DMA, so that no pulse
//! costs the processor anything. Once a block, [`gate_mask`] walks back through the newest stamps and sets, for each stretch of
//! open gate, the bits of the conversions whose whole aperture lies in it. *Age*: clock cycles before the moment of reading.
//! *Aperture*: the time in which a conversion samples its input.

use crate::board::{ADC, CORE_HZ, EDGE_MODULUS, GAP_SAMPLING, SERVO};
use crate::gap::{BLOCK, GapBlock};
use crate::timing::adc;

/// Cycles from one conversion to the next.
const SPACING: u32 = SERVO.steps() as u32 / BLOCK as u32;
/// Cycles of one converter clock.
const ADC_CYCLE: u32 = CORE_HZ / ADC.hz;
/// Cycles that a conversion samples.
const APERTURE: u32 = GAP_SAMPLING.sample_cycles as u32 * ADC_CYCLE;
/// Cycles from the trigger to the end of the aperture.
pub const TRIGGER_TO_END: u32 = adc::LATENCY_CYCLES * ADC_CYCLE + APERTURE;
/// Cycles of doubt at either end of an aperture: synchronisation of trigger and stamp, input filter of the stamp.
const GUARD: u32 = 3 * ADC_CYCLE;
/// Edges that one block is worth walking back for: 400 000 pulses a second. What lies beyond stays ungated.
pub const MOST_EDGES: usize = 40;

/// Age of a stamp, cycles; right for edges younger than [`EDGE_MODULUS`].
pub const fn age(now: u32, stamp: u32) -> u32 {
    if now >= stamp { now - stamp } else { now + EDGE_MODULUS - stamp }
}

/// Bit i is set when the gate was open during the whole aperture of conversion i of the last block.
///
/// `now` is the edge timer at the moment of reading, `open` the gate then, `edges` the stamps of its edges, newest first,
/// none older than [`EDGE_MODULUS`]; before the oldest of them the gate did not change. `end_phase` is the count of the
/// edge timer, modulo one tick, at the end of a block's last aperture.
#[inline]
pub fn gate_mask(now: u32, open: bool, edges: impl Iterator<Item = u16>, end_phase: u32) -> u32 {
    let tick = SERVO.steps() as u32;
    // Age of the newest end of a last aperture, and age at which the first of its block began.
    let end = (now % tick + tick - end_phase % tick) % tick;
    let begin = end + SPACING * (BLOCK as u32 - 1) + APERTURE + GUARD;
    let mut mask = 0;
    let mut open = open;
    let mut newer = 0;
    let mut edges = edges.map(|stamp| age(now, u32::from(stamp)));
    for _ in 0..MOST_EDGES + 1 {
        // A stretch of one level, from the edge of age `older` to the edge of age `newer`.
        let older = edges.next().unwrap_or(u32::MAX);
        if open {
            mask |= inside(newer, older, end);
        }
        if older >= begin {
            break;
        }
        newer = older;
        open = !open;
    }
    mask
}

/// The conversions whose apertures lie between two edges, as a run of bits: `newer` is less than the age at which the first
/// conversion of the block began, `end` the age at which the last one ended.
#[inline]
fn inside(newer: u32, older: u32, end: u32) -> u32 {
    // Counted from the newest conversion: the first that ended before the newer edge, and how many began after the older.
    let first = (newer + GUARD).checked_sub(end + 1).map_or(0, |before| before / SPACING + 1);
    let Some(after) = older.checked_sub(end + APERTURE + GUARD) else { return 0 };
    let past = (after / SPACING).min(BLOCK as u32 - 1) + 1;
    (GapBlock::ALL >> first) & (u32::MAX << (BLOCK as u32 - past))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Reading happens this long after the last aperture.
    const LATE: u32 = 300;
    /// Wherever the block lies in the tick.
    const PHASE: u32 = 8000;
    /// A moment of reading.
    const NOW: u32 = 3 * 8400 + PHASE + LATE;

    /// Mask by ages of the edges, newest first.
    fn mask(open: bool, ages: &[u32]) -> u32 {
        let stamps = ages.iter().map(|age| ((NOW + EDGE_MODULUS - age) % EDGE_MODULUS) as u16);
        gate_mask(NOW % EDGE_MODULUS, open, stamps, PHASE)
    }

    /// Ages at which conversion `i` begins and ends to sample.
    fn aperture(i: u32) -> (u32, u32) {
        let end = LATE + 336 * (24 - i);
        (end + 120, end)
    }

    #[test]
    fn a_gate_that_does_not_change_is_all_or_nothing() {
        assert_eq!(mask(true, &[]), GapBlock::ALL);
        assert_eq!(mask(false, &[]), 0);
    }

    #[test]
    fn a_conversion_that_straddles_an_edge_is_not_gated() {
        let (begin, end) = aperture(10);
        let newer_than_10 = GapBlock::ALL & !((1 << 11) - 1);
        // Opened while conversion 10 sampled, then before it began.
        assert_eq!(mask(true, &[(begin + end) / 2]), newer_than_10);
        assert_eq!(mask(true, &[begin + GUARD - 1]), newer_than_10);
        assert_eq!(mask(true, &[begin + GUARD]), newer_than_10 | 1 << 10);
        // Closed while it sampled, then after it ended.
        assert_eq!(mask(false, &[(begin + end) / 2]), (1 << 10) - 1);
        assert_eq!(mask(false, &[end - GUARD + 1]), (1 << 10) - 1);
        assert_eq!(mask(false, &[end - GUARD]), (1 << 11) - 1);
    }

    #[test]
    fn an_off_time_between_two_apertures_costs_no_conversion() {
        let (_, end) = aperture(7);
        let (begin, _) = aperture(8);
        assert_eq!(mask(true, &[begin + GUARD, end - GUARD]), GapBlock::ALL);
    }

    #[test]
    fn a_spike_shorter_than_an_aperture_gates_nothing() {
        let (begin, end) = aperture(3);
        assert_eq!(mask(false, &[end + 10, begin - 10]), 0);
    }

    #[test]
    fn stamps_across_the_wrap_of_the_timer_are_read_right() {
        for tick in 0..7 {
            let now = (tick * 8400 + PHASE + LATE) % EDGE_MODULUS;
            let closed = (now + EDGE_MODULUS - (LATE + 336 * 12 + 60)) % EDGE_MODULUS;
            let mask = gate_mask(now, false, core::iter::once(closed as u16), PHASE);
            assert_eq!(mask, (1 << 12) - 1, "tick {tick}");
        }
    }

    #[test]
    fn more_edges_than_are_worth_walking_leave_the_rest_ungated() {
        // 100 ns on, 100 ns off: no aperture fits. Older than the walk the gate was open: unknown, so not gated.
        let ages: Vec<u32> = (0..=MOST_EDGES as u32).map(|i| LATE + 17 * i).collect();
        assert_eq!(mask(true, &ages), 0);
    }

    proptest! {
        /// Against the definition: sampled level by level at every cycle of every aperture.
        #[test]
        fn a_bit_is_set_exactly_when_the_gate_was_open_around_the_whole_aperture(
            open: bool, gaps in prop::collection::vec(40u32..3000, 0..30)
        ) {
            let ages: Vec<u32> = gaps.iter().scan(0, |sum, gap| { *sum += gap; Some(*sum) }).collect();
            let level_at = |age: u32| open ^ (ages.iter().filter(|&&edge| edge <= age).count() % 2 == 1);
            let got = mask(open, &ages);
            for i in 0..25 {
                let (begin, end) = aperture(i);
                let steady = !ages.iter().any(|&edge| edge > end - GUARD && edge < begin + GUARD);
                prop_assert_eq!(got >> i & 1 == 1, steady && level_at(end), "conversion {}", i);
            }
        }
    }
}
