//! Plain and gated average of the same pulses with short and with long off-times.

use edm_hal_shim::gap::{BLOCK, GapBlock};
use edm_servo_head::gap::voltage::{Average, Config};
use edm_servo_head::gap::{GapSource, Voltage};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;

/// Most that the gated average may move.
pub const BOUND: f64 = 0.01;
/// Off-times that are compared, us.
pub const OFF_US: [f64; 2] = [10.0, 1000.0];
/// Open circuit, burn and noise of a conversion, V.
const VOLTS: (f64, f64, f64) = (100.0, 40.0, 4.0);
/// From one conversion to the next, us.
const SAMPLE_US: f64 = 2.0;
/// Quarter of a percent by which any generator is off: the converter meets other places of every pulse.
const OFF_BY: f64 = 1.0023;

/// How long a gate is open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// 100 us.
    IsoFrequency,
    /// 60 us from ignition, at most 300 us before it.
    IsoEnergy,
}

impl Kind {
    /// Wait until it ignites and on-time of a pulse, us.
    fn pulse(self, random: &mut Xoshiro256PlusPlus) -> (f64, f64) {
        let draw: f64 = random.random();
        let wait = -60.0 * (1.0 - draw).ln();
        match self {
            Kind::IsoFrequency => (wait, 100.0),
            Kind::IsoEnergy => (wait, wait.min(300.0) + 60.0),
        }
    }
}

/// Mean of the average over so many pulses, V.
fn mean(kind: Kind, average: Average, off_us: f64, pulses: u32) -> f64 {
    let config = Config { average, ..Config::default() };
    let mut source = Voltage::new(config.build().expect("the default configuration"));
    let (mut random, mut noises) = (Xoshiro256PlusPlus::seed_from_u64(3), Xoshiro256PlusPlus::seed_from_u64(4));
    let (mut block, mut at) = (GapBlock::EMPTY, 0);
    let (mut sum, mut ticks) = (0.0, 0u32);
    // When the next conversion is, from when its pulse begins.
    let mut next = 0.0;
    for _ in 0..pulses {
        let (wait, on) = kind.pulse(&mut random);
        let period = (on + off_us) * OFF_BY;
        while next < period {
            let noise: f64 = StandardNormal.sample(&mut noises);
            let volts = if next >= on {
                0.0
            } else if next < wait {
                VOLTS.0
            } else {
                VOLTS.1
            };
            let code = f64::from(config.zero_code) + (volts + VOLTS.2 * noise) / f64::from(config.volts_per_code);
            block.codes[at] = code.round().clamp(0.0, 4095.0) as u16;
            // One that an edge falls into is none.
            block.gate |= u32::from(next + SAMPLE_US <= on) << at;
            at += 1;
            if at == BLOCK {
                let reading = source.update(Some(&block));
                (sum, ticks) = (sum + f64::from(reading.block.0), ticks + 1);
                (block, at) = (GapBlock::EMPTY, 0);
            }
            next += SAMPLE_US;
        }
        next -= period;
    }
    sum / f64::from(ticks.max(1))
}

/// The average at both off-times, V, and by how much of the first it moves.
pub fn shift(kind: Kind, average: Average, pulses: u32) -> ([f64; 2], f64) {
    let [short, long] = OFF_US.map(|off_us| mean(kind, average, off_us, pulses));
    ([short, long], (long / short - 1.0).abs())
}
