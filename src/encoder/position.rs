//! Position in signed 64-bit counts, from a raw count that wraps.
//!
//! Only differences of raw counts are used, so a wrap of the counter is a step like any other; 64 bits last 58 000 years at
//! 5 Mcount/s. \[R\] section 6.7.3: an unsigned count that fell below zero became a huge positive one and drove the actuator
//! to its stop.

use crate::units::Fixed;
use edm_hal_shim::encoder::RawCount;

/// Where the axis is, counts, positive toward the work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Position {
    raw: u32,
    counts: i64,
    fixed: Fixed,
}

impl Position {
    /// Starts at the first reading: a counter that started at 0 and has since gone three back is at -3.
    pub fn new(first: RawCount) -> Self {
        let counts = i64::from(first.count as i32);
        Position { raw: first.count, counts, fixed: Fixed::whole(counts) }
    }

    /// Takes a reading, at most 2^31 - 1 counts from the one before, and returns the position.
    #[inline]
    pub fn update(&mut self, reading: RawCount) -> i64 {
        self.set_position(self.at(reading.count));
        self.raw = reading.count;
        self.counts
    }

    /// Position at the newest reading.
    pub fn counts(&self) -> i64 {
        self.counts
    }

    /// The same as a coordinate, which saturates.
    #[inline]
    pub fn fixed(&self) -> Fixed {
        self.fixed
    }

    /// Position at a raw count less than 2^31 from the newest reading: where an index mark is.
    pub fn at(&self, raw: u32) -> i64 {
        self.counts.saturating_add(i64::from(raw.wrapping_sub(self.raw) as i32))
    }

    /// Says where the axis is now, for homing. The raw count continues as before, so nothing that is made of differences, such
    /// as the velocity, sees a step.
    pub fn set_position(&mut self, counts: i64) {
        self.counts = counts;
        self.fixed = Fixed::whole(counts);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reading(count: u32) -> RawCount {
        RawCount { count, ..RawCount::default() }
    }

    #[test]
    fn one_count_below_zero_is_minus_one_and_not_four_thousand_million() {
        let mut position = Position::new(reading(0));
        assert_eq!(position.update(reading(u32::MAX)), -1);
        assert_eq!(position.update(reading(0)), 0);
    }

    #[test]
    fn it_starts_where_the_counter_is() {
        assert_eq!(Position::new(reading(5)).counts(), 5);
        assert_eq!(Position::new(reading(5u32.wrapping_neg())).counts(), -5);
    }

    #[test]
    fn it_goes_through_every_wrap_of_the_counter_both_ways() {
        let mut position = Position::new(reading(0));
        let mut count = 0u32;
        let step = 0x7FFF_FFFF;
        for trip in 1..=1000 {
            count = count.wrapping_add(step);
            assert_eq!(position.update(reading(count)), trip * i64::from(step));
        }
        for trip in (-1000..1000).rev() {
            count = count.wrapping_sub(step);
            assert_eq!(position.update(reading(count)), trip * i64::from(step));
        }
    }

    #[test]
    fn homing_moves_the_scale_and_later_counts_follow_it() {
        let mut position = Position::new(reading(100));
        position.set_position(-7_000_000_000);
        assert_eq!(position.counts(), -7_000_000_000);
        assert_eq!(position.update(reading(103)), -6_999_999_997);
        assert_eq!(position.at(98), -7_000_000_002);
    }

    #[test]
    fn at_the_end_of_its_range_it_stops_instead_of_wrapping() {
        let mut position = Position::new(reading(0));
        position.set_position(i64::MAX - 1);
        assert_eq!(position.update(reading(5)), i64::MAX);
    }
}
