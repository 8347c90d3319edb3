//! Hazard of ignition from simulated delays: is its variance the smallest that there can be, and the one that it states?
//!
//! Delays are exponential with a known hazard, and cut off by the gate; they are captured in ticks of the core clock. The
//! Cramer-Rao bound of M pulses is hazard^2 / (M p), p the chance that a pulse ignites. *From the start*: M pulses at a memory of
//! 2 M, against the bound of these M. *After long*: against the bound of the 2 memory - 1 pulses that the memory is worth.

use edm_process::Parameters;
use edm_servo_head::gap::likelihood::{Curve, Hazard, Likelihood};
use edm_servo_head::units::{CLOCK_HZ, Micrometres};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// Share of the bound that has to be reached: a variance at most 10 % above it.
pub const EFFICIENCY: f64 = 1.0 / 1.1;
/// Mean square of the error over the stated variance.
pub const CHI2: (f64, f64) = (0.8, 1.2);
/// Pulses of an estimate.
const PULSES: u32 = 500;

/// Pulse rate, kHz; on-time, us; gap, um: those at which the sinkers of docs/process-model.md erode.
pub const CASES: [(f64, f64, f64); 3] = [(1.0, 800.0, 62.0), (5.0, 160.0, 34.0), (100.0, 8.02, 15.0)];

/// What came of a rate.
pub struct Row {
    /// Hazard that there was, 1/s.
    pub hazard: f64,
    /// Share of the pulses that ignite by it.
    pub ignites: f64,
    /// Cramer-Rao bound over the variance: from the start, after long.
    pub efficiency: [f64; 2],
    /// Mean square of the error over the stated variance, likewise.
    pub chi2: [f64; 2],
    /// Standard deviation of the gap that follows after long, and its mean error, um.
    pub gap_um: (f64, f64),
}

/// Hazard of the process model's sinker with a flat, clean face, 1/s: docs/process-model.md, equation 1.
fn hazard(gap_um: f64) -> f64 {
    let p = Parameters::default();
    p.ignition * std::f64::consts::PI * (p.radius_um * 1e-3).powi(2) * (50.0 / gap_um).powi(3)
}

/// Moments of an estimate over the trials.
#[derive(Default)]
struct Trials {
    count: f64,
    error: f64,
    squares: f64,
    chi2: f64,
}

impl Trials {
    fn add(&mut self, known: f64, estimate: &Hazard) {
        let rate = f64::from(estimate.rate);
        self.count += 1.0;
        self.error += rate - known;
        self.squares += (rate - known).powi(2);
        self.chi2 += (rate - known).powi(2) / (f64::from(estimate.variance) * rate * rate);
    }

    fn variance(&self) -> f64 {
        self.squares / self.count - (self.error / self.count).powi(2)
    }
}

/// Runs so many estimates of each kind.
pub fn run((_, on_us, gap_um): (f64, f64, f64), trials: u32) -> Row {
    let known = hazard(gap_um);
    let on = on_us * 1e-6;
    let ignites = 1.0 - (-known * on).exp();
    let curve = Curve::new(Micrometres(50.0), hazard(50.0) as f32, Curve::POWER).expect("a curve in range");
    let mut random = Xoshiro256PlusPlus::seed_from_u64(11);
    let mut pulse = |likelihood: &mut Likelihood, memory: u32| {
        let draw: f64 = random.random();
        let waits = -(1.0 - draw).ln() / known;
        let keep = 1.0 - 1.0 / memory as f32;
        likelihood.step(keep, (waits.min(on) * f64::from(CLOCK_HZ)) as u32, (waits < on).into());
    };
    let mut kinds = [Trials::default(), Trials::default()];
    let mut gaps = (0.0, 0.0);
    let mut long = Likelihood::default();
    (0..10 * PULSES).for_each(|_| pulse(&mut long, PULSES / 2));
    for _ in 0..trials {
        let mut fresh = Likelihood::default();
        (0..PULSES).for_each(|_| pulse(&mut fresh, 2 * PULSES));
        // Until nothing is left of the estimate before.
        (0..4 * PULSES).for_each(|_| pulse(&mut long, PULSES / 2));
        for (kind, likelihood) in kinds.iter_mut().zip([&fresh, &long]) {
            if let Some(hazard) = likelihood.hazard() {
                kind.add(known, &hazard);
            }
        }
        if let Some(hazard) = long.hazard() {
            let error = f64::from(curve.gap(&hazard).0.0) - gap_um;
            gaps = (gaps.0 + error * error, gaps.1 + error);
        }
    }
    let bound = |pulses: u32| known * known / (f64::from(pulses) * ignites);
    let counted = f64::from(trials);
    let mean = gaps.1 / counted;
    Row {
        hazard: known,
        ignites,
        efficiency: [bound(PULSES) / kinds[0].variance(), bound(PULSES - 1) / kinds[1].variance()],
        chi2: kinds.map(|kind| kind.chi2 / kind.count),
        gap_um: ((gaps.0 / counted - mean * mean).sqrt(), mean),
    }
}
