//! What moves the electrode: moving coil, friction, counterbalance, cable, play, stops, contact.
//!
//! i = (u - K x')/(R + L s); m x'' = K i + m g - counterbalance - cable - friction - stops + external force.
//! Friction is that of Canudas de Wit, Olsson, Astrom and Lischinsky (IEEE Trans. Automatic Control 40, 1995), with
//! the velocity dependence of Hess and Soom (1990): z' = v - s0 |v| z/g(v), F = s0 z + s1 z' + s2 v,
//! g(v) = Fc + (Fs - Fc)/(1 + (v/vs)^2). Before it slides, it is a spring: that is presliding.
//!
//! A step solves the winding exactly for the voltage and velocity it begins with, and the velocity implicitly in friction
//! and all damping, so that neither bristles nor a thin film nor a hard stop can make it unstable at the 12.5 us it is
//! meant for; position follows the new velocity, which keeps the energy of a contact from growing.

use crate::gap::Film;
use crate::math::gone;
use crate::parameters::Parameters;

const GRAVITY: f64 = 9.80665;
/// Stiffness and damping of the end stops, N/m and N s/m: steel on hard rubber (assumed).
const STOP: (f64, f64) = (2e7, 200.0);
/// With the bridge open the current dies through the diodes against the bus: much faster than L/R (assumed tenfold).
const DIODES: f64 = 10.0;

/// What the bridge does with the winding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Winding {
    /// Nothing: its current dies through the diodes.
    Open,
    /// A voltage, V; 0 is a brake.
    Volts(f64),
}

/// Forces on the moving mass other than the axis' own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Load {
    /// Force toward the work, N.
    pub force_n: f64,
    /// Gap under the electrode, um; below zero it is a contact.
    pub gap_um: f64,
    /// The fluid.
    pub film: Film,
}

impl Load {
    /// Nothing near.
    pub const NONE: Load = Load { force_n: 0.0, gap_um: 1e9, film: Film { damping: 0.0, suction: 0.0 } };
}

/// State of the axis, SI units.
#[derive(Clone, Debug)]
pub struct Axis {
    p: Parameters,
    /// Position of the scale, m below the upper stop.
    pub x: f64,
    /// Velocity, m/s.
    pub v: f64,
    /// Current, A.
    pub i: f64,
    /// Deflection of the friction's bristles, m.
    z: f64,
    /// Position of the electrode in its play, m.
    electrode: f64,
    step_s: f64,
    /// Step over mass, s/kg.
    response: f64,
    /// One over the winding's resistance, A/V.
    conductance: f64,
    per_stribeck: f64,
    /// One over the step, 1/s.
    per_step: f64,
    /// Weight less counterbalance and cable at the upper stop, N, and what a metre adds.
    hanging: (f64, f64),
    decay: f64,
    decay_open: f64,
    bristle: f64,
    bristle_damping: f64,
    stroke: f64,
    play: f64,
}

impl Axis {
    /// At rest at the upper stop, for steps of a length.
    pub fn new(p: &Parameters, step_us: f64) -> Axis {
        let step_s = step_us * 1e-6;
        let rate = p.coil_ohm / (p.coil_mh * 1e-3);
        let bristle = p.friction_n / (p.presliding_um * 1e-6);
        Axis {
            p: *p,
            x: 0.0,
            v: 0.0,
            i: 0.0,
            z: 0.0,
            electrode: 0.0,
            step_s,
            response: step_s / p.mass_kg,
            conductance: 1.0 / p.coil_ohm,
            per_stribeck: 1e3 / p.stribeck_mm_s,
            per_step: 1.0 / step_s,
            hanging: (
                p.mass_kg * GRAVITY - p.counterbalance_n + 0.5 * p.cable_n_mm * p.stroke_mm,
                (p.counterbalance_n_mm - p.cable_n_mm) * 1e3,
            ),
            decay: 1.0 - gone(rate * step_s),
            decay_open: 1.0 - gone(rate * step_s * DIODES),
            bristle,
            bristle_damping: 2.0 * p.bristle_damping * (bristle * p.mass_kg).sqrt(),
            stroke: p.stroke_mm * 1e-3,
            play: 0.5e-6 * p.play_um,
        }
    }

    /// Position of the electrode, m: the scale's, but for the play.
    pub fn electrode(&self) -> f64 {
        self.electrode
    }

    /// Force between electrode and work at a gap, N.
    pub fn contact_n(&self, gap_um: f64) -> f64 {
        self.p.contact_n_um * (-gap_um).max(0.0)
    }

    /// One step.
    #[inline]
    pub fn step(&mut self, winding: Winding, load: &Load) {
        let p = &self.p;
        let dt = self.step_s;
        let (target, decay) = match winding {
            Winding::Open => (0.0, self.decay_open),
            Winding::Volts(volts) => ((volts - p.force_n_a * self.v) * self.conductance, self.decay),
        };
        self.i = target + (self.i - target) * decay;

        let mut force = p.force_n_a * self.i + self.hanging.0 + self.hanging.1 * self.x + load.force_n;
        // A stop and a contact push; they do not hold what leaves them.
        let mut damping = p.viscous_n_s_m;
        if self.x < 0.0 || self.x > self.stroke {
            let past = if self.x < 0.0 { self.x } else { self.x - self.stroke };
            force -= STOP.0 * past;
            if past * self.v > 0.0 {
                damping += STOP.1;
            }
        }
        if load.gap_um < 0.0 {
            force -= self.contact_n(load.gap_um);
            if self.v > 0.0 {
                damping += p.contact_n_s_m;
            }
        }

        // Bristles: with |v| of the step's beginning, their deflection is linear in the new velocity. Both terms of
        // 1/(1 + s0 |v| dt/g(v)) times the denominator of g, so that there is one division.
        let speed = self.v.abs();
        let ratio = speed * self.per_stribeck;
        let fast = 1.0 + ratio * ratio;
        let sliding = p.friction_n * fast + (p.stiction_n - p.friction_n);
        let keep = if sliding > 0.0 { sliding / (sliding + self.bristle * speed * dt * fast) } else { 1.0 };
        // z_new = (z + v dt) keep; z' = (z_new - z)/dt.
        let held = self.z * (self.bristle * keep + self.bristle_damping * (keep - 1.0) * self.per_step);
        let per_v = (self.bristle * dt + self.bristle_damping) * keep;

        let solve = |force: f64, damping: f64| {
            (self.v + (force - held) * self.response) / (1.0 + (damping + per_v) * self.response)
        };
        let slow = solve(force, damping + load.film.damping);
        let torn_off = -slow * load.film.damping > load.film.suction;
        self.v = if torn_off { solve(force + load.film.suction, damping) } else { slow };
        self.z = (self.z + self.v * dt) * keep;
        self.x += self.v * dt;
        self.electrode = self.electrode.clamp(self.x - self.play, self.x + self.play);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_US: f64 = 12.5;

    fn bare() -> Parameters {
        Parameters {
            counterbalance_n: 0.2 * GRAVITY,
            friction_n: 0.0,
            stiction_n: 0.0,
            cable_n_mm: 0.0,
            stroke_mm: 1000.0,
            ..Parameters::default()
        }
    }

    fn rough() -> Parameters {
        Parameters { friction_n: 0.3, stiction_n: 0.36, ..bare() }
    }

    fn run(axis: &mut Axis, winding: Winding, seconds: f64, load: &Load) {
        for _ in 0..(seconds / STEP_US * 1e6).round() as usize {
            axis.step(winding, load);
        }
    }

    fn pushed(force_n: f64) -> Load {
        Load { force_n, ..Load::NONE }
    }

    #[test]
    fn a_braked_axis_sinks_as_back_emf_lets_it_and_an_open_one_falls() {
        let p = Parameters { counterbalance_n: 0.0, ..bare() };
        let mut axis = Axis::new(&p, STEP_US);
        run(&mut axis, Winding::Volts(0.0), 1.0, &Load::NONE);
        assert!((axis.v - 0.2 * GRAVITY * 12.4 / 56.25).abs() < 1e-3, "{}", axis.v);
        let mut axis = Axis::new(&p, STEP_US);
        run(&mut axis, Winding::Open, 0.1, &Load::NONE);
        assert!((axis.v - 0.980_665).abs() < 1e-3);
    }

    #[test]
    fn before_it_slides_friction_is_a_spring() {
        // 0.15 N on 0.3 N over 2 um: one micrometre, and back.
        let mut axis = Axis::new(&rough(), STEP_US);
        axis.x = 0.1;
        let from = axis.x;
        run(&mut axis, Winding::Open, 0.5, &pushed(0.15));
        let there = axis.x - from;
        // LuGre's bristles give way a little on the way.
        assert!((1.0e-6..2.5e-6).contains(&there), "{there}");
        run(&mut axis, Winding::Open, 0.5, &Load::NONE);
        let back = there - (axis.x - from);
        assert!((0.8e-6..1.2e-6).contains(&back) && axis.v.abs() < 1e-7, "{back}");
    }

    #[test]
    fn it_holds_up_to_stiction_and_slides_with_less() {
        for (force, slides) in [(0.34, false), (0.38, true), (-0.34, false), (-0.38, true)] {
            let mut axis = Axis::new(&rough(), STEP_US);
            axis.x = 0.1;
            // Slowly: a step would overshoot.
            (1..=100).for_each(|k| run(&mut axis, Winding::Open, 0.01, &pushed(force * f64::from(k) / 100.0)));
            assert_eq!((axis.x - 0.1).abs() > 100e-6, slides, "{force} N: {} um", (axis.x - 0.1) * 1e6);
        }
        // Sliding, 0.32 N keep it going against 0.3.
        let mut axis = Axis::new(&rough(), STEP_US);
        (axis.x, axis.v) = (0.1, 0.05);
        run(&mut axis, Winding::Open, 1.0, &pushed(0.32));
        assert!(axis.v > 0.05, "{}", axis.v);
    }

    #[test]
    fn friction_takes_what_it_says_from_a_sliding_mass() {
        // 0.1 m/s, 0.3 N, 0.2 kg: 67 ms and 3.33 mm, less a hundredth of the speed that the bristles take when they are bent.
        let mut axis = Axis::new(&rough(), STEP_US);
        (axis.x, axis.v) = (0.1, 0.1);
        run(&mut axis, Winding::Open, 0.2, &Load::NONE);
        assert!((axis.x - 0.1 - 3.27e-3).abs() < 0.02e-3, "{}", axis.x);
        assert!(axis.v.abs() < 1e-4);
    }

    #[test]
    fn a_contact_holds_a_force_and_gives_it_back() {
        let mut axis = Axis::new(&bare(), STEP_US);
        axis.x = 0.1;
        let surface = 0.1 + 5e-6;
        for _ in 0..80_000 {
            let gap_um = (surface - axis.x) * 1e6;
            axis.step(Winding::Open, &Load { force_n: 4.0, gap_um, ..Load::NONE });
        }
        // 4 N on 2 N/um.
        assert!((axis.x - surface - 2e-6).abs() < 0.05e-6 && axis.v.abs() < 1e-6, "{}", axis.x - surface);
    }

    #[test]
    fn play_lets_the_electrode_stay_behind() {
        let mut axis = Axis::new(&Parameters { play_um: 10.0, ..bare() }, STEP_US);
        axis.x = 0.1;
        axis.step(Winding::Open, &Load::NONE);
        assert!((axis.electrode() - 0.1 + 5e-6).abs() < 1e-9);
        axis.x -= 8e-6;
        axis.step(Winding::Open, &Load::NONE);
        assert!((axis.electrode() - 0.1 + 5e-6).abs() < 1e-9);
        axis.x -= 8e-6;
        axis.step(Winding::Open, &Load::NONE);
        assert!((axis.electrode() - 0.1 + 11e-6).abs() < 1e-9);
    }

    #[test]
    fn suction_holds_back_a_lift_and_no_harder_than_it_can() {
        let lift = |suction| {
            let mut axis = Axis::new(&bare(), STEP_US);
            axis.x = 0.05;
            let load = Load { film: Film { damping: 1e6, suction }, ..Load::NONE };
            run(&mut axis, Winding::Volts(-24.0), 0.01, &load);
            axis.v
        };
        assert!((-20e-6..-5e-6).contains(&lift(f64::INFINITY)), "{}", lift(f64::INFINITY));
        assert!(lift(5.0) < -0.1, "{}", lift(5.0));
    }

    #[test]
    fn work_put_in_is_heat_and_motion_and_nothing_else() {
        let p = Parameters { viscous_n_s_m: 2.0, ..bare() };
        let mut axis = Axis::new(&p, STEP_US);
        axis.x = 0.5;
        let (mut electric, mut heat) = (0.0, 0.0);
        for step in 0..8000 {
            let volts = if step / 1000 % 2 == 0 { 14.4 } else { -14.4 };
            let (i, v) = (axis.i, axis.v);
            axis.step(Winding::Volts(volts), &Load::NONE);
            let (i, v) = (0.5 * (i + axis.i), 0.5 * (v + axis.v));
            electric += volts * i * STEP_US * 1e-6;
            heat += (12.4 * i * i + 2.0 * v * v) * STEP_US * 1e-6;
        }
        let stored = 0.1 * axis.v * axis.v + 1.5e-3 * axis.i * axis.i;
        assert!(electric > 0.1 && (electric - heat - stored).abs() < 0.005 * electric, "{electric} {heat} {stored}");
    }

    #[test]
    fn the_stops_stop_and_let_go() {
        let mut axis = Axis::new(&Parameters::default(), STEP_US);
        run(&mut axis, Winding::Volts(43.0), 1.0, &Load::NONE);
        assert!((0.0..5e-6).contains(&(axis.x - 0.012)) && axis.v.abs() < 1e-6, "{} {}", axis.x, axis.v);
        run(&mut axis, Winding::Volts(-43.0), 1.0, &Load::NONE);
        assert!((0.0..5e-6).contains(&-axis.x));
        run(&mut axis, Winding::Volts(5.0), 0.05, &Load::NONE);
        assert!(axis.x > 1e-3);
    }
}
