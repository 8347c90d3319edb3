//! From a block of conversions to one sample a tick: integer sums, one multiplication.

use core::ops::RangeInclusive;
use edm_hal_shim::gap::BLOCK;

/// 1/n for every number of conversions that a block can hold; 0 for none.
const RECIPROCAL: [f32; BLOCK + 1] = {
    let mut table = [0.0; BLOCK + 1];
    let mut n = 1;
    while n <= BLOCK {
        table[n] = 1.0 / n as f32;
        n += 1;
    }
    table
};

/// Sums over the chosen conversions of a block.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Tally {
    /// Conversions chosen.
    pub count: u32,
    /// Sum of their codes.
    pub sum: u32,
    /// How many of them lie outside the codes that the converter is trusted with.
    pub clipped: u32,
}

impl Tally {
    /// Counts the conversions whose bit in `chosen` is set (bit 0 is the oldest).
    #[inline]
    pub fn of(codes: &[u16; BLOCK], chosen: u32, good: &RangeInclusive<u16>) -> Self {
        let mut tally = Self::default();
        for (i, &code) in codes.iter().enumerate() {
            let bit = (chosen >> i) & 1;
            tally.count += bit;
            tally.sum += bit * u32::from(code);
            tally.clipped += bit & u32::from(!good.contains(&code));
        }
        tally
    }

    /// Mean of the chosen conversions above `zero`, codes; 0 when none was chosen.
    #[inline]
    pub fn mean_above(&self, zero: u16) -> f32 {
        // 25 codes of 16 bits stay below 2^24: the difference is exact in f32, and two roundings remain.
        let above = self.sum.wrapping_sub(self.count.wrapping_mul(u32::from(zero))) as i32;
        above as f32 * RECIPROCAL.get(self.count as usize).copied().unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const ALL: u32 = (1 << BLOCK) - 1;
    const GOOD: RangeInclusive<u16> = 1..=4094;

    #[test]
    fn only_chosen_conversions_count() {
        let mut codes = [4095; BLOCK];
        codes[0] = 100;
        codes[24] = 301;
        let tally = Tally::of(&codes, 1 | 1 << 24, &GOOD);
        assert_eq!(tally, Tally { count: 2, sum: 401, clipped: 0 });
        assert_eq!(tally.mean_above(200), 0.5);
        assert_eq!(Tally::of(&codes, ALL, &GOOD).clipped, 23);
    }

    #[test]
    fn a_choice_beyond_the_block_chooses_nothing() {
        let tally = Tally::of(&[7; BLOCK], !ALL, &GOOD);
        assert_eq!(tally, Tally::default());
        assert_eq!(tally.mean_above(200), 0.0);
    }

    #[test]
    fn codes_next_to_the_rails_are_good_and_the_rails_are_not() {
        let clipped = |code| Tally::of(&[code; BLOCK], ALL, &GOOD).clipped;
        assert_eq!([0, 1, 4094, 4095, u16::MAX].map(clipped), [25, 0, 0, 25, 25]);
    }

    proptest! {
        #[test]
        fn the_mean_is_right_to_two_roundings(codes: [u16; BLOCK], chosen: u32, zero: u16) {
            let tally = Tally::of(&codes, chosen, &GOOD);
            let picked = || codes.iter().enumerate().filter(|(i, _)| chosen >> i & 1 == 1).map(|(_, &c)| i64::from(c));
            let n = picked().count();
            prop_assume!(n > 0);
            let exact = picked().map(|c| c - i64::from(zero)).sum::<i64>() as f64 / n as f64;
            prop_assert!((f64::from(tally.mean_above(zero)) - exact).abs() <= exact.abs() * f64::from(f32::EPSILON));
        }
    }
}
