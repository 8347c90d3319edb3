//! Bit timing of the bxCAN controller.
//!
//! A bit is 1 + TS1 + TS2 *time quanta* long; a quantum is BRP periods of the APB1 clock; the bus is sampled between the
//! two segments (RM0090 32.7.7). SJW is how many quanta a bit may be stretched or cut to follow another node.
//! CiA 301 recommends a sample point at 87.5 % for every rate. From 42 MHz that is exact at 125 and 250 kbit/s; 7/8
//! needs a multiple of 8 quanta: a bit of 500 or 1000 kbit/s lasts 84 or 42 clock periods, which 8 does not divide, and 12
//! of 14 quanta (85.7 %) is nearest. CiA 301 accepts 85 to 90 %. The rate itself is always exact.

use super::Refused;

/// Bit rates a head offers, bit/s.
pub const BIT_RATES: [u32; 4] = [125_000, 250_000, 500_000, 1_000_000];

/// Segments of a bit, in time quanta, and the prescaler that makes the quantum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct BitTiming {
    /// Clock periods in a quantum, 1..=1024.
    pub brp: u16,
    /// Quanta before the sample point, without the synchronisation quantum, 1..=16.
    pub ts1: u8,
    /// Quanta after the sample point, 1..=8.
    pub ts2: u8,
    /// Quanta of resynchronisation, 1..=4.
    pub sjw: u8,
}

impl BitTiming {
    /// Quanta in a bit.
    pub const fn quanta(self) -> u32 {
        1 + self.ts1 as u32 + self.ts2 as u32
    }

    /// Sample point in thousandths of a bit, rounded to nearest.
    pub const fn sample_point(self) -> u32 {
        (1000 * (1 + self.ts1 as u32) + self.quanta() / 2) / self.quanta()
    }

    /// Bit rate from this clock, bit/s.
    pub const fn bit_rate(self, clock_hz: u32) -> u32 {
        clock_hz / (self.brp as u32 * self.quanta())
    }

    /// Value of CAN_BTR for normal operation: neither silent nor looped back (RM0090 32.9.2).
    pub const fn btr(self) -> u32 {
        (self.sjw as u32 - 1) << 24 | (self.ts2 as u32 - 1) << 20 | (self.ts1 as u32 - 1) << 16 | (self.brp as u32 - 1)
    }
}

/// Bit timing for `bit_rate` (up to 1 Mbit/s) from the controller's clock: the exact rate with the sample point nearest to
/// 87.5 %, and of equals the one with most quanta. Refused when the rate is not exact or the sample point would lie outside
/// 85..=90 %.
pub const fn bit_timing(clock_hz: u32, bit_rate: u32) -> Result<BitTiming, Refused> {
    if bit_rate == 0 || bit_rate > 1_000_000 {
        return Err(Refused::CanBitRate { clock_hz, bit_rate });
    }
    let mut divides = false;
    // Distance of the best sample point from 7/8, in eighths of a quantum.
    let mut best: Option<(BitTiming, u32)> = None;
    let mut quanta = 25;
    while quanta >= 8 {
        let product = bit_rate * quanta;
        let brp = clock_hz / product;
        if clock_hz.is_multiple_of(product) && brp >= 1 && brp <= 1024 {
            divides = true;
            // Nearest to 7/8; a tie goes to the earlier point.
            let sample = (7 * quanta + 3) / 8;
            let (ts1, ts2) = (sample - 1, quanta - sample);
            let in_range = 1000 * sample >= 850 * quanta && 1000 * sample <= 900 * quanta;
            if in_range && ts1 <= 16 && ts2 >= 1 && ts2 <= 8 {
                let distance = (8 * sample).abs_diff(7 * quanta);
                let nearer = match best {
                    Some((b, d)) => distance * b.quanta() < d * quanta,
                    None => true,
                };
                if nearer {
                    let sjw = if ts2 < 4 { ts2 } else { 4 };
                    let timing = BitTiming { brp: brp as u16, ts1: ts1 as u8, ts2: ts2 as u8, sjw: sjw as u8 };
                    best = Some((timing, distance));
                }
            }
        }
        quanta -= 1;
    }
    match best {
        Some((timing, _)) => Ok(timing),
        None if divides => Err(Refused::CanSamplePoint { clock_hz, bit_rate }),
        None => Err(Refused::CanBitRate { clock_hz, bit_rate }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const APB1: u32 = crate::board::APB1_HZ;

    #[test]
    fn the_four_rates_of_a_head_at_42_mhz() {
        let expected = [
            (BitTiming { brp: 21, ts1: 13, ts2: 2, sjw: 2 }, 875, 0x011C_0014),
            (BitTiming { brp: 21, ts1: 6, ts2: 1, sjw: 1 }, 875, 0x0005_0014),
            (BitTiming { brp: 6, ts1: 11, ts2: 2, sjw: 2 }, 857, 0x011A_0005),
            (BitTiming { brp: 3, ts1: 11, ts2: 2, sjw: 2 }, 857, 0x011A_0002),
        ];
        for (rate, (timing, sample_point, btr)) in BIT_RATES.into_iter().zip(expected) {
            assert_eq!(bit_timing(APB1, rate), Ok(timing), "{rate}");
            assert_eq!((timing.sample_point(), timing.btr()), (sample_point, btr), "{rate}");
            assert_eq!(timing.bit_rate(APB1), rate);
        }
    }

    #[test]
    fn at_42_mhz_no_division_comes_nearer_to_87_5_percent() {
        for rate in BIT_RATES {
            let granted = bit_timing(APB1, rate).unwrap();
            let best = (8 * (1 + u32::from(granted.ts1))).abs_diff(7 * granted.quanta());
            // Every setting of the register that gives the rate exactly.
            let mut eighths = false;
            for brp in 1..=1024u32 {
                for (ts1, ts2) in (1..=16u32).flat_map(|ts1| (1..=8u32).map(move |ts2| (ts1, ts2))) {
                    let quanta = 1 + ts1 + ts2;
                    if quanta >= 8 && brp * quanta == APB1 / rate {
                        let distance = (8 * (1 + ts1)).abs_diff(7 * quanta);
                        assert!(distance * granted.quanta() >= best * quanta, "{rate}: {brp} {ts1} {ts2} is nearer");
                        eighths |= quanta % 8 == 0;
                    }
                }
            }
            // The reason: a bit of 84 or 42 periods has no whole eighths.
            assert_eq!(eighths, rate <= 250_000, "{rate}");
        }
    }

    #[test]
    fn a_bus_clock_of_40_mhz_would_sample_all_rates_at_87_5_percent() {
        for rate in BIT_RATES {
            assert_eq!(bit_timing(40_000_000, rate).map(BitTiming::sample_point), Ok(875), "{rate}");
        }
    }

    #[test]
    fn a_rate_that_does_not_divide_the_clock_is_refused() {
        for rate in [0, 800_000, 999_999, 1_000_001, 124_999, u32::MAX] {
            assert_eq!(bit_timing(APB1, rate), Err(Refused::CanBitRate { clock_hz: APB1, bit_rate: rate }), "{rate}");
        }
        // 7 quanta would divide, but a bit needs 8.
        assert!(matches!(bit_timing(7_000_000, 1_000_000), Err(Refused::CanBitRate { .. })));
        assert!(bit_timing(8_000_000, 1_000_000).is_ok());
        assert!(bit_timing(0, 1_000_000).is_err());
    }

    #[test]
    fn a_sample_point_too_far_off_is_refused() {
        // 11 and 22 quanta only: 9 or 10 of 11 are 81.8 % and 90.9 %; 19 of 22 is 86.4 % but TS1 ends at 16.
        assert!(matches!(bit_timing(11_000_000, 1_000_000), Err(Refused::CanSamplePoint { .. })));
        // 10 quanta: 9 of 10 is just inside.
        assert_eq!(bit_timing(10_000_000, 1_000_000).map(BitTiming::sample_point), Ok(900));
    }

    #[test]
    fn the_prescaler_ends_at_1024() {
        assert_eq!(bit_timing(1024 * 16 * 1000, 1000).map(|t| (t.brp, t.ts1, t.ts2)), Ok((1024, 13, 2)));
        assert!(bit_timing(1031 * 16 * 1000, 1000).is_err());
    }

    proptest! {
        #[test]
        fn what_is_granted_is_exact_in_range_and_the_nearest(clock in 1u32..100_000, rate in 1u32..=1000) {
            let (clock, rate) = (clock * 1000, rate * 1000);
            // Every timing the registers can hold, by search.
            let mut nearest: Option<f64> = None;
            for ts1 in 1..=16u32 {
                for ts2 in 1..=8u32 {
                    let quanta = 1 + ts1 + ts2;
                    let sample = f64::from(1 + ts1) / f64::from(quanta);
                    let whole = clock % (rate * quanta) == 0 && (1..=1024).contains(&(clock / (rate * quanta)));
                    if quanta >= 8 && whole && (0.85..=0.90).contains(&sample) {
                        let off = (sample - 0.875).abs();
                        nearest = Some(nearest.map_or(off, |n| n.min(off)));
                    }
                }
            }
            match (bit_timing(clock, rate), nearest) {
                (Ok(t), Some(off)) => {
                    prop_assert_eq!(u32::from(t.brp) * t.quanta() * rate, clock);
                    prop_assert!((f64::from(1 + t.ts1) / f64::from(t.quanta()) - 0.875).abs() < off + 1e-9);
                    prop_assert!(t.sjw >= 1 && t.sjw <= 4 && t.sjw <= t.ts2);
                }
                (granted, found) => prop_assert!(granted.is_err() && found.is_none(), "{granted:?} {found:?}"),
            }
        }
    }
}
