//! The servo tick: inputs in, the head's tick, outputs out.
//!
//! Reflex and stop may force the lines at any moment of it. What they had forced is read first; outputs that were decided
//! without knowing are written, and then what was forced meanwhile is repeated ([`ForcedLines::settle`]).

use crate::Board;
use crate::board::Caller;
use crate::crossings::{ANSWERS, Answer, Checked, REQUESTS, Request, SERVO, ServoConfig, Signals, StorageJob};
use crate::timers;
use edm_crossing::latest::{Reader, Writer};
use edm_crossing::ring::{Receiver, Sender};
use edm_hal_shim::bridge::{Drive, HBridge};
use edm_hal_shim::can::SyncInbox;
use edm_hal_shim::clock::Clock;
use edm_hal_shim::encoder::{EdgeCounter, EdgeGuard};
use edm_hal_shim::generator::Generator;
use edm_hal_shim::reflex::ForcedLines;
use edm_hal_shim::safety::{DriveSense, Safety};
use edm_hal_shim::tick::ServoTimer;
use edm_servo_head::canopen::drive::SetPoint;
use edm_servo_head::encoder::{DecoderCount, Handover, TimerCount};
use edm_servo_head::gap::{GapReading, Quality};
use edm_servo_head::head::{
    Change, Command, Fault, Head, Reason, Refused, State, Status, TickInput, TickOutput, WritePermit,
};
use edm_servo_head::path::Path;
use edm_servo_head::units::TICKS_PER_MS;

/// The newest commands, and the tick that carried them out: a debugger, or the emulated chip, may look at it.
pub struct Carried {
    commands: [Command; REQUESTS],
    count: usize,
    tick: u32,
}

impl Carried {
    /// None yet.
    pub const NONE: Carried = Carried { commands: [Command::Enable; REQUESTS], count: 0, tick: 0 };

    fn push(&mut self, command: Command, tick: u32) {
        if self.tick != tick {
            (self.tick, self.count) = (tick, 0);
        }
        if let Some(slot) = self.commands.get_mut(self.count) {
            *slot = command;
            self.count = self.count.wrapping_add(1);
        }
    }
}

type Forced<B> = <<B as Board>::Forced as ForcedLines>::Mark;

/// The head with its inputs and outputs.
pub struct Servo<B: Board> {
    pub(crate) head: Head<&'static mut Path>,
    pub(crate) bridge: B::Bridge,
    pub(crate) generator: B::Generator,
    pub(crate) inputs: B::Inputs,
    pub(crate) drive: B::Drive,
    pub(crate) lines: B::Forced,
    pub(crate) guard: B::Guard,
    pub(crate) tick: B::Tick,
    pub(crate) sync: B::Sync,
    pub(crate) decoder: DecoderCount<'static, B::Clock>,
    pub(crate) timer: TimerCount<B::Timer, B::Clock>,
    pub(crate) handover: Handover,
    pub(crate) clock: B::Clock,
    pub(crate) caller: B::Caller,
    pub(crate) signals: &'static Signals,
    /// What reflex and stop had forced, and the retreats of the reflex, at the tick before.
    pub(crate) forced: Forced<B>,
    pub(crate) retreats: u32,
    /// State that the reflex knows.
    pub(crate) state: State,
    /// What the newest tick saw, written in place: a debugger, or the emulated chip, may look at it.
    pub(crate) input: TickInput,
    /// The newest fault that another task told of, and the tick that was told.
    pub(crate) told: (Fault, u32),
    pub(crate) carried: Carried,
    /// What the next SYNC releases, and how many had come before.
    pub(crate) sync_preview: Option<(SetPoint, u32)>,
    /// Ticks of this millisecond that were timed.
    pub(crate) timed: u32,
    pub(crate) reading: Reader<'static, GapReading>,
    pub(crate) faults: Receiver<'static, Fault, 8>,
    pub(crate) requests: Receiver<'static, Request, REQUESTS>,
    pub(crate) answers: Sender<'static, Answer, ANSWERS>,
    pub(crate) config: Reader<'static, ServoConfig>,
    pub(crate) granted: Sender<'static, (StorageJob, WritePermit), 1>,
    pub(crate) returned: Receiver<'static, WritePermit, 1>,
    pub(crate) judged: Writer<'static, Status>,
    pub(crate) published: Writer<'static, Status>,
    pub(crate) changes: Sender<'static, Change, 16>,
    pub(crate) checked: Sender<'static, Checked, 2>,
}

impl<B: Board> Servo<B> {
    /// The head, as it is after the newest tick.
    pub fn head(&self) -> &Head<&'static mut Path> {
        &self.head
    }

    /// What the newest tick saw.
    pub fn input(&self) -> &TickInput {
        &self.input
    }

    /// The newest fault that another task told of, and the tick that was told.
    pub fn told(&self) -> (Fault, u32) {
        self.told
    }

    /// One tick.
    #[inline(always)]
    pub fn tick(&mut self) {
        self.tick.acknowledge();
        let forced = self.lines.forced();
        // Before the requests, which may have come after that SYNC.
        if self.sync_preview.is_some() {
            self.synchronise();
        }
        // Who sets it has a lower priority: nothing can come in between.
        if self.signals.waiting.is_set() {
            self.signals.waiting.clear();
            self.requests();
        }
        self.inputs();
        let output = self.head.tick(&self.input);
        self.outputs(output, forced);
        if output.more {
            self.tell(output.drive);
        }
    }

    #[inline(always)]
    fn inputs(&mut self) {
        let storm = self.guard.serve();
        if storm || self.handover.timer_leads() || self.head.looks_at_encoder() {
            self.compare_counters(storm);
        } else {
            self.input.encoder.raw = self.handover.count(self.decoder.read());
        }
        if self.head.wants_gap() {
            self.take_reading();
        }
        let input = &mut self.input;
        input.gap.short_ticks = self.signals.short_ticks.load();
        input.reflex = false;
        let retreats = self.lines.retreats();
        if retreats != self.retreats {
            self.retreats = retreats;
            input.reflex = true;
        }
        input.drive = self.drive.read();
        if !self.inputs.are_quiet() || self.input.safety.is_some() {
            self.safety();
        }
    }

    /// A safety input is unsafe, or was in the tick before.
    #[cold]
    fn safety(&mut self) {
        self.input.safety = self.inputs.read().unsafe_ones();
    }

    /// For a plan: the newest gap reading, or the one before, marked as missing.
    #[cold]
    fn take_reading(&mut self) {
        if self.reading.refresh() {
            self.input.gap = *self.reading.get();
        } else {
            self.input.gap.quality = Quality::Missing;
        }
    }

    /// For the look, or while the timer leads: both counters.
    #[cold]
    fn compare_counters(&mut self, storm: bool) {
        let timer = self.timer.read();
        self.input.encoder = self.handover.read(self.decoder.snapshot(), timer, storm);
        self.input.watch = Some(timer);
    }

    /// Whom a change of state, or the look once a millisecond, concerns.
    #[cold]
    fn tell(&mut self, drive: Drive) {
        let state = self.head.status().state;
        let looked = self.head.has_looked();
        if state != self.state {
            self.state = state;
            // A retreat may be forced only while the head erodes, or a CNC does with it.
            self.signals.reflex.arm(matches!(state, State::Eroding | State::Guiding));
        } else if !looked {
            return self.time();
        }
        // The PWM, which a fault of the bridge disconnects.
        if drive != Drive::Coast && !self.input.safety.is_some_and(|safety| safety.bridge_fault) {
            self.tick.arm();
        }
        while let Some(change) = self.head.next_change() {
            self.changes.send(change);
            if let (Reason::CommissioningEnded, Some(result)) = (change.reason, self.head.commissioning_result()) {
                self.checked.send(result);
            }
        }
        self.signals.lost_changes.store(self.head.lost_changes());
        if looked {
            let status = self.head.status();
            self.judged.write(|slot| *slot = *status);
            self.published.write(|slot| *slot = *status);
            self.caller.protocol();
            self.signals.task_watchdog.report(SERVO, self.clock.now());
        }
        self.time();
        if looked {
            let others = TICKS_PER_MS.saturating_sub(core::mem::take(&mut self.timed));
            self.signals.times[SERVO].add(others.wrapping_mul(timers::LOOP));
        }
    }

    /// A tick ends that has done more than its loop.
    fn time(&mut self) {
        self.signals.times[SERVO].ran(self.tick.since_due());
        self.timed = self.timed.wrapping_add(1);
    }

    #[cold]
    fn requests(&mut self) {
        while let Some(fault) = self.faults.receive() {
            self.raise(fault);
        }
        self.signals.lost_faults.store(self.faults.lost());
        while let Some(permit) = self.returned.receive() {
            self.head.end_write(permit);
        }
        while let Some(request) = self.requests.receive() {
            let answer = match request {
                Request::Command(command) => {
                    let (result, tick) = self.carry_out(command);
                    Answer::Command(command, result, tick)
                }
                Request::Configure => self.configure(),
                Request::SyncPreview(point, syncs) => {
                    self.sync_preview = point.map(|point| (point, syncs));
                    self.synchronise();
                    Answer::Done
                }
                Request::Raise(fault) => {
                    self.raise(fault);
                    Answer::Done
                }
                Request::PermitWrite(job) => self.permit_write(job),
            };
            self.answers.send(answer);
        }
        self.caller.protocol();
    }

    /// The newest configuration runs from this tick on, or is refused.
    fn configure(&mut self) -> Answer {
        if self.config.refresh() {
            let ServoConfig { head, off_time_ns } = *self.config.get();
            if self.head.configure(head).is_ok() {
                self.generator.request_off_time(off_time_ns);
                self.config.accept();
            } else {
                self.config.refuse();
            }
        }
        Answer::Configured
    }

    /// Carries out what waits for a SYNC if that has come: counted, or still in the controller.
    #[cold]
    fn synchronise(&mut self) {
        let (signals, sync) = (self.signals, &self.sync);
        let came = |syncs| {
            signals.syncs.read() != syncs || sync.waits().is_some_and(|n| u32::from(n) == signals.sync_length.load())
        };
        if let Some((point, _)) = self.sync_preview.take_if(|(_, syncs)| came(*syncs)) {
            let (result, tick) = self.carry_out(point.command());
            self.answers.send(Answer::SyncPreview(point.command(), result, tick));
        }
    }

    /// Number of the tick that begins.
    fn number(&self) -> u32 {
        self.head.status().tick.wrapping_add(1)
    }

    fn raise(&mut self, fault: Fault) {
        self.told = (fault, self.number());
        self.head.raise(fault);
    }

    fn carry_out(&mut self, command: Command) -> (Result<(), Refused>, u32) {
        let tick = self.number();
        self.carried.push(command, tick);
        (self.head.command(command), tick)
    }

    fn permit_write(&mut self, job: StorageJob) -> Answer {
        match self.head.permit_write() {
            // Idle goes on. There is one permit, and room for it.
            Ok(permit) => {
                self.granted.send((job, permit));
                Answer::Done
            }
            Err(_) => Answer::NoPermit,
        }
    }

    #[inline(always)]
    fn outputs(&mut self, output: TickOutput, forced: Forced<B>) {
        if self.lines.bridge_forced(self.forced, forced) {
            self.restart_bridge(forced);
        }
        if self.bridge.apply(output.drive).is_err() {
            self.lines.stop();
        }
        self.generator.set_pulses(output.pulses);
        self.lines.settle(forced);
    }

    /// Whatever was forced, the bridge starts from coasting.
    #[cold]
    fn restart_bridge(&mut self, forced: Forced<B>) {
        self.forced = forced;
        if self.bridge.apply(Drive::Coast).is_err() {
            self.lines.stop();
        }
    }
}
