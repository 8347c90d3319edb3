//! Register values computed from clocks: exact, or refused.
//!
//! Everything here is `const` arithmetic without hardware. A board asks through [`must!`](crate::must), and a clock tree
//! that cannot give the rate does not compile; a rate that a person sets asks at run time and gets [`Refused`].
//! Formulas are those of RM0090 (the reference manual of the STM32F405/407); each function names its section.

pub mod adc;
pub mod can;
pub mod timer;

use core::fmt;

/// Why a value cannot be had.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Refused {
    /// A clock of 0 Hz.
    NoClock,
    /// No whole number of time quanta makes this bit rate.
    CanBitRate {
        /// Clock of the controller, Hz.
        clock_hz: u32,
        /// Bit rate asked for, bit/s.
        bit_rate: u32,
    },
    /// The bit rate can be had, but not with a sample point between 85 % and 90 %.
    CanSamplePoint {
        /// Clock of the controller, Hz.
        clock_hz: u32,
        /// Bit rate asked for, bit/s.
        bit_rate: u32,
    },
    /// The timer cannot make this rate exactly.
    TimerRate {
        /// Clock of the timer, Hz.
        clock_hz: u32,
        /// Rate asked for, Hz.
        rate_hz: u32,
    },
    /// The PWM has too few steps in a period.
    PwmSteps {
        /// Steps in a period.
        steps: u32,
        /// Steps asked for.
        least: u32,
    },
    /// The trigger rate is not a whole multiple of the tick rate.
    TickRate {
        /// Rate of the conversions, Hz.
        trigger_hz: u32,
        /// Rate of the tick, Hz.
        tick_hz: u32,
    },
    /// No prescaler brings the converter's clock between 0.6 and 36 MHz.
    AdcClock {
        /// Clock of the bus, Hz.
        apb2_hz: u32,
    },
    /// The converter cannot settle from this source and convert within the trigger period.
    AdcRate {
        /// Resistance of the source, ohm.
        source_ohm: u32,
        /// Rate asked for, Hz.
        trigger_hz: u32,
    },
    /// The threshold lies outside the converter's range, or where it can never be crossed.
    Threshold {
        /// Threshold asked for, mV at the input of the divider.
        mv: i32,
    },
    /// The blanking time does not fit the timer.
    Blanking {
        /// Ticks needed.
        ticks: u64,
        /// Ticks the timer can count.
        most: u32,
    },
}

impl Refused {
    /// The reason without its numbers, for a message at compile time.
    pub const fn why(self) -> &'static str {
        match self {
            Refused::NoClock => "a clock must be above 0 Hz",
            Refused::CanBitRate { .. } => "CAN bit rate: no whole division of the clock into 8..25 time quanta",
            Refused::CanSamplePoint { .. } => "CAN bit rate: no sample point between 85 % and 90 %",
            Refused::TimerRate { .. } => "timer rate: no whole division of the timer clock",
            Refused::PwmSteps { .. } => "PWM: too few steps in a period",
            Refused::TickRate { .. } => "ADC trigger rate: not a whole multiple of the tick rate",
            Refused::AdcClock { .. } => "ADC clock: no prescaler gives 0.6..36 MHz",
            Refused::AdcRate { .. } => "ADC: source settles and converts too slowly for the trigger rate",
            Refused::Threshold { .. } => "threshold: outside the range of the converter",
            Refused::Blanking { .. } => "blanking: longer than the timer counts",
        }
    }
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.why())?;
        match *self {
            Refused::NoClock => Ok(()),
            Refused::CanBitRate { clock_hz, bit_rate } | Refused::CanSamplePoint { clock_hz, bit_rate } => {
                write!(f, " ({bit_rate} bit/s from {clock_hz} Hz)")
            }
            Refused::TimerRate { clock_hz, rate_hz } => write!(f, " ({rate_hz} Hz from {clock_hz} Hz)"),
            Refused::PwmSteps { steps, least } => write!(f, " ({steps}, at least {least})"),
            Refused::TickRate { trigger_hz, tick_hz } => write!(f, " ({trigger_hz} Hz and {tick_hz} Hz)"),
            Refused::AdcClock { apb2_hz } => write!(f, " (from {apb2_hz} Hz)"),
            Refused::AdcRate { source_ohm, trigger_hz } => write!(f, " ({source_ohm} ohm at {trigger_hz} Hz)"),
            Refused::Threshold { mv } => write!(f, " ({mv} mV)"),
            Refused::Blanking { ticks, most } => write!(f, " ({ticks} ticks, at most {most})"),
        }
    }
}

impl core::error::Error for Refused {}

/// The value, or a compile-time error that says why there is none.
///
/// ```
/// use edm_hal_shim::{must, timing::can};
/// const BTR: u32 = must!(can::bit_timing(42_000_000, 250_000)).btr();
/// assert_eq!(BTR, 0x0005_0014);
/// ```
/// ```compile_fail
/// use edm_hal_shim::{must, timing::can};
/// const BTR: u32 = must!(can::bit_timing(42_000_000, 800_000)).btr();
/// ```
#[macro_export]
macro_rules! must {
    ($result:expr) => {
        const {
            match $result {
                Ok(value) => value,
                Err(refused) => panic!("{}", $crate::timing::Refused::why(refused)),
            }
        }
    };
}

/// Ticks of a free-running counter as time, and back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Timebase {
    hz: u32,
}

const NS_PER_S: u64 = 1_000_000_000;

impl Timebase {
    /// A counter of `hz` ticks per second, above 0.
    pub const fn new(hz: u32) -> Result<Self, Refused> {
        if hz == 0 { Err(Refused::NoClock) } else { Ok(Timebase { hz }) }
    }

    /// Time of `ticks`, ns, rounded down.
    pub const fn ns(self, ticks: u32) -> u64 {
        // Below 2^32 * 10^9, which is below 2^62.
        ticks as u64 * NS_PER_S / self.hz as u64
    }

    /// Ticks that last at least `ns`.
    pub const fn ticks(self, ns: u32) -> u64 {
        (ns as u64 * self.hz as u64).div_ceil(NS_PER_S)
    }
}

/// Shortest blanking after the gate opens, ns (architecture page, "Short path").
pub const BLANKING_NS: u32 = 2000;

/// Blanking time in ticks of a timer: the longer of 2 us and three time constants of the charging gap, rounded up.
///
/// `tau_ns` is the time constant, `most` the largest count of the timer. After three time constants the gap has 95 % of
/// the open-circuit voltage, so that charging no longer looks like a short.
pub const fn blanking(tau_ns: u32, timer: Timebase, most: u32) -> Result<u32, Refused> {
    let three_tau = 3 * tau_ns as u64;
    let ns = if three_tau > BLANKING_NS as u64 { three_tau } else { BLANKING_NS as u64 };
    // Three times 2^32 times 2^32 overflows 64 bits; a counter above 1.4 GHz is needed for that.
    let ticks = (ns as u128 * timer.hz as u128).div_ceil(NS_PER_S as u128) as u64;
    if ticks > most as u64 { Err(Refused::Blanking { ticks, most }) } else { Ok(ticks as u32) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CORE: Timebase = must!(Timebase::new(168_000_000));

    #[test]
    fn ticks_of_the_168_mhz_clock() {
        assert_eq!(CORE.ns(168), 1000);
        assert_eq!(CORE.ns(1), 5); // 5.95 ns
        assert_eq!(CORE.ns(u32::MAX), 25_565_281_517);
        assert_eq!(CORE.ticks(1000), 168);
        assert_eq!(CORE.ticks(1001), 169);
        assert_eq!(CORE.ticks(0), 0);
        assert_eq!(Timebase::new(0), Err(Refused::NoClock));
        assert_eq!(Timebase::new(1).map(|t| t.ns(u32::MAX)), Ok(4_294_967_295_000_000_000));
    }

    #[test]
    fn blanking_is_two_microseconds_until_three_tau_is_longer() {
        const TIM4: Timebase = must!(Timebase::new(84_000_000));
        assert_eq!(blanking(0, TIM4, 0xFFFF), Ok(168));
        assert_eq!(blanking(666, TIM4, 0xFFFF), Ok(168));
        assert_eq!(blanking(667, TIM4, 0xFFFF), Ok(169)); // 2001 ns, 168.08 ticks
        assert_eq!(blanking(1000, TIM4, 0xFFFF), Ok(252));
        // 16 bits end at 780.178 us.
        assert_eq!(blanking(260_059, TIM4, 0xFFFF), Ok(0xFFFF));
        assert_eq!(blanking(260_060, TIM4, 0xFFFF), Err(Refused::Blanking { ticks: 0x1_0000, most: 0xFFFF }));
        assert!(blanking(u32::MAX, Timebase { hz: u32::MAX }, u32::MAX).is_err());
    }

    #[test]
    fn a_refusal_names_value_and_range() {
        let refused = Refused::Blanking { ticks: 65_536, most: 65_535 };
        assert_eq!(refused.to_string(), "blanking: longer than the timer counts (65536 ticks, at most 65535)");
    }

    proptest! {
        #[test]
        fn a_number_of_ticks_is_never_shorter_than_asked(ns: u32, hz in 1u32..) {
            let exact = ns as u128 * hz as u128; // in units of 1e-9 ticks
            let ticks = u128::from(Timebase { hz }.ticks(ns)) * 1_000_000_000;
            prop_assert!(ticks >= exact && ticks < exact + 1_000_000_000);
        }

        #[test]
        fn ticks_survive_the_way_through_time(ticks: u32, hz in 1u32..=1_000_000_000) {
            let timer = Timebase { hz };
            let ns = timer.ns(ticks);
            if let Ok(ns) = u32::try_from(ns) {
                prop_assert!(u64::from(ticks) >= timer.ticks(ns));
                prop_assert!(u64::from(ticks) - timer.ticks(ns) <= 1);
            }
        }

        #[test]
        fn blanking_covers_both_times_and_no_tick_more(tau_ns: u32, hz in 1u32..) {
            if let Ok(ticks) = blanking(tau_ns, Timebase { hz }, u32::MAX) {
                let asked = (3 * u128::from(tau_ns)).max(2000) * u128::from(hz);
                let got = u128::from(ticks) * 1_000_000_000;
                prop_assert!(got >= asked && got < asked + 1_000_000_000);
            }
        }
    }
}
