//! Process model: what the head's wires are connected to.
//!
//! Pulses are events in continuous time, mechanics run in steps of 12.5 us, conversions happen at their own instants. All
//! randomness comes from one seed, in a stream of its own for every cause. Every parameter has its source in
//! [`Parameters`]; x is positive toward the work, gap = surface - electrode face.
//!
//! Everything here is simulated; nothing was fitted to a machine.

mod actuator;
mod debris;
mod front_end;
mod normal;
mod parameters;
mod random;
mod scale;
mod spark;

pub use crate::events::FaultInputs;
pub use parameters::Parameters;
pub use scale::Edge;
pub use spark::Pulses;

use crate::events::{Event, EventError, Timeline};
use actuator::{Actuator, Load, STEPS};
use edm_hal_shim::bridge::Drive;
use edm_hal_shim::encoder::Levels;
use edm_hal_shim::gap::{BLOCK, GapBlock};
use edm_hal_shim::reflex::PulseCounts;
use edm_hal_shim::safety::{DriveCodes, SafetyInputs};
use edm_servo_head::settings::{SettingError, Value};
use edm_servo_head::units::{ADC_FULL_SCALE, CLOCK_HZ, TICK_HZ};
use front_end::FrontEnd;
use scale::Scale;
use spark::Spark;
use std::f64::consts::PI;

/// Servo tick, us.
const TICK_US: f64 = 1e6 / TICK_HZ as f64;
/// Servo tick in clock ticks.
const TICK_CLOCK: u32 = CLOCK_HZ / TICK_HZ;
/// Atmospheric pressure, Pa: no film pulls harder than this on the electrode's face.
const ATMOSPHERE: f64 = 101_325.0;
/// Damping of a contact, N s/m (assumed).
const CONTACT_DAMPING: f64 = 20.0;
/// Thinnest film that the formula is used for, m: below that, roughness lets the dielectric out (assumed).
const THINNEST_FILM: f64 = 5e-6;

/// What the head's wires show after a tick.
#[derive(Clone, Debug)]
pub struct Sensors {
    /// Conversions of the tick.
    pub block: GapBlock,
    /// Encoder edges of the tick, in order of time.
    pub edges: Vec<Edge>,
    /// Count of a timer in encoder mode on the same lines.
    pub timer_count: u32,
    /// Levels of the encoder lines.
    pub levels: Levels,
    /// Clock at the end of the tick.
    pub now: u32,
    /// Safety inputs.
    pub safety: SafetyInputs,
    /// Motor current and bus voltage.
    pub drive: DriveCodes,
    /// What the pulses have done; of a reflex that finds every short.
    pub pulses: PulseCounts,
}

/// The gap between two changes, within or around a tick. Times are us since the tick began.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    /// When it began; negative: in a tick before.
    pub from_us: f64,
    /// Voltage when it began, V.
    pub initial: f64,
    /// Voltage it tends to, V.
    pub volts: f64,
    /// Time constant of that, us.
    pub rise_us: f64,
    /// Gate on.
    pub gate: bool,
}

impl Piece {
    /// Voltage at a time, V.
    pub fn at(&self, us: f64) -> f64 {
        let age = (us - self.from_us).max(0.0);
        self.volts + (self.initial - self.volts) * (-age / self.rise_us).exp()
    }
}

/// What really is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Truth {
    /// Time since the start, s.
    pub t_s: f64,
    /// Electrode carrier, um below the upper stop.
    pub position_um: f64,
    /// Electrode face, um: the carrier less wear.
    pub face_um: f64,
    /// Velocity, um/s, positive toward the work.
    pub velocity_um_s: f64,
    /// Surface under the electrode, um.
    pub surface_um: f64,
    /// Surface before the first spark, um.
    pub first_surface_um: f64,
    /// Gap, um; negative in contact.
    pub gap_um: f64,
    /// Count of an encoder that makes no mistakes.
    pub count: i64,
    /// Pulses so far.
    pub pulses: Pulses,
    /// Electrode wear, um.
    pub wear_um: f64,
    /// Force between electrode and work, N.
    pub contact_n: f64,
    /// Motor current, A, positive toward the work.
    pub current_a: f64,
    /// Debris concentration; 1 is about the default working point.
    pub debris: f64,
}

/// The machine and the process.
#[derive(Clone, Debug)]
pub struct Process {
    p: Parameters,
    actuator: Actuator,
    scale: Scale,
    spark: Spark,
    front: FrontEnd,
    ticks: u64,
    held_gap_um: Option<f64>,
    sensors: Sensors,
    /// Squeeze-film damping times the cube of the gap, N s m^2.
    film: f64,
    /// Most that the film can pull, N.
    suction: f64,
    /// Stiffness of a contact, N/m.
    stiffness: f64,
    /// Converter codes for an ampere of motor current and a volt of the bus.
    codes_per: (f64, f64),
    timeline: Timeline,
    /// Wires to pull between two ticks.
    pub fault_inputs: FaultInputs,
}

impl Process {
    /// A head at rest at its upper stop above a fresh workpiece. The same seed gives the same run.
    pub fn new(p: &Parameters, seed: u64) -> Result<Process, SettingError> {
        p.validate()?;
        let scale = Scale::new(p, seed);
        let radius = f64::from(p.radius) * 1e-3;
        Ok(Process {
            actuator: Actuator::new(p),
            spark: Spark::new(p, seed),
            front: FrontEnd::new(p, seed),
            ticks: 0,
            held_gap_um: None,
            sensors: Sensors {
                block: GapBlock { codes: [0; BLOCK], gate: 0 },
                edges: Vec::with_capacity(64),
                timer_count: 0,
                levels: scale.levels(),
                now: 0,
                safety: SafetyInputs::default(),
                drive: DriveCodes::default(),
                pulses: PulseCounts::default(),
            },
            film: 3.0 * PI * f64::from(p.viscosity) * 1e-3 * radius.powi(4) / 2.0,
            suction: ATMOSPHERE * PI * radius * radius,
            stiffness: f64::from(p.contact) * 1e6,
            codes_per: (1.0 / f64::from(p.amps_per_code), 1.0 / f64::from(p.bus_per_code)),
            timeline: Timeline::default(),
            fault_inputs: FaultInputs::default(),
            scale,
            p: *p,
        })
    }

    /// Lets these events happen, counted from the first tick, instead of those given before.
    pub fn schedule(&mut self, events: &[Event]) {
        self.timeline = Timeline::new(events);
    }

    /// Lets this happen at the beginning of the next tick, besides what is scheduled.
    ///
    /// # Errors
    /// When there is no such signal, or it cannot have this value.
    pub fn happen(&mut self, signal: &str, value: Value<'_>) -> Result<(), EventError> {
        self.timeline.now(signal, value)
    }

    /// Holds gap and debris, whatever the axis does, without erosion, arcs and bridges: the open loop in which the shot
    /// floor is measured.
    pub fn hold_gap(&mut self, um: f64, debris: f64) {
        self.held_gap_um = Some(um);
        self.spark.hold(debris);
    }

    /// Advances by one servo tick under the head's outputs and gives what its wires show at the end.
    pub fn advance(&mut self, drive: Drive, pulses: bool) -> &Sensors {
        let from = self.ticks as f64 * TICK_US;
        self.timeline.advance(self.ticks, &mut self.fault_inputs, self.p.bus.into());
        self.front.stuck = self.fault_inputs.stuck_code;
        self.front.gate_lost = self.fault_inputs.gate_lost;
        self.scale.dead = self.fault_inputs.encoder_dead;
        self.spark.dead = self.fault_inputs.generator_dead;
        self.spark.forced_short = self.fault_inputs.short;
        self.spark.senseless = self.fault_inputs.sense_off;

        let before = self.gap_um();
        self.move_axis(if self.fault_inputs.safety.bridge_fault { Drive::Coast } else { drive });
        let gap = self.held_gap_um.map_or((before, self.gap_um()), |held| (held, held));
        let pulses_before = self.spark.pulses;
        self.spark.advance(from, from + TICK_US, gap, pulses || self.fault_inputs.disobeys);
        self.count_pulses(pulses_before);
        self.sensors.block = self.front.convert(from, &self.spark.stretches);

        self.ticks += 1;
        self.sensors.now = self.sensors.now.wrapping_add(TICK_CLOCK);
        self.sense();
        &self.sensors
    }

    /// The gate wire divides on the board: to the timer that counts its edges, and to the one that starts the reflex's
    /// converter.
    fn count_pulses(&mut self, before: Pulses) {
        let counts = &mut self.sensors.pulses;
        let add = |count: &mut u8, more: u64| *count = count.wrapping_add(more as u8);
        let new = self.spark.pulses.total() - before.total();
        if !self.fault_inputs.gate_lost {
            add(&mut counts.edges, 2 * new);
            if !self.fault_inputs.start_lost {
                add(&mut counts.conversions, new);
                add(&mut counts.shorts, self.spark.pulses.short - before.short);
            }
        }
    }

    fn bus(&self) -> f64 {
        self.fault_inputs.bus_v.unwrap_or(self.p.bus.into())
    }

    fn move_axis(&mut self, drive: Drive) {
        self.sensors.edges.clear();
        let bus = self.bus();
        let surface = self.surface_m() + self.spark.wear_um * 1e-6;
        let ticks = f64::from(TICK_CLOCK) / STEPS as f64;
        let x = self.actuator.x;
        if self.actuator.rests(drive, bus, self.contact(surface - x) + self.fault_inputs.hand_n) {
            self.scale.travel(x, x, self.sensors.now, ticks, &mut self.sensors.edges);
            return;
        }
        for step in 0..STEPS {
            let from = self.actuator.x;
            let load = self.load(surface - from);
            self.actuator.step(drive, bus, load);
            let start = self.sensors.now.wrapping_add((step as f64 * ticks) as u32);
            self.scale.travel(from, self.actuator.x, start, ticks, &mut self.sensors.edges);
        }
    }

    /// Contact and squeeze film: 3 pi mu R^4 v / (2 h^3), whose suction ends at the weight of the atmosphere.
    fn load(&self, gap: f64) -> Load {
        let hits = gap < 0.0 && self.actuator.v > 0.0;
        let film = if gap > THINNEST_FILM { gap } else { THINNEST_FILM };
        Load {
            force: self.contact(gap) + self.fault_inputs.hand_n,
            damping: self.film / (film * film * film) + if hits { CONTACT_DAMPING } else { 0.0 },
            suction: self.suction,
        }
    }

    /// Force of a contact on the electrode, N, at a gap in m.
    fn contact(&self, gap: f64) -> f64 {
        if gap < 0.0 { gap * self.stiffness } else { 0.0 }
    }

    fn sense(&mut self) {
        let bus = self.bus();
        let sensors = &mut self.sensors;
        sensors.levels = self.scale.levels();
        sensors.timer_count = self.scale.timer();
        let x_mm = self.actuator.x * 1e3;
        let opened = self.fault_inputs.safety;
        sensors.safety = SafetyInputs {
            upper_limit: opened.upper_limit || x_mm < self.p.upper_limit.into(),
            lower_limit: opened.lower_limit || x_mm > self.p.lower_limit.into(),
            ..opened
        };
        let code = |value: f64, per_unit: f64, zero: f64| {
            (zero + value * per_unit).clamp(0.0, f64::from(ADC_FULL_SCALE)) as i32 as u16
        };
        // The sensor sits between bridge and coil, so it does not know which way round the coil is.
        let sign = if self.p.motor_reversed { -1.0 } else { 1.0 };
        sensors.drive = DriveCodes {
            motor_current: code(sign * self.actuator.i, self.codes_per.0, 2048.5),
            bus_voltage: code(bus, self.codes_per.1, 0.5),
        };
    }

    fn surface_m(&self) -> f64 {
        (f64::from(self.p.surface) - self.fault_inputs.raised_mm) * 1e-3 + self.spark.removed_um * 1e-6
    }

    fn gap_um(&self) -> f64 {
        (self.surface_m() - self.actuator.x) * 1e6 + self.spark.wear_um
    }

    /// What the wires show now.
    pub fn sensors(&self) -> &Sensors {
        &self.sensors
    }

    /// The gap during the last tick, in order of time: for wires that a converter's block does not show.
    pub fn pieces(&self) -> impl Iterator<Item = Piece> + '_ {
        let began = self.ticks.saturating_sub(1) as f64 * TICK_US;
        let gate_lost = self.fault_inputs.gate_lost;
        self.spark.stretches.iter().map(move |s| Piece {
            from_us: s.from - began,
            initial: s.initial,
            volts: s.volts,
            rise_us: s.rise,
            gate: s.gate.0 < s.gate.1 && !gate_lost,
        })
    }

    /// What really is.
    pub fn truth(&self) -> Truth {
        let position_um = self.actuator.x * 1e6;
        Truth {
            t_s: self.ticks as f64 * TICK_US * 1e-6,
            position_um,
            face_um: position_um - self.spark.wear_um,
            velocity_um_s: self.actuator.v * 1e6,
            surface_um: self.surface_m() * 1e6,
            first_surface_um: f64::from(self.p.surface) * 1e3,
            gap_um: self.gap_um(),
            count: self.scale.true_count(self.actuator.x),
            pulses: self.spark.pulses,
            wear_um: self.spark.wear_um,
            contact_n: self.stiffness * (-self.gap_um()).max(0.0) * 1e-6,
            current_a: self.actuator.i,
            debris: self.spark.debris.concentration(),
        }
    }
}

#[cfg(test)]
mod tests;
