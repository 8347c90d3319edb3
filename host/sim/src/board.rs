//! A PC as a board: the process model on the traits that the tasks of a head are written over.
//!
//! All parts of a board look at one set of [`Ports`]: what the wires of the process show, and what the head has put on its own.
//! Nothing in them moves by itself; the caller of the tasks ([`crate::machine`]) fills the ports before, and reads them
//! afterwards.

use crate::battery::Battery;
use crate::store::Store;
use edm_bus::Frame;
use edm_hal_shim::bridge::{Drive, HBridge};
use edm_hal_shim::can::{Filters, Inbox, Inboxes, Mailboxes, Overrun, SyncInbox, Trouble};
use edm_hal_shim::clock::Clock;
use edm_hal_shim::double::live::TestLive;
use edm_hal_shim::encoder::{Edge, EdgeGuard, EdgeLines, EncoderTimer, Levels, Line, QuadratureLines};
use edm_hal_shim::gap::{GapBlock, GapFrontEnd};
use edm_hal_shim::generator::Generator;
use edm_hal_shim::live::Live;
use edm_hal_shim::pause;
use edm_hal_shim::reflex::{Config, ForcedLines, PulseCounts, Thresholds};
use edm_hal_shim::safety::{DriveCodes, DriveSense, Safety, SafetyInputs};
use edm_hal_shim::self_test::Registers;
use edm_hal_shim::self_test::SelfTest;
use edm_hal_shim::steps::{Account, Counted, Found, Polarity, Ring, STAMPS, StepInput};
use edm_hal_shim::tick::{Period, ServoTimer};
use edm_hal_shim::watchdog::{Stuck, Watchdog};
use edm_runtime::Note;
use edm_runtime::board::{Board, Caller, Pulse, Tunable};
use edm_servo_head::encoder::Shared as Published;
use edm_servo_head::gap::teach::Shown;
use edm_servo_head::gap::{GapReading, GapSource, Surrogate, SurrogateConfig, Voltage, voltage};
use edm_servo_head::units::{CLOCK_HZ, FRACTION_BITS, Fixed, Volts};
use embedded_can::Frame as _;
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::sync::atomic::AtomicU32;

/// The dry loop of \[R\]: position, noise and imagined erosion instead of a gap signal.
pub struct Dry {
    /// What makes readings of positions.
    pub source: Surrogate,
    /// How.
    pub config: SurrogateConfig,
    /// Length of an encoder count, um.
    pub count_um: f64,
}

/// What the tasks of a head see and set.
#[derive(Default)]
pub struct Ports {
    /// What the board has found of itself at its start.
    pub self_test: Cell<SelfTest>,
    /// Clock.
    pub now: Cell<u32>,
    /// Encoder lines.
    pub levels: Cell<Levels>,
    /// Second counter on them.
    pub timer: Cell<u32>,
    /// The settings of the gap task have changed by themselves.
    pub gap_damaged: Cell<bool>,
    /// A register of the chip has.
    pub register_changed: Cell<bool>,
    /// Count at which the clock is stopped, if it is.
    pub stands_at: Cell<Option<u32>>,
    /// When that is read, if not now.
    pub timer_read_at: Cell<Option<u32>>,
    /// The time that a reader gets.
    reads_at: Cell<Option<u32>>,
    /// Newest block of conversions.
    pub block: Cell<Option<GapBlock>>,
    /// Safety inputs.
    pub safety: Cell<SafetyInputs>,
    /// Retreats that a reflex has begun; a PC has none, but may stand in for a chip.
    pub retreats: Cell<u32>,
    /// What the pulses have done.
    pub pulse_counts: Cell<PulseCounts>,
    /// Motor current and bus voltage.
    pub codes: Cell<DriveCodes>,
    /// The converter of the drive has stopped.
    pub drive_stands: Cell<bool>,
    /// Output of the bridge.
    pub drive: Cell<Drive>,
    /// Pulses allowed.
    pub pulses: Cell<bool>,
    /// Live signal, and the circuit behind it. Pulses and bridge do not depend on it here.
    pub live: RefCell<TestLive>,
    /// Off-time requested of the generator, ns.
    pub off_time_ns: Cell<Option<u32>>,
    /// Thresholds of the reflex.
    pub thresholds: Cell<Option<Config>>,
    /// Pauses between pulses, and whether the ends of pulses are watched.
    pub pauses: Cell<Option<&'static pause::Pauses>>,
    /// See `pauses`.
    pub ends_watched: Cell<bool>,
    /// Pauses that the process has begun so far, wrapping.
    pub pauses_begun: Cell<u32>,
    /// Measured position, counts, for the dry loop.
    pub position: Cell<i64>,
    /// Instead of the gap signal.
    pub dry: RefCell<Option<Dry>>,
    /// The line that lets a host step.
    pub takes_steps: Cell<bool>,
    /// What the timer of the steps has counted, its stamps, and how far they are taken.
    pub steps: Cell<Counted>,
    /// See `steps`.
    pub stamps: Stamps,
    /// See `steps`.
    stepped: Cell<Option<Account>>,
    /// A period of the supervision has begun.
    pub period: Cell<bool>,
    /// Frames that came: SYNC, everything else.
    pub inboxes: [RefCell<VecDeque<Frame>>; 2],
    /// Frames that the head has sent.
    pub outbox: RefCell<VecDeque<Frame>>,
    /// The controller had to drop a frame since it was asked last.
    pub overrun: Cell<bool>,
    /// Times that it had to, between two times that it was asked: that is all that a controller knows.
    pub overruns: Cell<u64>,
    /// Frames that it had to drop, of which it knows nothing.
    pub dropped: Cell<u64>,
    /// Places for frames to be sent that are free; `None` for any number of them.
    pub mailboxes: Cell<Option<usize>>,
    /// Identifiers that the controller lets through, that of SYNC first.
    pub listens: RefCell<Vec<u16>>,
    /// Bit rate that the controller is to have, bit/s: frames on this bus have none.
    pub bit_rate: Cell<u32>,
    /// Gap voltage of the newest block, for observers.
    pub gap_block: Cell<Volts>,
    /// Tasks requested: protocol, transmission, supervision, plan.
    pub wants: [Cell<bool>; 4],
    /// What was noted.
    pub notes: RefCell<Vec<Note>>,
    /// A task that has fallen silent.
    pub silent: Cell<Option<usize>>,
}

/// Stamps of a change of direction.
pub struct Stamps(pub Ring);

impl Default for Stamps {
    fn default() -> Stamps {
        Stamps([const { AtomicU32::new(0) }; STAMPS])
    }
}

/// Number of the protocol in [`Ports::wants`].
pub const PROTOCOL: usize = 0;
/// Of the transmission.
pub const TRANSMIT: usize = 1;
/// Of the supervision.
pub const SUPERVISE: usize = 2;
/// Of the plan.
pub const PLAN: usize = 3;
/// Clock cycles from one imagined edge of the dry loop to the next: 5 kHz.
const IMAGINED: u32 = CLOCK_HZ / 10_000;
/// Frames that an inbox of the controller holds.
const DEPTH: usize = 3;

impl Ports {
    /// Pauses between pulses, core cycles from the end of a pulse of each class.
    pub fn holds(&self) -> [u32; pause::CLASSES] {
        self.pauses.get().filter(|_| self.ends_watched.get()).map_or([0; pause::CLASSES], pause::Pauses::holds)
    }

    /// Ports for as long as the program runs, as those of a chip always exist.
    pub fn leak() -> &'static Ports {
        Box::leak(Box::default())
    }

    /// Whether a task was requested since the last call.
    pub fn wanted(&self, task: usize) -> bool {
        self.wants[task].take()
    }

    /// Receives a frame. The filters drop what the head does not use; what does not fit is lost.
    pub fn arrives(&self, frame: &Frame) -> Option<Inbox> {
        let embedded_can::Id::Standard(id) = frame.id() else { return None };
        let listens = self.listens.borrow();
        let place = listens.iter().position(|other| *other == id.as_raw())?;
        let inbox = if place == 0 && frame.is_data_frame() { Inbox::Sync } else { Inbox::Others };
        let mut frames = self.inboxes[inbox as usize].borrow_mut();
        if frames.len() == DEPTH {
            self.dropped.set(self.dropped.get() + 1);
            if !self.overrun.replace(true) {
                self.overruns.set(self.overruns.get() + 1);
            }
        } else {
            frames.push_back(*frame);
        }
        Some(inbox)
    }
}

/// A part of the board.
#[derive(Clone, Copy)]
pub struct Part(pub &'static Ports);

/// A PC.
pub struct Pc;

impl Board for Pc {
    type Clock = Part;
    type Published = &'static Published;
    type Lines = Part;
    type Guard = Part;
    type Timer = Part;
    type FrontEnd = Part;
    type Source = Source;
    type Bridge = Part;
    type Generator = Part;
    type Inputs = Part;
    type Drive = Part;
    type Steps = Part;
    type Registers = Part;
    type Forced = Part;
    type Live = Part;
    type Tick = Part;
    type Millisecond = Part;
    type Thresholds = Part;
    type Inboxes = Part;
    type Sync = Part;
    type Mailboxes = Part;
    type Filters = Part;
    type Watchdog = Part;
    type Storage = Store;
    type Backup = Battery;
    type Stage = crate::stage::Memory;
    type Caller = Part;
}

impl Clock for Part {
    const HZ: u32 = CLOCK_HZ;
    fn now(&self) -> u32 {
        let now = self.0.reads_at.take().unwrap_or(self.0.now.get());
        self.0.stands_at.get().unwrap_or(now)
    }
    fn restart(&self) {
        self.0.stands_at.set(None);
    }
}

impl QuadratureLines for Part {
    fn levels(&self) -> Levels {
        self.0.levels.get()
    }
}

/// A PC serves every edge in its time.
impl EdgeLines for Part {
    fn acknowledge(&mut self, _: Line) {}
    fn follows(&mut self) -> bool {
        true
    }
    fn unusual(&mut self) -> Edge {
        Edge::Last
    }
}

impl EdgeGuard for Part {
    fn serve(&mut self) -> bool {
        false
    }
    fn missed(&mut self) {}
}

impl EncoderTimer for Part {
    const BITS: u32 = 32;
    fn counter(&self) -> u32 {
        // Whoever reads it asks for the time next.
        self.0.reads_at.set(self.0.timer_read_at.get());
        self.0.timer.get()
    }
}

impl GapFrontEnd for Part {
    fn block(&mut self, block: &mut Option<GapBlock>) {
        // Not `take`, which copies it twice.
        *block = self.0.block.get();
        self.0.block.set(None);
    }
}

/// The gap source of a head on a PC: that of every head, or the dry loop.
pub struct Source {
    /// That of every head.
    pub voltage: Voltage,
    /// Where the dry loop is.
    pub ports: &'static Ports,
}

impl GapSource for Source {
    fn update(&mut self, block: Option<&GapBlock>) -> GapReading {
        let reading = match &mut *self.ports.dry.borrow_mut() {
            None => self.voltage.update(block),
            Some(_) if !self.ports.pulses.get() => GapReading::default(),
            Some(Dry { source, config, count_um }) => {
                let um = self.ports.position.get() as f64 * *count_um;
                source.update(config, Fixed((um * f64::from(1u32 << FRACTION_BITS)) as i64))
            }
        };
        self.ports.gap_block.set(reading.block);
        reading
    }
}

impl Tunable for Source {
    fn retune(&mut self, active: &voltage::Active) {
        Tunable::retune(&mut self.voltage, active);
    }

    fn permit(&mut self, permitted: bool) {
        Tunable::permit(&mut self.voltage, permitted);
    }

    fn is_intact(&mut self) -> bool {
        Tunable::is_intact(&mut self.voltage) && !self.ports.gap_damaged.get()
    }

    fn slow(&mut self) -> (usize, u32) {
        Tunable::slow(&mut self.voltage)
    }

    fn collect(&mut self, collects: bool) {
        Tunable::collect(&mut self.voltage, collects);
    }

    fn has_news(&self) -> bool {
        Tunable::has_news(&self.voltage)
    }

    fn look(&mut self) -> (u32, Option<Shown>) {
        Tunable::look(&mut self.voltage)
    }
}

impl HBridge for Part {
    type Error = core::convert::Infallible;
    fn apply(&mut self, drive: Drive) -> Result<(), Self::Error> {
        self.0.drive.set(drive);
        Ok(())
    }
}

impl Generator for Part {
    fn set_pulses(&mut self, enabled: bool) {
        self.0.pulses.set(enabled);
    }
    fn request_off_time(&mut self, ns: Option<u32>) {
        self.0.off_time_ns.set(ns);
    }
}

impl Safety for Part {
    fn read(&mut self) -> SafetyInputs {
        self.0.safety.get()
    }
}

impl DriveSense for Part {
    fn read(&mut self) -> DriveCodes {
        self.0.codes.get()
    }

    fn stands(&mut self) -> bool {
        self.0.drive_stands.get()
    }
}

impl StepInput for Part {
    fn read(&mut self, polarity: Polarity, run: impl FnMut(i32)) -> Found {
        let Ports { steps, stamps, stepped, .. } = self.0;
        let mut account = stepped.get().unwrap_or_else(|| Account::new(steps.get(), &stamps.0));
        let found = account.read(steps.get(), &stamps.0, polarity, run);
        stepped.set(Some(account));
        found
    }
}

impl Registers for Part {
    fn is_intact(&mut self) -> bool {
        !self.0.register_changed.get()
    }
}

/// A PC has no reflex: the gap task detects a short, the servo task a safety input.
impl ForcedLines for Part {
    type Mark = ();
    fn forced(&self) {}
    fn bridge_forced(&self, (): (), (): ()) -> bool {
        false
    }
    fn settle(&mut self, (): ()) {}
    fn stop(&mut self) {
        self.0.drive.set(Drive::Coast);
        self.0.pulses.set(false);
    }
    fn retreats(&self) -> u32 {
        self.0.retreats.get()
    }
    fn pulses(&self) -> PulseCounts {
        let counts = self.0.pulse_counts.get();
        // The dry loop has no pulses to miss.
        let dry = self.0.dry.borrow().is_some() && self.0.pulses.get();
        if !dry {
            return counts;
        }
        let imagined = (self.0.now.get() / IMAGINED) as u8;
        let newest = [imagined.into(); 2];
        PulseCounts { edges: imagined, conversions: imagined, comparators: [imagined; 2], newest, ..counts }
    }
}

impl Live for Part {
    fn toggle(&mut self) {
        self.0.live.borrow_mut().toggle();
    }
    fn run(&mut self, runs: bool) {
        self.0.live.borrow_mut().run(runs);
    }
    fn arm(&mut self, high: bool) {
        self.0.live.borrow_mut().arm(high);
    }
    fn armed(&self) -> bool {
        self.0.live.borrow().armed()
    }
}

impl ServoTimer for Part {
    fn acknowledge(&mut self) {}
    fn since_due(&self) -> u32 {
        0
    }
    fn arm(&mut self) {}
}

impl Period for Part {
    fn begins(&mut self) -> bool {
        self.0.period.take()
    }
}

impl Thresholds for Part {
    type Error = core::convert::Infallible;
    fn set(&mut self, config: &Config) -> Result<(), Self::Error> {
        self.0.thresholds.set(Some(*config));
        Ok(())
    }
    fn watch_ends(&mut self, pauses: &pause::Config) {
        self.0.ends_watched.set(pauses.pauses());
    }
    fn pauses_begun(&self) -> u32 {
        self.0.pauses_begun.get() & (u32::MAX >> 1)
    }
    fn gate_rung(&self) -> u32 {
        0
    }
}

impl Inboxes for Part {
    type Frame = Frame;
    fn next(&mut self, from: Inbox) -> Option<Result<Frame, Overrun>> {
        if self.0.overrun.take() {
            return Some(Err(Overrun));
        }
        self.0.inboxes[from as usize].borrow_mut().pop_front().map(Ok)
    }
}

impl SyncInbox for Part {
    fn waits(&self) -> Option<u8> {
        self.0.inboxes[Inbox::Sync as usize].borrow().front().map(|frame| frame.dlc() as u8)
    }
}

impl Mailboxes for Part {
    type Frame = Frame;
    fn send(&mut self, frame: &Frame) -> bool {
        match self.0.mailboxes.get() {
            Some(0) => return false,
            free => self.0.mailboxes.set(free.map(|free| free - 1)),
        }
        self.0.outbox.borrow_mut().push_back(*frame);
        true
    }
    fn acknowledge(&mut self) {}
}

impl Filters for Part {
    fn listen(&mut self, sync: u16, others: &[u16]) {
        let mut listens = self.0.listens.borrow_mut();
        listens.clear();
        listens.push(sync);
        listens.extend(others);
    }
    fn join(&mut self, bit_rate: u32) {
        self.0.bit_rate.set(bit_rate);
    }
    fn trouble(&self) -> Trouble {
        Trouble::default()
    }
}

impl Watchdog for Part {
    fn feed(&mut self) {}
    fn erase(&mut self) -> Result<(), Stuck> {
        Ok(())
    }
    fn normal(&mut self) -> Result<(), Stuck> {
        Ok(())
    }
    fn silent(&mut self, task: usize) {
        self.0.silent.set(Some(task));
    }
}

impl Caller for Part {
    fn plan(&self) {
        self.0.wants[PLAN].set(true);
    }
    fn protocol(&self) {
        self.0.wants[PROTOCOL].set(true);
    }
    fn transmit(&self) {
        self.0.wants[TRANSMIT].set(true);
    }
    fn supervise(&self) {
        self.0.wants[SUPERVISE].set(true);
    }
    fn note(&self, note: &Note) {
        // How the head is, every second: a PC has the status itself.
        if !matches!(note, Note::Status(_) | Note::Pulses(_)) {
            self.0.notes.borrow_mut().push(*note);
        }
    }
    fn light(&self, _: bool) {}

    fn ask(&self, _: bool) {}
    fn takes_steps(&self, takes: bool) {
        self.0.takes_steps.set(takes);
    }
    fn pulse(&self) -> Pulse {
        Pulse::default()
    }
}
