//! Hum of drifting frequency, through a tracking notch and a fixed one.

use edm_servo_head::dsp::chain::{Coefficients, Config, State, Tracked};
use edm_servo_head::units::{Hertz, TICK_HZ};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::f64::consts::TAU;

/// Least attenuation of the drifting hum, dB.
pub const BOUND_DB: f64 = 40.0;
/// How far a notch may go without hum, Hz: so far off one of Q 2.5 still takes out 40 dB.
pub const WANDERING_HZ: f64 = 0.1;
/// How far it drifts either way, Hz, and how fast, Hz/s.
const DRIFT: (f64, f64) = (0.5, 0.1);
/// Time to find the hum, and to be measured, s: three times there and back.
const SECONDS: (usize, usize) = (10, 60);
const SECOND: usize = TICK_HZ as usize;

/// A hum on a gap voltage.
pub struct Case {
    /// In words.
    pub name: &'static str,
    /// About which frequency it drifts, and to which the notch is set at first, Hz.
    mains: f64,
    set_hz: f32,
    /// Its amplitude, and the standard deviation of the noise from one tick to the next, codes.
    hum: f64,
    noise: f64,
}

/// What is measured.
pub const CASES: [Case; 4] = [
    Case { name: "50 Hz, 10 V of hum alone", mains: 50.0, set_hz: 50.0, hum: 100.0, noise: 0.0 },
    Case { name: "60 Hz, 10 V of hum, set to 50 Hz", mains: 60.0, set_hz: 50.0, hum: 100.0, noise: 0.0 },
    Case { name: "50 Hz, 10 V of hum, noise of 6 V", mains: 50.0, set_hz: 50.0, hum: 100.0, noise: 60.0 },
    Case { name: "50 Hz, 2 V of hum, noise of 6 V", mains: 50.0, set_hz: 50.0, hum: 20.0, noise: 60.0 },
];

/// Result of a case, dB: the smallest attenuation of any second.
pub struct Attenuation {
    /// Of the notch that follows.
    pub tracked: f64,
    /// Of the same notch at rest at the middle frequency.
    pub fixed: f64,
}

/// Runs a case. The filter is linear in what it filters, so what the hum leaves is the difference from a second one that is moved
/// in the same way and gets the same noise without it.
pub fn attenuation(case: &Case) -> Attenuation {
    let config = |mains: f32| Config { mains: Hertz(mains), ..Config::default() };
    let mut tracked = Tracked::new(follows(config(case.set_hz)));
    let fixed = config(case.mains as f32).build().expect("a mains frequency");
    let mut states = [State::settled(1000.0); 3];
    let mut random = Xoshiro256PlusPlus::seed_from_u64(5);
    let (mut phase, mut hertz, mut rate) = (0.0f64, case.mains, DRIFT.1);
    let (mut left, mut worst) = ([0.0; 2], [0.0f64; 2]);
    for n in 0..(SECONDS.0 + SECONDS.1) * SECOND {
        hertz += rate / SECOND as f64;
        if (hertz - case.mains).abs() > DRIFT.0 {
            rate = DRIFT.1.copysign(case.mains - hertz);
        }
        phase = (phase + hertz / SECOND as f64).fract();
        let noise: f64 = StandardNormal.sample(&mut random);
        let bare = 1000.0 + case.noise * noise;
        let hum = case.hum * (TAU * phase).sin();
        let [with, without, at_rest] = &mut states;
        let before = *tracked.coefficients();
        let difference = tracked.tick(with, (bare + hum) as f32) - without.tick(&before, bare as f32);
        let rest = at_rest.tick(&fixed, (1000.0 + hum) as f32) - 1000.0;
        for (sum, left) in left.iter_mut().zip([difference, rest]) {
            *sum += f64::from(left).powi(2);
        }
        if n % SECOND == SECOND - 1 {
            for (worst, sum) in worst.iter_mut().zip(std::mem::take(&mut left)) {
                *worst = if n >= SECONDS.0 * SECOND { worst.max(sum / SECOND as f64) } else { *worst };
            }
        }
    }
    let [tracked, fixed] = worst.map(|left| -10.0 * (left / (case.hum * case.hum / 2.0)).log10());
    Attenuation { tracked, fixed }
}

/// How far a notch at 50 Hz goes away without hum in a minute, Hz: the most of some seeds, with white noise of 6 V a tick.
pub fn wandering_hz(seeds: u64) -> f64 {
    let wander = |seed| {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut tracked = Tracked::new(follows(Config::default()));
        let mut state = State::settled(1000.0);
        let mut most = 0.0f64;
        for _ in 0..60 * SECOND {
            let noise: f64 = StandardNormal.sample(&mut random);
            tracked.tick(&mut state, (1000.0 + 60.0 * noise) as f32);
            most = most.max((f64::from(tracked.mains().0) - 50.0).abs());
        }
        most
    };
    (0..seeds).map(wander).fold(0.0, f64::max)
}

/// Group delay at a frequency, ms: of the low-pass of 200 Hz with the notch of Q 2.5 at 50 Hz, and of the notch alone. It is
/// that of the continuous filters, from which the sampled ones differ by a tick at most.
pub fn group_delay_ms(hertz: f64) -> [f64; 2] {
    let phase = |f: f64, centre: f64, damping: f64| {
        let w = f / centre;
        (damping * w).atan2(1.0 - w * w)
    };
    let delay = |centre: f64, damping: f64| {
        let step = 1e-3;
        (phase(hertz + step, centre, damping) - phase(hertz - step, centre, damping)) / (2.0 * step * TAU) * 1000.0
    };
    let eighth = TAU / 16.0;
    let low_pass = delay(200.0, 2.0 * eighth.cos()) + delay(200.0, 2.0 * (3.0 * eighth).cos());
    let notch = delay(50.0, 1.0 / 2.5);
    [low_pass + notch, notch]
}

fn follows(config: Config) -> Coefficients {
    Config { follow: true, ..config }.build().expect("a mains frequency")
}
