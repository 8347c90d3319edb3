//! Gated average: the gap voltage during on-time, carried through off-time.
//!
//! Roberts (section 6.5.1) proposes to sample only while the generator's switch is on and to hold through off-time. What
//! is held decides whether the average is right. Every pulse starts at open circuit, and every pulse that ignites ends at
//! the burn voltage: to hold the last conversions, or to count a block with few of them like a full one, shifts the
//! average by about 2 V either way at 80 % on-time and adds a fifth to its scatter (simulated). Held here is the mean of
//! the on-time that has just ended, and each off-time conversion of a block counts as one at that mean. A block with few
//! gated conversions then says little, wherever the edges of the pulses fall.

use crate::dsp::decimate::Tally;
use edm_hal_shim::gap::{BLOCK, GapBlock};

/// 1 / conversions in a block.
pub(super) const PER_BLOCK: f32 = 1.0 / BLOCK as f32;

/// Conversions after which an on-time that does not end is taken for ended, 20 ms. Keeps the sums within 32 bits.
const LONGEST: u32 = 10_000;

/// Values are codes above zero volts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(super) struct Gated {
    /// Sum over the on-time in progress.
    sum: i32,
    /// Conversions in it.
    count: u32,
    /// Mean of the last complete on-time.
    held: Option<f32>,
}

impl Gated {
    /// Takes the gated conversions of a block: their `tally`, the `gate` they were chosen by, and their sum above zero
    /// volts. Gives the average of the block, or `None` before the first on-time.
    #[inline]
    pub fn block(&mut self, tally: &Tally, gate: u32, above: i32) -> Option<f32> {
        let began_off = gate & 1 == 0;
        // An on-time ends either between the blocks or, when this one began inside it, at the first gap in its gate.
        if began_off {
            self.end();
        }
        self.sum = self.sum.wrapping_add(above);
        self.count = self.count.wrapping_add(tally.count);
        let whole = gate & GapBlock::ALL == GapBlock::ALL;
        if !began_off && !whole || self.count >= LONGEST {
            self.end();
        }
        if whole {
            return Some(above as f32 * PER_BLOCK);
        }
        if self.held.is_none() && tally.count > 0 {
            self.held = Some(above as f32 / tally.count as f32);
        }
        let off = BLOCK as f32 - tally.count as f32;
        self.held.map(|held| (above as f32 + off * held) * PER_BLOCK)
    }

    fn end(&mut self) {
        if self.count > 0 {
            self.held = Some(self.sum as f32 / self.count as f32);
            self.sum = 0;
            self.count = 0;
        }
    }

    /// Goes on in another unit: what is held is multiplied by `ratio`, the on-time in progress is dropped.
    pub fn scale(&mut self, ratio: f32) {
        *self = Self { held: self.held.map(|held| held * ratio), ..Self::default() };
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::dsp::decimate::CodeRange;
    use std::vec::Vec;

    const GOOD: CodeRange = CodeRange { lowest: 0, highest: 4095 };

    /// Averages of blocks cut from a long record of codes, `None` for off-time; zero volts is code 0.
    fn averages(record: &[Option<u16>]) -> Vec<Option<f32>> {
        let mut gated = Gated::default();
        let average = |chunk: &[Option<u16>]| {
            let mut codes = [0; BLOCK];
            let mut gate = 0;
            for (i, code) in chunk.iter().enumerate() {
                codes[i] = code.unwrap_or(0);
                gate |= u32::from(code.is_some()) << i;
            }
            let tally = Tally::of(&codes, gate, GOOD);
            gated.block(&tally, gate, tally.above(0))
        };
        record.chunks_exact(BLOCK).map(average).collect()
    }

    /// Pulses of `on` conversions, the first half open at 1000, the second burning at 400, then `off` conversions.
    fn pulses(on: usize, off: usize, shift: usize, length: usize) -> Vec<Option<u16>> {
        let at = |phase: usize| (phase < on).then_some(if phase < on / 2 { 1000 } else { 400 });
        (0..length).map(|i| at((i + shift) % (on + off))).collect()
    }

    #[test]
    fn off_time_is_held_at_the_mean_of_the_on_time_before_it_and_not_at_its_end() {
        let mut record = pulses(50, 200, 0, 250);
        record.extend(pulses(50, 200, 0, 50));
        let expected = [1000.0, 400.0].into_iter().chain([700.0; 8]).chain([1000.0, 400.0]);
        assert!(averages(&record).into_iter().eq(expected.map(Some)));
    }

    #[test]
    fn the_mean_does_not_depend_on_how_pulses_and_blocks_fall() {
        // 5 kHz at 80 % and at 50 %, 1 kHz, 100 kHz with 2 conversions of on-time, and one that drifts past the blocks.
        for (on, off) in [(80, 20), (50, 50), (400, 100), (2, 3), (4, 1), (62, 41)] {
            for shift in 0..on + off {
                let averages = averages(&pulses(on, off, shift, 100_000));
                let settled: Vec<f32> = averages.into_iter().flatten().skip(200).collect();
                let mean = settled.iter().sum::<f32>() / settled.len() as f32;
                assert!((mean - 700.0).abs() < 14.0, "{on} on, {off} off, shifted by {shift}: {mean}");
            }
        }
    }

    #[test]
    fn nothing_is_known_before_the_first_on_time() {
        let mut record = std::vec![None; 2 * BLOCK];
        record.extend([None; 20]);
        record.extend([Some(900); 5]);
        assert_eq!(averages(&record), [None, None, Some(900.0)]);
    }

    #[test]
    fn a_gate_that_never_closes_keeps_its_sums_bounded() {
        let mut gated = Gated::default();
        let codes = [u16::MAX; BLOCK];
        let tally = Tally::of(&codes, GapBlock::ALL, GOOD);
        for _ in 0..100_000 {
            assert_eq!(gated.block(&tally, GapBlock::ALL, tally.above(0)), Some(65_535.0));
            assert!(gated.count < LONGEST && gated.sum < i32::MAX / 2);
        }
        let none = Tally::default();
        assert_eq!(gated.block(&none, 0, 0), Some(65_535.0));
    }
}
