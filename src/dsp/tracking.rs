//! A mains notch that follows the real frequency.
//!
//! The band that a notch takes out (`band` of its section) is the hum, turned by no more than the notch is off. Of it one sample
//! in [`EVERY`] ticks goes into a complex resonator of half width 1 Hz,
//!
//! ```text
//! p = e^(j theta) z        z = rho p + (1 - rho) x
//! ```
//!
//! which a tone of another frequency turns faster or slower than theta, by Im(z p*) / |p|^2 = -(1 - rho) x Im(p) / |p|^2 a sample
//! on average: the gradient by which theta follows (a frequency-locked loop; its two poles have 0.16 and 0.3 s). One
//! sample x takes the place of its average, so what is integrated ripples at twice the mains frequency, by 0.01 Hz.
//!
//! The notch goes after theta only while the resonator has more than half of the power of the band: with less, or without
//! hum, theta may wander, and the notch stays where it is, at the last hum that it knew. It goes at most 5 Hz/s, so that
//! nothing steps; on and off is a change of coefficients like any other.
//!
//! The work is spread over ticks of their own, so that none of them takes long.

use super::svf;
use crate::units::{Hertz, TICK_HZ, within, within_either};
use core::f32::consts::TAU;

/// Ticks from one sample of the hum to the next: 500 Hz. What lies at 450 and 550 Hz is 26 dB down in the band of a notch of
/// Q 2.5, and 25 more behind a low-pass of 200 Hz.
pub const EVERY: u32 = 40;

const SAMPLE_HZ: f32 = TICK_HZ as f32 / EVERY as f32;
/// Of the resonator, each sample.
const FORGET: f32 = TAU * 1.0 / SAMPLE_HZ;
/// Of theta towards the frequency that was seen, each sample: 0.3 s.
const FOLLOW: f32 = 1.0 / (0.3 * SAMPLE_HZ);
/// Of the powers, each sample: 0.3 s.
const SMOOTH: f32 = 1.0 / (0.3 * SAMPLE_HZ);
/// Most that one sample says of theta: 4 Hz.
const MOST: f32 = TAU * 4.0 / SAMPLE_HZ;
/// What the notch goes in a sample at most: 5 Hz/s.
const STEP: f32 = TAU * 5.0 / (SAMPLE_HZ * SAMPLE_HZ);
/// Ends of what is followed, and their middle.
const LOWEST: f32 = TAU * 45.0 / SAMPLE_HZ;
const HIGHEST: f32 = TAU * 65.0 / SAMPLE_HZ;
const MIDDLE: f32 = 0.5 * (LOWEST + HIGHEST);
/// Half-angle of a tick by radians a sample.
const HALF_ANGLE: f32 = 0.5 / EVERY as f32;
/// Cosine and sine of the middle.
const TURNED: [f32; 2] = [0.770_513_24, 0.637_424];
/// Share of the band's power that the hum has to have.
const SHARE: f32 = 0.5;
/// Power of the band, codes^2, below which there is nothing to follow: rounding.
const NOTHING: f32 = 1e-3;

/// Notches that a [`Tracker`] moves.
#[derive(Debug)]
pub struct Notches<'a> {
    /// At the mains frequency.
    pub(super) mains: &'a mut svf::Coefficients,
    /// At twice that, where there is one.
    pub(super) harmonic: Option<&'a mut svf::Coefficients>,
    /// Their Q.
    pub(super) width: svf::Width,
}

/// Finds the hum, and moves the notches.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Tracker {
    /// Ticks since the newest sample.
    turn: u32,
    /// Resonator, and e^(j theta).
    z: [f32; 2],
    rotation: [f32; 2],
    /// Newest sample, what was expected of the resonator, its power, and what they say of theta.
    x: f32,
    p: [f32; 2],
    power: f32,
    error: f32,
    /// Powers of the band and of the resonator.
    band: f32,
    hum: f32,
    /// Where the hum is looked for, and where the notch is: radians a sample.
    theta: f32,
    notch: f32,
    locked: bool,
}

impl Tracker {
    /// Looks for the hum from here on, 45..=65 Hz.
    pub fn new(mains: Hertz) -> Tracker {
        let theta = within(mains.0 * (TAU / SAMPLE_HZ), LOWEST, HIGHEST);
        Tracker {
            turn: 0,
            z: [0.0; 2],
            rotation: rotation(theta),
            x: 0.0,
            p: [0.0; 2],
            power: 0.0,
            error: 0.0,
            band: 0.0,
            hum: 0.0,
            theta,
            notch: theta,
            locked: false,
        }
    }

    /// Where the notch is.
    pub fn mains(&self) -> Hertz {
        Hertz(self.notch * (SAMPLE_HZ / TAU))
    }

    /// Whether there is hum that the notch follows.
    pub fn is_locked(&self) -> bool {
        self.locked
    }

    /// One tick: takes the band of the mains notch as this tick has left it, and moves the notches when it is their turn.
    #[inline]
    pub fn tick(&mut self, band: f32, notches: &mut Notches<'_>) {
        match self.turn {
            0 => self.resonate(band),
            1 => self.compare(),
            2 => self.judge(),
            3 => self.follow(),
            4 => self.rotation = rotation(self.theta),
            5 => *notches.mains = svf::slow_notch(self.notch * HALF_ANGLE, &notches.width),
            6 => {
                if let Some(harmonic) = &mut notches.harmonic {
                    **harmonic = svf::slow_notch(self.notch * (2.0 * HALF_ANGLE), &notches.width);
                }
            }
            _ => {}
        }
        self.turn = if self.turn < EVERY - 1 { self.turn.wrapping_add(1) } else { 0 };
    }

    fn resonate(&mut self, x: f32) {
        let [re, im] = self.z;
        let [cos, sin] = self.rotation;
        let p = [cos * re - sin * im, cos * im + sin * re];
        self.z = [p[0] + FORGET * (x - p[0]), p[1] - FORGET * p[1]];
        (self.p, self.x) = (p, x);
    }

    fn compare(&mut self) {
        let [re, im] = self.p;
        let power = re * re + im * im;
        self.power = power;
        self.error = -FORGET * self.x * im / (power + NOTHING);
    }

    fn judge(&mut self) {
        // 4 |p|^2 is the square of the hum's amplitude.
        self.hum += SMOOTH * (2.0 * self.power - self.hum);
        self.band += SMOOTH * (self.x * self.x - self.band);
        self.locked = self.hum > SHARE * self.band && self.band > NOTHING;
    }

    fn follow(&mut self) {
        self.theta = within(self.theta + FOLLOW * within_either(self.error, MOST), LOWEST, HIGHEST);
        if self.locked {
            self.notch += within_either(self.theta - self.notch, STEP);
        }
    }
}

/// e^(j theta), by Taylor's series about the middle: within 3e-7 at the ends.
fn rotation(theta: f32) -> [f32; 2] {
    let x = theta - MIDDLE;
    let xx = x * x;
    let cos = 1.0 - xx * (0.5 - xx * (1.0 / 24.0));
    let sin = x * (1.0 - xx * (1.0 / 6.0 - xx * (1.0 / 120.0)));
    [TURNED[0] * cos - TURNED[1] * sin, TURNED[1] * cos + TURNED[0] * sin]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::chain::{Config, State, Tracked};
    use rand::{RngExt, SeedableRng};
    use rand_xoshiro::Xoshiro256PlusPlus;

    const SECOND: usize = TICK_HZ as usize;

    #[test]
    fn the_rotation_is_exact_over_what_is_followed() {
        for step in 0..=2000 {
            let theta = LOWEST + (HIGHEST - LOWEST) * step as f32 / 2000.0;
            let [cos, sin] = rotation(theta).map(f64::from);
            let (sin64, cos64) = f64::from(theta).sin_cos();
            assert!((cos - cos64).abs() < 5e-7 && (sin - sin64).abs() < 5e-7, "{theta}: {cos} {sin}");
        }
    }

    /// Runs a filter over what `input` gives for a tick; gives what comes out.
    fn run(tracked: &mut Tracked, state: &mut State, ticks: usize, mut input: impl FnMut(usize) -> f64) -> Vec<f32> {
        (0..ticks).map(|n| tracked.tick(state, input(n) as f32)).collect()
    }

    fn tone(n: usize, hz: f64) -> f64 {
        (core::f64::consts::TAU * hz * n as f64 / SECOND as f64).sin()
    }

    fn filter(mains: f32, second_harmonic: bool) -> Tracked {
        Tracked::new(
            Config { mains: Hertz(mains), second_harmonic, follow: true, ..Config::default() }.build().unwrap(),
        )
    }

    #[test]
    fn hum_of_any_frequency_from_45_to_65_hz_is_found_from_either_mains() {
        for mains in [50.0, 60.0] {
            for hz in [45.2, 48.0, 50.0, 52.5, 55.0, 60.0, 64.8] {
                for amplitude in [1.0, 30.0, 1000.0] {
                    let (mut tracked, mut state) = (filter(mains, false), State::settled(1000.0));
                    run(&mut tracked, &mut state, 12 * SECOND, |n| 1000.0 + amplitude * tone(n, hz));
                    assert!(tracked.is_locked(), "{mains}: {hz} Hz of {amplitude}");
                    let found = tracked.mains().0;
                    assert!((f64::from(found) - hz).abs() < 0.03, "{mains}: {hz} Hz of {amplitude}: {found}");
                }
            }
        }
    }

    #[test]
    fn its_second_harmonic_is_followed_with_it() {
        let (mut tracked, mut state) = (filter(50.0, true), State::settled(1000.0));
        let hum = |n| 1000.0 + 80.0 * tone(n, 51.0) + 80.0 * tone(n, 102.0);
        let y = run(&mut tracked, &mut state, 10 * SECOND, hum);
        let left = y[9 * SECOND..].iter().map(|y| (f64::from(*y) - 1000.0).powi(2)).sum::<f64>() / SECOND as f64;
        assert!(left.sqrt() < 0.8, "{} codes rms of 80", left.sqrt());
    }

    #[test]
    fn without_hum_the_notch_stays_where_it_is() {
        for seed in 0..5 {
            let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
            let (mut tracked, mut state) = (filter(50.0, false), State::settled(1000.0));
            // Noise of every frequency, as sparks make it.
            run(&mut tracked, &mut state, 60 * SECOND, |_| 1000.0 + random.random_range(-300.0..300.0));
            assert_eq!(tracked.mains(), filter(50.0, false).mains(), "{seed}");
        }
        let (mut tracked, mut state) = (filter(50.0, false), State::settled(1000.0));
        run(&mut tracked, &mut state, 10 * SECOND, |_| 1000.0);
        assert_eq!((tracked.mains(), tracked.is_locked()), (filter(50.0, false).mains(), false));
    }

    #[test]
    fn the_notch_stays_at_the_last_hum_that_it_knew() {
        let (mut tracked, mut state) = (filter(50.0, false), State::settled(1000.0));
        run(&mut tracked, &mut state, 10 * SECOND, |n| 1000.0 + 50.0 * tone(n, 50.4));
        let known = tracked.mains().0;
        run(&mut tracked, &mut state, 60 * SECOND, |_| 1000.0);
        assert!(!tracked.is_locked());
        assert!((tracked.mains().0 - known).abs() < 0.05, "{known} to {:?}", tracked.mains());
    }

    #[test]
    fn on_and_off_does_not_move_a_constant_and_makes_no_step_of_hum() {
        let fixed = Config::default().build().unwrap();
        let (mut tracked, mut state) = (filter(50.0, false), State::settled(1000.0));
        let hum = |n: usize| (1000.0 + 100.0 * tone(n, 50.4)) as f32;
        let mut last = 1000.0;
        let mut steepest = [0.0f32; 2];
        for n in 0..20 * SECOND {
            // On for 3 s, off for 3 s.
            let on = (n / (3 * SECOND)).is_multiple_of(2);
            if n.is_multiple_of(3 * SECOND) && n > 0 {
                if on {
                    tracked = filter(50.0, false);
                } else {
                    state.retune(tracked.coefficients(), &fixed);
                }
            }
            let y = if on { tracked.tick(&mut state, hum(n)) } else { state.tick(&fixed, hum(n)) };
            if n > SECOND {
                let away = &mut steepest[usize::from(n % (3 * SECOND) < 100)];
                *away = away.max((y - last).abs());
            }
            last = y;
        }
        // The fixed notch leaves 4 % of the hum: 0.06 codes a tick. Nothing is steeper where it is switched.
        assert!(steepest[1] < 2.0 * steepest[0], "{steepest:?}");
        let (mut tracked, mut state) = (filter(50.0, false), State::settled(1000.0));
        let y = run(&mut tracked, &mut state, 2 * SECOND, |_| 1000.0);
        assert!(y.iter().all(|y| (y - 1000.0).abs() < 0.01));
    }
}
