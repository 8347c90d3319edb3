//! A timer in encoder mode as an edge counter.
//!
//! The hardware counts by itself and keeps up with any speed, but does not time its edges: an edge gets the time of the
//! first reading that sees it, up to one reading late.

use edm_hal_shim::clock::Clock;
use edm_hal_shim::encoder::{EdgeCounter, EncoderTimer, RawCount};

/// Extends a counter of 16 or 32 bits to a raw count.
///
/// Read it at least once per half turn of the counter: a 16-bit one at 5 Mcount/s every 6.5 ms.
#[derive(Clone, Debug)]
pub struct TimerCount<T, C> {
    timer: T,
    clock: C,
    seen: u32,
    count: u32,
    last_edge: u32,
    toward_work: bool,
}

impl<T: EncoderTimer, C: Clock> TimerCount<T, C> {
    /// Left-justified, every width wraps at 32 bits.
    const SHIFT: u32 = {
        assert!(T::BITS == 16 || T::BITS == 32, "an encoder timer has 16 or 32 bits");
        32 - T::BITS
    };

    /// Starts at count 0, wherever the counter is.
    pub fn new(timer: T, clock: C) -> Self {
        let seen = timer.counter() << Self::SHIFT;
        let last_edge = clock.now();
        TimerCount { timer, clock, seen, count: 0, last_edge, toward_work: false }
    }
}

impl<T: EncoderTimer, C: Clock> EdgeCounter for TimerCount<T, C> {
    fn read(&mut self) -> RawCount {
        let seen = self.timer.counter() << Self::SHIFT;
        let now = self.clock.now();
        let moved = seen.wrapping_sub(self.seen) as i32 >> Self::SHIFT;
        if moved != 0 {
            self.seen = seen;
            self.count = self.count.wrapping_add_signed(moved);
            self.last_edge = now;
            self.toward_work = moved > 0;
        }
        RawCount { count: self.count, last_edge: self.last_edge, toward_work: self.toward_work, now }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::cell::Cell;

    struct Register<'a, const BITS: u32>(&'a Cell<u32>);

    impl<const BITS: u32> EncoderTimer for Register<'_, BITS> {
        const BITS: u32 = BITS;
        fn counter(&self) -> u32 {
            self.0.get()
        }
    }

    struct Ticks<'a>(&'a Cell<u32>);

    impl Clock for Ticks<'_> {
        const HZ: u32 = 168_000_000;
        fn now(&self) -> u32 {
            self.0.get()
        }
    }

    #[test]
    fn a_16_bit_counter_wraps_both_ways_and_the_count_does_not_notice() {
        let (register, clock) = (Cell::new(0xFFFE), Cell::new(0));
        let mut counter = TimerCount::new(Register::<16>(&register), Ticks(&clock));
        register.set(0x0001);
        assert_eq!(counter.read().count, 3);
        register.set(0xFFFC);
        assert_eq!(counter.read().count, 2u32.wrapping_neg());
        // Half a turn is the most one reading may bridge.
        register.set(0xFFFC_u32.wrapping_add(0x7FFF) & 0xFFFF);
        assert_eq!(counter.read().count, 0x7FFD);
    }

    #[test]
    fn a_32_bit_counter_wraps_both_ways_and_the_count_does_not_notice() {
        let (register, clock) = (Cell::new(u32::MAX), Cell::new(0));
        let mut counter = TimerCount::new(Register::<32>(&register), Ticks(&clock));
        register.set(0x7FFF_FFFE);
        assert_eq!(counter.read().count, 0x7FFF_FFFF);
        register.set(u32::MAX - 1);
        assert_eq!(counter.read().count, u32::MAX);
    }

    #[test]
    fn an_edge_has_the_time_of_the_first_reading_that_sees_it() {
        let (register, clock) = (Cell::new(0), Cell::new(100));
        let mut counter = TimerCount::new(Register::<16>(&register), Ticks(&clock));
        clock.set(200);
        assert_eq!(counter.read(), RawCount { count: 0, last_edge: 100, toward_work: false, now: 200 });
        register.set(1);
        clock.set(300);
        assert_eq!(counter.read(), RawCount { count: 1, last_edge: 300, toward_work: true, now: 300 });
        clock.set(400);
        assert_eq!(counter.read(), RawCount { count: 1, last_edge: 300, toward_work: true, now: 400 });
        register.set(0);
        clock.set(500);
        assert_eq!(counter.read(), RawCount { count: 0, last_edge: 500, toward_work: false, now: 500 });
    }
}
