//! One second-order state-variable section in zero-delay (TPT) form.
//!
//! Two trapezoidal integrators in a loop that is solved within the tick: the bilinear transform, with its frequency
//! prewarped, of `1 / (s^2 + k s + 1)` (low-pass) and `(s^2 + 1) / (s^2 + k s + 1)` (notch); `scipy.signal` designs the
//! same filters. Terms: the *damping* k is 1/Q; *band* and *low* are the two integrators.
//!
//! Why this form: at 20 Hz of 20 kHz the poles lie within 0.7 % of 1. There the coefficients of a direct form cancel to
//! almost nothing, and f32 leaves errors above one converter code. Here each coefficient is small by itself and keeps
//! its full precision, and the zero of the notch stays on the unit circle however they are rounded.
//!
//! A tick has three parts, [`State::rest`], [`State::respond`] and a commit, so that [`chain`](super::chain) can stagger
//! its sections: the Cortex-M4 stalls when an instruction needs the result of the one before.

use crate::units::{Hertz, TICK_HZ};

/// What a section multiplies by; built between ticks.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Coefficients {
    /// Gain of an integrator over half a tick: tan(pi f / tick rate).
    g: f32,
    /// g + k.
    r: f32,
    /// g / (1 + g (g + k)): solves the loop.
    b: f32,
}

impl Coefficients {
    /// A low-pass of natural frequency `frequency`, above 0 and up to 2000 Hz, and `damping` 1/Q.
    pub fn low_pass(frequency: Hertz, damping: f32) -> Self {
        Self::solve(gain(frequency), damping)
    }

    /// A notch at `frequency`, above 0 and up to 2000 Hz, with its -3 dB corners `frequency / q` apart.
    ///
    /// As in `scipy.signal.iirnotch` the distance of the corners is prewarped too:
    /// k = tan(pi f / (q fs)) (1 + g^2) / g, which at 50 Hz is 1/q but for 4 parts in 10^5.
    pub fn notch(frequency: Hertz, q: f32) -> Self {
        let g = gain(frequency);
        Self::solve(g, gain(Hertz(frequency.0 / q)) * (1.0 + g * g) / g)
    }

    fn solve(g: f32, k: f32) -> Self {
        let r = g + k;
        Self { g, r, b: g / (1.0 + g * r) }
    }
}

fn gain(frequency: Hertz) -> f32 {
    tan(frequency.0 * (core::f32::consts::PI / TICK_HZ as f32))
}

/// Tangent, 0..=0.33 rad: Lambert's continued fraction cut after the 9, where f32 rounding outweighs what is missing
/// (1e-10 of the value). The same bits on every machine; micromath's approximations are too coarse for a corner.
fn tan(x: f32) -> f32 {
    let xx = x * x;
    x / (1.0 - xx / (3.0 - xx / (5.0 - xx / (7.0 - xx / 9.0))))
}

/// What a section remembers, in the unit of its input.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct State {
    band: f32,
    low: f32,
    /// What the sum in `low` could not hold.
    lost: f32,
}

/// What a tick does to a section.
#[derive(Clone, Copy, Debug)]
pub struct Response {
    /// Rise of *band* over each half of the tick.
    band_rise: f32,
    /// *band* in the middle of the tick.
    band: f32,
    /// Rise of *low* over each half of the tick.
    low_rise: f32,
}

impl State {
    /// A section that has seen `x` for ever.
    pub fn settled(x: f32) -> Self {
        Self { low: x, ..Self::default() }
    }

    /// *low*: the input without what is faster than the section.
    pub fn low(&self) -> f32 {
        self.low
    }

    /// The input under which *band* would not move; known before the input is.
    #[inline]
    pub fn rest(&self, c: &Coefficients) -> f32 {
        self.low + c.r * self.band
    }

    /// Answers an input that lies `push` above [`State::rest`].
    #[inline]
    pub fn respond(&self, c: &Coefficients, push: f32) -> Response {
        let band_rise = c.b * push;
        let band = self.band + band_rise;
        Response { band_rise, band, low_rise: c.g * band }
    }

    /// Low-pass output.
    #[inline]
    pub fn low_pass(&self, r: &Response) -> f32 {
        self.low + r.low_rise
    }

    /// Ends the tick of a low-pass.
    ///
    /// Close to rest the last steps of *low* are smaller than half its last digit: a plain sum would stop 0.05 codes
    /// short at 20 Hz. What the sum cannot hold is carried over to the next tick (Kahan).
    #[inline]
    pub fn commit_low_pass(&mut self, r: &Response) {
        self.band = r.band + r.band_rise;
        let step = (r.low_rise + r.low_rise) + self.lost;
        let low = self.low + step;
        self.lost = step - (low - self.low);
        self.low = low;
    }

    /// Ends the tick of a notch, whose frequency and Q are such that a plain sum stops within 0.01/Q codes.
    #[inline]
    pub fn commit_notch(&mut self, r: &Response) {
        self.band = r.band + r.band_rise;
        self.low += r.low_rise + r.low_rise;
    }

    /// Goes on with other coefficients.
    ///
    /// *low* has the unit of the signal and stays. *band* is the slope of *low* over the frequency: when the frequency
    /// rises it shrinks, so that the slope stays; when the frequency falls it stays, and the slope falls, because
    /// stretching it would stretch the noise in it as well.
    pub fn retune(&mut self, old: &Coefficients, new: &Coefficients) {
        if new.g > old.g {
            self.band *= old.g / new.g;
        }
    }

    /// Multiplies everything remembered by `ratio`, for an input whose unit changes.
    pub fn scale(&mut self, ratio: f32) {
        self.band *= ratio;
        self.low *= ratio;
        self.lost *= ratio;
    }
}

/// Notch output for the input `x` that led to `r`.
#[inline]
pub fn notch(c: &Coefficients, x: f32, r: &Response) -> f32 {
    x - (c.r - c.g) * r.band
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::vec::Vec;

    #[test]
    fn the_tangent_is_right_to_the_last_two_bits_of_f32() {
        for i in 1..=33_000 {
            let x = i as f32 * 1e-5;
            let exact = f64::from(x).tan();
            assert!((f64::from(tan(x)) / exact - 1.0).abs() < 2.0 * f64::from(f32::EPSILON), "tan({x})");
        }
        assert_eq!(tan(0.0), 0.0);
    }

    #[test]
    fn coefficients_keep_their_precision_down_to_the_lowest_corner() {
        for hz in [20.0, 50.0, 200.0, 2000.0] {
            for q in [0.5, 2.5, 30.0] {
                let c = Coefficients::notch(Hertz(hz), q);
                let half_angle = |f: f64| core::f64::consts::PI * f / f64::from(TICK_HZ);
                let g = half_angle(f64::from(hz)).tan();
                let k = half_angle(f64::from(hz) / f64::from(q)).tan() * (1.0 + g * g) / g;
                for (got, exact) in [(c.g, g), (c.r, g + k), (c.b, g / (1.0 + g * (g + k)))] {
                    assert!((f64::from(got) / exact - 1.0).abs() < 5e-7, "{hz} Hz, Q {q}: {got} for {exact}");
                }
            }
        }
    }

    fn low_pass(c: &Coefficients, start: f32, input: &[f32], commit: fn(&mut State, &Response)) -> Vec<f32> {
        let mut state = State::settled(start);
        let tick = |&x: &f32| {
            let response = state.respond(c, x - state.rest(c));
            let y = state.low_pass(&response);
            commit(&mut state, &response);
            y
        };
        input.iter().map(tick).collect()
    }

    #[test]
    fn a_low_pass_is_the_bilinear_transform_of_its_prototype() {
        // Difference equation of 1 / (s^2 + k s + 1) with s = (1 - 1/z) / (1 + 1/z) / g, in f64.
        let (hz, k) = (300.0, 0.7);
        let g = (core::f64::consts::PI * hz / f64::from(TICK_HZ)).tan();
        let a0 = 1.0 + g * k + g * g;
        let (a1, a2) = (2.0 * (g * g - 1.0) / a0, (1.0 - g * k + g * g) / a0);
        let (mut x, mut y) = ([0.0; 3], [0.0; 3]);
        let input: Vec<f32> = (0..2000).map(|n| if n % 700 < 350 { 3000.0 } else { 500.0 }).collect();
        let c = Coefficients::low_pass(Hertz(hz as f32), k as f32);
        for (&sample, got) in input.iter().zip(low_pass(&c, 0.0, &input, State::commit_low_pass)) {
            x = [f64::from(sample), x[0], x[1]];
            y = [g * g / a0 * (x[0] + 2.0 * x[1] + x[2]) - a1 * y[0] - a2 * y[1], y[0], y[1]];
            assert!((f64::from(got) - y[0]).abs() < 0.003, "{got} for {}", y[0]);
        }
    }

    #[test]
    fn a_20_hz_low_pass_follows_a_step_so_small_that_a_plain_sum_would_lose_it() {
        let c = Coefficients::low_pass(Hertz(20.0), 1.85);
        let input = [4095.03; 40_000];
        let end = |commit| low_pass(&c, 4095.0, &input, commit).last().unwrap() - 4095.03;
        assert!(end(State::commit_low_pass).abs() < 5e-4, "{}", end(State::commit_low_pass));
        assert!(end(State::commit_notch) < -0.025, "{}", end(State::commit_notch));
    }

    #[test]
    fn a_rising_frequency_keeps_the_slope_and_a_falling_one_does_not_raise_it() {
        let (slow, fast) = (Coefficients::low_pass(Hertz(20.0), 1.0), Coefficients::low_pass(Hertz(200.0), 1.0));
        let slope = |s: &State, c: &Coefficients| s.band * c.g;
        let start = State { band: 10.0, low: 500.0, lost: 0.0 };
        let mut s = start;
        s.retune(&slow, &fast);
        assert!((slope(&s, &fast) / slope(&start, &slow) - 1.0).abs() < 1e-6);
        let mut s = start;
        s.retune(&fast, &slow);
        assert_eq!(s, start);
    }
}
