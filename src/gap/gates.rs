//! Shorts by gates: pulses in a row in which the gap never passed 20 % of its open-circuit voltage.
//!
//! A pulse is *low* when its gate has closed and nothing showed a voltage: no rise of the comparator for 20 %, no edge of the one for 70 %, no
//! conversion above `gap.short_v`. It takes no conversion for that, so a pulse of any length and any pause count. The gap is short after n
//! low pulses in a row. A healthy gap has low pulses too, with a share p that is learned ([`MEMORY`]), and n is the least for which
//! p^n < 2^-[`HOUR`]: one false short in an hour at the most, at any rate (independent pulses, assumed).
//!
//! What belongs to which pulse is known by the block: where one of a block showed a voltage, all of the block did; low pulses of a block are
//! one, or a line that rings would be a short.
//!
//! A comparator that stood above through [`STANDS`] blocks with pulses, or below through as many in which a voltage was seen otherwise, is
//! not believed until it moves. Then pulses of which something was converted count, and no others.

use edm_hal_shim::gap::GapBlock;

/// Blocks with pulses that the share of low ones remembers, 2^10.
const MEMORY: u32 = 10;
/// Blocks of an hour, 2^27.
const HOUR: u32 = 27;
/// One, as a share.
const ONE: u32 = 1 << 16;
/// Most low pulses that are wanted for a short.
const MOST: u32 = 255;
/// Blocks, 10 ms.
const STANDS: u8 = 200;

/// What the pulses of late have shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(super) struct Gates {
    /// Low pulses in a row, and how many are a short.
    run: u32,
    needed: u32,
    /// Share of low pulses, of [`ONE`].
    share: u32,
    /// The pulse whose gate is open has shown a voltage.
    shown: bool,
    /// Blocks with pulses since the comparator was below or rose; blocks in which it alone saw no voltage since it did.
    above: u8,
    below: u8,
}

impl Gates {
    /// Nothing seen yet; so many low pulses are a short in a gap that has none.
    pub const fn new(least: u32) -> Gates {
        Gates { run: 0, needed: least, share: 0, shown: false, above: STANDS, below: 0 }
    }

    /// Takes a block, and whether the conversions of its on-time are as high as no short; `None`: there are none. Whether the gap is short;
    /// `None`: the block does not say.
    #[inline(always)]
    pub fn block(&mut self, block: &GapBlock, converted: Option<bool>) -> Option<bool> {
        let edges = block.gate_edges.count;
        if edges == 0 && !block.gate_was_open {
            return None;
        }
        let open = block.gate_was_open ^ (edges & 1 == 1);
        let rose = block.low_rises > 0;
        let seen = converted == Some(true) || block.high_edges.count > 0;
        self.above = if rose | !block.above_low { 0 } else { self.above.saturating_add(1) };
        self.below = if rose | block.above_low { 0 } else { self.below.saturating_add(seen.into()) };
        let believed = self.above < STANDS && self.below < STANDS;
        let closed = edges > 1 || edges == 1 && block.gate_was_open;
        if seen | (believed & (rose | open & block.above_low)) {
            self.shown = open;
            self.learn(closed.into(), 0);
            self.run = 0;
            return Some(false);
        }
        // The first to close may have shown it in a block before.
        let first = self.shown && block.gate_was_open && closed;
        let low = !first && closed && (believed || converted.is_some());
        if first {
            self.run = 0;
        }
        self.shown &= edges == 0;
        self.learn(first.into(), low.into());
        self.run = self.run.saturating_add(low.into());
        (self.run >= self.needed).then_some(true)
    }

    /// A pulse has shown a voltage, or was low. Those of a short are not those of a healthy gap.
    #[inline(always)]
    fn learn(&mut self, shown: u32, low: u32) {
        if self.run < self.needed {
            let forgotten = self.share.saturating_mul(shown.wrapping_add(low)) >> MEMORY;
            self.share = self.share.saturating_sub(forgotten).saturating_add(low.wrapping_mul(ONE >> MEMORY)).min(ONE);
        }
    }

    /// Says anew how many low pulses are a short: at least so many. Now and then.
    pub fn judge(&mut self, least: u32) {
        // Logarithm to the base 2 in sixteenths, straight between powers of 2, and above the true one by up to an eighth.
        let share = self.share.max(1);
        let whole = share.ilog2();
        let part = (share << (31 - whole) >> 27) & 15;
        let bits = (16 * 16u32).saturating_sub(16 * whole + part + 2).max(1);
        self.needed = (16 * HOUR).div_ceil(bits).clamp(least, MOST.max(least));
    }

    /// Low pulses in a row that are a short.
    #[cfg(test)]
    fn needed(&self) -> u32 {
        self.needed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FIVE: u32 = 5;

    /// A block with so many pulses, all within it.
    fn pulses(count: u8, rises: u8) -> GapBlock {
        let mut block = GapBlock { low_rises: rises, ..GapBlock::EMPTY };
        (0..2 * u16::from(count)).for_each(|n| assert!(block.gate_edges.push(200 * n + 100)));
        block
    }

    /// One that has seen its comparator move.
    fn seeing() -> Gates {
        let mut gates = Gates::new(FIVE);
        assert_eq!(gates.block(&pulses(1, 1), None), Some(false));
        gates
    }

    #[test]
    fn five_low_pulses_in_a_row_are_a_short_without_a_conversion_and_however_far_apart() {
        for apart in [0, 1, 50] {
            let mut gates = seeing();
            for n in 1..=20 {
                assert_eq!(gates.block(&pulses(1, 0), None), (n >= 5).then_some(true), "{n}");
                (0..apart).for_each(|_| assert_eq!(gates.block(&GapBlock::EMPTY, None), None));
            }
            assert_eq!(gates.block(&pulses(1, 1), None), Some(false));
            assert_eq!(gates.block(&pulses(1, 0), None), None);
        }
    }

    #[test]
    fn a_line_that_rings_for_a_block_or_two_is_no_short() {
        let mut gates = seeing();
        let mut block = GapBlock::EMPTY;
        (0..32).for_each(|n| assert!(block.gate_edges.push(84 * n)));
        assert_eq!([(); 4].map(|()| gates.block(&block, None)), [None; 4], "a block is one pulse");
    }

    #[test]
    fn a_pulse_that_showed_its_voltage_blocks_ago_is_not_low_when_it_closes() {
        let edge = |open, at: &[u16], rises, above| {
            let mut block = GapBlock { gate_was_open: open, low_rises: rises, above_low: above, ..GapBlock::EMPTY };
            at.iter().for_each(|at| assert!(block.gate_edges.push(*at)));
            block
        };
        let mut gates = seeing();
        for _ in 0..100 {
            assert_eq!(gates.block(&edge(false, &[4000], 1, true), None), Some(false));
            // It has ignited, and burns below the threshold.
            assert_eq!(gates.block(&edge(true, &[], 0, false), None), None);
            assert_eq!(gates.block(&edge(true, &[3000], 0, false), None), None);
            assert_eq!(gates.run, 0);
        }
        // The same without the rise.
        for n in 1..=5 {
            assert_eq!(gates.block(&edge(false, &[4000], 0, false), None), None);
            assert_eq!(gates.block(&edge(true, &[3000], 0, false), None), (n == 5).then_some(true));
        }
    }

    #[test]
    fn a_voltage_that_anything_shows_ends_the_run() {
        let high = {
            let mut block = pulses(1, 0);
            assert!(block.high_edges.push(300) && block.high_edges.push(350));
            block
        };
        for (block, converted) in [(pulses(1, 1), None), (high, None), (pulses(1, 0), Some(true))] {
            let mut gates = seeing();
            (0..4).for_each(|_| assert_eq!(gates.block(&pulses(1, 0), Some(false)), None));
            assert_eq!(gates.block(&block, converted), Some(false));
            assert_eq!(gates.run, 0);
        }
    }

    #[test]
    fn a_gap_with_many_low_pulses_wants_a_longer_run_and_has_no_false_short() {
        for (percent, needed) in [(0, 5..=5), (3, 5..=7), (30, 14..=20), (70, 48..=75)] {
            let (mut gates, mut chance, mut shorts, mut late) = (seeing(), 1u64, 0, 0);
            for n in 0..400_000 {
                chance = chance.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                let low = (chance >> 33) % 100 < percent;
                let short = gates.block(&pulses(1, u8::from(!low)), None) == Some(true);
                shorts += u32::from(short && n < 20_000);
                late += u32::from(short && n >= 20_000);
                if n % 5 == 0 {
                    gates.judge(FIVE);
                }
            }
            assert!(needed.contains(&gates.needed()), "{percent} %: {}", gates.needed());
            assert_eq!(late, 0, "{percent} %, {shorts} while it was learned");
        }
    }

    #[test]
    fn a_comparator_that_stands_is_not_believed_and_conversions_decide_until_it_moves() {
        // Stuck above: a short shows no rise, but a level.
        let above = GapBlock { above_low: true, gate_was_open: true, ..GapBlock::EMPTY };
        let mut gates = seeing();
        let (mut found, mut closing) = (None, pulses(1, 0));
        closing.above_low = true;
        for n in 0..1000 {
            let short =
                gates.block(&above, Some(false)) == Some(true) || gates.block(&closing, Some(false)) == Some(true);
            found = found.or(short.then_some(n));
        }
        assert!(found.is_some_and(|n| n < 110), "{found:?}");
        // Cut: the conversions show what it does not.
        let mut gates = seeing();
        (0..300).for_each(|_| assert_eq!(gates.block(&pulses(1, 0), Some(true)), Some(false)));
        (0..300).for_each(|_| assert_eq!(gates.block(&pulses(1, 0), None), None, "nothing says what these were"));
        (1..=5).for_each(|n| assert_eq!(gates.block(&pulses(1, 0), Some(false)), (n == 5).then_some(true)));
        assert_eq!(gates.block(&pulses(1, 1), Some(false)), Some(false), "it moves");
    }
}
