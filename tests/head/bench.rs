//! A head on a bench: the actuator of the settings' defaults with 0.3 N of dry friction, an exact encoder, a gap that reads in
//! proportion to its width. Every wire can be pulled.

use edm_hal_shim::bridge::Drive;
use edm_hal_shim::encoder::RawCount;
use edm_hal_shim::reflex::PulseCounts;
use edm_hal_shim::safety::{DriveCodes, SafetyInputs};
use edm_servo_head::encoder::Snapshot;
use edm_servo_head::gap::pulses::{Class, Counts};
use edm_servo_head::gap::{GapReading, Quality};
use edm_servo_head::head::{Change, Command, Fault, Head, Inputs, LEAD, MotionLimits, State, TickOutput};
use edm_servo_head::path::Path;
use edm_servo_head::settings::Settings;
use edm_servo_head::units::{
    CLOCK_HZ, MicrometresPerSecond, MicrometresPerSecond2, Nanometres, TICK_HZ, TICK_S, Volts,
};

/// Duty of an open-loop lift: weight plus 20 %, and 0.3 N of friction, less counterbalance: 0.453 N up.
pub const LIFT: f64 = -0.01563;

/// The bench, in SI units; um where it says so.
pub struct Bench {
    pub head: Head<Box<Path>>,
    pub settings: Settings,
    pub output: TickOutput,
    /// Position of the head, m, positive toward the work.
    pub x: f64,
    pub v: f64,
    /// Workpiece surface, um.
    pub surface_um: f64,
    /// The surface goes with the head, at this gap, um: what hangs between them is no work.
    pub follows: Option<f64>,
    /// Force from outside, N, positive toward the work.
    pub push: f64,
    pub safety: SafetyInputs,
    pub bus: f64,
    pub quality: Quality,
    /// The encoder stands still whatever the head does.
    pub encoder_dead: bool,
    /// The second counter, where wired, is off by this.
    pub watch_offset: Option<i32>,
    pub encoder_sign: f64,
    pub motor_sign: f64,
    pub gap_sign: f64,
    pub host_alive: bool,
    pub extra_amps: f64,
    pub stroke_m: f64,
    /// The reflex begins a retreat before the next tick.
    pub reflex: bool,
    /// Edges of the gate in each tick, which start no conversion.
    pub edges: u8,
    /// What the generator gives.
    pub open_v: f64,
    /// What of a hundred pulses arcs.
    pub arcs: u32,
    pulses: PulseCounts,
    counts: Counts,
    pub drive_stands: bool,
    count: i64,
    last_edge: u32,
    toward_work: bool,
    now: u32,
    ticks: u64,
    short_ticks: u32,
}

const FRICTION_N: f64 = 0.3;
pub const OPEN_V: f64 = 100.0;
pub const SLOPE_V_UM: f64 = 2.0;

impl Bench {
    pub fn with(change: impl FnOnce(&mut Settings)) -> Bench {
        let mut settings = Settings { commissioned: true, ..Settings::default() };
        change(&mut settings);
        let active = settings.build().expect("the test's settings fit together");
        Bench {
            head: Head::new(active.head, Box::new(Path::EMPTY)),
            settings,
            output: TickOutput::default(),
            x: 0.0,
            v: 0.0,
            surface_um: 2000.0,
            follows: None,
            push: 0.0,
            safety: SafetyInputs::default(),
            bus: 48.0,
            quality: Quality::Valid,
            encoder_dead: false,
            watch_offset: None,
            encoder_sign: 1.0,
            motor_sign: 1.0,
            gap_sign: 1.0,
            host_alive: true,
            extra_amps: 0.0,
            stroke_m: 0.012,
            reflex: false,
            edges: 0,
            open_v: OPEN_V,
            arcs: 0,
            pulses: PulseCounts::default(),
            counts: Counts::default(),
            drive_stands: false,
            count: 0,
            last_edge: 0,
            toward_work: true,
            now: 0,
            ticks: 0,
            short_ticks: 0,
        }
    }

    pub fn new() -> Bench {
        Bench::with(|_| {})
    }

    /// Enabled and homed at the upper stop, 2 mm above the work.
    pub fn ready() -> Bench {
        let mut bench = Bench::new();
        bench.make_ready();
        bench
    }

    /// The same, with no work in the way, after the whole travel has been gone through slowly.
    pub fn cleared() -> Bench {
        let mut bench = Bench::ready();
        bench.surface_um = 1e6;
        let ramp = MicrometresPerSecond2(1e6);
        let limits = MotionLimits { velocity: MicrometresPerSecond(1e5), acceleration: ramp, deceleration: ramp };
        for to in [12_000_000, 0] {
            bench.command(Command::Position(Nanometres(to), limits));
            bench.run_until(3.0, |bench| bench.state() == State::Ready);
            bench.run(0.1);
        }
        bench.changes();
        bench
    }

    pub fn make_ready(&mut self) {
        self.run(0.01);
        self.command(Command::Enable);
        self.command(Command::SetHome(Nanometres(0)));
        self.run(0.01);
    }

    /// Eroding, a little way into the work.
    pub fn eroding() -> Bench {
        let mut bench = Bench::ready();
        bench.erode();
        bench
    }

    pub fn erode(&mut self) {
        self.command(Command::MoveTo(Nanometres(4_000_000)));
        self.command(Command::Start);
        self.run_until(10.0, |bench| bench.state() == State::Eroding);
        self.run(1.0);
        assert_eq!(self.state(), State::Eroding);
    }

    /// Puts a head that is switched off somewhere else, and waits until its estimates have forgotten the jump.
    pub fn put(&mut self, x: f64) {
        (self.x, self.v) = (x, 0.0);
        self.run(0.4);
        (self.x, self.v) = (x, 0.0);
    }

    pub fn command(&mut self, command: Command) {
        self.head.command(command).unwrap_or_else(|refused| panic!("{command:?}: {refused}"));
    }

    pub fn state(&self) -> State {
        self.head.status().state
    }

    pub fn fault(&self) -> Option<Fault> {
        self.head.status().fault
    }

    pub fn um(&self) -> f64 {
        self.x * 1e6
    }

    pub fn coasts(&self) -> bool {
        self.output.drive == Drive::Coast
    }

    pub fn duty(&self) -> f64 {
        match self.output.drive {
            Drive::Duty(duty) => f64::from(duty) / f64::from(Drive::FULL),
            Drive::Coast | Drive::Brake => 0.0,
        }
    }

    pub fn changes(&mut self) -> Vec<Change> {
        std::iter::from_fn(|| self.head.next_change()).collect()
    }

    pub fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds * f64::from(TICK_HZ)) as u64 {
            self.tick();
        }
    }

    pub fn run_until(&mut self, seconds: f64, mut done: impl FnMut(&Bench) -> bool) {
        for _ in 0..(seconds * f64::from(TICK_HZ)) as u64 {
            self.tick();
            if done(self) {
                // What has been decided comes into force.
                (0..LEAD).for_each(|_| self.tick());
                return;
            }
        }
        panic!("not within {seconds} s: {:?}", self.head.status());
    }

    pub fn tick(&mut self) {
        self.move_axis();
        if let Some(gap) = self.follows {
            self.surface_um = self.um() + gap;
        }
        self.ticks += 1;
        self.now = self.now.wrapping_add(CLOCK_HZ / TICK_HZ);
        let count = (self.um() * self.encoder_sign).floor() as i64;
        if count != self.count && !self.encoder_dead {
            self.toward_work = count > self.count;
            self.count = count;
            self.last_edge = self.now;
        }
        let raw = RawCount {
            count: self.count as u32,
            last_edge: self.last_edge,
            toward_work: self.toward_work,
            now: self.now,
        };
        let watch = self.watch_offset.map(|off| RawCount { count: raw.count.wrapping_add_signed(off), ..raw });
        let [edges, conversions] = if self.output.pulses && self.quality != Quality::NoGate { [2, 1] } else { [0; 2] };
        let edges = self.edges.wrapping_add(edges);
        self.pulses.edges = self.pulses.edges.wrapping_add(edges);
        self.pulses.conversions = self.pulses.conversions.wrapping_add(conversions);
        // An open pulse or an arc, evenly mixed.
        let arc = self.ticks * u64::from(self.arcs) % 100 < u64::from(self.arcs);
        let class = if arc { Class::Arc } else { Class::Open };
        self.counts.classes[class as usize] += u32::from(edges / 2);
        self.counts.waits += if arc { 0 } else { u32::from(edges / 2) };
        // A sound converter.
        let noise = (self.ticks % 7) as u16;
        self.pulses.newest = [2048, 1410].map(|code| code + noise);
        self.pulses.comparators = [self.pulses.edges; 2];
        self.pulses.shorts = self.pulses.shorts.wrapping_add((self.short_ticks > 0).into());
        let inputs = Inputs {
            gap: self.gap(),
            encoder: Snapshot { raw, ..Snapshot::default() },
            watch,
            pulses: self.pulses,
            drive_stands: self.drive_stands,
            safety: self.safety.unsafe_ones(),
            drive: DriveCodes {
                // The sensor sits between bridge and coil: it does not know which way round the coil is.
                // A code of noise.
                motor_current: (2048.0
                    + self.motor_sign * self.amps() / f64::from(self.settings.motor_amps_per_code)
                    + (self.ticks % 2) as f64)
                    .clamp(0.0, 4095.0) as u16,
                bus_voltage: (self.bus / f64::from(self.settings.motor_bus_per_code)) as u16,
            },
            reflex: std::mem::take(&mut self.reflex),
            host_alive: self.host_alive,
        };
        self.output = self.head.tick(&inputs);
        let state = self.head.in_force().state;
        assert!(!self.output.pulses || state.pulses() || state == State::Commissioning, "pulses while {state:?}");
    }

    fn amps(&self) -> f64 {
        let drive = match self.output.drive {
            Drive::Coast => 0.0,
            Drive::Brake => -7.5 * self.v / 12.4,
            Drive::Duty(_) => (self.duty() * self.motor_sign * self.bus - 7.5 * self.v) / 12.4,
        };
        drive + self.extra_amps
    }

    /// Force toward the work that friction does not take, N.
    pub fn force(&self) -> f64 {
        7.5 * (self.amps() - self.extra_amps) + 0.2 * 9.80665 - 2.2 + self.push
    }

    fn move_axis(&mut self) {
        let dt = f64::from(TICK_S);
        let force = self.force();
        let free = self.v + force / 0.2 * dt;
        let slowed = free.abs() - FRICTION_N / 0.2 * dt;
        self.v = if slowed > 0.0 { slowed.copysign(free) } else { 0.0 };
        self.x += self.v * dt;
        if self.x < 0.0 || self.x > self.stroke_m {
            self.x = self.x.clamp(0.0, self.stroke_m);
            self.v = 0.0;
        }
    }

    fn gap(&mut self) -> GapReading {
        let gap = self.surface_um - self.um();
        let volts = if self.output.pulses { (gap * SLOPE_V_UM).clamp(0.0, self.open_v) } else { 0.0 };
        let shorted = self.output.pulses && gap <= 0.0;
        self.short_ticks = if shorted { self.short_ticks + 1 } else { 0 };
        let quality = match self.quality {
            Quality::Valid if self.gap_sign < 0.0 && volts > 10.0 => Quality::Reversed,
            other => other,
        };
        let volts = Volts((volts * self.gap_sign) as f32);
        let touches = !self.output.pulses && gap <= 0.0;
        GapReading {
            filtered: volts,
            block: volts,
            mean: volts,
            quality,
            touches,
            short_ticks: self.short_ticks,
            code: 2000 + (self.ticks % 7) as u16,
            pulses: self.counts,
            regauged: 0.0,
        }
    }
}
