//! Version 0 of the process model: axis and gap of [`Parameters`].

use super::actuator::{Actuator, Load, STEPS};
use super::spark::{Spark, Stretch};
use super::{Parameters, TICK_US, Tick};
use std::f64::consts::PI;

/// Atmospheric pressure, Pa: no film pulls harder than this on the electrode's face.
const ATMOSPHERE: f64 = 101_325.0;
/// Damping of a contact, N s/m (assumed).
const CONTACT_DAMPING: f64 = 20.0;
/// Thinnest film that the formula is used for, m: below that, roughness lets the dielectric out (assumed).
const THINNEST_FILM: f64 = 5e-6;

/// State of axis and gap.
#[derive(Clone, Debug)]
pub struct Zero {
    pub actuator: Actuator,
    pub spark: Spark,
    held_gap_um: Option<f64>,
    /// Squeeze-film damping times the cube of the gap, N s m^2.
    film: f64,
    /// Most that the film can pull, N.
    suction: f64,
    /// Stiffness of a contact, N/m.
    stiffness: f64,
}

impl Zero {
    /// At rest at the upper stop above a fresh workpiece.
    pub fn new(p: &Parameters, seed: u64) -> Zero {
        let radius = f64::from(p.radius) * 1e-3;
        Zero {
            actuator: Actuator::new(p),
            spark: Spark::new(p, seed),
            held_gap_um: None,
            film: 3.0 * PI * f64::from(p.viscosity) * 1e-3 * radius.powi(4) / 2.0,
            suction: ATMOSPHERE * PI * radius * radius,
            stiffness: f64::from(p.contact) * 1e6,
        }
    }

    pub fn hold_gap(&mut self, um: f64, debris: f64) {
        self.held_gap_um = Some(um);
        self.spark.hold(debris);
    }

    /// One tick; `travel` is called for every step of the axis: from, to, its number and how many there are.
    pub fn advance(&mut self, tick: &Tick<'_>, travel: impl FnMut(f64, f64, usize, usize)) {
        let before = self.gap_um(tick.surface_m);
        self.move_axis(tick, travel);
        let gap = self.held_gap_um.map_or((before, self.gap_um(tick.surface_m)), |held| (held, held));
        let spark = &mut self.spark;
        (spark.dead, spark.forced_short, spark.senseless) = (tick.dead, tick.shorted, tick.senseless);
        spark.forced_arcs = tick.arcs;
        spark.advance(tick.from_us, tick.from_us + TICK_US, gap, tick.pulses);
    }

    fn move_axis(&mut self, tick: &Tick<'_>, mut travel: impl FnMut(f64, f64, usize, usize)) {
        let surface = self.surface_m(tick.surface_m) + self.spark.wear_um * 1e-6;
        let x = self.actuator.x;
        if self.actuator.rests(tick.drive, tick.bus_v, self.contact(surface - x) + tick.hand_n) {
            travel(x, x, 0, STEPS);
            return;
        }
        for step in 0..STEPS {
            let from = self.actuator.x;
            let load = self.load(surface - from, tick.hand_n);
            self.actuator.step(tick.drive, tick.bus_v, load);
            travel(from, self.actuator.x, step, STEPS);
        }
    }

    /// Contact and squeeze film: 3 pi mu R^4 v / (2 h^3), whose suction ends at the weight of the atmosphere.
    fn load(&self, gap: f64, hand_n: f64) -> Load {
        let hits = gap < 0.0 && self.actuator.v > 0.0;
        Load {
            force: self.contact(gap) + hand_n,
            damping: self.film_damping(gap) + if hits { CONTACT_DAMPING } else { 0.0 },
            suction: self.suction,
        }
    }

    fn film_damping(&self, gap: f64) -> f64 {
        let film = if gap > THINNEST_FILM { gap } else { THINNEST_FILM };
        self.film / (film * film * film)
    }

    /// Force of a contact on the electrode, N, at a gap in m.
    fn contact(&self, gap: f64) -> f64 {
        if gap < 0.0 { gap * self.stiffness } else { 0.0 }
    }

    /// Surface of the work, m, where the first one is at `first_m`.
    pub fn surface_m(&self, first_m: f64) -> f64 {
        first_m + self.spark.removed_um * 1e-6
    }

    pub fn gap_um(&self, first_m: f64) -> f64 {
        (self.surface_m(first_m) - self.actuator.x) * 1e6 + self.spark.wear_um
    }

    /// Force of a contact and of the film on the electrode, N.
    pub fn forces_n(&self, gap_um: f64) -> (f64, f64) {
        let film = (-self.film_damping(gap_um * 1e-6) * self.actuator.v).min(self.suction);
        (self.stiffness * (-gap_um).max(0.0) * 1e-6, film)
    }

    pub fn stretches(&self) -> &[Stretch] {
        &self.spark.stretches
    }
}
