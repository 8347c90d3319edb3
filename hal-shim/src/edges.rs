//! Edges of gate and comparators, and which conversions of a block lie inside the generator's on-time.
//!
//! The edges are stamped by a timer that runs in phase with the conversions and stored by DMA, so that no pulse
//! costs the processor anything until a block is read. Once a block, [`take`] moves the new stamps of a line into the block, and
//! [`gate_mask`] sets, for each stretch of open gate, the bits of the conversions whose whole aperture lies in it.
//! *Aperture*: the time in which a conversion samples its input.

use crate::board::{ADC, CORE_HZ, EDGE_MODULUS, GAP_SAMPLING, SERVO};
use crate::gap::{BLOCK, Edges, GapBlock};
use crate::reflex::EDGE_COUNT;
use crate::timing::adc;

/// Cycles of one converter clock.
const ADC_CYCLE: u32 = CORE_HZ / ADC.hz;
/// Cycles from the trigger to the end of the aperture.
pub const TRIGGER_TO_END: u32 = adc::LATENCY_CYCLES * ADC_CYCLE + GapBlock::APERTURE;
/// Cycles of doubt at either end of an aperture: synchronisation of trigger and stamp, input filter of the stamp.
const GUARD: u32 = 3 * ADC_CYCLE;

// What a block says of its times is what the converter is set to.
const _: () = assert!(GapBlock::CYCLES as u64 == SERVO.steps());
const _: () = assert!(GapBlock::APERTURE == GAP_SAMPLING.sample_cycles as u32 * ADC_CYCLE);

/// Cycles from `earlier` to `later`, counts of the edge timer; right below [`EDGE_MODULUS`].
pub const fn age(later: u32, earlier: u32) -> u32 {
    if later >= earlier { later - earlier } else { later + EDGE_MODULUS - earlier }
}

/// What the blocks so far say of gate and high comparator, for whoever comes later than the stamps can tell: they wrap after seven ticks.
///
/// The end of a pulse reads it as it was a block ago. An edge that it has is older than a tick; one that it has not is younger than three,
/// and its stamp is right.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Seen(
    /// Edges of the gate, of the high comparator, modulo [`EDGE_COUNT`], and [`Seen::DELAYED`].
    u32,
);

impl Seen {
    const MASK: u32 = EDGE_COUNT - 1;
    const HIGH: u32 = 8;
    /// The newest edge of the high comparator came after the newest of the gate.
    const DELAYED: u32 = 1 << 16;

    /// As a word.
    #[inline(always)]
    pub const fn word(self) -> u32 {
        self.0
    }

    /// Of a word.
    #[inline(always)]
    pub const fn of(word: u32) -> Seen {
        Seen(word)
    }

    /// With the edges of a block, up to these numbers.
    #[inline(always)]
    pub fn block(self, [gate, high]: [u32; 2], block: &GapBlock) -> Seen {
        let delayed = match (block.high_edges.times().last(), block.gate_edges.times().last()) {
            (None, None) => self.0 & Seen::DELAYED != 0,
            (high, gate) => high.is_some() && high >= gate,
        };
        Seen(gate & Seen::MASK | (high & Seen::MASK) << Seen::HIGH | if delayed { Seen::DELAYED } else { 0 })
    }

    /// The gate has closed with the newest of so many edges: whether the one by which it had opened is old.
    #[inline(always)]
    pub const fn opened(self, gate: u32) -> bool {
        gate.wrapping_sub(self.0) & Seen::MASK <= 1
    }

    /// Whether the newest of so many edges of the high comparator is old.
    #[inline(always)]
    pub const fn high(self, highs: u32) -> bool {
        highs & Seen::MASK == self.0 >> Seen::HIGH & Seen::MASK
    }

    /// Of edges that are both old: the high comparator's newest came after the gate's.
    #[inline(always)]
    pub const fn delayed(self) -> bool {
        self.0 & Seen::DELAYED != 0
    }
}

/// Count of the edge timer at which the newest complete block began, at the moment `now` less than a tick after its end.
/// `end_phase` is the count, modulo one tick, at the end of a block's last aperture.
pub const fn block_began(now: u32, end_phase: u32) -> u32 {
    let since_end = (now + EDGE_MODULUS - end_phase) % GapBlock::CYCLES;
    age(now, since_end + GapBlock::CYCLES)
}

/// Moves stamps into a block that began at the count `began`, oldest first: those of the numbers from `taken` to `count`, modulo
/// `RING`. Stops at the first that is later than the block, which belongs to the next. Gives the number of that, and when it
/// came, in cycles since the block began.
#[inline(always)]
pub fn take<const RING: u32>(
    edges: &mut Edges,
    began: u32,
    mut taken: u32,
    count: u32,
    stamp: impl Fn(u32) -> u16,
) -> (u32, u32) {
    let mut moved = 0;
    let mut later = u32::MAX;
    while taken != count {
        let mut since = age(u32::from(stamp(taken)), began);
        if since > GapBlock::CYCLES {
            if since <= 2 * GapBlock::CYCLES {
                later = since;
                break;
            }
            // It came before the block and was not there to be taken: an edge on its way into the ring.
            since = 0;
        }
        if let Some(place) = edges.at.get_mut(moved) {
            *place = since as u16;
            moved += 1;
        }
        taken = taken.wrapping_add(1) % RING;
    }
    edges.count = moved as u8;
    (taken, later)
}

/// Bit i is set when the gate was open during the whole aperture of conversion i of a block: by its edges, oldest first, and
/// the edge after its end, cycles since the block began. `open`: when it began. No edge is later than the block.
#[inline]
pub fn gate_mask(mut open: bool, edges: &[u16], later: u32) -> u32 {
    // What opens sets all that follows, what closes clears it: fewer instructions than a stretch at a time.
    let mut mask = if open { u32::MAX } else { 0 };
    for at in edges {
        let at = u32::from(*at);
        if open {
            mask &= !u32::MAX.wrapping_shl(ended(at));
        } else {
            mask |= u32::MAX.wrapping_shl(begun(at));
        }
        open = !open;
    }
    if open {
        mask &= !u32::MAX.wrapping_shl(ended(later));
    }
    mask & GapBlock::ALL
}

/// The first conversion that begins to sample after an edge; [`BLOCK`] when none does.
#[inline(always)]
fn begun(at: u32) -> u32 {
    const BEGIN: u32 = GapBlock::SPACING - GapBlock::APERTURE;
    // Rounded up: the conversion's number times the spacing is at least what is left.
    (at + GUARD).saturating_sub(BEGIN).div_ceil(GapBlock::SPACING)
}

/// How many conversions have sampled before an edge.
#[inline(always)]
fn ended(at: u32) -> u32 {
    (at.saturating_sub(GUARD) / GapBlock::SPACING).min(BLOCK as u32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Cycles at which conversion `i` begins and ends to sample.
    fn aperture(i: u32) -> (u32, u32) {
        (336 * i + 216, 336 * i + 336)
    }

    fn mask(open: bool, edges: &[u32]) -> u32 {
        let (inside, later): (Vec<u32>, Vec<u32>) = edges.iter().partition(|at| **at <= 8400);
        let inside: Vec<u16> = inside.into_iter().map(|at| at as u16).collect();
        gate_mask(open, &inside, later.first().copied().unwrap_or(u32::MAX))
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
        assert_eq!(mask(false, &[(begin + end) / 2]), newer_than_10);
        assert_eq!(mask(false, &[begin - GUARD + 1]), newer_than_10);
        assert_eq!(mask(false, &[begin - GUARD]), newer_than_10 | 1 << 10);
        // Closed while it sampled, then after it ended.
        assert_eq!(mask(true, &[(begin + end) / 2]), (1 << 10) - 1);
        assert_eq!(mask(true, &[end + GUARD - 1]), (1 << 10) - 1);
        assert_eq!(mask(true, &[end + GUARD]), (1 << 11) - 1);
    }

    #[test]
    fn an_off_time_between_two_apertures_costs_no_conversion() {
        let (_, end) = aperture(7);
        let (begin, _) = aperture(8);
        assert_eq!(mask(true, &[end + GUARD, begin - GUARD]), GapBlock::ALL);
    }

    #[test]
    fn a_spike_shorter_than_an_aperture_gates_nothing() {
        let (begin, end) = aperture(3);
        assert_eq!(mask(false, &[begin + 10, end - 10]), 0);
    }

    #[test]
    fn an_edge_right_after_the_block_still_falls_into_its_last_conversion() {
        assert_eq!(mask(true, &[8400 + GUARD - 1]), GapBlock::ALL >> 1);
        assert_eq!(mask(true, &[8400 + GUARD]), GapBlock::ALL);
    }

    /// Wherever the block lies in the tick.
    const PHASE: u32 = 8000;

    #[test]
    fn a_block_began_a_tick_before_its_end_wherever_the_timer_wraps() {
        for tick in 0..7 {
            for late in [0, 1, 300, 8399] {
                let now = (tick * 8400 + PHASE + late) % EDGE_MODULUS;
                let end = (tick * 8400 + PHASE) % EDGE_MODULUS;
                assert_eq!(age(end, block_began(now, PHASE)), 8400, "tick {tick}, {late} cycles late");
            }
        }
    }

    proptest! {
        /// Against the definition: sampled level by level at every cycle of every aperture.
        #[test]
        fn a_bit_is_set_exactly_when_the_gate_was_open_around_the_whole_aperture(
            open: bool, gaps in prop::collection::vec(40u32..3000, 0..30)
        ) {
            let edges: Vec<u32> = gaps.iter().scan(0, |sum, gap| { *sum += gap; Some(*sum) }).collect();
            let level_at = |at: u32| open ^ (edges.iter().filter(|&&edge| edge <= at).count() % 2 == 1);
            let got = mask(open, &edges);
            for i in 0..25 {
                let (begin, end) = aperture(i);
                let steady = !edges.iter().any(|&edge| edge + GUARD > begin && edge < end + GUARD);
                prop_assert_eq!(got >> i & 1 == 1, steady && level_at(end), "conversion {}", i);
            }
        }

        /// Every stamp is handed over once, in order, in the block in which it came, whenever the blocks are read.
        #[test]
        fn no_edge_is_lost_or_taken_twice(
            gaps in prop::collection::vec(300u32..20_000, 1..200), lates in prop::collection::vec(0u32..8000, 1..20)
        ) {
            let times: Vec<u64> = gaps.iter().scan(50_000u64, |sum, gap| { *sum += u64::from(*gap); Some(*sum) }).collect();
            const RING: u32 = 256;
            let (mut taken, mut found) = (0usize, vec![]);
            let blocks = times.last().unwrap() / 8400 + 2;
            for block in 5..blocks {
                let end = block * 8400 + u64::from(PHASE);
                let now = end + u64::from(lates[block as usize % lates.len()]);
                let came = times.iter().filter(|time| **time <= now).count();
                let began = block_began((now % u64::from(EDGE_MODULUS)) as u32, PHASE);
                // The newest of the ring.
                let stamp = |number: u32| {
                    let place = (taken..came).find(|n| *n as u32 % RING == number).unwrap();
                    (times[place] % u64::from(EDGE_MODULUS)) as u16
                };
                let mut edges = Edges::NONE;
                let (next, later) = take::<RING>(&mut edges, began, taken as u32 % RING, came as u32 % RING, stamp);
                taken += (next.wrapping_sub(taken as u32) % RING) as usize;
                found.extend(edges.times().iter().map(|at| end - 8400 + u64::from(*at)));
                let next = times[taken..came].first().map_or(u32::MAX, |time| (time - (end - 8400)) as u32);
                prop_assert_eq!(later, next);
            }
            prop_assert_eq!(&found[..], &times[..found.len()]);
            prop_assert!(found.len() + 2 >= times.iter().filter(|time| **time < (blocks - 1) * 8400).count());
        }
    }
}
