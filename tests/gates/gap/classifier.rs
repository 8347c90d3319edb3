//! Labelled pulses through the classifier of the core, as blocks of converter codes.
//!
//! *Label*: what the pulse is made of. An open one stays at the open circuit; the others step to what they burn at after a wait
//! of 0 to 8 conversions (a short: of none) and stay there for a stated number of conversions. Equal priors. Noise is normal
//! and independent from one conversion to the next. Off-time is 3 to 9 conversions, so pulses fall on blocks anyhow; one
//! conversion of each pulse is blanked. The classifier knows the levels and the noise, and nothing of the wait.

use edm_hal_shim::gap::{BLOCK, GapBlock};
use edm_servo_head::gap::pulses::{BoundaryConfig, CLASSES, Class, PulseStream};
use edm_servo_head::units::{CLOCK_HZ, Seconds, Volts};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::collections::VecDeque;

/// Labels, in the order of the rows of a confusion matrix.
pub const LABELS: [Class; 4] = [Class::Open, Class::Spark, Class::Arc, Class::Short];

/// What an arc burns at, and a short.
const ARC: Volts = Volts(28.0);
const SHORT: Volts = Volts(5.0);

/// How often a label (row) was given a class (column, in the order of [`Class`]).
pub type Confusion = [[u64; CLASSES]; LABELS.len()];

/// Pulses of a kind.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    /// Signal to noise of a conversion, relative to what a spark burns at, dB.
    pub snr_db: f64,
    /// Conversions after ignition; of an open pulse, in addition to its wait.
    pub burns: usize,
    /// Longest wait, conversions.
    pub waits: usize,
    /// Conversions that are blanked.
    pub blanking: u32,
    /// Labels that there are.
    pub labels: &'static [Class],
}

impl Case {
    /// Four labels, with waits.
    pub fn new(snr_db: f64, burns: usize) -> Case {
        Case { snr_db, burns, waits: 8, blanking: 1, labels: &LABELS }
    }

    fn config(&self) -> BoundaryConfig {
        let config = BoundaryConfig::default();
        let noise = f64::from(config.spark.0) / 10f64.powf(self.snr_db / 20.0);
        // The gate opens half a conversion before the first.
        let blanking = Seconds((self.blanking * GapBlock::SPACING) as f32 / CLOCK_HZ as f32);
        let short_below = Volts(0.5 * (ARC.0 + SHORT.0));
        // The label is the level's, whatever the wait.
        BoundaryConfig { noise: Volts(noise as f32), blanking, short_below, arc_delay: Seconds(1.0), ..config }
    }

    /// Runs so many pulses of a seed.
    pub fn run(&self, pulses: u64, seed: u64) -> Confusion {
        let config = self.config();
        let mut stream = PulseStream::new(config.build().expect("levels in order"));
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut labels = VecDeque::new();
        let mut confusion = Confusion::default();
        let (mut block, mut at, mut open) = (GapBlock::EMPTY, 0, false);
        let mut convert = |volts: Option<f64>, random: &mut Xoshiro256PlusPlus, labels: &mut VecDeque<usize>| {
            let noise: f64 = StandardNormal.sample(random);
            let volts_noise = volts.unwrap_or(0.0) + f64::from(config.noise.0) * noise;
            let code = f64::from(config.zero) + volts_noise / f64::from(config.volts_per_code);
            block.codes[at] = code.round().clamp(0.0, 4095.0) as u16;
            block.gate |= u32::from(volts.is_some()) << at;
            if volts.is_some() != open {
                open = !open;
                block.gate_edges.push((at as u32 * GapBlock::SPACING) as u16);
            }
            at += 1;
            if at == BLOCK {
                stream.block(&block, |pulse| {
                    let label = labels.pop_front().expect("no more pulses than there were");
                    confusion[label][pulse.class as usize] += 1;
                });
                (block, at) = (GapBlock { gate_was_open: open, ..GapBlock::EMPTY }, 0);
            }
        };
        for _ in 0..pulses {
            let label = self.labels[random.random_range(0..self.labels.len())];
            labels.push_back(LABELS.iter().position(|other| *other == label).expect("a label"));
            let wait = if label == Class::Short { 0 } else { random.random_range(0..=self.waits) };
            let waits = f64::from(config.open.0);
            let burns = match label {
                Class::Spark => config.spark,
                Class::Arc => ARC,
                Class::Short => SHORT,
                _ => config.open,
            };
            for _ in 0..self.blanking {
                let rising = 0.5 * waits;
                convert(Some(rising), &mut random, &mut labels);
            }
            for n in 0..wait + self.burns {
                let volts = if n < wait { waits } else { f64::from(burns.0) };
                convert(Some(volts), &mut random, &mut labels);
            }
            for _ in 0..random.random_range(3..=9) {
                convert(None, &mut random, &mut labels);
            }
        }
        for _ in 0..2 * BLOCK {
            convert(None, &mut random, &mut labels);
        }
        assert!(labels.is_empty(), "{} pulses without a class", labels.len());
        confusion
    }

    /// What the best rule gets right of a label, when it knows when the pulse ignited: the mean against the midway points.
    pub fn bayes(&self, label: Class) -> f64 {
        let config = self.config();
        let deviation = f64::from(config.noise.0) / (self.burns as f64).sqrt();
        let within = |away: f32| normal(0.5 * f64::from(away) / deviation);
        let (open, spark, arc, short) = (config.open.0, config.spark.0, ARC.0, SHORT.0);
        match label {
            Class::Spark => within(open - spark) + within(spark - arc) - 1.0,
            Class::Arc => within(spark - arc) + within(arc - short) - 1.0,
            Class::Short => within(arc - short),
            _ => within(open - spark),
        }
    }
}

/// Share of a normal distribution that lies below so many standard deviations.
fn normal(z: f64) -> f64 {
    0.5 * libm::erfc(-z / std::f64::consts::SQRT_2)
}

fn share(row: &[u64; CLASSES], class: Class) -> f64 {
    row[class as usize] as f64 / row.iter().sum::<u64>().max(1) as f64
}

/// Share of a label that was given its own class.
pub fn recall(confusion: &Confusion, label: Class) -> f64 {
    share(row(confusion, label), label)
}

/// Share of a label that was uncertain.
pub fn uncertain(confusion: &Confusion, label: Class) -> f64 {
    share(row(confusion, label), Class::Uncertain)
}

fn row(confusion: &Confusion, label: Class) -> &[u64; CLASSES] {
    &confusion[LABELS.iter().position(|other| *other == label).expect("a label")]
}

/// Smallest recall of these labels.
pub fn least(confusion: &Confusion, labels: &[Class]) -> f64 {
    labels.iter().map(|label| recall(confusion, *label)).fold(1.0, f64::min)
}

/// 100 kHz, half of it on: two or three conversions in a pulse, and none of them blanked. Pulses, and how many of the arcs
/// and sparks were named arc or spark.
pub fn at_100_khz(pulses: u64) -> (u64, u64) {
    let mut named = 0;
    for burns in [2, 3] {
        let case = Case { snr_db: 20.0, burns, waits: 0, blanking: 0, labels: &[Class::Spark, Class::Arc] };
        let confusion = case.run(pulses / 2, 7 + burns as u64);
        named += [Class::Spark, Class::Arc]
            .iter()
            .map(|label| {
                let row = row(&confusion, *label);
                row[Class::Spark as usize] + row[Class::Arc as usize]
            })
            .sum::<u64>();
    }
    (pulses / 2 * 2, named)
}
