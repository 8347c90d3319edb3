//! Moving coil, its friction and its stops.
//!
//! i = (v - K x') / (R + L s); m x'' = K i - b x' + m g - F_counterbalance - friction + what pushes from outside. x is
//! positive toward the work. Four steps a servo tick: 12.5 us against an L/R of 0.24 ms and a contact resonance of 0.5 kHz.
//! The winding is solved exactly for constant voltage, damping implicitly, so that a thin film of dielectric cannot make
//! the step unstable.

use super::Parameters;
use edm_hal_shim::bridge::Drive;
use edm_servo_head::units::TICK_S;

/// Steps in one servo tick.
pub const STEPS: usize = 4;
/// One step, s.
pub const STEP_S: f64 = TICK_S as f64 / STEPS as f64;
const GRAVITY: f64 = 9.80665;
/// Stiffness and damping of the end stops, N/m and N s/m: steel on hard rubber (assumed).
const STOP: (f64, f64) = (2e7, 200.0);
/// With the bridge open the current dies through the diodes against the bus: much faster than L/R (assumed tenfold).
const DIODES: f64 = 10.0;

/// What acts on the moving mass besides the actuator itself.
#[derive(Clone, Copy, Debug, Default)]
pub struct Load {
    /// Force, N.
    pub force: f64,
    /// Damping, N s/m.
    pub damping: f64,
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
    mass: f64,
    resistance: f64,
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
            mass,
            resistance,
            decay: (-rate * STEP_S).exp(),
            decay_open: (-rate * STEP_S * DIODES).exp(),
            friction: p.friction.into(),
            damping: p.damping.into(),
            weight: mass * GRAVITY - f64::from(p.counterbalance),
            stroke: f64::from(p.stroke) * 1e-3,
            sign: if p.motor_reversed { -1.0 } else { 1.0 },
        }
    }

    /// One step under a drive, a bus voltage and a load.
    pub fn step(&mut self, drive: Drive, bus: f64, load: Load) {
        let (target, decay) = match drive {
            Drive::Coast => (0.0, self.decay_open),
            Drive::Brake => (-self.k * self.v / self.resistance, self.decay),
            Drive::Duty(duty) => {
                let volts = self.sign * bus * f64::from(duty) / f64::from(Drive::FULL);
                ((volts - self.k * self.v) / self.resistance, self.decay)
            }
        };
        self.i = target + (self.i - target) * decay;
        let past = (self.x.min(0.0), (self.x - self.stroke).max(0.0));
        let at_stop = past != (0.0, 0.0);
        let force = self.k * self.i + self.weight + load.force - STOP.0 * (past.0 + past.1);
        let damping = self.damping + load.damping + if at_stop { STOP.1 } else { 0.0 };
        let moving = (self.v + force / self.mass * STEP_S) / (1.0 + damping / self.mass * STEP_S);
        // Dry friction takes what it can, and no more than there is.
        let slowed = (moving.abs() - self.friction / self.mass * STEP_S).max(0.0);
        self.v = slowed.copysign(moving);
        self.x += self.v * STEP_S;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bare() -> Parameters {
        Parameters { counterbalance: 0.0, friction: 0.0, stroke: 1000.0, ..Parameters::default() }
    }

    fn run(actuator: &mut Actuator, drive: Drive, seconds: f64) {
        for _ in 0..(seconds / STEP_S) as usize {
            actuator.step(drive, 48.0, Load::default());
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
        let mut actuator = Actuator::new(&Parameters { mass: 20.0, ..bare() });
        run(&mut actuator, Drive::Duty(5000), 3e-3 / 12.4);
        let expected = 24.0 / 12.4 * (1.0 - (-1.0f64).exp());
        assert!((actuator.i / expected - 1.0).abs() < 0.03, "{} {expected}", actuator.i);
    }

    #[test]
    fn friction_holds_up_to_its_force_and_not_beyond() {
        // Counterbalance surplus 0.24 N against friction of 0.3 N; 0.0187 of duty is 0.542 N down, 0.302 N net.
        let p = Parameters { stroke: 100.0, ..Parameters::default() };
        for (duty, moves) in [(0, false), (180, false), (190, true)] {
            let mut actuator = Actuator::new(&p);
            actuator.x = 0.05;
            run(&mut actuator, Drive::Duty(duty), 0.5);
            assert_eq!(actuator.v != 0.0, moves, "duty {duty}");
        }
    }

    #[test]
    fn the_stops_stop() {
        let mut actuator = Actuator::new(&Parameters::default());
        run(&mut actuator, Drive::Duty(9000), 1.0);
        assert!((actuator.x - 0.012).abs() < 50e-6 && actuator.v.abs() < 1e-3);
        run(&mut actuator, Drive::Duty(-9000), 1.0);
        assert!(actuator.x.abs() < 50e-6 && actuator.v.abs() < 1e-3);
    }
}
