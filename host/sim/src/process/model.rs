//! The process model of `host/process` on the wires of a head.

use super::{Plant, TICK_US, Tick};
use edm_hal_shim::bridge::Drive;
use edm_process::axis::{Axis, Load, Winding};
use edm_process::{Edge, Orders, Wires};

/// Steps of the axis in a tick: 25 us are a tenth of L/R and a quarter of a radian of the stiffest resonance, that of a
/// stop. Half the step changes time, swing and arcs by less than their scatter
/// (six seeds of sinker-0.4kg, silicon and thesis-machine).
const STEPS: usize = 2;
/// Time constants of an edge after which a stretch counts as settled: 3e-4 of the step.
const SETTLED: f64 = 8.0;

/// Stretch of constant gap condition, as the wires show it; times in us since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stretch {
    /// When it began.
    pub from: f64,
    /// Voltage it tends to, V.
    pub volts: f64,
    /// Voltage when it began, V.
    pub initial: f64,
    /// Time constant of the way from one to the other.
    pub rise: f64,
    /// Current, A.
    pub amps: Edge,
    /// When the generator's gate opened and will close, the same time twice while it is off.
    pub gate: (f64, f64),
}

impl Stretch {
    /// Whether the edge is over at a time inside the stretch.
    pub fn settled(&self, time: f64) -> bool {
        time - self.from > SETTLED * self.rise
    }

    /// Gap voltage at a time inside the stretch, V.
    pub fn at(&self, time: f64) -> f64 {
        if self.settled(time) {
            return self.volts;
        }
        self.volts + (self.initial - self.volts) * libm::exp((self.from - time) / self.rise)
    }
}

/// State of axis and gap.
#[derive(Clone, Debug)]
pub struct Model {
    pub axis: Axis,
    pub process: edm_process::Process,
    held_gap_um: Option<f64>,
    /// What the electrode met in the last step.
    load: Load,
    seen: Seen,
    /// The motor is connected the wrong way round: -1.
    sign: f64,
}

/// What the gap has shown in the last tick.
#[derive(Clone, Debug)]
struct Seen {
    stretches: Vec<Stretch>,
    /// The gap leads are swapped: -1.
    sign: f64,
}

impl Wires for Seen {
    #[inline]
    fn stretch(&mut self, stretch: &edm_process::Stretch) {
        let edm_process::Stretch { from, volts, gate, amps } = *stretch;
        let (initial, settles) = (self.sign * volts.from, self.sign * volts.to);
        self.stretches.push(Stretch { from, volts: settles, initial, rise: volts.us, amps, gate });
    }
}

impl Model {
    /// At rest at the upper stop above a fresh workpiece.
    ///
    /// # Errors
    /// When a number does not fit.
    pub fn new(plant: &Plant, seed: u64) -> Result<Model, edm_process::Refused> {
        let (p, around) = (plant.model(), &plant.installation);
        let sign = |reversed| if reversed { -1.0 } else { 1.0 };
        let process = edm_process::Process::new(&p, f64::from(around.surface) * 1e3, seed)?;
        let mut seen = Seen { stretches: Vec::with_capacity(64), sign: sign(around.gap_reversed) };
        seen.stretch(process.stretch());
        Ok(Model {
            axis: Axis::new(&p, TICK_US / STEPS as f64),
            process,
            held_gap_um: None,
            load: Load::NONE,
            seen,
            sign: sign(around.motor_reversed),
        })
    }

    pub fn hold_gap(&mut self, um: f64, debris: f64) {
        self.held_gap_um = Some(um);
        self.process.hold(debris);
    }

    /// One tick; `travel` is called for every step of the axis: from, to, its number and how many there are.
    pub fn advance(&mut self, tick: &Tick<'_>, mut travel: impl FnMut(f64, f64, usize, usize)) {
        let winding = match tick.drive {
            Drive::Coast => Winding::Open,
            Drive::Brake => Winding::Volts(0.0),
            Drive::Duty(duty) => {
                Winding::Volts(self.sign * tick.bus_v * f64::from(duty) * (1.0 / f64::from(Drive::FULL)))
            }
        };
        for step in 0..STEPS {
            let from = self.axis.x;
            self.load = self.process.load(self.carrier_um(tick.surface_m));
            self.load.force_n = tick.hand_n;
            self.axis.step(winding, &self.load);
            travel(from, self.axis.x, step, STEPS);
        }
        let carrier_um = match self.held_gap_um {
            Some(held) => self.process.depth_um() + self.process.worn_um() - held,
            None => self.carrier_um(tick.surface_m),
        };
        let mut orders = Orders {
            pulses: tick.pulses,
            off_us: tick.off_us,
            pauses_us: tick.pauses_us,
            shorted: tick.shorted,
            dead: tick.dead,
            senseless: tick.senseless,
            arcs: tick.arcs,
        };
        // The last one goes on.
        let over = self.seen.stretches.len() - 1;
        self.seen.stretches.swap(0, over);
        self.seen.stretches.truncate(1);
        let mut from_us = 0.0;
        for (at_us, pulses) in tick.permission {
            self.process.advance(at_us - from_us, carrier_um, &orders, &mut self.seen);
            (from_us, orders.pulses) = (*at_us, *pulses);
        }
        self.process.advance(TICK_US - from_us, carrier_um, &orders, &mut self.seen);
    }

    /// The electrode's carrier below the first surface, um.
    fn carrier_um(&self, first_m: f64) -> f64 {
        (self.axis.electrode() - first_m) * 1e6
    }

    pub fn gap_um(&self, first_m: f64) -> f64 {
        self.process.depth_um() + self.process.worn_um() - self.carrier_um(first_m)
    }

    /// Force of a contact and of the film on the electrode in the last step, N.
    pub fn forces_n(&self) -> (f64, f64) {
        let Load { gap_um, film, .. } = self.load;
        (self.axis.contact_n(gap_um), (-film.damping * self.axis.v).min(film.suction))
    }

    pub fn stretches(&self) -> &[Stretch] {
        &self.seen.stretches
    }
}
