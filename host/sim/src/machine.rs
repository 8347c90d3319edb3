//! The closed loop on a PC: the tasks of a head on the process model, tick by tick.
//!
//! [`Core`] is what every head has: process, encoder, gap and servo task, supervision. They are called by priority at their
//! times, as RTIC calls them on the chip: in each period of the PWM the edges of the encoder, the block of conversions, the
//! tick, and the plan when it requests one; every millisecond the supervision. What commands the head is the protocol of a
//! virtual head ([`crate::serve`]), or, in a [`Machine`], its owner.

use crate::board::{Dry, PLAN, Part, Pc, Ports, Source};
use crate::process::{Plant, Process, Pulses, Sensors};
use edm_hal_shim::encoder::Line;
use edm_hal_shim::steps::STAMPS;
use edm_runtime::assemble::{Host, IdleEnds};
use edm_runtime::can::{Receive, Transmit};
use edm_runtime::crossings::{Answer, HeadConfig, PROTOCOL, Request};
use edm_runtime::encoder::Decoder;
use edm_runtime::gap::Gap;
use edm_runtime::plan::Plans;
use edm_runtime::servo::Servo;
use edm_runtime::supervise::Supervise;
use edm_runtime::{Crossings, HostEnds, Parts, Room, Signals, Tasks, assemble};
use edm_servo_head::encoder::Shared as Published;
use edm_servo_head::gap::{Surrogate, SurrogateConfig, Voltage};
use edm_servo_head::head::{
    Change, Command, Evidence, Fault, Finding, Refused, Report, Status, SupervisionConfig, TickInput,
};
use edm_servo_head::path::Path;
use edm_servo_head::scope::Memory;
use edm_servo_head::settings::{Active, SettingError, Settings};
use edm_servo_head::units::{CLOCK_HZ, Fixed, MicrometresPerSecond, Nanometres, PLAN_TICKS, TICKS_PER_MS, Volts};
use edm_technology::File;
use std::mem::MaybeUninit;
use std::sync::atomic::Ordering::Relaxed;

/// Gap that counts as right in the dry loop, um.
const DRY_GAP_UM: f64 = 40.0;
/// Tick of a millisecond after which the supervision runs: the head has reported in it.
pub(crate) const SUPERVISED: u32 = 2;

/// A head with its process, wherever the head runs.
pub trait Rig {
    /// The machine and the process.
    fn process(&self) -> &Process;
    /// What the head knows after the last tick.
    fn status(&self) -> &Status;
    /// Oldest change of the head's state not read yet; those that end in a fault at least.
    fn next_change(&mut self) -> Option<Change>;
    /// One servo tick.
    ///
    /// # Errors
    /// When the head cannot go on.
    fn tick(&mut self) -> Result<(), String>;
    /// Gives the head a command that must be accepted in its present state. Ticks may pass.
    ///
    /// # Errors
    /// When it is refused.
    fn command(&mut self, command: Command) -> Result<(), String>;
    /// Has the head run settings that differ in feed.max_um_s alone. Ticks may pass.
    ///
    /// # Errors
    /// When they are refused.
    fn limit_feed(&mut self, settings: &Settings) -> Result<(), String>;
    /// Has the head make a hole of this depth row after row of a table, by itself. Ticks may pass.
    ///
    /// # Errors
    /// When it is refused, or the rig has no drive that could.
    fn erode_by(&mut self, _table: &File, _to: Nanometres) -> Result<(), String> {
        Err("a table of technology needs a head that is commanded over its bus".into())
    }
    /// Row of the table under way, from 1. Ticks may pass.
    ///
    /// # Errors
    /// When the head does not answer.
    fn row(&mut self) -> Result<Option<u8>, String> {
        Ok(None)
    }
    /// Has a coarse axis carry the head to so many mm from where it was.
    fn carry(&mut self, mm: f64);
    /// The true count at the moment that the position of the status is of.
    fn true_count(&self) -> i64 {
        self.process().truth().count
    }
    /// Gap voltage of the newest block, before the filters.
    fn gap_block(&self) -> Volts {
        self.status().gap.block
    }
    /// Position of the imagined surface of the dry loop, um; `None` with a real gap.
    fn imagined_surface_um(&self) -> Option<f64> {
        None
    }
}

impl Rig for Machine {
    fn process(&self) -> &Process {
        &self.process
    }
    fn status(&self) -> &Status {
        Machine::status(self)
    }
    fn next_change(&mut self) -> Option<Change> {
        Machine::next_change(self)
    }
    fn tick(&mut self) -> Result<(), String> {
        Machine::tick(self);
        Ok(())
    }
    fn command(&mut self, command: Command) -> Result<(), String> {
        Machine::command(self, command).map_err(|refused| format!("{command:?} was refused: {refused}"))
    }
    fn limit_feed(&mut self, settings: &Settings) -> Result<(), String> {
        let active = settings.build().map_err(|error| error.to_string())?;
        Machine::configure(self, &active).map_err(|refused| format!("feed.max_um_s was refused: {refused}"))
    }
    fn carry(&mut self, mm: f64) {
        self.process.fault_inputs.carried_mm = mm;
    }
    fn gap_block(&self) -> Volts {
        self.core.ports.gap_block.get()
    }
    fn imagined_surface_um(&self) -> Option<f64> {
        Machine::imagined_surface_um(self)
    }
}

/// The tasks that every head has, above those that command it.
pub struct Core {
    /// What the tasks see and set.
    pub ports: &'static Ports,
    pub(crate) signals: &'static Signals,
    /// Where the decoder says what it has counted.
    pub(crate) published: &'static Published,
    pub(crate) decoder: Decoder<Pc>,
    pub(crate) gap: Gap<Pc>,
    pub(crate) servo: Servo<Pc>,
    pub(crate) plan: &'static mut Plans<Pc>,
    pub(crate) supervise: &'static mut Supervise<Pc>,
    pub(crate) ticks: u32,
    status: Status,
}

/// The tasks that command a head, before they are chosen.
pub struct Others {
    /// Of the protocol, or of its substitute.
    pub host: Host<Pc>,
    /// Of idle.
    pub idle: IdleEnds<Pc>,
    /// Frames that come.
    pub receive: Receive<Pc>,
    /// Frames that go.
    pub transmit: Transmit<Pc>,
}

impl Core {
    /// The tasks of a disabled head whose wires show what `process` does. What they share is there for as long as the program
    /// runs, as on the chip.
    pub fn new(active: &Active, process: &Process) -> (Core, Others) {
        let ports = Ports::leak();
        show(ports, process);
        Core::on(ports, active)
    }

    /// The same over ports that show something already.
    pub fn on(ports: &'static Ports, active: &Active) -> (Core, Others) {
        let signals: &'static Signals = Box::leak(Box::default());
        ports.pauses.set(Some(&signals.pauses));
        let crossings: &'static mut Crossings = Box::leak(Box::default());
        let path: &'static mut Path = Box::leak(Box::new(Path::EMPTY));
        let published: &'static Published = Box::leak(Box::default());
        let part = Part(ports);
        let parts = Parts {
            clock: part,
            caller: part,
            self_test: ports.self_test.get(),
            published: (published, published),
            lines: part,
            guard: part,
            timer: part,
            blocks: part,
            source: Source { voltage: Voltage::new(active.gap), ports },
            bridge: part,
            generator: part,
            inputs: part,
            drive: part,
            registers: part,
            forced: part,
            live: part,
            tick: part,
            millisecond: part,
            steps: part,
            thresholds: part,
            can: Some((part, part, part)),
            sync: part,
            scope: Memory::leak(),
        };
        let room = Room { plan: leak(), supervise: leak(), crossings: leak() };
        let Ok(tasks) = assemble(parts, room, crossings, signals, active, path);
        let Tasks { decoder, gap, servo, plan, supervise, receive, transmit, host, idle } = tasks;
        let status = *plan.planner().status();
        let core = Core { ports, signals, published, decoder, gap, servo, plan, supervise, ticks: 0, status };
        (core, Others { host, idle, receive, transmit })
    }

    /// One period of the PWM: the process advances by 50 us, then encoder, gap and servo task run on what it shows, and every
    /// millisecond the supervision. Whether this was its turn.
    pub fn tick(&mut self, process: &mut Process) -> bool {
        self.period(process);
        let supervised = self.ticks % TICKS_PER_MS == SUPERVISED;
        if supervised {
            self.ports.period.set(true);
        }
        if supervised || self.ports.wanted(crate::board::SUPERVISE) {
            self.supervise.tick();
        }
        supervised
    }

    /// The same without the supervision.
    fn period(&mut self, process: &mut Process) {
        let ports = self.ports;
        self.ticks = self.ticks.wrapping_add(1);
        let made = process.made();
        let sensors = go_on(ports, process);
        for &(time, levels) in &sensors.edges {
            ports.now.set(time);
            ports.levels.set(levels);
            // Which line it is does not matter to a PC: its lines need no acknowledgement.
            self.decoder.edge(Line::A);
        }
        show(ports, process);
        self.count_pauses(&process.made().since(&made));
        self.gap.block();
        self.servo.tick();
        self.follow_up();
    }

    /// The plan, if the tick has requested one; and what is known then.
    pub(crate) fn follow_up(&mut self) {
        if self.ports.wanted(PLAN) {
            self.plan.run();
            self.status = *self.plan.planner().status();
        }
        self.servo.follower().report(&mut self.status);
        self.ports.position.set(self.status.position);
    }

    /// The process makes the pauses, as the fast path does on the chip.
    fn count_pauses(&self, pulses: &Pulses) {
        let ended = [pulses.open, pulses.spark, pulses.arc, pulses.short];
        let held = ended.into_iter().zip(self.ports.holds()).filter(|(_, hold)| *hold > 0);
        let new: u32 = held.map(|(ended, _)| ended as u32).sum();
        self.ports.pauses_begun.set(self.ports.pauses_begun.get().wrapping_add(new));
    }

    /// Reports in place of the protocol, for a head that is commanded without it.
    pub(crate) fn reports(&self) {
        self.signals.task_watchdog.report(PROTOCOL, self.ports.now.get());
    }

    /// What the head knows after the last tick.
    pub fn status(&self) -> &Status {
        &self.status
    }

    /// What the head saw in the last tick.
    pub fn input(&self) -> &TickInput {
        self.servo.input()
    }

    /// A host has given a life sign.
    pub fn host_is_alive(&self) {
        self.signals.host.set();
    }
}

/// Room that is there for as long as the program runs.
pub(crate) fn leak<T>() -> &'static mut MaybeUninit<T> {
    Box::leak(Box::new_uninit())
}

/// Advances the process by a period under the outputs of the head.
pub(crate) fn go_on<'a>(ports: &Ports, process: &'a mut Process) -> &'a Sensors {
    process.off_time_ns = ports.off_time_ns.get();
    process.steps.ready = ports.takes_steps.get();
    process.pauses_us = ports.holds().map(|cycles| f64::from(cycles) * 1e6 / f64::from(CLOCK_HZ));
    if let Some(thresholds) = ports.thresholds.get() {
        process.set_reflex(thresholds);
    }
    process.advance(ports.drive.get(), ports.pulses.get())
}

/// Puts what the wires of a process show on the ports.
pub(crate) fn show(ports: &Ports, process: &Process) {
    let sensors = process.sensors();
    ports.now.set(sensors.now);
    ports.levels.set(sensors.levels);
    ports.timer.set(sensors.timer_count);
    ports.block.set(Some(sensors.block));
    ports.safety.set(sensors.safety);
    ports.codes.set(sensors.drive);
    ports.pulse_counts.set(sensors.pulses);
    let (counted, ring) = process.steps.counted();
    let mut number = ports.steps.get().stamps;
    while number != counted.stamps {
        let place = number as usize % STAMPS;
        ports.stamps.0[place].store(ring[place], Relaxed);
        number = (number + 1) % STAMPS as u32;
    }
    ports.steps.set(counted);
}

/// Head, process and the wires between them; the owner commands the head.
pub struct Machine {
    /// The machine and the process.
    pub process: Process,
    /// A host gives life signs.
    pub host_alive: bool,
    core: Core,
    ends: HostEnds,
    count_um: f64,
}

impl Machine {
    /// A head at rest at its upper stop, disabled.
    ///
    /// # Errors
    /// When the values do not fit together.
    pub fn new(plant: Plant, settings: &Settings, seed: u64) -> Result<Machine, SettingError> {
        let active = settings.build()?;
        let process = Process::new(plant, seed)?;
        let (core, others) = Core::new(&active, &process);
        let ends = others.host.ends;
        Ok(Machine { process, host_alive: true, core, ends, count_um: settings.encoder_count.into() })
    }

    /// Replaces the gap signal by position, noise and imagined erosion (Roberts, section 6.8): the dry loop. The imagined
    /// surface begins at `surface_um`; no real one should be in the way. The generator is off.
    pub fn run_dry(&mut self, settings: &Settings, surface_um: f64, seed: u64) {
        // C of [R] section 6.8 as 0.2 mm/min, worse by half of that for 3 um of error; noise of 0.5, as in section 7.1.
        let config = SurrogateConfig {
            setpoint: Volts(settings.gap_setpoint),
            open: Volts(100.0),
            slope: 1.0,
            erosion: MicrometresPerSecond(3.3),
            worsening: 0.5,
            noise: Volts(0.5),
        };
        // The gap is right some way above the surface, so that the seek comes from an open gap.
        let right = Fixed::whole((surface_um - DRY_GAP_UM) as i64);
        let source = Surrogate::new(right, seed as u32);
        *self.core.ports.dry.borrow_mut() = Some(Dry { source, config, count_um: self.count_um });
        self.process.fault_inputs.generator_dead = true;
    }

    /// Position of the imagined surface of the dry loop, um; `None` with a real gap.
    pub fn imagined_surface_um(&self) -> Option<f64> {
        let dry = self.core.ports.dry.borrow();
        dry.as_ref().map(|dry| f64::from(dry.source.surface().0) + DRY_GAP_UM)
    }

    /// One servo tick: the process advances by 50 us, then the tasks of the head run.
    pub fn tick(&mut self) {
        if self.host_alive {
            self.core.host_is_alive();
        }
        self.core.reports();
        self.core.tick(&mut self.process);
        self.core.ports.takes_steps.set(self.core.status().takes_steps);
    }

    /// What the head knows after the last tick.
    pub fn status(&self) -> &Status {
        self.core.status()
    }

    /// What the head saw in the last tick.
    pub fn input(&self) -> &TickInput {
        self.core.input()
    }

    /// What the plan task has counted of a host's steps, as the drive takes it.
    pub fn steps(&self) -> [u32; 3] {
        self.core.signals.steps.each_ref().map(edm_crossing::atomic::Word::load)
    }

    /// What the gap task knows of the levels of pulses: 2013h:16 to 18.
    pub fn levels(&self) -> u32 {
        self.core.signals.teaching.levels.load()
    }

    /// Whether the generator may pulse after the last tick.
    pub fn pulses(&self) -> bool {
        self.core.ports.pulses.get()
    }

    /// Limits of the supervision.
    pub fn supervision(&self) -> &SupervisionConfig {
        self.core.supervise.config()
    }

    /// Oldest change of the head's state not read yet.
    pub fn next_change(&mut self) -> Option<Change> {
        self.ends.changes.receive()
    }

    /// Oldest result of commissioning not read yet.
    pub fn next_check(&mut self) -> Option<Result<Report, Finding>> {
        self.ends.commissioned.receive()
    }

    /// What the head has shown that measures itself, oldest first.
    pub fn next_evidence(&mut self) -> Option<Evidence> {
        self.ends.evidence.receive()
    }

    /// Lets the head carry out a command with its next plan, which this waits for.
    ///
    /// # Errors
    /// Why it was refused.
    pub fn command(&mut self, command: Command) -> Result<(), Refused> {
        match self.request(Request::Command(command)) {
            Answer::Command(_, result, _) => result,
            answer => unreachable!("{answer:?} to a command"),
        }
    }

    /// Lets the head know of a fault with its next plan, which this waits for.
    pub fn raise(&mut self, fault: Fault) {
        self.request(Request::Raise(fault));
    }

    /// Runs other settings from the next plan on, which this waits for.
    ///
    /// # Errors
    /// When they change the axis as wired while a loop is closed.
    pub fn configure(&mut self, active: &Active) -> Result<(), Refused> {
        self.ends.head.write(|slot| *slot = HeadConfig { head: active.head, off_time_ns: active.off_time_ns });
        let state = self.status().state;
        self.request(Request::Configure);
        if !self.ends.head.verdict().accepted {
            return Err(Refused::State(state));
        }
        self.ends.gap.write(|slot| *slot = active.gap);
        self.ends.supervision.write(|slot| *slot = active.head.supervision());
        self.core.signals.pauses.set(&active.pause);
        self.core.ports.ends_watched.set(active.pause.pauses());
        self.core.ports.wants[crate::board::SUPERVISE].set(true);
        Ok(())
    }

    /// Sends a request, which the next plan takes, and gives its answer.
    fn request(&mut self, request: Request) -> Answer {
        self.ends.requests.send(request);
        self.core.signals.waiting.set();
        for _ in 0..PLAN_TICKS {
            self.tick();
            if let Some(answer) = self.ends.answers.receive() {
                return answer;
            }
        }
        unreachable!("a plan answers every request")
    }
}
