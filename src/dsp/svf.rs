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
//! The arithmetic of a sample is [`gap_filter`](edm_hal_shim::gap_filter); here the coefficients are designed.

use crate::units::{Hertz, TICK_HZ};

pub use edm_hal_shim::gap_filter::{Coefficients, State};

/// A low-pass of natural frequency `frequency`, above 0 and up to 2000 Hz, and `damping` 1/Q.
pub fn low_pass(frequency: Hertz, damping: f32) -> Coefficients {
    solve(gain(frequency), damping)
}

/// A notch at `frequency`, above 0 and up to 2000 Hz, with its -3 dB corners `frequency / q` apart.
///
/// As in `scipy.signal.iirnotch` the distance of the corners is prewarped too:
/// k = tan(pi f / (q fs)) (1 + g^2) / g, which at 50 Hz is 1/q but for 4 parts in 10^5.
pub fn notch(frequency: Hertz, q: f32) -> Coefficients {
    let g = gain(frequency);
    solve(g, gain(Hertz(frequency.0 / q)) * (1.0 + g * g) / g)
}

/// Q of a notch that is moved in a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(super) struct Width {
    /// 1/q.
    inverse_q: f32,
    /// By how much the damping grows with the square of the half-angle.
    grows: f32,
}

impl Width {
    /// Its numbers, to compare them.
    pub fn each(&self) -> [f32; 2] {
        [self.inverse_q, self.grows]
    }

    /// Of a Q from 0.5 on.
    pub fn new(q: f32) -> Width {
        let inverse_q = 1.0 / q;
        Width { inverse_q, grows: inverse_q * (inverse_q * inverse_q + 2.0) * (1.0 / 3.0) }
    }
}

/// [`notch`] cheaply enough for a tick, at a half-angle (pi f / tick rate) x of 0.002..=0.021 rad.
///
/// tan x = x + x^3/3 and k = tan(x/q) (1 + tan^2 x) / tan x = 1/q (1 + x^2 (1/q^2 + 2)/3). What is left out of k is 5e-7 of it at
/// q = 0.5 and 130 Hz, and less than f32 rounds from q = 1 on.
#[inline]
pub(super) fn slow_notch(x: f32, width: &Width) -> Coefficients {
    let xx = x * x;
    solve(x + x * xx * (1.0 / 3.0), width.inverse_q + xx * width.grows)
}

fn solve(g: f32, k: f32) -> Coefficients {
    let r = g + k;
    Coefficients { r, b: g / (1.0 + g * r), g }
}

/// Gain of an integrator over half a tick: tan(pi f / tick rate).
fn gain(frequency: Hertz) -> f32 {
    tan(frequency.0 * (core::f32::consts::PI / TICK_HZ as f32))
}

/// Tangent, 0..=0.33 rad: Lambert's continued fraction cut after the 9, where f32 rounding outweighs what is missing
/// (1e-10 of the value). The same bits on every machine; micromath's approximations are too coarse for a corner.
fn tan(x: f32) -> f32 {
    let xx = x * x;
    x / (1.0 - xx / (3.0 - xx / (5.0 - xx / (7.0 - xx / 9.0))))
}

/// A section that has settled at `x`.
pub fn settled(x: f32) -> State {
    State { low: x, ..State::default() }
}

/// Goes on with other coefficients.
///
/// *low* has the unit of the signal and stays. *band* is the slope of *low* over the frequency: when the frequency
/// rises it shrinks, so that the slope stays; when the frequency falls it stays, and the slope falls, because
/// stretching it would stretch the noise in it as well.
pub fn retune(state: &mut State, old: &Coefficients, new: &Coefficients) {
    if new.g > old.g {
        state.band *= old.g / new.g;
    }
}

/// Multiplies everything remembered by `ratio`, for an input whose unit changes.
pub fn scale(state: &mut State, ratio: f32) {
    state.band *= ratio;
    state.low *= ratio;
    state.lost *= ratio;
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
                let c = notch(Hertz(hz), q);
                let half_angle = |f: f64| core::f64::consts::PI * f / f64::from(TICK_HZ);
                let g = half_angle(f64::from(hz)).tan();
                let k = half_angle(f64::from(hz) / f64::from(q)).tan() * (1.0 + g * g) / g;
                for (got, exact) in [(c.g, g), (c.r, g + k), (c.b, g / (1.0 + g * (g + k)))] {
                    assert!((f64::from(got) / exact - 1.0).abs() < 5e-7, "{hz} Hz, Q {q}: {got} for {exact}");
                }
            }
        }
    }

    #[test]
    fn a_notch_for_a_tick_is_the_same_notch() {
        for (hz, q) in (90..=260).flat_map(|half| [0.5, 1.0, 2.5, 30.0].map(|q| (half as f32 * 0.5, q))) {
            let (exact, cheap) =
                (notch(Hertz(hz), q), slow_notch(hz * (core::f32::consts::PI / TICK_HZ as f32), &Width::new(q)));
            for (exact, cheap) in [(exact.r, cheap.r), (exact.b, cheap.b), (exact.g, cheap.g)] {
                assert!(
                    (cheap / exact - 1.0).abs() < if q < 1.0 { 8e-7 } else { 5e-7 },
                    "{hz} Hz, Q {q}: {cheap} for {exact}"
                );
            }
        }
    }

    fn filtered(c: &Coefficients, start: f32, input: &[f32], keep: bool) -> Vec<f32> {
        let mut state = settled(start);
        let tick = |&x: &f32| {
            let y = state.low_pass(c, x);
            if !keep {
                state.lost = 0.0;
            }
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
        let c = low_pass(Hertz(hz as f32), k as f32);
        for (&sample, got) in input.iter().zip(filtered(&c, 0.0, &input, true)) {
            x = [f64::from(sample), x[0], x[1]];
            y = [g * g / a0 * (x[0] + 2.0 * x[1] + x[2]) - a1 * y[0] - a2 * y[1], y[0], y[1]];
            assert!((f64::from(got) - y[0]).abs() < 0.003, "{got} for {}", y[0]);
        }
    }

    #[test]
    fn a_20_hz_low_pass_follows_a_step_so_small_that_a_plain_sum_would_lose_it() {
        let c = low_pass(Hertz(20.0), 1.85);
        let input = [4095.03; 40_000];
        let end = |keep| filtered(&c, 4095.0, &input, keep).last().unwrap() - 4095.03;
        assert!(end(true).abs() < 5e-4, "{}", end(true));
        assert!(end(false) < -0.025, "{}", end(false));
    }

    #[test]
    fn a_rising_frequency_keeps_the_slope_and_a_falling_one_does_not_raise_it() {
        let (slow, fast) = (low_pass(Hertz(20.0), 1.0), low_pass(Hertz(200.0), 1.0));
        let slope = |s: &State, c: &Coefficients| s.band * c.g;
        let start = State { band: 10.0, low: 500.0, lost: 0.0 };
        let mut s = start;
        retune(&mut s, &slow, &fast);
        assert!((slope(&s, &fast) / slope(&start, &slow) - 1.0).abs() < 1e-6);
        let mut s = start;
        retune(&mut s, &fast, &slow);
        assert_eq!(s, start);
    }
}
