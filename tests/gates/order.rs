//! Order of the model that a gap needs, by the test of \[X\] section 3: the electrode steps by an inverse M-sequence of 0 and 10 um, a step a
//! period of 100 ms, about a place that follows the erosion. An inverse M-sequence is one of which every other bit is turned over, so that its
//! mean is zero. Over 100 periods the products of the last gaps y and steps u are summed:
//!
//! ```text
//! H(n) = sum h h',  h = [y(k-1), u(k-1), .. y(k-n), u(k-n)],   DR(n) = det H(n) / det H(n+1)
//! ```
//!
//! A model of order n explains y(k-1) by n older pairs; with one pair more than that, H is singular but for noise. So DR rises last at the
//! order (Woodside, Automatica 7, 1971, 727). H is decomposed into L D L': det H(n) is the product of the first 2 n of D.

use super::gate::{Gate, Kind, Wanted};
use super::statistics::{Mean, each};
use edm_process::harness::{Law, Motion, Rig};
use edm_process::parameters::XIN;
use edm_process::random::{Cause, Stream};

/// Largest order that is told from a larger one.
const MOST: usize = 3;
const SIZE: usize = 2 * (MOST + 1);
/// Periods before the first sum, and periods that are summed.
const SETTLES: usize = 16;
const PERIODS: usize = 100;
const PERIOD_S: f64 = 0.1;
/// Gap about which it steps, and a step, um.
const GAP: f64 = 40.0;
const STEP: f64 = 10.0;
/// Rise that is one: noise alone makes up to two (simulated; chosen).
const RISES: f64 = 3.0;
/// Share of a mean, and of a gap that is off, that follows in a period.
const MEAN: f64 = 0.06;
const FOLLOWS: f64 = 0.05;

/// Inverse M-sequence: x^7 + x^6 + 1.
struct Sequence {
    bits: u8,
    turned: bool,
}

impl Iterator for Sequence {
    type Item = bool;

    fn next(&mut self) -> Option<bool> {
        let bit = (self.bits >> 6 ^ self.bits >> 5) & 1;
        self.bits = (self.bits << 1 | bit) & 0x7F;
        self.turned = !self.turned;
        Some((bit == 1) != self.turned)
    }
}

/// Order by gaps and steps, the newest last: of each the difference from its mean.
fn order(pairs: &[[f64; 2]]) -> f64 {
    let mut h = [[0.0; SIZE]; SIZE];
    for window in pairs.windows(MOST + 1) {
        let newest: Vec<f64> = window.iter().rev().flatten().copied().collect();
        for (row, x) in h.iter_mut().zip(&newest) {
            row.iter_mut().zip(&newest).for_each(|(sum, y)| *sum += x * y);
        }
    }
    let mut pivots = [0.0; SIZE];
    for n in 0..SIZE {
        let row = h[n];
        pivots[n] = row[n].max(f64::MIN_POSITIVE);
        for (below, line) in h.iter_mut().enumerate().skip(n + 1) {
            let factor = row[below] / pivots[n];
            line.iter_mut().zip(row).for_each(|(x, above)| *x -= factor * above);
        }
    }
    let pair = |n: usize| pivots[2 * n] * pivots[2 * n + 1];
    // DR(n) = 1 / (pair n).
    let last = (0..MOST).rev().find(|n| pair(*n) >= RISES * pair(n + 1));
    last.map_or(1.0, |n| n as f64 + 1.0)
}

/// Order of the model's gap by one seed, with a gap that is measured to a micrometre rms.
fn found(seed: u64) -> f64 {
    // A law that never moves.
    let still = Law::Tav(f64::INFINITY, f64::NEG_INFINITY);
    let Ok(mut rig) = Rig::new(&XIN.of(), still, Motion::default(), seed) else { return f64::NAN };
    let mut instrument = Stream::new(Cause::Instrument, seed);
    let mut sequence = Sequence { bits: 0x7F, turned: false };
    let (mut up, mut mean) = (false, GAP);
    let mut pairs = Vec::new();
    rig.x += rig.process.gap_um() - GAP;
    for period in 1..=SETTLES + PERIODS {
        rig.run(PERIOD_S * period as f64);
        let gap = rig.process.gap_um() + instrument.step();
        mean += MEAN * (gap - mean);
        let step = if up { 0.5 * STEP } else { -0.5 * STEP };
        pairs.push([gap - mean, step]);
        // An upper step is a narrow gap.
        let next = sequence.next() == Some(true);
        rig.x +=
            STEP * (f64::from(u8::from(next)) - f64::from(u8::from(up))) + (FOLLOWS * (mean - GAP)).clamp(-1.0, 1.0);
        up = next;
    }
    order(&pairs[SETTLES - MOST..])
}

pub fn orders() -> Vec<Gate> {
    // Known ones first: y(k) = a1 y(k-1) + a2 y(k-2) + b0 u(k-1) + b1 u(k-2), with noise of 0.2 um.
    let known = |[a1, a2]: [f64; 2], [b0, b1]: [f64; 2]| {
        let orders = (1..=10).map(|seed| {
            let (mut noise, mut sequence) =
                (Stream::new(Cause::Instrument, seed), Sequence { bits: 0x7F, turned: false });
            let (mut y, mut u) = ([0.0; 2], [0.0; 2]);
            let pairs: Vec<[f64; 2]> = (0..PERIODS)
                .map(|_| {
                    let step = if sequence.next() == Some(true) { 0.5 * STEP } else { -0.5 * STEP };
                    let seen = [y[0] + 0.2 * noise.step(), step];
                    u = [step, u[0]];
                    y = [a1 * y[0] + a2 * y[1] + b0 * u[0] + b1 * u[1], y[0]];
                    seen
                })
                .collect();
            order(&pairs)
        });
        Mean::new(&orders.collect::<Vec<_>>())
    };
    let gate = |kind, name: &str, mean: Mean, wanted: f64, note: &str| {
        Gate::new(kind, name, mean.of, Wanted::Between(wanted, wanted), format!("+- {:.2}; {note}", mean.error))
    };
    let seeds: Vec<u64> = (1..=16).collect();
    vec![
        gate(Kind::Physics, "order of a known gap of order 1", known([0.5, 0.0], [-0.5, 0.0]), 1.0, "10 seeds"),
        gate(Kind::Physics, "order of a known gap of order 2", known([1.2, -0.5], [-0.5, -0.3]), 2.0, "10 seeds"),
        gate(
            Kind::Validation,
            "[X] section 3, order of the gap",
            Mean::new(&each(&seeds, |seed| found(*seed))),
            2.0,
            "mean of 16 seeds",
        ),
    ]
}
