//! From a block of conversions to one sample a tick: integer sums.

use edm_hal_shim::gap::{BLOCK, GapBlock};

/// The codes that the converter is trusted with; what lies outside is clipped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct CodeRange {
    /// Lowest of them.
    pub lowest: u16,
    /// Highest of them.
    pub highest: u16,
}

/// Sum of codes, two at a time: the compiler reads them as a word.
#[inline(always)]
pub fn sum(codes: &[u16]) -> u32 {
    let (pairs, rest) = codes.as_chunks::<2>();
    let of_pairs = pairs.iter().fold(0u32, |sum, [a, b]| {
        let pair = u32::from(*a) | u32::from(*b) << 16;
        sum.wrapping_add(pair & 0xffff).wrapping_add(pair >> 16)
    });
    rest.iter().fold(of_pairs, |sum, code| sum.wrapping_add((*code).into()))
}

/// Counts and sums over the chosen conversions of a block.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Tally {
    /// Conversions chosen.
    pub count: u32,
    /// Sum of their codes.
    pub sum: u32,
    /// How many of them are clipped.
    pub clipped: u32,
}

impl Tally {
    /// Looks at the conversions whose bit in `chosen` is set (bit 0 is the oldest), run by run: a generator's pulses make few.
    #[inline]
    pub fn of(codes: &[u16; BLOCK], chosen: u32, good: CodeRange) -> Self {
        let mut left = chosen & GapBlock::ALL;
        let count = left.count_ones();
        let (lowest, range) = (u32::from(good.lowest), u32::from(good.highest.wrapping_sub(good.lowest)));
        let (mut sum, mut clipped) = (0, 0);
        while left != 0 {
            let begin = left.trailing_zeros();
            let end = begin + (!(left >> begin)).trailing_zeros();
            for code in codes.get(begin as usize..end as usize).unwrap_or(&[]) {
                let code = u32::from(*code);
                sum += code;
                clipped += u32::from(code.wrapping_sub(lowest) > range);
            }
            left &= u32::MAX << end;
        }
        Self { count, sum, clipped }
    }

    /// Sum of the chosen conversions above `zero`, codes. Exact in f32 too: 25 codes of 16 bits stay below 2^24.
    #[inline]
    pub fn above(&self, zero: u16) -> i32 {
        self.sum.wrapping_sub(self.count.wrapping_mul(u32::from(zero))) as i32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const ALL: u32 = GapBlock::ALL;
    const GOOD: CodeRange = CodeRange { lowest: 1, highest: 4094 };

    #[test]
    fn only_chosen_conversions_count() {
        let mut codes = [4095; BLOCK];
        codes[0] = 100;
        codes[24] = 301;
        let tally = Tally::of(&codes, 1 | 1 << 24, GOOD);
        assert_eq!(tally, Tally { count: 2, sum: 401, clipped: 0 });
        assert_eq!(tally.above(200), 1);
        assert_eq!(Tally::of(&codes, ALL, GOOD).clipped, 23);
    }

    #[test]
    fn a_choice_beyond_the_block_chooses_nothing() {
        assert_eq!(Tally::of(&[7; BLOCK], !ALL, GOOD), Tally::default());
    }

    #[test]
    fn codes_next_to_the_rails_are_good_and_the_rails_are_not() {
        let clipped = |code| Tally::of(&[code; BLOCK], ALL, GOOD).clipped;
        assert_eq!([0, 1, 4094, 4095, u16::MAX].map(clipped), [25, 0, 0, 25, 25]);
    }

    #[test]
    fn code_0_is_good_where_the_lowest_good_code_says_so() {
        let clipped = |code, chosen| Tally::of(&[code; BLOCK], chosen, CodeRange { lowest: 0, highest: 4094 }).clipped;
        assert_eq!([clipped(0, ALL), clipped(0, 0b111), clipped(4095, 0b111), clipped(4095, 0)], [0, 0, 3, 0]);
    }

    proptest! {
        #[test]
        fn the_sum_above_zero_is_exact(codes: [u16; BLOCK], chosen: u32, zero: u16) {
            let picked = codes.iter().enumerate().filter(|(i, _)| chosen >> i & 1 == 1);
            let exact: i64 = picked.map(|(_, &code)| i64::from(code) - i64::from(zero)).sum();
            let above = Tally::of(&codes, chosen, GOOD).above(zero);
            prop_assert_eq!(i64::from(above), exact);
            prop_assert_eq!(above as f32 as i64, exact);
        }

        #[test]
        fn every_chosen_code_out_of_range_is_clipped_and_no_other(
            codes in prop::array::uniform25(prop_oneof![5 => 0u16..4096, 1 => any::<u16>()]),
            chosen: u32, lowest in 0u16..100, highest in 3900u16..4096,
        ) {
            let picked = codes.iter().enumerate().filter(|(i, _)| chosen >> i & 1 == 1);
            let outside = picked.filter(|(_, code)| !(lowest..=highest).contains(code)).count();
            prop_assert_eq!(Tally::of(&codes, chosen, CodeRange { lowest, highest }).clipped as usize, outside);
        }
    }
}
