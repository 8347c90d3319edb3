//! Prescaler and reload of the timers.
//!
//! The counter counts from 0 to ARR at CK_PSC / (PSC + 1), so its update rate is CK_PSC / ((PSC + 1) (ARR + 1))
//! (RM0090 18.3.1 and 18.3.2 for TIM2 to TIM5, 17.3.1 and 17.3.2 for TIM1 and TIM8).

use super::Refused;

/// Largest reload of a 16-bit timer.
pub const MAX_RELOAD_16: u32 = 0xFFFF;
/// Largest reload of the 32-bit timers TIM2 and TIM5.
pub const MAX_RELOAD_32: u32 = 0xFFFF_FFFF;

/// Register values that divide a timer's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Divider {
    /// TIMx_PSC.
    pub prescaler: u16,
    /// TIMx_ARR.
    pub reload: u32,
}

impl Divider {
    /// Counts in a period: the resolution of a PWM.
    pub const fn steps(self) -> u64 {
        self.reload as u64 + 1
    }

    /// Update rate from this clock, Hz, rounded down.
    pub const fn rate(self, clock_hz: u32) -> u32 {
        (clock_hz as u64 / ((self.prescaler as u64 + 1) * self.steps())) as u32
    }
}

/// Clock of the timers on a bus: the bus clock, or twice that when the bus is slower than the core (RM0090 7.2).
pub const fn timer_clock(hclk_hz: u32, bus_hz: u32) -> u32 {
    if bus_hz == hclk_hz { bus_hz } else { 2 * bus_hz }
}

/// Divides `clock_hz` to exactly `rate_hz` with the smallest prescaler that fits, which gives the finest resolution.
///
/// `max_reload` is [`MAX_RELOAD_16`] or [`MAX_RELOAD_32`]. A reload of 0 stops the counter, so a rate above half the clock
/// is refused.
pub const fn divide(clock_hz: u32, rate_hz: u32, max_reload: u32) -> Result<Divider, Refused> {
    let refused = Err(Refused::TimerRate { clock_hz, rate_hz });
    if rate_hz == 0 || clock_hz == 0 || !clock_hz.is_multiple_of(rate_hz) {
        return refused;
    }
    let cycles = (clock_hz / rate_hz) as u64;
    let mut division = cycles.div_ceil(max_reload as u64 + 1);
    while division <= 0x1_0000 && 2 * division <= cycles {
        if cycles.is_multiple_of(division) {
            return Ok(Divider { prescaler: (division - 1) as u16, reload: (cycles / division - 1) as u32 });
        }
        division += 1;
    }
    refused
}

/// Divides `clock_hz` to a PWM of exactly `rate_hz` with at least `least` steps in a period.
///
/// The reload stays below 0xFFFF: a compare value of ARR + 1, always on, must fit its 16 bits.
pub const fn pwm(clock_hz: u32, rate_hz: u32, least: u32) -> Result<Divider, Refused> {
    match divide(clock_hz, rate_hz, MAX_RELOAD_16 - 1) {
        Ok(divider) if divider.steps() < least as u64 => {
            Err(Refused::PwmSteps { steps: divider.steps() as u32, least })
        }
        result => result,
    }
}

/// Conversions in a tick, when a trigger of `trigger_hz` and a tick of `tick_hz` come from the same clock.
pub const fn conversions_per_tick(trigger_hz: u32, tick_hz: u32) -> Result<usize, Refused> {
    if tick_hz == 0 || trigger_hz == 0 || !trigger_hz.is_multiple_of(tick_hz) {
        return Err(Refused::TickRate { trigger_hz, tick_hz });
    }
    Ok((trigger_hz / tick_hz) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gap::BLOCK;
    use proptest::prelude::*;

    #[test]
    fn the_clocks_of_the_head() {
        let (hclk, apb1, apb2) = (168_000_000, 42_000_000, 84_000_000);
        assert_eq!(timer_clock(hclk, apb1), 84_000_000);
        assert_eq!(timer_clock(hclk, apb2), 168_000_000);
        assert_eq!(timer_clock(16_000_000, 16_000_000), 16_000_000);
    }

    #[test]
    fn tick_trigger_and_pwm_of_the_head() {
        let divider = |prescaler, reload| Ok(Divider { prescaler, reload });
        assert_eq!(divide(84_000_000, 20_000, MAX_RELOAD_16), divider(0, 4199));
        assert_eq!(divide(84_000_000, 500_000, MAX_RELOAD_16), divider(0, 167));
        assert_eq!(divide(84_000_000, 1000, MAX_RELOAD_16), divider(1, 41_999));
        assert_eq!(divide(84_000_000, 1000, MAX_RELOAD_32), divider(0, 83_999));
        assert_eq!(pwm(168_000_000, 20_000, 8000), divider(0, 8399));
        assert_eq!(conversions_per_tick(500_000, 20_000), Ok(BLOCK));
    }

    #[test]
    fn a_rate_that_does_not_divide_is_refused() {
        let refused = |clock_hz, rate_hz| Err(Refused::TimerRate { clock_hz, rate_hz });
        assert_eq!(divide(84_000_000, 22_000, MAX_RELOAD_16), refused(84_000_000, 22_000));
        assert_eq!(divide(84_000_000, 0, MAX_RELOAD_16), refused(84_000_000, 0));
        assert_eq!(divide(0, 1, MAX_RELOAD_16), refused(0, 1));
        // A prime above 16 bits divides no further: one step more than the timer counts.
        assert_eq!(divide(65_537, 1, MAX_RELOAD_16), refused(65_537, 1));
        assert_eq!(divide(65_537, 1, MAX_RELOAD_32), Ok(Divider { prescaler: 0, reload: 65_536 }));
        assert_eq!(
            conversions_per_tick(500_000, 30_000),
            Err(Refused::TickRate { trigger_hz: 500_000, tick_hz: 30_000 })
        );
        assert!(conversions_per_tick(500_000, 0).is_err() && conversions_per_tick(0, 20_000).is_err());
    }

    #[test]
    fn the_fastest_and_the_slowest_rate() {
        assert_eq!(divide(84_000_000, 42_000_000, MAX_RELOAD_16), Ok(Divider { prescaler: 0, reload: 1 }));
        assert!(divide(84_000_000, 84_000_000, MAX_RELOAD_16).is_err());
        assert_eq!(divide(1 << 31, 1, MAX_RELOAD_16), Ok(Divider { prescaler: 0x7FFF, reload: 0xFFFF }));
        assert_eq!(divide(0xFFFF_0000, 1, MAX_RELOAD_16), Ok(Divider { prescaler: 0xFFFE, reload: 0xFFFF }));
    }

    #[test]
    fn a_pwm_too_coarse_is_refused() {
        assert!(pwm(168_000_000, 20_000, 8400).is_ok());
        assert_eq!(pwm(168_000_000, 20_000, 8401), Err(Refused::PwmSteps { steps: 8400, least: 8401 }));
        // Always on must be expressible: 65 535 steps at most.
        assert_eq!(pwm(65_535, 1, 2), Ok(Divider { prescaler: 0, reload: 65_534 }));
        assert_eq!(pwm(65_536, 1, 2), Ok(Divider { prescaler: 1, reload: 32_767 }));
    }

    proptest! {
        #[test]
        fn a_divider_is_exact_and_its_prescaler_the_smallest(rate in 1u32..100_000, cycles in 1u32..40_000) {
            let clock = rate * cycles;
            match divide(clock, rate, MAX_RELOAD_16) {
                Ok(d) => {
                    prop_assert_eq!((u64::from(d.prescaler) + 1) * d.steps(), u64::from(cycles));
                    prop_assert_eq!(d.rate(clock), rate);
                    prop_assert_eq!(d.prescaler, 0);
                }
                Err(_) => prop_assert_eq!(cycles, 1),
            }
        }

        #[test]
        fn a_long_period_takes_the_smallest_prescaler_that_divides(cycles in 65_537u32..) {
            let by_search = (2..=0x1_0000).find(|p| cycles % p == 0 && cycles / p <= 0x1_0000 && cycles / p >= 2);
            let divider = divide(cycles, 1, MAX_RELOAD_16).ok();
            prop_assert_eq!(divider.map(|d| u32::from(d.prescaler) + 1), by_search);
        }
    }
}
