//! Moving coil, its friction and its stops.
//!
//! i = (v - K x')/(R + L s); m x'' = K i - b x' + m g - F_counterbalance - friction + external force [R] section
//! 7.2. x is positive toward the work.
//!
//! Four steps a servo tick. In each the winding is solved exactly for the voltage and the velocity it begins with, and the
//! velocity implicitly in all damping and dry friction, so that neither a thin film of dielectric nor a hard stop can make
//! it unstable; position follows the new velocity, which keeps the energy of a contact from growing. A step of 12.5 us is
//! a twentieth of L/R = 0.24 ms and a radian of the stiffest resonance (20 N/um, 0.2 kg) is 100 us; at 0.5 m/s the head
//! moves 6 um a step, so a film is met before it is passed.

use super::Parameters;
use edm_hal_shim::bridge::Drive;
use edm_servo_head::units::TICK_HZ;

/// Steps in one servo tick.
pub const STEPS: usize = 4;
/// One step, s.
pub const STEP_S: f64 = 1.0 / (TICK_HZ as f64 * STEPS as f64);
const GRAVITY: f64 = 9.80665;
/// Stiffness and damping of the end stops, N/m and N s/m: steel on hard rubber (assumed).
const STOP: (f64, f64) = (2e7, 200.0);
/// With the bridge open the current dies through the diodes against the bus: much faster than L/R (assumed tenfold).
const DIODES: f64 = 10.0;

/// Forces on the moving mass other than the actuator's.
#[derive(Clone, Copy, Debug)]
pub struct Load {
    /// Force, N.
    pub force: f64,
    /// Damping, N s/m.
    pub damping: f64,
    /// Most that this damping can hold back a lift, N.
    pub suction: f64,
}

/// State and constants of the actuator, SI units.
#[derive(Clone, Debug)]
pub struct Actuator {
    /// Position, m.
    pub x: f64,
    /// Velocity, m/s.
    pub v: f64,
    /// Current, A.
    pub i: f64,
    k: f64,
    /// Step over mass, s/kg.
    response: f64,
    /// One over the winding's resistance, A/V.
    conductance: f64,
    decay: f64,
    decay_open: f64,
    friction: f64,
    damping: f64,
    /// Weight less counterbalance, N.
    weight: f64,
    stroke: f64,
    sign: f64,
}

impl Actuator {
    /// At rest at the upper stop.
    pub fn new(p: &Parameters) -> Actuator {
        let resistance = f64::from(p.resistance);
        let rate = resistance / (f64::from(p.inductance) * 1e-3);
        let mass = f64::from(p.mass);
        Actuator {
            x: 0.0,
            v: 0.0,
            i: 0.0,
            k: p.force_constant.into(),
            response: STEP_S / mass,
            conductance: 1.0 / resistance,
            decay: (-rate * STEP_S).exp(),
            decay_open: (-rate * STEP_S * DIODES).exp(),
            friction: p.friction.into(),
            damping: p.damping.into(),
            weight: mass * GRAVITY - f64::from(p.counterbalance),
            stroke: f64::from(p.stroke) * 1e-3,
            sign: if p.motor_reversed { -1.0 } else { 1.0 },
        }
    }

    /// Voltage across the winding, unless it is open, and share of the current that a step leaves.
    fn drive(&self, drive: Drive, bus: f64) -> (Option<f64>, f64) {
        match drive {
            Drive::Coast => (None, self.decay_open),
            Drive::Brake => (Some(0.0), self.decay),
            Drive::Duty(duty) => (Some(self.sign * bus * f64::from(duty) * (1.0 / f64::from(Drive::FULL))), self.decay),
        }
    }

    /// All steps of a tick at once, if dry friction holds the head at rest throughout: the current then nears its end
    /// without back-EMF, and the force it makes is largest at one end of the tick. Whether it did.
    pub fn rests(&mut self, drive: Drive, bus: f64, force: f64) -> bool {
        if self.v != 0.0 {
            return false;
        }
        let (volts, decay) = self.drive(drive, bus);
        let target = volts.map_or(0.0, |volts| volts * self.conductance);
        let first = target + (self.i - target) * decay;
        let last = target + (first - target) * (decay * decay * decay);
        let others = self.weight + force - STOP.0 * self.past();
        let held = |i: f64| (self.k * i + others).abs() <= self.friction;
        let rests = held(first) && held(last);
        if rests {
            self.i = last;
        }
        rests
    }

    /// How far it is beyond a stop, m: negative at the upper one.
    fn past(&self) -> f64 {
        if self.x < 0.0 {
            self.x
        } else if self.x > self.stroke {
            self.x - self.stroke
        } else {
            0.0
        }
    }

    /// One step under a drive, a bus voltage and a load.
    pub fn step(&mut self, drive: Drive, bus: f64, load: Load) {
        let (volts, decay) = self.drive(drive, bus);
        let target = volts.map_or(0.0, |volts| (volts - self.k * self.v) * self.conductance);
        self.i = target + (self.i - target) * decay;

        let past = self.past();
        let force = self.k * self.i + self.weight + load.force - STOP.0 * past;
        // A stop pushes; it does not hold what leaves it.
        let damping = self.damping + if past * self.v > 0.0 { STOP.1 } else { 0.0 };
        let solve = |force: f64, damping: f64| {
            // Dry friction takes what it can, and no more than there is.
            let moving = self.v + force * self.response;
            let left = moving.abs() - self.friction * self.response;
            if left > 0.0 { left.copysign(moving) / (1.0 + damping * self.response) } else { 0.0 }
        };
        let held = solve(force, damping + load.damping);
        let torn_off = -held * load.damping > load.suction;
        self.v = if torn_off { solve(force + load.suction, damping) } else { held };
        self.x += self.v * STEP_S;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: Load = Load { force: 0.0, damping: 0.0, suction: f64::INFINITY };

    fn bare() -> Parameters {
        Parameters { counterbalance: 0.0, friction: 0.0, stroke: 1000.0, ..Parameters::default() }
    }

    fn run(actuator: &mut Actuator, drive: Drive, seconds: f64) {
        for _ in 0..(seconds / STEP_S).round() as usize {
            actuator.step(drive, 48.0, NONE);
        }
    }

    #[test]
    fn a_braked_head_sinks_at_0_43_m_s() {
        let mut actuator = Actuator::new(&bare());
        run(&mut actuator, Drive::Brake, 1.0);
        // m g R / K^2.
        assert!((actuator.v - 0.2 * GRAVITY * 12.4 / 56.25).abs() < 1e-3, "{}", actuator.v);
    }

    #[test]
    fn a_coasting_head_falls_freely() {
        let mut actuator = Actuator::new(&bare());
        run(&mut actuator, Drive::Coast, 0.1);
        assert!((actuator.v - 0.980665).abs() < 1e-3 && (actuator.x - 0.049).abs() < 1e-3);
    }

    #[test]
    fn the_current_rises_with_the_windings_time_constant() {
        // Held by mass. 20 steps are 0.25 ms.
        let mut actuator = Actuator::new(&Parameters { mass: 20.0, ..bare() });
        run(&mut actuator, Drive::Duty(5000), 20.0 * STEP_S);
        let expected = 24.0 / 12.4 * (1.0 - (-20.0 * STEP_S * 12.4 / 3e-3).exp());
        assert!((actuator.i / expected - 1.0).abs() < 1e-3, "{} {expected}", actuator.i);
    }

    #[test]
    fn an_opened_winding_loses_its_current_at_once_and_its_force_with_it() {
        let mut actuator = Actuator::new(&bare());
        run(&mut actuator, Drive::Duty(10_000), 2e-3);
        assert!(actuator.i > 3.0);
        run(&mut actuator, Drive::Coast, 3e-4);
        assert!(actuator.i.abs() < 0.001, "{}", actuator.i);
    }

    #[test]
    fn a_driven_head_nears_the_speed_at_which_back_emf_leaves_only_friction() {
        // v = (V - R F / K) / K with the force left over, here weight and friction.
        let mut actuator = Actuator::new(&Parameters { friction: 0.3, ..bare() });
        run(&mut actuator, Drive::Duty(2000), 0.5);
        let expected = (9.6 + 12.4 * (0.2 * GRAVITY - 0.3) / 7.5) / 7.5;
        assert!((actuator.v / expected - 1.0).abs() < 1e-3, "{} {expected}", actuator.v);
    }

    #[test]
    fn work_put_in_is_heat_and_motion_and_nothing_else() {
        let mut actuator = Actuator::new(&Parameters { friction: 0.3, damping: 2.0, ..bare() });
        let (mut electric, mut heat) = (0.0, 0.0);
        for step in 0..8000 {
            let duty = if step / 1000 % 2 == 0 { 3000 } else { -3000 };
            let (i, v) = (actuator.i, actuator.v);
            actuator.step(Drive::Duty(duty), 48.0, NONE);
            let (i, v) = (0.5 * (i + actuator.i), 0.5 * (v + actuator.v));
            electric += 48.0 * f64::from(duty) / 1e4 * i * STEP_S;
            heat += (12.4 * i * i + 0.3 * v.abs() + 2.0 * v * v) * STEP_S;
        }
        let stored = 0.5 * 0.2 * actuator.v.powi(2) + 0.5 * 3e-3 * actuator.i.powi(2) - 0.2 * GRAVITY * actuator.x;
        assert!(electric > 0.1);
        assert!((electric - heat - stored).abs() < 0.005 * electric, "{electric} {heat} {stored}");
    }

    #[test]
    fn friction_holds_up_to_its_force_and_not_beyond() {
        // Counterbalance surplus 0.24 N against friction of 0.3 N; 0.0187 of duty is 0.542 N down, 0.302 N net.
        let p = Parameters { stroke: 100.0, ..Parameters::default() };
        for (duty, moves) in [(0, false), (180, false), (190, true), (-19, false), (-25, true)] {
            let mut actuator = Actuator::new(&p);
            actuator.x = 0.05;
            run(&mut actuator, Drive::Duty(duty), 0.5);
            assert_eq!(actuator.v != 0.0, moves, "duty {duty}");
            assert_eq!(actuator.x != 0.05, moves, "duty {duty}");
        }
    }

    #[test]
    fn friction_brings_a_sliding_head_to_a_full_stop() {
        // Weightless; 0.1 m/s, 1.5 m/s^2: 67 ms and 3.3 mm.
        let mut actuator = Actuator::new(&Parameters { counterbalance: 0.2 * GRAVITY as f32, friction: 0.3, ..bare() });
        actuator.v = 0.1;
        run(&mut actuator, Drive::Coast, 0.07);
        assert_eq!(actuator.v, 0.0);
        assert!((actuator.x - 0.1 * 0.1 / 3.0).abs() < 5e-6, "{}", actuator.x);
    }

    #[test]
    fn a_film_does_not_add_to_what_friction_holds() {
        // 0.4 N against 0.3 N of friction in 10 000 N s/m: it creeps at 10 um/s.
        let mut actuator = Actuator::new(&Parameters { counterbalance: 0.2 * GRAVITY as f32, friction: 0.3, ..bare() });
        for _ in 0..8000 {
            actuator.step(Drive::Coast, 48.0, Load { force: 0.4, damping: 1e4, suction: f64::INFINITY });
        }
        assert!((actuator.v - 10e-6).abs() < 0.1e-6, "{}", actuator.v);
    }

    #[test]
    fn a_tick_at_rest_is_four_steps_at_rest() {
        let p = Parameters { stroke: 100.0, ..Parameters::default() };
        let drives = [-40, -20, -1, 0, 60, 170, 179, 185].map(Drive::Duty);
        let mut rested = 0;
        for drive in drives.into_iter().chain([Drive::Brake, Drive::Coast]) {
            for (i, force) in [(0.0, 0.0), (0.05, 0.0), (-0.02, 0.3), (0.08, -0.2), (0.0, 0.6)] {
                let mut at_once = Actuator::new(&p);
                (at_once.x, at_once.i) = (0.05, i);
                let mut by_step = at_once.clone();
                let mut moved = false;
                for _ in 0..STEPS {
                    by_step.step(drive, 48.0, Load { force, ..NONE });
                    moved |= by_step.v != 0.0;
                }
                assert_eq!(at_once.rests(drive, 48.0, force), !moved, "{drive:?} {i} {force}");
                if !moved {
                    rested += 1;
                    assert!((at_once.i - by_step.i).abs() < 1e-15 && at_once.x == by_step.x);
                }
            }
        }
        assert!(rested > 10, "{rested}");
    }

    #[test]
    fn suction_holds_back_a_lift_and_no_harder_than_it_can() {
        let lift = |suction| {
            let mut actuator = Actuator::new(&bare());
            actuator.x = 0.05;
            for _ in 0..800 {
                actuator.step(Drive::Duty(-5000), 48.0, Load { force: 0.0, damping: 1e6, suction });
            }
            actuator.v
        };
        // 14.5 N less 2 N of weight against the damping, or against a limit of 5 N.
        assert!((-20e-6..-5e-6).contains(&lift(f64::INFINITY)), "{}", lift(f64::INFINITY));
        assert!(lift(5.0) < -0.1, "{}", lift(5.0));
    }

    #[test]
    fn the_stops_stop_and_let_go() {
        let mut actuator = Actuator::new(&Parameters::default());
        run(&mut actuator, Drive::Duty(9000), 1.0);
        assert!(
            (0.0..5e-6).contains(&(actuator.x - 0.012)) && actuator.v.abs() < 1e-6,
            "{} {}",
            actuator.x,
            actuator.v
        );
        run(&mut actuator, Drive::Duty(-9000), 1.0);
        assert!((0.0..5e-6).contains(&-actuator.x) && actuator.v.abs() < 1e-6);
        run(&mut actuator, Drive::Duty(500), 0.05);
        assert!(actuator.x > 1e-3);
    }
}
