//! Process model: machine and process at the other end of the head's wires.
//!
//! Pulses are events in continuous time, mechanics run in steps of 12.5 or 25 us, conversions happen at their own instants.
//! All randomness comes from one seed, in a stream of its own for every cause. x is positive toward the work, gap = surface
//! - electrode face.
//!
//! Axis and gap are the package `host/process`, put on the wires of a head in `model`. Encoder, converter, switches and faults are here.
//!
//! Everything here is simulated; what of it was fitted to a machine, docs/process-model.md says.

mod coupling;
mod front_end;
mod gated;
mod installation;
mod lines;
mod model;
mod normal;
mod plant;
mod random;
mod scale;
pub mod steps;

pub use crate::events::{Cable, FaultInputs};
pub use edm_process::Pulses;
use edm_process::Setting;
use edm_servo_head::technology::Pulse;
pub use gated::current_code;
pub use installation::Installation;
pub use plant::Plant;
use random::{Cause, Random};
pub use scale::Edge;

use crate::events::{Event, EventError, Timeline};
use coupling::Coupling;
pub use coupling::discharges;
use edm_hal_shim::bridge::Drive;
use edm_hal_shim::encoder::Levels;
use edm_hal_shim::gap::GapBlock;
use edm_hal_shim::reflex::{self, PulseCounts};
use edm_hal_shim::safety::{DriveCodes, SafetyInputs};
use edm_servo_head::settings::{SettingError, Value};
use edm_servo_head::units::{ADC_FULL_SCALE, CLOCK_HZ, TICK_HZ};
use front_end::FrontEnd;
use gated::Gated;
use lines::Lines;
pub use lines::{THRESHOLDS, crossing};
use model::Model;
use scale::Scale;
use steps::Steps;

/// Servo tick, us.
const TICK_US: f64 = 1e6 / TICK_HZ as f64;
/// Servo tick in clock ticks.
const TICK_CLOCK: u32 = CLOCK_HZ / TICK_HZ;
/// Noise of a conversion of the motor current, codes rms; assumed: a third of a code of the current amplifier (INA240) and as much of
/// the converter.
const NOISE_CODES: f64 = 0.5;
/// What a tick asks of a model.
#[derive(Clone, Copy, Debug)]
struct Tick<'a> {
    /// What the bridge does.
    drive: Drive,
    bus_v: f64,
    /// First surface of the work, m below the upper stop.
    surface_m: f64,
    /// Force of a hand on the head, N.
    hand_n: f64,
    /// Pulses may be made.
    pulses: bool,
    /// Changes of that within the tick, us since it began.
    permission: &'a [(f64, bool)],
    /// Off-time requested.
    off_us: Option<f64>,
    /// Least off-time after an open pulse, a spark, an arc, a short, us.
    pauses_us: [f64; 4],
    /// A wire lies across the gap.
    shorted: bool,
    /// The generator makes no pulses.
    dead: bool,
    /// The contact sense supply gives nothing.
    senseless: bool,
    /// Share of the pulses that arc whatever the gap is like.
    arcs: f64,
}

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
    /// What the pulses have done.
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
    /// Current, A, from when it began on.
    pub amps: edm_process::Edge,
    /// Gate on.
    pub gate: bool,
}

impl Piece {
    /// Voltage at a time, V.
    pub fn at(&self, us: f64) -> f64 {
        let age = (us - self.from_us).max(0.0);
        self.volts + (self.initial - self.volts) * (-age / self.rise_us).exp()
    }

    /// Current at a time, A.
    pub fn amps_at(&self, us: f64) -> f64 {
        self.amps.at((us - self.from_us).max(0.0))
    }
}

/// What really is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Truth {
    /// Time since the start, s.
    pub t_s: f64,
    /// Electrode carrier, um below the upper stop before a coarse axis has carried that.
    pub position_um: f64,
    /// Electrode face, um: the carrier less wear.
    pub face_um: f64,
    /// Velocity, um/s, positive toward the work.
    pub velocity_um_s: f64,
    /// Surface under the electrode, um.
    pub surface_um: f64,
    /// Surface before the first spark, um.
    pub first_surface_um: f64,
    /// Mean gap, um; negative in contact.
    pub gap_um: f64,
    /// Gap over the highest peak of the surface, um: what touches first.
    pub least_um: f64,
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
    /// Debris of the front gap, in 5 % by volume.
    pub debris: f64,
    /// Mean damage of the surfaces by arcs: 1 doubles a clean channel's recovery time.
    pub damage: f64,
    /// Share of the face before which nothing is left.
    pub through: f64,
    /// Force of the dielectric's film on the electrode, N, positive toward the work.
    pub film_n: f64,
}

/// The machine and the process.
#[derive(Clone, Debug)]
pub struct Process {
    around: Installation,
    model: Model,
    scale: Scale,
    front: FrontEnd,
    lines: Lines,
    coupling: Coupling,
    /// Voltages at which the high and the low comparator switch, V.
    comparators_v: [f64; 2],
    gated: Gated,
    ticks: u64,
    sensors: Sensors,
    /// Converter codes for an ampere of motor current and a volt of the bus.
    codes_per: (f64, f64),
    /// Of the conversions of motor current.
    noise: Random,
    timeline: Timeline,
    /// Off-time that the head requests of the generator, ns; its own without.
    pub off_time_ns: Option<u32>,
    /// Least off-time that the head gives an open pulse, a spark, an arc, a short, us: for a head whose own end of a pulse does not see the
    /// wires, as it has no interrupts. It knows what the pulse was.
    pub pauses_us: [f64; 4],
    /// When the head lets pulses through, or inhibits them, within the next tick, us since it begins: for wires that are seen in between.
    pub permission: Vec<(f64, bool)>,
    /// Wires to pull between two ticks.
    pub fault_inputs: FaultInputs,
    /// Step and direction outputs of a host.
    pub steps: Steps,
}

impl Process {
    /// A head at rest at its upper stop above a fresh workpiece. The same seed gives the same run.
    ///
    /// # Errors
    /// When a number does not fit.
    pub fn new(plant: Plant, seed: u64) -> Result<Process, SettingError> {
        plant.validate()?;
        let refused = |_| SettingError::Conflict { field: "model", rule: "does not fit" };
        let model = Model::new(&plant, seed).map_err(refused)?;
        let p = plant.installation;
        let scale = Scale::new(&p, seed);
        Ok(Process {
            model,
            front: FrontEnd::new(&p, seed),
            lines: Lines::default(),
            coupling: Coupling::new(&p, seed),
            comparators_v: plant.comparators_v(),
            gated: Gated::new(&p, seed),
            ticks: 0,
            sensors: Sensors {
                block: GapBlock::EMPTY,
                edges: Vec::with_capacity(64),
                timer_count: 0,
                levels: scale.levels(),
                now: 0,
                safety: SafetyInputs::default(),
                drive: DriveCodes::default(),
                pulses: PulseCounts::default(),
            },
            codes_per: (1.0 / f64::from(p.amps_per_code), 1.0 / f64::from(p.bus_per_code)),
            noise: Cause::MotorCurrent.stream(seed),
            timeline: Timeline::default(),
            off_time_ns: None,
            pauses_us: [0.0; 4],
            permission: Vec::new(),
            fault_inputs: FaultInputs::default(),
            steps: Steps::default(),
            scale,
            around: p,
        })
    }

    /// Sets the generator as a row of a technology table says; what it does not say stays.
    pub fn set_generator(&mut self, pulse: &Pulse) {
        let said = |value: u32| (value > 0).then(|| f64::from(value) * 1e-3);
        let set = Setting {
            on_us: said(pulse.on_ns),
            off_us: said(pulse.off_ns),
            amps: said(pulse.current_ma),
            negative: (pulse.polarity > 0).then_some(pulse.polarity == 1),
            burn_v: None,
        };
        // A generator that cannot be set so stays as it is, as a real one does.
        let _ = self.model.process.set_generator(&set);
    }

    /// Another burning voltage of sparks from now on, V, as of another electrode. One that the generator cannot have changes nothing.
    pub fn set_burn(&mut self, volts: f64) {
        let _ = self.model.process.set_generator(&Setting { burn_v: Some(volts), ..Setting::default() });
    }

    /// Sets the thresholds of the head's reflex, converter codes, and how long it waits in a pulse.
    pub fn set_reflex(&mut self, reflex: reflex::Config) {
        self.gated.reflex = reflex;
    }

    /// Lets these events happen, counted from the first tick, instead of those given before.
    pub fn schedule(&mut self, events: &[Event]) {
        self.timeline = Timeline::new(events);
    }

    /// Lets this happen at the beginning of the next tick, in addition to what is scheduled.
    ///
    /// # Errors
    /// When there is no such signal, or it cannot have this value.
    pub fn happen(&mut self, signal: &str, value: Value<'_>) -> Result<(), EventError> {
        self.timeline.now(signal, value)
    }

    /// Holds gap and debris, whatever the axis does, without erosion, arcs and bridges: the open loop in which the shot
    /// floor is measured.
    pub fn hold_gap(&mut self, um: f64, debris: f64) {
        self.model.hold_gap(um, debris);
    }

    /// Advances by one servo tick under the head's outputs and gives what its wires show at the end.
    pub fn advance(&mut self, drive: Drive, pulses: bool) -> &Sensors {
        let from = self.ticks as f64 * TICK_US;
        self.timeline.advance(self.ticks, &mut self.fault_inputs, self.around.bus.into());
        self.steps.waits |= self.fault_inputs.step_waits;
        self.steps.advance(self.fault_inputs.step_hz);
        self.front.stuck = self.fault_inputs.stuck_code;
        self.front.gate_lost = self.fault_inputs.gate_lost;
        self.scale.begin(self.fault_inputs.encoder);

        let permission = std::mem::take(&mut self.permission);
        let faults = &self.fault_inputs;
        let tick = Tick {
            drive: if faults.safety.bridge_fault { Drive::Coast } else { drive },
            bus_v: self.bus(),
            surface_m: self.surface_below_m(),
            hand_n: faults.hand_n,
            pulses: pulses || faults.disobeys,
            permission: if faults.disobeys { &[] } else { &permission },
            off_us: self.off_time_ns.map(|ns| f64::from(ns) * 1e-3),
            pauses_us: self.pauses_us,
            shorted: faults.short,
            dead: faults.generator_dead,
            senseless: faults.sense_off,
            arcs: faults.arcs,
        };
        let pulses_before = self.model.process.pulses();
        let (scale, now, edges) = (&mut self.scale, self.sensors.now, &mut self.sensors.edges);
        edges.clear();
        self.model.advance(&tick, |from, to, step, steps| {
            let ticks = f64::from(TICK_CLOCK) / steps as f64;
            scale.travel(from, to, now.wrapping_add((step as f64 * ticks) as u32), ticks, edges);
        });
        let shorts_before = self.gated.shorts;
        self.gated.look(from + TICK_US, self.model.stretches());
        self.count_pulses(pulses_before, shorts_before);
        self.sensors.block = self.front.convert(from, self.model.stretches());
        let (stretches, gate_lost) = (self.model.stretches(), self.front.gate_lost);
        self.lines.see(&mut self.sensors.block, from, stretches, self.comparators_v, gate_lost);

        let (clock, levels) = (self.sensors.now, self.sensors.levels);
        self.ticks += 1;
        self.sensors.now = self.sensors.now.wrapping_add(TICK_CLOCK);
        self.sense();
        let encoder = (levels, self.fault_inputs.encoder);
        self.coupling.disturb(&mut self.sensors, (from, clock), encoder, self.model.stretches());
        &self.sensors
    }

    /// Makes its last tick once more, from how it was `before`, with a permission that changes in it. What was asked of it since stays.
    pub fn repeat(&mut self, before: &Process, drive: Drive, pulses: bool, permission: &[(f64, bool)]) {
        let later = std::mem::replace(self, before.clone());
        self.permission.extend(permission);
        self.advance(drive, pulses);
        (self.fault_inputs, self.timeline) = (later.fault_inputs, later.timeline);
    }

    /// The gate wire divides on the board: to the timer that counts its edges, and to the one that starts the reflex's
    /// converter.
    fn count_pulses(&mut self, before: Pulses, shorts: u64) {
        let counts = &mut self.sensors.pulses;
        let add = |count: &mut u8, more: u64| *count = count.wrapping_add(more as u8);
        let after = self.model.process.pulses();
        let new = after.total() - before.total();
        if !self.fault_inputs.gate_lost {
            add(&mut counts.edges, 2 * new);
            counts.comparators = [counts.edges; 2];
            if !self.fault_inputs.start_lost {
                add(&mut counts.conversions, new);
                add(&mut counts.shorts, self.gated.shorts - shorts);
                let [current, voltage] = self.gated.newest;
                counts.newest = [current, self.fault_inputs.stuck_code.unwrap_or(voltage)];
            }
        }
    }

    /// Voltages at which the high and the low comparator switch, V.
    pub fn comparators_v(&self) -> [f64; 2] {
        self.comparators_v
    }

    /// Pulses so far.
    pub(crate) fn made(&self) -> Pulses {
        self.model.process.pulses()
    }

    fn bus(&self) -> f64 {
        self.fault_inputs.bus_v.unwrap_or(self.around.bus.into())
    }

    /// The same below the upper stop of the head, which a coarse axis may have carried.
    fn surface_below_m(&self) -> f64 {
        self.first_surface_m() - self.fault_inputs.carried_mm * 1e-3
    }

    /// First surface of the work, m below the place where the upper stop is before a coarse axis has carried it.
    fn first_surface_m(&self) -> f64 {
        (f64::from(self.around.surface) - self.fault_inputs.raised_mm) * 1e-3
    }

    fn sense(&mut self) {
        let bus = self.bus();
        let (x, current) = (self.model.axis.x, self.model.axis.i);
        let sensors = &mut self.sensors;
        sensors.levels = self.scale.levels();
        sensors.timer_count = self.scale.timer();
        let x_mm = x * 1e3;
        let opened = self.fault_inputs.safety;
        sensors.safety = SafetyInputs {
            upper_limit: opened.upper_limit || x_mm < self.around.upper_limit.into(),
            lower_limit: opened.lower_limit || x_mm > self.around.lower_limit.into(),
            ..opened
        };
        let code = |value: f64, per_unit: f64, zero: f64| {
            (zero + value * per_unit).clamp(0.0, f64::from(ADC_FULL_SCALE)) as i32 as u16
        };
        // The sensor sits between bridge and coil, so it does not know which way round the coil is.
        let sign = if self.around.motor_reversed { -1.0 } else { 1.0 };
        sensors.drive = DriveCodes {
            motor_current: code(
                sign * current,
                self.codes_per.0,
                2048.5 + NOISE_CODES * f64::from(normal::one(&mut self.noise)),
            ),
            bus_voltage: code(bus, self.codes_per.1, 0.5),
        };
    }

    /// What the wires show now.
    pub fn sensors(&self) -> &Sensors {
        &self.sensors
    }

    /// The gap during the last tick, in order of time: for wires that a converter's block does not show.
    pub fn pieces(&self) -> impl Iterator<Item = Piece> + '_ {
        let began = self.ticks.saturating_sub(1) as f64 * TICK_US;
        let gate_lost = self.fault_inputs.gate_lost;
        self.model.stretches().iter().map(move |s| Piece {
            from_us: s.from - began,
            initial: s.initial,
            volts: s.volts,
            rise_us: s.rise,
            amps: s.amps,
            gate: s.gate.0 < s.gate.1 && !gate_lost,
        })
    }

    /// Mean size of the last craters, um.
    pub fn crater_um(&self) -> f64 {
        self.model.process.truth().crater_um
    }

    /// Deepest pit that arcs in one place have left, um.
    pub fn pit_um(&self) -> f64 {
        self.model.process.truth().pit_um
    }

    /// What really is. Inlined, so that nobody pays for what he does not read of it.
    #[inline(always)]
    pub fn truth(&self) -> Truth {
        let Model { axis, process, .. } = &self.model;
        let (x, wear_um) = (axis.x, process.worn_um());
        let first_m = self.first_surface_m();
        let below_m = self.surface_below_m();
        let (contact_n, film_n) = self.model.forces_n();
        let position_um = x * 1e6 + self.fault_inputs.carried_mm * 1e3;
        Truth {
            t_s: self.ticks as f64 * TICK_US * 1e-6,
            position_um,
            face_um: position_um - wear_um,
            velocity_um_s: axis.v * 1e6,
            surface_um: (first_m + process.depth_um() * 1e-6) * 1e6,
            first_surface_um: f64::from(self.around.surface) * 1e3,
            gap_um: self.model.gap_um(below_m),
            least_um: process.truth().least_um,
            count: self.scale.true_count(x),
            pulses: process.pulses(),
            wear_um,
            contact_n,
            current_a: axis.i,
            debris: process.dirt(),
            damage: process.damage(),
            through: process.through(),
            film_n,
        }
    }
}

#[cfg(test)]
mod tests;
