//! The converter that looks at the gap: noise, hum, gain error, saturation, 12 bits.

use super::Parameters;
use super::spark::Stretch;
use edm_hal_shim::gap::{BLOCK, GapBlock};
use edm_servo_head::units::{ADC_FULL_SCALE, ADC_HZ};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::f64::consts::TAU;

/// Time between conversions, us.
const PERIOD_US: f64 = 1e6 / ADC_HZ as f64;
/// A conversion closer to a gate edge than this does not count as gated: it would mix on-time and off-time.
const GUARD_US: f64 = 0.75;
/// Noise comes from a table, entered at a random place each block: a tenth of the cost of drawing each value.
const TABLE: usize = 1 << 14;
/// Time in which the mains frequency drifts once up and down, s (assumed).
const DRIFT_S: f64 = 20.0;

/// State of the front end.
#[derive(Clone, Debug)]
pub struct FrontEnd {
    per_volt: f64,
    zero: f64,
    rise_us: f64,
    hum: f64,
    mains: f64,
    drift: f64,
    /// Phase of the hum, turns.
    phase: f64,
    noise: Vec<f32>,
    random: Xoshiro256PlusPlus,
    /// The converter gives this code whatever it sees.
    pub stuck: Option<u16>,
}

impl FrontEnd {
    /// Front end with its own stream of randomness.
    pub fn new(p: &Parameters, seed: u64) -> FrontEnd {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed.wrapping_mul(16).wrapping_add(4));
        let per_volt = (1.0 + f64::from(p.gain_error) * 0.01) / f64::from(p.volts_per_code);
        let sigma = f64::from(p.noise) * per_volt;
        let noise = (0..TABLE)
            .map(|_| {
                let normal: f64 = StandardNormal.sample(&mut random);
                (normal * sigma) as f32
            })
            .collect();
        FrontEnd {
            per_volt,
            zero: p.zero_code.into(),
            rise_us: p.rise.into(),
            hum: p.hum.into(),
            mains: p.mains.into(),
            drift: p.mains_drift.into(),
            phase: random.random::<f64>(),
            noise,
            random,
            stuck: None,
        }
    }

    /// Converts the block of a tick that begins at `from` (us), under the stretches that touch it.
    pub fn convert(&mut self, from: f64, stretches: &[Stretch]) -> GapBlock {
        let seconds = from * 1e-6;
        let mains = self.mains + self.drift * (TAU * seconds / DRIFT_S).sin();
        self.phase = (self.phase + mains * PERIOD_US * 1e-6 * BLOCK as f64).fract();
        let base = (self.zero + self.hum * self.per_volt * (TAU * self.phase).sin() + 0.5) as f32;
        let start = self.random.random::<u32>() as usize % (TABLE - BLOCK);
        let noise = self.noise.get(start..start + BLOCK).unwrap_or(&[]);

        let mut block = GapBlock { codes: [0; BLOCK], gate: 0 };
        let mut stretches = stretches.iter().peekable();
        let mut current = stretches.next();
        for (k, (code, noise)) in block.codes.iter_mut().zip(noise).enumerate() {
            let at = from + (k as f64 + 0.5) * PERIOD_US;
            while stretches.peek().is_some_and(|next| next.from <= at) {
                current = stretches.next();
            }
            let Some(now) = current else { break };
            let age = at - now.from;
            let volts = if age > 8.0 * self.rise_us {
                now.volts
            } else {
                now.volts + (now.initial - now.volts) * (-age / self.rise_us).exp()
            };
            let exact = base + (volts * self.per_volt) as f32 + noise;
            *code = (exact as i32).clamp(0, i32::from(ADC_FULL_SCALE)) as u16;
            let edge_before = age < GUARD_US && stretch_opens(now);
            let edge_after = now.to - at < GUARD_US;
            if now.gate && !edge_before && !(edge_after && stretches.peek().is_none_or(|next| !next.gate)) {
                block.gate |= 1 << k;
            }
        }
        if let Some(stuck) = self.stuck {
            block.codes = [stuck; BLOCK];
        }
        block
    }
}

/// Whether a stretch begins with the gate's rising edge.
fn stretch_opens(stretch: &Stretch) -> bool {
    stretch.gate && stretch.initial == 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn steady(volts: f64) -> Stretch {
        Stretch { from: -1e9, to: 1e18, volts, initial: volts, gate: true }
    }

    fn moments(p: &Parameters, volts: f64) -> (f64, f64) {
        let mut front = FrontEnd::new(p, 3);
        let (mut sum, mut square, mut n) = (0.0, 0.0, 0.0);
        for tick in 0..4000 {
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
        let p = Parameters { hum: 0.0, ..Parameters::default() };
        let (mean, rms) = moments(&p, 60.0);
        assert!((mean - 60.0).abs() < 0.01, "{mean}");
        assert!((rms - 0.5).abs() < 0.01, "{rms}");
    }

    #[test]
    fn hum_of_one_volt_adds_its_rms() {
        let (_, rms) = moments(&Parameters { noise: 0.0, ..Parameters::default() }, 60.0);
        assert!((rms - 0.5f64.sqrt()).abs() < 0.02, "{rms}");
    }

    #[test]
    fn it_saturates_at_both_ends() {
        for (volts, code) in [(-100.0, 0), (400.0, 4095)] {
            let mut front = FrontEnd::new(&Parameters::default(), 1);
            assert_eq!(front.convert(0.0, &[steady(volts)]).codes, [code; BLOCK]);
        }
    }

    #[test]
    fn only_conversions_well_inside_on_time_are_gated() {
        let mut front = FrontEnd::new(&Parameters::default(), 1);
        let stretches = [
            Stretch { from: -100.0, to: 9.3, volts: 0.0, initial: 0.0, gate: false },
            Stretch { from: 9.3, to: 20.0, volts: 100.0, initial: 0.0, gate: true },
            Stretch { from: 20.0, to: 31.5, volts: 40.0, initial: 100.0, gate: true },
            Stretch { from: 31.5, to: 1e9, volts: 0.0, initial: 40.0, gate: false },
        ];
        // Conversions at 1, 3, 5 ... us: 11 (k = 5) to 29 (k = 14); 31 (k = 15) is 0.5 us before the edge.
        let block = front.convert(0.0, &stretches);
        assert_eq!(block.gate, 0b111_1111_1110_0000);
    }
}
