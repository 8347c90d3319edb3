//! Roberts 2014, chapter 7: which of the simulated loops are stable.
//!
//! The thesis does not state the plant of its simulations, only their outcome: position control without a derivative term
//! ran away, with one (0.001) it was stable, and the velocity cascade (P = 20, I = 10) was stable without. This is the same
//! ordering, with the controllers of the core, on the plant measured in section 7.2:
//! R = 12.4 ohm, K = 7.5 (N/A and V/(m/s)), L = 3 mH (assumed), m = 0.2 kg, no friction, no weight.
//!
//! Closed by a proportional gain P (V/m) on position, its characteristic equation is
//! L m s^3 + R m s^2 + K^2 s + K P = 0, stable by Routh for P < R K / L = 31 000 V/m.
//!
//! Positions are in the thesis' units, taken as 0.1 mm: a step from 55 to 60, an erosion ramp of 0.5/s, noise of +-0.2 or
//! +-0.5.

use edm_servo_head::servo::{Pid, PidGains, Window};
use edm_servo_head::units::{TICK_HZ, TICK_S};

const RESISTANCE: f64 = 12.4;
const INDUCTANCE: f64 = 3e-3;
const K: f64 = 7.5;
const MASS: f64 = 0.2;
const METRES_PER_UNIT: f64 = 1e-4;
/// Routh's bound on the proportional gain, volts per unit.
const BOUND: f64 = RESISTANCE * K / INDUCTANCE * METRES_PER_UNIT;

/// The actuator, fed with a voltage; no limit, since stability is in question.
#[derive(Default)]
struct Actuator {
    current: f64,
    velocity: f64,
    position: f64,
}

impl Actuator {
    fn advance(&mut self, volts: f64) {
        const STEPS: u32 = 20;
        let dt = f64::from(TICK_S) / f64::from(STEPS);
        for _ in 0..STEPS {
            self.current += (volts - K * self.velocity - RESISTANCE * self.current) / INDUCTANCE * dt;
            self.velocity += K * self.current / MASS * dt;
            self.position += self.velocity * dt;
        }
    }

    fn units(&self) -> f32 {
        (self.position / METRES_PER_UNIT) as f32
    }
}

enum Loop {
    /// Position error -> volts.
    Position(PidGains),
    /// Position error -> velocity command (units/s per unit) -> volts.
    Cascade(f32, PidGains),
}

fn gains(p: f64, i: f64, d: f64) -> PidGains {
    PidGains { p: p as f32, i: i as f32 * TICK_S, d: d as f32, integral_error: f32::MAX, integral: f32::MAX }
}

/// Largest distance from the moving setpoint in the last of `seconds`; infinite once it has run away.
fn error_at_the_end(controller: Loop, noise: f32, seconds: u32) -> f32 {
    const FREE: Window = Window { low: -1e6, high: 1e6 };
    let mut actuator = Actuator { position: 55.0 * METRES_PER_UNIT, ..Actuator::default() };
    let mut pid = Pid::default();
    let mut random = 1u32;
    let mut worst = 0.0f32;
    for tick in 0..seconds * TICK_HZ {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        // Roberts' generator holds a value for a while; 1 kHz here.
        let wobble = if tick % 20 == 0 { noise * (random.cast_signed() as f32 / i32::MAX as f32) } else { 0.0 };
        let setpoint = 60.0 + 0.5 * tick as f32 * TICK_S;
        let error = setpoint + wobble - actuator.units();
        let volts = match &controller {
            Loop::Position(gains) => pid.update(gains, error, 0.0, FREE).value,
            Loop::Cascade(per_unit, gains) => {
                let velocity = (actuator.velocity / METRES_PER_UNIT) as f32;
                pid.update(gains, per_unit * error - velocity, 0.0, FREE).value
            }
        };
        actuator.advance(f64::from(volts));
        let off = (setpoint - actuator.units()).abs();
        if off.is_nan() || off > 1e3 {
            return f32::INFINITY;
        }
        if tick >= (seconds - 1) * TICK_HZ {
            worst = worst.max(off);
        }
    }
    worst
}

/// P = 20 and I = 10 of section 7.1.2, per m/s of velocity error.
fn cascade(per_unit: f32) -> Loop {
    Loop::Cascade(per_unit, gains(20.0 * METRES_PER_UNIT, 10.0 * METRES_PER_UNIT, 0.0))
}

#[test]
fn position_control_without_derivative_is_unstable_beyond_rouths_bound_and_stable_below() {
    let at = |share: f64| error_at_the_end(Loop::Position(gains(share * BOUND, 0.0, 0.0)), 0.0, 4);
    assert!(at(0.7) < 0.2, "{}", at(0.7));
    assert_eq!(at(1.4), f32::INFINITY);
}

#[test]
fn a_derivative_term_of_0_001_makes_the_runaway_loop_stable() {
    let p = 1.4 * BOUND;
    let with = |d: f64, noise| error_at_the_end(Loop::Position(gains(p, 0.0, d * p)), noise, 4);
    assert_eq!(with(0.0, 0.0), f32::INFINITY);
    assert_eq!(with(0.000_01, 0.0), f32::INFINITY, "a hundredth of it is not enough");
    assert!(with(0.001, 0.0) < 0.05);
}

#[test]
fn the_velocity_cascade_is_stable_without_derivative_and_follows_through_noise() {
    let quiet = error_at_the_end(cascade(20.0), 0.0, 8);
    let small = error_at_the_end(cascade(20.0), 0.2, 8);
    let large = error_at_the_end(cascade(20.0), 0.5, 8);
    assert!(quiet < 0.1, "{quiet}");
    assert!(quiet < small && small < large, "{quiet} {small} {large}");
    assert!(large < 0.5, "the loop averages the noise: {large}");
}

#[test]
fn the_velocity_cascade_too_has_a_bound_and_it_is_far_away() {
    // Routh, the small integral part left out: c < R (K + P) / (L P), 5 700 1/s against the 20 1/s that do the work.
    let bound = (RESISTANCE * (K + 20.0) / (INDUCTANCE * 20.0)) as f32;
    assert!(error_at_the_end(cascade(0.8 * bound), 0.0, 4) < 0.1);
    assert_eq!(error_at_the_end(cascade(1.3 * bound), 0.0, 4), f32::INFINITY);
}
