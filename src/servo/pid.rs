//! P, PI or PID with anti-windup on both sides.
//!
//! The integrator stops only while the output (or the integral itself) is at a limit *and* the error would push it
//! further; an error of the other sign always brings it back. The error that enters the integrator is clipped as well
//! (\[R\] section 6.6.1).

use super::Window;
use crate::units::{TICK_HZ, rare, within_either};

/// Gains, in output per unit of error.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PidGains {
    /// Proportional.
    pub p: f32,
    /// Integral, per tick.
    pub i: f32,
    /// Derivative, seconds.
    pub d: f32,
    /// Largest error that enters the integrator.
    pub integral_error: f32,
    /// Largest integral, in output units.
    pub integral: f32,
}

/// What a controller gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Output {
    /// Inside the window.
    pub value: f32,
    /// At one of its ends.
    pub limited: bool,
}

impl Output {
    /// The nearest that a window allows.
    pub fn new(wanted: f32, window: Window) -> Output {
        let value = window.clamp(wanted);
        Output { value, limited: value <= window.low || value >= window.high }
    }
}

/// State of one controller.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Pid {
    integral: f32,
    last: Option<f32>,
}

impl Pid {
    /// Output for this tick: controller plus `offset`, inside `window`.
    pub fn update(&mut self, gains: &PidGains, error: f32, offset: f32, window: Window) -> Output {
        let slope = self.last.map_or(0.0, |last| (error - last) * TICK_HZ as f32);
        self.last = Some(error);
        self.update_pi(gains, error, offset + gains.d * slope, window)
    }

    /// As [`Pid::update`], without the derivative: what a velocity loop runs.
    #[inline]
    pub fn update_pi(&mut self, gains: &PidGains, error: f32, offset: f32, window: Window) -> Output {
        let rest = gains.p * error + offset;
        let clipped = within_either(error, gains.integral_error);
        let integral = within_either(self.integral + gains.i * clipped, gains.integral);
        let free = rest + integral;
        if free > window.low && free < window.high {
            // The usual case, and the cheap one: nothing to clamp.
            self.integral = integral;
            return Output { value: free, limited: false };
        }
        rare();
        let above = free >= window.high;
        let end = if above { window.high } else { window.low };
        let pushes = free != end && if above { integral > self.integral } else { integral < self.integral };
        let wanted = if pushes {
            rest + self.integral
        } else {
            self.integral = integral;
            free
        };
        let beyond = if above { wanted >= end } else { wanted <= end };
        if beyond { Output { value: end, limited: true } } else { Output::new(wanted, window) }
    }

    /// Forgets integral and slope.
    pub fn reset(&mut self) {
        *self = Pid::default();
    }

    /// The integral, in output units.
    pub fn integral(&self) -> f32 {
        self.integral
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::TICK_S;

    const GAINS: PidGains = PidGains { p: 1.0, i: 100.0 * TICK_S, d: 0.0, integral_error: 10.0, integral: 5.0 };
    const WIDE: Window = Window { low: -100.0, high: 100.0 };

    #[test]
    fn a_lasting_error_is_integrated_at_its_rate() {
        let mut pid = Pid::default();
        for _ in 0..100 {
            pid.update(&GAINS, 1.0, 0.0, WIDE);
        }
        assert!((pid.integral() - 0.5).abs() < 1e-4);
    }

    #[test]
    fn the_integral_stops_at_its_limit_and_leaves_it_at_once() {
        for sign in [1.0f32, -1.0] {
            let mut pid = Pid::default();
            for _ in 0..100_000 {
                pid.update(&GAINS, sign, 0.0, WIDE);
            }
            assert_eq!(pid.integral(), 5.0 * sign);
            pid.update(&GAINS, -sign, 0.0, WIDE);
            assert!(pid.integral() * sign < 5.0);
        }
    }

    #[test]
    fn a_saturated_output_does_not_wind_up_on_either_side() {
        for sign in [1.0f32, -1.0] {
            let mut pid = Pid::default();
            let window = Window::symmetric(2.0);
            for _ in 0..100_000 {
                let output = pid.update(&GAINS, 3.0 * sign, 0.0, window);
                assert_eq!(output, Output { value: 2.0 * sign, limited: true });
            }
            assert_eq!(pid.integral(), 0.0, "the proportional part alone saturates");
            // Released: the output follows at once, with nothing to unwind.
            let released = pid.update(&GAINS, 0.0, 0.0, window);
            assert!(released.value.abs() < 0.02 && !released.limited);
            // And an error of the other sign still integrates while the output is saturated by the offset.
            pid.update(&GAINS, -sign, 10.0 * sign, window);
            assert!(pid.integral() * sign < 0.0);
        }
    }

    #[test]
    fn a_huge_error_enters_the_integrator_clipped() {
        let mut pid = Pid::default();
        pid.update(&GAINS, 50.0, 0.0, WIDE);
        assert!((pid.integral() - 10.0 * 100.0 * TICK_S).abs() < 1e-6);
    }

    #[test]
    fn the_first_error_has_no_slope() {
        let mut pid = Pid::default();
        let gains = PidGains { d: 1.0, i: 0.0, ..GAINS };
        assert_eq!(pid.update(&gains, 5.0, 0.0, WIDE).value, 5.0);
        assert_eq!(pid.update(&gains, 5.001, 0.0, WIDE).value.round(), 25.0);
    }
}
