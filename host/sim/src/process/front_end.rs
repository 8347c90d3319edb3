//! The converter of the gap voltage: noise, hum, gain error, saturation, 12 bits.
//!
//! Between two events of the gap all conversions see one settled voltage and one gate, so a block is filled stretch by
//! stretch; only the rest of an edge is calculated conversion by conversion.

use super::Installation;
use super::model::Stretch;
use super::normal;
use super::random::{Cause, Random};
use edm_hal_shim::gap::{BLOCK, GapBlock};
use edm_servo_head::units::{ADC_FULL_SCALE, ADC_HZ};
use rand::RngExt;
use std::f64::consts::TAU;
use std::ops::Range;

/// Time between conversions, us.
const PERIOD_US: f64 = 1e6 / ADC_HZ as f64;
/// A conversion takes 15 cycles of 21 MHz, 0.71 us. One closer to a gate edge than this does not count as gated: it would
/// mix on-time and off-time.
const GUARD_US: f64 = 0.75;
/// Time in which the mains frequency drifts once up and down, evenly, s (assumed).
const DRIFT_S: f64 = 20.0;
/// Blocks for which the mains frequency is taken as steady, 3.2 ms: it then drifts by 0.1 mHz.
const RETUNE: u64 = 64;
/// Length of a block, s.
const BLOCK_S: f64 = BLOCK as f64 / ADC_HZ as f64;
/// 2^23: to a number up to 4095 this adds, the sum is rounded to a whole number, and its lowest bits are that number.
const WHOLE: f32 = 8_388_608.0;

/// State of the front end.
#[derive(Clone, Debug)]
pub struct FrontEnd {
    per_volt: f64,
    zero: f64,
    hum: Hum,
    /// Share of an edge that is left a conversion later, by the edge's time constant in us.
    fades: (f64, f64),
    /// Noise of a conversion, codes rms.
    noise: f32,
    random: Random,
    /// The converter gives this code whatever it sees.
    pub stuck: Option<u16>,
    /// The wire of the gate signal is broken.
    pub gate_lost: bool,
}

/// Mains hum, as the sine of a pointer that is turned on from block to block, which is cheaper than a sine for each.
#[derive(Clone, Debug)]
struct Hum {
    codes: f64,
    mains: f64,
    drift: f64,
    /// Blocks so far.
    blocks: u64,
    /// Cosine and sine of the angle from one block to the next, and of the phase.
    step: (f64, f64),
    pointer: (f64, f64),
}

impl Hum {
    /// Codes by which it is off in the next block. Over a block it moves by 1.6 % of its amplitude: one value will do.
    fn next(&mut self) -> f64 {
        if self.blocks.is_multiple_of(RETUNE) {
            let turn = (self.blocks as f64 * (BLOCK_S / DRIFT_S)).fract();
            let hz = self.mains + self.drift * (1.0 - 4.0 * (turn - 0.5).abs());
            let (sine, cosine) = libm::sincos(TAU * BLOCK_S * hz);
            self.step = (cosine, sine);
            // Of length one for ever.
            let length = libm::hypot(self.pointer.0, self.pointer.1);
            self.pointer = (self.pointer.0 / length, self.pointer.1 / length);
        }
        self.blocks += 1;
        let ((cosine, sine), (x, y)) = (self.step, self.pointer);
        self.pointer = (x * cosine - y * sine, x * sine + y * cosine);
        self.codes * self.pointer.1
    }
}

impl FrontEnd {
    /// Front end whose mains starts at a phase of its own.
    pub fn new(p: &Installation, seed: u64) -> FrontEnd {
        let mut random = Cause::FrontEnd.stream(seed);
        let per_volt = (1.0 + f64::from(p.gain_error) * 0.01) / f64::from(p.volts_per_code);
        let phase = TAU * random.random::<f64>();
        FrontEnd {
            per_volt,
            zero: p.zero_code.into(),
            hum: Hum {
                codes: f64::from(p.hum) * per_volt,
                mains: p.mains.into(),
                drift: p.mains_drift.into(),
                blocks: 0,
                step: (1.0, 0.0),
                pointer: (libm::cos(phase), libm::sin(phase)),
            },
            fades: (0.0, 0.0),
            noise: (f64::from(p.noise) * per_volt) as f32,
            random,
            stuck: None,
            gate_lost: false,
        }
    }

    /// Converts the block of a tick that begins at `from` (us), under the stretches that touch it, the oldest first. Blocks
    /// follow each other without a pause.
    pub fn convert(&mut self, from: f64, stretches: &[Stretch]) -> GapBlock {
        let base = self.zero + self.hum.next();
        // A stretch writes a whole block from its first conversion on, which takes no loop, and the next one over it.
        let mut seen = [0.0; 2 * BLOCK];
        let mut gate = 0;
        let mut begin = 0;
        for (i, now) in stretches.iter().enumerate() {
            let end = stretches.get(i + 1).map_or(BLOCK, |next| before(from, next.from)).max(begin);
            if begin < end
                && let Some(seen) = seen.get_mut(begin..).and_then(|seen| seen.first_chunk_mut())
            {
                self.see(from, now, base, begin..end, seen);
                gate |= mask(gated(from, now.gate, begin..end));
                begin = end;
            }
        }
        let codes = self.quantise(seen.first_chunk().unwrap_or(&[0.0; BLOCK]));
        GapBlock {
            codes: self.stuck.map_or(codes, |stuck| [stuck; BLOCK]),
            gate: if self.gate_lost { 0 } else { gate },
            ..GapBlock::EMPTY
        }
    }

    /// What these conversions see of a stretch, in codes; behind them it is written as settled.
    fn see(&mut self, from: f64, now: &Stretch, base: f64, of: Range<usize>, seen: &mut [f32; BLOCK]) {
        *seen = [(base + now.volts * self.per_volt) as f32; BLOCK];
        let begins = from + (of.start as f64 + 0.5) * PERIOD_US;
        if now.settled(begins) {
            return;
        }
        let mut left = now.at(begins) - now.volts;
        for (edge, code) in (1..=of.len()).zip(seen) {
            *code = (base + (now.volts + left) * self.per_volt) as f32;
            if now.settled(begins + edge as f64 * PERIOD_US) {
                break;
            }
            if self.fades.0 != now.rise {
                self.fades = (now.rise, libm::exp(-PERIOD_US / now.rise));
            }
            left *= self.fades.1;
        }
    }

    /// Noise, saturation, and the nearest code.
    fn quantise(&mut self, seen: &[f32; BLOCK]) -> [u16; BLOCK] {
        let noise = normal::block(&mut self.random);
        let mut codes = [0; BLOCK];
        for ((code, seen), noise) in codes.iter_mut().zip(seen).zip(&noise) {
            let exact = (seen + self.noise * noise).clamp(0.0, f32::from(ADC_FULL_SCALE));
            *code = (exact + WHOLE).to_bits() as u16 & ADC_FULL_SCALE;
        }
        codes
    }
}

/// How many conversions of the block from `from` on come before `time`.
fn before(from: f64, time: f64) -> usize {
    let exact = ((time - from) * (1.0 / PERIOD_US) - 0.5).clamp(0.0, BLOCK as f64);
    let whole = exact as u32;
    (whole + u32::from(exact > f64::from(whole))) as usize
}

/// How many do not come after it.
fn until(from: f64, time: f64) -> usize {
    ((time - from) * (1.0 / PERIOD_US) + 0.5).clamp(0.0, BLOCK as f64) as u32 as usize
}

/// Those of a stretch's conversions that lie well within the gate.
fn gated(from: f64, gate: (f64, f64), of: Range<usize>) -> Range<usize> {
    if gate.0 >= gate.1 {
        return 0..0;
    }
    let end = from + BLOCK as f64 * PERIOD_US;
    if gate.0 + GUARD_US < from && end < gate.1 - GUARD_US {
        return of;
    }
    let (opens, closes) = (before(from, gate.0 + GUARD_US), until(from, gate.1 - GUARD_US));
    opens.max(of.start)..closes.min(of.end)
}

/// A bit for every number in the range.
fn mask(range: Range<usize>) -> u32 {
    let below = |end: usize| (1u32 << end.min(BLOCK)) - 1;
    below(range.end) & !below(range.start)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_1_SQRT_2;

    fn steady(volts: f64) -> Stretch {
        Stretch { from: -1e9, volts, initial: volts, rise: 0.2, gate: (-1e9, 1e18), ..Stretch::default() }
    }

    fn quiet() -> Installation {
        Installation { noise: 0.0, hum: 0.0, ..Installation::default() }
    }

    /// Mean and rms about it, V, as the head's defaults read the codes.
    fn moments(p: &Installation, volts: f64) -> (f64, f64) {
        let mut front = FrontEnd::new(p, 3);
        let (mut sum, mut square, mut n) = (0.0, 0.0, 0.0);
        for tick in 0..8000 {
            for code in front.convert(f64::from(tick) * 50.0, &[steady(volts)]).codes {
                let v = (f64::from(code) - 410.0) * 0.1;
                sum += v;
                square += v * v;
                n += 1.0;
            }
        }
        let mean: f64 = sum / n;
        (mean, (square / n - mean * mean).sqrt())
    }

    #[test]
    fn it_reads_volts_with_half_a_volt_of_noise() {
        let (mean, rms) = moments(&Installation { noise: 0.5, ..quiet() }, 60.0);
        assert!((mean - 60.0).abs() < 0.01, "{mean}");
        // The rounding to codes adds 0.1 V / sqrt(12).
        assert!((rms - 0.5f64.hypot(0.0289)).abs() < 0.005, "{rms}");
    }

    #[test]
    fn hum_of_one_volt_adds_its_rms() {
        let (_, rms) = moments(&Installation { hum: 1.0, ..quiet() }, 60.0);
        assert!((rms - FRAC_1_SQRT_2).abs() < 0.01, "{rms}");
    }

    #[test]
    fn the_noise_of_one_conversion_tells_nothing_of_the_next() {
        let mut front = FrontEnd::new(&Installation { noise: 0.5, ..quiet() }, 3);
        let codes: Vec<f64> = (0..4000)
            .flat_map(|tick| front.convert(f64::from(tick) * 50.0, &[steady(60.0)]).codes)
            .map(f64::from)
            .collect();
        for lag in [1, 2, 24, 25, 50] {
            let pairs = codes.iter().zip(&codes[lag..]);
            let correlation: f64 =
                pairs.map(|(a, b)| (a - 1010.0) * (b - 1010.0)).sum::<f64>() / codes.len() as f64 / 25.0;
            assert!(correlation.abs() < 0.015, "lag {lag}: {correlation}");
        }
    }

    #[test]
    fn the_mains_drifts_about_its_frequency_and_no_farther() {
        let mut front = FrontEnd::new(&Installation { hum: 20.0, mains_drift: 0.2, ..quiet() }, 3);
        // Rising passages through zero in each quarter of the drift, against 50 Hz.
        let mut crossings = Vec::new();
        let mut before = u16::MAX;
        for tick in 0..800_000 {
            let code = front.convert(f64::from(tick) * 50.0, &[steady(0.0)]).codes[0];
            if before < 410 && code >= 410 {
                crossings.push(f64::from(tick) * 50e-6);
            }
            before = code;
        }
        let rates: Vec<f64> = crossings.windows(2).step_by(20).map(|pair| 1.0 / (pair[1] - pair[0])).collect();
        let mean = crossings.len() as f64 / 40.0;
        assert!((mean - 50.0).abs() < 0.05, "{mean}");
        let (low, high) = rates.iter().fold((f64::MAX, 0.0f64), |(low, high), &rate| (low.min(rate), high.max(rate)));
        assert!((49.6..49.9).contains(&low) && (50.1..50.4).contains(&high), "{low} {high}");
    }

    #[test]
    fn a_gain_error_scales_what_is_read() {
        for (percent, code) in [(0.0, 1010), (5.0, 1040), (-5.0, 980)] {
            let mut front = FrontEnd::new(&Installation { gain_error: percent, ..quiet() }, 1);
            assert_eq!(front.convert(0.0, &[steady(60.0)]).codes[0], code);
        }
    }

    #[test]
    fn it_saturates_at_both_ends_and_not_before() {
        for (volts, code) in [(-100.0, 0), (-41.0, 0), (-40.9, 1), (368.4, 4094), (368.5, 4095), (400.0, 4095)] {
            let mut front = FrontEnd::new(&quiet(), 1);
            assert_eq!(front.convert(0.0, &[steady(volts)]).codes, [code; BLOCK], "{volts}");
        }
    }

    #[test]
    fn only_conversions_well_inside_on_time_are_gated() {
        let mut front = FrontEnd::new(&quiet(), 1);
        let off = |from: f64, initial| Stretch {
            from,
            volts: 0.0,
            initial,
            rise: 0.2,
            gate: (from, from),
            ..Stretch::default()
        };
        let on =
            |from, volts, initial| Stretch { from, volts, initial, rise: 0.2, gate: (9.3, 31.5), ..Stretch::default() };
        let stretches = [off(-100.0, 0.0), on(9.3, 100.0, 0.0), on(20.0, 40.0, 100.0), off(31.5, 40.0)];
        // Conversions at 1, 3, 5 ... us: 11 (k = 5) to 29 (k = 14); 31 (k = 15) is 0.5 us before the edge.
        let block = front.convert(0.0, &stretches);
        assert_eq!(block.gate, 0b111_1111_1110_0000);
        assert_eq!((block.codes[4], block.codes[5], block.codes[14], block.codes[17]), (410, 1410, 810, 410));
    }

    #[test]
    fn a_block_filled_by_stretches_is_that_of_conversions_one_by_one() {
        let mut random = Cause::Encoder.stream(9);
        for _ in 0..2000 {
            let rise = random.random_range(0.05..5.0);
            let mut stretches =
                vec![Stretch { from: -3.0, volts: 0.0, initial: 0.0, rise, gate: (-3.0, -3.0), ..Stretch::default() }];
            let mut time = 0.0;
            while time < 50.0 {
                time += random.random_range(0.01..20.0);
                let last = stretches[stretches.len() - 1];
                let gate = (time, if last.gate.0 < last.gate.1 { time } else { time + random.random_range(0.5..40.0) });
                let volts = random.random_range(-20.0..120.0);
                stretches.push(Stretch { from: time, volts, initial: last.at(time), rise, gate, ..Stretch::default() });
            }
            let block = FrontEnd::new(&quiet(), 1).convert(0.0, &stretches);
            for (k, code) in block.codes.into_iter().enumerate() {
                let at = 1.0 + 2.0 * k as f64;
                let now = stretches.iter().rev().find(|stretch| stretch.from <= at).unwrap();
                let volts = (f64::from(code) - 410.0) * 0.1;
                assert!((volts - now.at(at)).abs() < 0.0501, "{at} us: {volts} V, not {} V", now.at(at));
                let gated = now.gate.0 + GUARD_US <= at && at <= now.gate.1 - GUARD_US;
                assert_eq!(block.gate >> k & 1 == 1, gated, "{at} us in {:?}", now.gate);
            }
        }
    }

    #[test]
    fn the_edge_of_a_pulse_is_an_exponential() {
        let mut front = FrontEnd::new(&quiet(), 1);
        let stretch =
            Stretch { from: 0.0, volts: 100.0, initial: 0.0, rise: 2.0, gate: (0.0, 1e9), ..Stretch::default() };
        let block = front.convert(0.0, &[stretch]);
        for (k, at) in [(0, 1.0), (1, 3.0), (4, 9.0)] {
            let volts = 100.0 * (1.0 - f64::exp(-at / 2.0));
            assert!((f64::from(block.codes[k]) - 410.0 - volts * 10.0).abs() <= 0.5, "{k}");
        }
    }

    #[test]
    fn a_stuck_converter_and_a_lost_gate_show_nothing_of_the_gap() {
        let mut front = FrontEnd::new(&Installation::default(), 1);
        (front.stuck, front.gate_lost) = (Some(1234), true);
        assert_eq!(front.convert(0.0, &[steady(60.0)]), GapBlock { codes: [1234; BLOCK], ..GapBlock::EMPTY });
    }
}
