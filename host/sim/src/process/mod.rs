//! Process model: what the head's wires are connected to.
//!
//! Pulses are events in continuous time, mechanics run in steps of 12.5 us, conversions happen at their own instants. All
//! randomness comes from one seed, in separate streams for ignition, arcs, bridges, front end and encoder, so that a
//! change of one cause leaves the others as they were. Every parameter has its source in [`Parameters`].
//!
//! Everything here is simulated; nothing was fitted to a machine.

mod actuator;
mod front_end;
mod parameters;
mod scale;
mod spark;

pub use parameters::Parameters;
pub use scale::Edge;
pub use spark::Pulses;

use actuator::{Actuator, Load, STEP_S, STEPS};
use edm_hal_shim::bridge::Drive;
use edm_hal_shim::encoder::Levels;
use edm_hal_shim::gap::{BLOCK, GapBlock};
use edm_hal_shim::safety::{DriveCodes, SafetyInputs};
use edm_servo_head::settings::SettingError;
use edm_servo_head::units::{ADC_FULL_SCALE, CLOCK_HZ, TICK_HZ};
use front_end::FrontEnd;
use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use scale::Scale;
use spark::{Spark, Stretch};
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
    /// Debris concentration; 1 at the default working point.
    pub debris: f64,
}

/// Wires to pull and contacts to open.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mishaps {
    /// Contacts opened besides those that the axis opens.
    pub safety: SafetyInputs,
    /// Bus voltage instead of the set one.
    pub bus_v: Option<f64>,
    /// Converter code whatever the gap does.
    pub stuck_code: Option<u16>,
    /// The encoder lines stand still.
    pub encoder_dead: bool,
    /// The generator makes no pulses.
    pub generator_dead: bool,
    /// A wire across the gap.
    pub short: bool,
}

/// The machine and the process.
#[derive(Clone, Debug)]
pub struct Process {
    p: Parameters,
    actuator: Actuator,
    scale: Scale,
    spark: Spark,
    front: FrontEnd,
    random: Xoshiro256PlusPlus,
    ticks: u64,
    held_gap_um: Option<f64>,
    sensors: Sensors,
    stretches: Vec<Stretch>,
    film: f64,
    face_area: f64,
    /// Wires to pull between two ticks.
    pub mishaps: Mishaps,
}

impl Process {
    /// A head at rest at its upper stop above a fresh workpiece. The same seed gives the same run.
    pub fn new(p: &Parameters, seed: u64) -> Result<Process, SettingError> {
        p.validate()?;
        let scale = Scale::new(p);
        let radius = f64::from(p.radius) * 1e-3;
        Ok(Process {
            actuator: Actuator::new(p),
            spark: Spark::new(p, seed),
            front: FrontEnd::new(p, seed),
            random: Xoshiro256PlusPlus::seed_from_u64(seed.wrapping_mul(16).wrapping_add(5)),
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
            },
            stretches: Vec::with_capacity(64),
            film: 3.0 * PI * f64::from(p.viscosity) * 1e-3 * radius.powi(4) / 2.0,
            face_area: PI * radius * radius,
            mishaps: Mishaps::default(),
            scale,
            p: *p,
        })
    }

    /// Holds gap and debris, whatever the axis does, without erosion: the open loop in which the shot floor is measured.
    pub fn hold_gap(&mut self, um: f64, debris: f64) {
        self.held_gap_um = Some(um);
        self.spark.freeze(debris);
    }

    /// Advances by one servo tick under the head's outputs and gives what its wires show at the end.
    pub fn advance(&mut self, drive: Drive, pulses: bool) -> &Sensors {
        let from = self.ticks as f64 * TICK_US;
        self.front.stuck = self.mishaps.stuck_code;
        self.scale.dead = self.mishaps.encoder_dead;
        self.spark.dead = self.mishaps.generator_dead;
        self.spark.forced_short = self.mishaps.short;

        let before = self.gap_um();
        self.move_axis(drive);
        let after = self.gap_um();
        let gap = self.held_gap_um.map_or((before, after), |held| (held, held));
        self.stretches.clear();
        self.spark.advance(from, from + TICK_US, gap, pulses, &mut self.stretches);
        self.sensors.block = self.front.convert(from, &self.stretches);

        self.ticks += 1;
        self.sensors.now = self.sensors.now.wrapping_add(TICK_CLOCK);
        self.sense();
        &self.sensors
    }

    fn bus(&self) -> f64 {
        self.mishaps.bus_v.unwrap_or(self.p.bus.into())
    }

    fn move_axis(&mut self, drive: Drive) {
        self.sensors.edges.clear();
        let bus = self.bus();
        let surface = self.surface_m() + self.spark.wear_um * 1e-6;
        let ticks = f64::from(TICK_CLOCK) / STEPS as f64;
        for step in 0..STEPS {
            let from = self.actuator.x;
            let load = self.load(surface - from);
            self.actuator.step(drive, bus, load);
            let start = self.sensors.now.wrapping_add((step as f64 * ticks) as u32);
            self.scale.travel(from, self.actuator.x, start, ticks, &mut self.random, &mut self.sensors.edges);
        }
        debug_assert!(self.actuator.v.abs() * STEP_S < 1e-3);
    }

    /// Contact and squeeze film: 3 pi mu R^4 v / (2 h^3), whose suction ends at the weight of the atmosphere.
    fn load(&self, gap: f64) -> Load {
        if gap <= 0.0 {
            return Load { force: gap * f64::from(self.p.contact) * 1e6, damping: CONTACT_DAMPING };
        }
        let damping = self.film / gap.max(THINNEST_FILM).powi(3);
        let suction = -self.actuator.v * damping;
        let most = ATMOSPHERE * self.face_area;
        if suction > most { Load { force: most, damping: 0.0 } } else { Load { force: 0.0, damping } }
    }

    fn sense(&mut self) {
        let sensors = &mut self.sensors;
        sensors.levels = self.scale.levels();
        let count = self.scale.count(self.actuator.x);
        // The timer is on the same lines: dead for one is dead for both.
        if !self.mishaps.encoder_dead {
            let signed = if self.p.encoder_reversed { -count } else { count };
            sensors.timer_count = signed as u32;
        }
        let x_mm = self.actuator.x * 1e3;
        let opened = self.mishaps.safety;
        sensors.safety = SafetyInputs {
            upper_limit: opened.upper_limit || x_mm < self.p.upper_limit.into(),
            lower_limit: opened.lower_limit || x_mm > self.p.lower_limit.into(),
            ..opened
        };
        let code = |value: f64, per_code: f32, zero: f64| {
            (zero + value / f64::from(per_code)).clamp(0.0, f64::from(ADC_FULL_SCALE)) as u16
        };
        let bus = self.mishaps.bus_v.unwrap_or(self.p.bus.into());
        let sign = if self.p.motor_reversed { -1.0 } else { 1.0 };
        sensors.drive = DriveCodes {
            motor_current: code(sign * self.actuator.i, self.p.amps_per_code, 2048.5),
            bus_voltage: code(bus, self.p.bus_per_code, 0.5),
        };
    }

    fn surface_m(&self) -> f64 {
        f64::from(self.p.surface) * 1e-3 + self.spark.removed_um * 1e-6
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
        let rise_us = self.p.rise.into();
        self.stretches.iter().map(move |s| Piece {
            from_us: s.from - began,
            initial: s.initial,
            volts: s.volts,
            rise_us,
            gate: s.gate,
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
            count: self.scale.count(self.actuator.x),
            pulses: self.spark.pulses,
            wear_um: self.spark.wear_um,
            debris: self.spark.debris(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(process: &mut Process, drive: Drive, pulses: bool, seconds: f64) {
        for _ in 0..(seconds * f64::from(TICK_HZ)) as u64 {
            process.advance(drive, pulses);
        }
    }

    #[test]
    fn the_same_seed_gives_the_same_run_and_another_seed_another() {
        let codes = |seed| {
            let mut process = Process::new(&Parameters::default(), seed).unwrap();
            process.hold_gap(30.0, 0.0);
            (0..1000).map(|_| process.advance(Drive::Coast, true).block).collect::<Vec<_>>()
        };
        assert_eq!(codes(1), codes(1));
        assert_ne!(codes(1), codes(2));
    }

    #[test]
    fn the_resting_head_stays_at_its_stop_at_count_zero() {
        let mut process = Process::new(&Parameters::default(), 1).unwrap();
        run(&mut process, Drive::Coast, false, 1.0);
        let truth = process.truth();
        assert_eq!(truth.count, 0);
        assert!(truth.position_um.abs() < 0.2, "{}", truth.position_um);
        assert!(process.sensors().edges.is_empty());
    }

    #[test]
    fn driven_onto_the_work_it_is_stopped_by_contact_and_shorts() {
        let mut process = Process::new(&Parameters::default(), 1).unwrap();
        run(&mut process, Drive::Duty(700), true, 2.0);
        let truth = process.truth();
        assert!((-3.0..0.0).contains(&truth.gap_um), "{}", truth.gap_um);
        let shorts = truth.pulses.short;
        run(&mut process, Drive::Duty(700), true, 0.1);
        assert_eq!(process.truth().pulses.short - shorts, 500);
    }

    #[test]
    fn a_thin_film_slows_the_approach_and_holds_back_the_retreat() {
        let fall = |viscosity| {
            let p =
                Parameters { viscosity, friction: 0.0, surface: 0.02, counterbalance: 0.0, ..Parameters::default() };
            let mut process = Process::new(&p, 1).unwrap();
            run(&mut process, Drive::Coast, false, 0.0015);
            process.truth().position_um
        };
        assert!(fall(100.0) < 0.8 * fall(0.1), "{} {}", fall(100.0), fall(0.1));
    }

    #[test]
    fn the_codes_of_current_and_bus_read_what_flows() {
        let mut process = Process::new(&Parameters::default(), 1).unwrap();
        run(&mut process, Drive::Duty(-1000), false, 0.1);
        let drive = process.sensors().drive;
        // 4.8 V over 12.4 ohm against the stop: 0.387 A, 77 codes up.
        assert!((2048 - 78..=2048 - 76).contains(&drive.motor_current), "{drive:?}");
        assert_eq!(drive.bus_voltage, 2400);
    }

    #[test]
    fn a_bad_parameter_is_refused() {
        let p = Parameters { burn: 99.0, open: 50.0, ..Parameters::default() };
        assert!(matches!(Process::new(&p, 1), Err(SettingError::Conflict { field: "generator.burn_v", .. })));
        let p = Parameters { mass: f32::NAN, ..Parameters::default() };
        assert!(matches!(Process::new(&p, 1), Err(SettingError::NotAllowed(field)) if field.key == "actuator.mass_kg"));
    }
}
