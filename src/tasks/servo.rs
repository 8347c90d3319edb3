//! The servo tick: inputs in, the head's tick, outputs out.
//!
//! Reflex and stop may force the lines at any moment of it. What they had forced is read first; outputs that were decided
//! without knowing are written, and then what was forced meanwhile is repeated ([`lines::settle`]).

use super::{
    Answer, Checked, Chore, Configuration, PROTOCOL_VECTOR, READING, REFLEX, ROLL, Request, SERVO, SYNC_LENGTH, SYNCS,
    WAITING, timers,
};
use core::sync::atomic::Ordering::Relaxed;
use edm_hal_shim::bridge::{Drive, HBridge};
use edm_hal_shim::clock::Clock;
use edm_hal_shim::encoder::EdgeCounter;
use edm_hal_shim::generator::Generator;
use edm_hal_shim::safety::{DriveSense, Safety};
use edm_hal_shim::stm32f4::cycles::Cycles;
use edm_hal_shim::stm32f4::drive::DriveAdc;
use edm_hal_shim::stm32f4::encoder::{self as edges, Timer};
use edm_hal_shim::stm32f4::generator::Interface;
use edm_hal_shim::stm32f4::pwm::{self, Bridge};
use edm_hal_shim::stm32f4::safety::Inputs;
use edm_hal_shim::stm32f4::{can, gated, lines};
use edm_servo_head::canopen::drive::SetPoint;
use edm_servo_head::encoder::{DecoderCount, Handover, TimerCount};
use edm_servo_head::head::{Change, Command, Fault, Head, Leave, Reason, State, Status, TickInput, TickOutput};
use edm_servo_head::path::Path;
use edm_servo_head::units::TICKS_PER_MS;
use heapless::spsc::{Consumer, Producer};

/// Commands that a tick can have: the length of their queue.
const MOST: usize = 8;

/// The newest commands, and the tick that carried them out: a debugger, or the emulated chip, may look at it.
pub struct Carried {
    commands: [Command; MOST],
    count: usize,
    tick: u32,
}

impl Carried {
    /// None yet.
    pub const NONE: Carried = Carried { commands: [Command::Enable; MOST], count: 0, tick: 0 };

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

/// The head with its inputs and outputs.
pub struct Servo {
    pub(super) head: Head<&'static mut Path>,
    pub(super) bridge: Bridge,
    pub(super) generator: Interface,
    pub(super) inputs: Inputs,
    pub(super) drive: DriveAdc,
    pub(super) decoder: DecoderCount<'static, Cycles>,
    pub(super) timer: TimerCount<Timer, Cycles>,
    pub(super) handover: Handover,
    pub(super) clock: Cycles,
    /// What reflex and stop had forced, and the retreats of the reflex, at the tick before.
    pub(super) forced: lines::Forced,
    pub(super) retreats: u32,
    /// State that the reflex knows.
    pub(super) state: State,
    /// What the newest tick saw, written in place: a debugger, or the emulated chip, may look at it.
    pub(super) input: TickInput,
    /// Number of the gap reading in it.
    pub(super) reading: u32,
    /// The newest fault that another task told of, and the tick that was told.
    pub(super) told: (Fault, u32),
    pub(super) carried: Carried,
    /// What the next SYNC releases, and how many had come before.
    pub(super) at_sync: Option<(SetPoint, u32)>,
    /// Ticks of this millisecond that were timed.
    pub(super) timed: u32,
    pub(super) faults: Consumer<'static, Fault>,
    pub(super) requests: Consumer<'static, Request>,
    pub(super) answers: Producer<'static, Answer>,
    pub(super) configurations: Consumer<'static, Configuration>,
    pub(super) granted: Producer<'static, (Chore, Leave)>,
    pub(super) returned: Consumer<'static, Leave>,
    pub(super) statuses: Producer<'static, Status>,
    pub(super) published: Producer<'static, Status>,
    pub(super) changes: Producer<'static, Change>,
    pub(super) checked: Producer<'static, Checked>,
}

impl Servo {
    /// One tick.
    #[inline(always)]
    pub fn tick(&mut self) {
        pwm::clear_tick();
        let forced = lines::forced();
        // Before the requests, which may have come after that SYNC.
        if self.at_sync.is_some() {
            self.synchronise();
        }
        if WAITING.load(Relaxed) {
            // Who sets it has a lower priority: nothing can come in between.
            WAITING.store(false, Relaxed);
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
        let storm = edges::serve();
        if self.head.wants_gap() || storm || self.handover.timer_leads() {
            self.read_more(storm);
        } else {
            self.input.encoder.raw = self.handover.count(self.decoder.read());
        }
        let input = &mut self.input;
        input.gap.short_ticks = READING.short_ticks();
        input.reflex = false;
        let retreats = gated::retreats();
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

    /// For a plan the gap; for the look, or while the timer leads, both counters.
    #[cold]
    fn read_more(&mut self, storm: bool) {
        READING.read(&mut self.reading, &mut self.input.gap);
        if storm || self.handover.timer_leads() || self.head.looks_at_encoder() {
            let timer = self.timer.read();
            self.input.encoder = self.handover.read(self.decoder.snapshot(), timer, storm);
            self.input.watch = Some(timer);
        } else {
            self.input.encoder.raw = self.handover.count(self.decoder.read());
        }
    }

    /// Whom a change of state, or the look once a millisecond, concerns.
    #[cold]
    fn tell(&mut self, drive: Drive) {
        let state = self.head.status().state;
        let looked = self.head.has_looked();
        if state != self.state {
            self.state = state;
            // A retreat may be forced only while the head erodes, or a CNC does with it.
            REFLEX.arm(matches!(state, State::Eroding | State::Guiding));
        } else if !looked {
            return self.time();
        }
        // The PWM, which a fault of the bridge disconnects.
        if drive != Drive::Coast && !self.input.safety.is_some_and(|safety| safety.bridge_fault) {
            pwm::arm();
        }
        while let Some(change) = self.head.next_change() {
            let _ = self.changes.enqueue(change);
            if let (Reason::CheckEnded, Some(result)) = (change.reason, self.head.check_result()) {
                let _ = self.checked.enqueue(result);
            }
        }
        if looked {
            let _ = self.statuses.enqueue(*self.head.status());
            let _ = self.published.enqueue(*self.head.status());
            rtic::pend(PROTOCOL_VECTOR);
            ROLL.report(SERVO, self.clock.now());
        }
        self.time();
        if looked {
            let others = TICKS_PER_MS.saturating_sub(core::mem::take(&mut self.timed));
            timers::add(SERVO, others.wrapping_mul(timers::LOOP));
        }
    }

    /// A tick ends that has done more than its loop.
    fn time(&mut self) {
        timers::ran(SERVO, pwm::since_tick());
        self.timed = self.timed.wrapping_add(1);
    }

    #[cold]
    fn requests(&mut self) {
        while let Some(fault) = self.faults.dequeue() {
            self.raise(fault);
        }
        if let Some(Configuration { head, off_time_ns }) = self.configurations.dequeue() {
            let taken = self.head.configure(head).is_ok();
            if taken {
                self.generator.request_off_time(off_time_ns);
            }
            let _ = self.answers.enqueue(Answer::Configured(taken));
        }
        while let Some(leave) = self.returned.dequeue() {
            self.head.end_leave(leave);
        }
        while let Some(request) = self.requests.dequeue() {
            match request {
                Request::Command(command) => self.command(command),
                Request::AtSync(point, syncs) => {
                    self.at_sync = point.map(|point| (point, syncs));
                    self.synchronise();
                }
                Request::Raise(fault) => self.raise(fault),
                Request::Leave(chore) => self.give_leave(chore),
            }
        }
    }

    /// Carries out what waits for a SYNC if that has come: counted, or still in the controller.
    #[cold]
    fn synchronise(&mut self) {
        let came = |syncs| SYNCS.load(Relaxed) != syncs || can::sync_waits() == Some(SYNC_LENGTH.load(Relaxed));
        if let Some((point, _)) = self.at_sync.take_if(|(_, syncs)| came(*syncs)) {
            self.command(point.command());
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

    fn command(&mut self, command: Command) {
        let tick = self.number();
        self.carried.push(command, tick);
        let result = self.head.command(command);
        let _ = self.answers.enqueue(Answer::Command(command, result, tick));
    }

    fn give_leave(&mut self, chore: Chore) {
        match self.head.give_leave() {
            // Idle goes on. There is one leave, and room for it.
            Ok(leave) => drop(self.granted.enqueue((chore, leave))),
            Err(_) => drop(self.answers.enqueue(Answer::NoLeave)),
        }
    }

    #[inline(always)]
    fn outputs(&mut self, output: TickOutput, forced: lines::Forced) {
        if forced.bridge_since(&self.forced) {
            self.restart_bridge(forced);
        }
        if self.bridge.apply(output.drive).is_err() {
            lines::stop();
        }
        self.generator.set_pulses(output.pulses);
        lines::settle(forced);
    }

    /// Whatever was forced, the bridge starts from coasting.
    #[cold]
    fn restart_bridge(&mut self, forced: lines::Forced) {
        self.forced = forced;
        if self.bridge.apply(Drive::Coast).is_err() {
            lines::stop();
        }
    }
}
