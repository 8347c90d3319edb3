//! Clock, sampling time and thresholds of the analogue-to-digital converters.
//!
//! A conversion of 12 bits takes its sampling time and 12 cycles more (RM0090 13.5); the three converters share one clock,
//! APB2 divided by 2, 4, 6 or 8 (RM0090 13.13.16), at most 36 MHz (data sheet, ADC characteristics). The source must
//! charge the sampling capacitor to a quarter of a step within the sampling time (data sheet, equation 1):
//! R_source <= (k - 0.5) / (f_ADC C_ADC ln 2^14) - R_ADC, k the sampling time in cycles.

use super::Refused;

/// Fastest clock of the converters, Hz, with an analogue supply of 2.4 V or more.
pub const MAX_HZ: u32 = 36_000_000;
/// Slowest clock of the converters, Hz.
pub const MIN_HZ: u32 = 600_000;
/// Resistance of the sampling switch, ohm; largest value of the data sheet.
pub const SWITCH_OHM: u32 = 6000;
/// Sampling capacitor, fF. Typically 4 pF; 7 pF, the largest value given for the family, is assumed.
pub const CAPACITOR_FF: u32 = 7000;
/// ln 2^14, times 10^4.
const LN_QUARTER_STEP_E4: u128 = 97_041;
/// Cycles of a conversion of 12 bits without the sampling time.
pub const CONVERSION_CYCLES: u32 = 12;
/// Cycles from an external trigger to the start of sampling (data sheet: 17 cycles per trigger at a sampling time of 3).
pub const LATENCY_CYCLES: u32 = 2;
/// Sampling times in cycles, in the order of their codes in ADC_SMPR1 and ADC_SMPR2 (RM0090 13.13.4).
pub const SAMPLE_CYCLES: [u16; 8] = [3, 15, 28, 56, 84, 112, 144, 480];

/// Common clock of the converters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct AdcClock {
    /// Field ADCPRE of ADC_CCR: 0..=3 for a division by 2, 4, 6, 8.
    pub adcpre: u8,
    /// Clock of the converters, Hz.
    pub hz: u32,
}

/// The fastest permitted converter clock from this bus clock.
pub const fn clock(apb2_hz: u32) -> Result<AdcClock, Refused> {
    let mut adcpre = 0;
    while adcpre < 4 {
        let hz = apb2_hz / (2 * (adcpre + 1));
        if hz >= MIN_HZ && hz <= MAX_HZ {
            return Ok(AdcClock { adcpre: adcpre as u8, hz });
        }
        adcpre += 1;
    }
    Err(Refused::AdcClock { apb2_hz })
}

/// Sampling time of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Sampling {
    /// Code for ADC_SMPR1 and ADC_SMPR2, 0..=7.
    pub smpr: u8,
    /// Sampling time, converter cycles.
    pub sample_cycles: u16,
    /// One whole conversion, converter cycles.
    pub conversion_cycles: u32,
    /// From a trigger to the end of its last conversion, converter cycles.
    pub sequence_cycles: u32,
}

impl AdcClock {
    /// The shortest sampling time that a source of `source_ohm` settles in, for `channels` conversions after each trigger.
    /// Refused when they are not done before the next trigger.
    pub const fn sampling(self, source_ohm: u32, channels: u32, trigger_hz: u32) -> Result<Sampling, Refused> {
        let refused = Err(Refused::AdcRate { source_ohm, trigger_hz });
        let mut smpr = 0;
        while smpr < SAMPLE_CYCLES.len() {
            let sample_cycles = SAMPLE_CYCLES[smpr];
            if matches!(self.max_source_ohm(sample_cycles), Some(most) if source_ohm <= most) {
                let conversion_cycles = sample_cycles as u32 + CONVERSION_CYCLES;
                let sequence = LATENCY_CYCLES as u64 + channels as u64 * conversion_cycles as u64;
                if channels == 0 || sequence > self.hz as u64 || sequence * trigger_hz as u64 > self.hz as u64 {
                    return refused;
                }
                let sequence_cycles = sequence as u32;
                return Ok(Sampling { smpr: smpr as u8, sample_cycles, conversion_cycles, sequence_cycles });
            }
            smpr += 1;
        }
        refused
    }

    /// Largest source resistance that settles in a sampling time, ohm, rounded down; `None` when the sampling switch alone
    /// takes longer.
    pub const fn max_source_ohm(self, sample_cycles: u16) -> Option<u32> {
        // (k - 0.5) / (f C ln 2^14), with k - 0.5 doubled, C in 10^-15 F and the logarithm times 10^4.
        let numerator = (2 * sample_cycles as u128 - 1) * 10u128.pow(15 + 4);
        let total = numerator / (2 * self.hz as u128 * CAPACITOR_FF as u128 * LN_QUARTER_STEP_E4);
        // The longest sampling at the slowest clock is below 2^24 ohm.
        (total as u32).checked_sub(SWITCH_OHM)
    }

    /// Duration of converter cycles, ns, rounded up.
    pub const fn ns(self, cycles: u32) -> u64 {
        (cycles as u64 * 1_000_000_000).div_ceil(self.hz as u64)
    }
}

/// How a voltage at the divider's input becomes a code: `code = zero + 4096 mv / span_mv`. For a current through a shunt
/// read mA for mV.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Scale {
    /// Code at 0 V; above 0 where an offset lets the input go negative.
    pub zero: u16,
    /// Voltage that spans 4096 codes, mV.
    pub span_mv: u32,
}

impl Scale {
    /// Code nearest to a voltage, 0..=4095.
    pub const fn code(self, mv: i32) -> Result<u16, Refused> {
        let refused = Err(Refused::Threshold { mv });
        if self.span_mv == 0 {
            return refused;
        }
        let span = self.span_mv as i64;
        // Half a step up, then down: rounds to nearest on both sides of zero.
        let code = self.zero as i64 + (2 * 4096 * mv as i64 + span).div_euclid(2 * span);
        if code < 0 || code > 4095 { refused } else { Ok(code as u16) }
    }

    /// Lower threshold of the analogue watchdog, ADC_LTR: it trips below this code. Code 0 is refused, nothing is below it
    /// (RM0090 13.3.7).
    pub const fn low(self, mv: i32) -> Result<u16, Refused> {
        match self.code(mv) {
            Ok(0) => Err(Refused::Threshold { mv }),
            result => result,
        }
    }

    /// Upper threshold of the analogue watchdog, ADC_HTR: it trips above this code. Code 4095 is refused, nothing is above
    /// it.
    pub const fn high(self, mv: i32) -> Result<u16, Refused> {
        match self.code(mv) {
            Ok(4095) => Err(Refused::Threshold { mv }),
            result => result,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::must;
    use proptest::prelude::*;

    const ADC: AdcClock = must!(clock(84_000_000));

    #[test]
    fn the_clock_is_the_fastest_permitted() {
        assert_eq!(ADC, AdcClock { adcpre: 1, hz: 21_000_000 });
        assert_eq!(clock(72_000_000), Ok(AdcClock { adcpre: 0, hz: 36_000_000 }));
        assert_eq!(clock(72_000_002), Ok(AdcClock { adcpre: 1, hz: 18_000_000 }));
        assert_eq!(clock(288_000_000), Ok(AdcClock { adcpre: 3, hz: 36_000_000 }));
        assert_eq!(clock(288_000_008), Err(Refused::AdcClock { apb2_hz: 288_000_008 }));
        assert_eq!(clock(1_200_000), Ok(AdcClock { adcpre: 0, hz: 600_000 }));
        assert_eq!(clock(1_199_999), Err(Refused::AdcClock { apb2_hz: 1_199_999 }));
    }

    #[test]
    fn source_resistance_by_hand() {
        // 14.5 / (21 MHz * 7 pF * 9.7041) = 10 165 ohm, less 6000.
        assert_eq!(ADC.max_source_ohm(15), Some(4164));
        // 27.5 cycles: 19 278 ohm, less 6000.
        assert_eq!(ADC.max_source_ohm(28), Some(13_277));
        // 2.5 cycles: 1753 ohm, less than the switch alone.
        assert_eq!(ADC.max_source_ohm(3), None);
    }

    #[test]
    fn the_gap_voltage_of_the_head_at_500_ks() {
        let s = ADC.sampling(1000, 1, 500_000).unwrap();
        assert_eq!((s.smpr, s.sample_cycles, s.conversion_cycles, s.sequence_cycles), (1, 15, 27, 29));
        assert_eq!(ADC.ns(s.conversion_cycles), 1286);
        // Voltage and current after one trigger.
        assert_eq!(ADC.sampling(1000, 2, 300_000).map(|s| s.sequence_cycles), Ok(56));
    }

    #[test]
    fn sampling_both_sides_of_each_bound() {
        assert_eq!(ADC.sampling(4164, 1, 1000).map(|s| s.sample_cycles), Ok(15));
        assert_eq!(ADC.sampling(4165, 1, 1000).map(|s| s.sample_cycles), Ok(28));
        // 28 + 12 + 2 cycles are exactly the 42 of 500 kHz.
        assert!(ADC.sampling(4165, 1, 500_000).is_ok());
        let refused = Err(Refused::AdcRate { source_ohm: 4165, trigger_hz: 500_001 });
        assert_eq!(ADC.sampling(4165, 1, 500_001), refused);
        assert_eq!(ADC.sampling(0, 1, 724_137).map(|s| s.sample_cycles), Ok(15));
        assert!(ADC.sampling(0, 1, 724_138).is_err());
        // The longest sampling time.
        let most = ADC.max_source_ohm(480).unwrap();
        assert_eq!(ADC.sampling(most, 1, 1000).map(|s| s.smpr), Ok(7));
        assert!(ADC.sampling(most + 1, 1, 1000).is_err());
        assert!(ADC.sampling(0, 0, 1000).is_err());
        assert!(ADC.sampling(0, u32::MAX, u32::MAX).is_err());
    }

    #[test]
    fn thresholds_by_hand() {
        // 100:1 divider, 3.3 V reference: 330 V span the converter.
        let gap = Scale { zero: 0, span_mv: 330_000 };
        assert_eq!(gap.code(0), Ok(0));
        assert_eq!(gap.code(20_000), Ok(248)); // 248.24
        assert_eq!(gap.code(70_000), Ok(869)); // 868.85
        assert_eq!(gap.code(329_959), Ok(4095)); // 4095.49
        assert_eq!(gap.code(329_960), Err(Refused::Threshold { mv: 329_960 })); // 4095.503
        assert_eq!(gap.low(41), Ok(1)); // 0.509
        assert_eq!(gap.low(40), Err(Refused::Threshold { mv: 40 })); // 0.496
        assert_eq!(gap.high(329_879), Ok(4094)); // 4094.498
        assert_eq!(gap.high(329_880), Err(Refused::Threshold { mv: 329_880 })); // 4094.511
    }

    #[test]
    fn an_offset_moves_zero() {
        let current = Scale { zero: 2048, span_mv: 4096 };
        assert_eq!([-2048, -1, 0, 1, 2047].map(|mv| current.code(mv)), [0, 2047, 2048, 2049, 4095].map(Ok));
        assert!(current.code(-2049).is_err() && current.code(2048).is_err());
        assert!(Scale { zero: 0, span_mv: 0 }.code(1).is_err());
    }

    proptest! {
        #[test]
        fn a_code_is_the_nearest(zero in 0u16..4096, span_mv in 1u32.., mv: i32) {
            let exact = f64::from(zero) + 4096.0 * f64::from(mv) / f64::from(span_mv);
            match (Scale { zero, span_mv }).code(mv) {
                Ok(code) => prop_assert!((f64::from(code) - exact).abs() <= 0.5 + 1e-6),
                Err(_) => prop_assert!(!(-0.5 + 1e-6..4095.5 - 1e-6).contains(&exact)),
            }
        }

        #[test]
        fn a_granted_sampling_settles_and_keeps_up(ohm in 0u32..100_000, channels in 1u32..16, trigger in 1u32..2_000_000) {
            if let Ok(s) = ADC.sampling(ohm, channels, trigger) {
                let seconds = (f64::from(s.sample_cycles) - 0.5) / f64::from(ADC.hz);
                let taus = seconds / (f64::from(ohm + SWITCH_OHM) * 7e-12);
                prop_assert!(taus >= 14.0 * core::f64::consts::LN_2 * 0.9999);
                prop_assert!(f64::from(s.sequence_cycles) * f64::from(trigger) <= f64::from(ADC.hz));
            }
        }
    }
}
