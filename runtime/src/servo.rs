//! The servo tick: inputs in, the head's tick, outputs out.
//!
//! Reflex and stop may force the lines at any moment of it. What they had forced is read first; outputs that were decided
//! without knowing are written, and then what was forced meanwhile is repeated ([`ForcedLines::settle`]).

use crate::Board;
use crate::board::Caller;
use crate::crossings::{Preview, SERVO, ServoConfig, Signals};
use crate::live::{self, ClockCheck, Pace};
use edm_crossing::latest::{Reader, Writer};
use edm_crossing::ring::Receiver;
use edm_hal_shim::bridge::{Drive, HBridge};
use edm_hal_shim::can::SyncInbox;
use edm_hal_shim::clock::Clock;
use edm_hal_shim::encoder::{EdgeCounter, EdgeGuard};
use edm_hal_shim::generator::Generator;
use edm_hal_shim::reflex::ForcedLines;
use edm_hal_shim::safety::{DriveSense, Safety};
use edm_hal_shim::tick::ServoTimer;
use edm_servo_head::encoder::{DecoderCount, Handover, TimerCount};
use edm_servo_head::gap::{GapReading, Quality};
use edm_servo_head::head::{
    Counters, Estimate, Fault, Follower, Measured, Plan, Reaction, SetPoint, State, TickInput, TickOutput,
};
use edm_servo_head::units::TICKS_PER_MS;

type Forced<B> = <<B as Board>::Forced as ForcedLines>::Mark;

/// The follower with its inputs and outputs.
pub struct Servo<B: Board> {
    pub(crate) follower: Follower,
    pub(crate) bridge: B::Bridge,
    pub(crate) generator: B::Generator,
    pub(crate) inputs: B::Inputs,
    pub(crate) drive: B::Drive,
    pub(crate) lines: B::Forced,
    pub(crate) live: live::Watch<B::Live>,
    pub(crate) pace: ClockCheck,
    /// A fault that this task has found, for its next tick.
    pub(crate) found: Option<Fault>,
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
    /// Both counters, once a millisecond.
    pub(crate) counters: Counters,
    /// A gap reading has come since the newest estimate.
    pub(crate) fresh: bool,
    /// Quality of the newest gap reading.
    pub(crate) quality: Quality,
    /// Something in the input was for its tick alone.
    pub(crate) once: bool,
    /// Tick that tells of a millisecond.
    pub(crate) millisecond: u32,
    /// What the next SYNC releases, and how many had come before.
    pub(crate) preview: Option<(SetPoint, u32)>,
    pub(crate) reading: Reader<'static, GapReading>,
    pub(crate) faults: Receiver<'static, Fault, 8>,
    pub(crate) config: Reader<'static, ServoConfig>,
    pub(crate) previews: Reader<'static, Preview>,
    pub(crate) plans: Reader<'static, Plan>,
    pub(crate) estimates: Writer<'static, Estimate>,
    pub(crate) measured: Writer<'static, (Measured, Counters)>,
}

impl<B: Board> Servo<B> {
    /// The follower, as it is after the newest tick.
    pub fn follower(&self) -> &Follower {
        &self.follower
    }

    /// What the newest tick saw.
    pub fn input(&self) -> &TickInput {
        &self.input
    }

    /// Both counters, as they were read last.
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// One tick.
    #[inline(always)]
    pub fn tick(&mut self) {
        self.tick.acknowledge();
        let forced = self.lines.forced();
        if self.once {
            self.forget();
        }
        // Before what waits, which may have come after that SYNC.
        if self.preview.is_some() {
            self.synchronise();
        }
        // Who sets it has a lower priority: nothing can come in between.
        if self.signals.waiting.is_set() {
            self.signals.waiting.clear();
            self.waits();
        }
        self.inputs();
        let plans = &mut self.plans;
        let output = self.follower.tick(&self.input, |generation| {
            plans.refresh();
            let plan = plans.get();
            (plan.generation == generation).then_some(plan)
        });
        self.outputs(output, forced);
        if output.hands_over {
            self.hand_over();
        } else if output.begins {
            self.begins();
        } else if self.follower.number().wrapping_sub(self.millisecond) as i32 >= 0 {
            self.tell(output.drive);
        }
        self.signals.times[SERVO].ran(self.tick.since_due());
        self.live.toggle();
    }

    #[inline(always)]
    fn inputs(&mut self) {
        let storm = self.guard.serve();
        if storm || self.handover.timer_leads() || self.is_millisecond_in(2) {
            self.compare_counters(storm);
        } else {
            self.input.encoder = self.handover.count(self.decoder.read());
        }
        if self.follower.wants_gap() {
            self.take_reading();
        }
        let input = &mut self.input;
        input.short_ticks = self.signals.short_ticks.load();
        input.touches = self.signals.touches.load() != 0;
        let retreats = self.lines.retreats();
        if retreats != self.retreats {
            self.retreats = retreats;
            input.reflex = true;
            self.once = true;
        }
        input.drive = self.drive.read();
        if !self.inputs.are_quiet() || self.input.safety.is_some() {
            self.safety();
        }
    }

    /// Whether a millisecond is to be told of so many ticks after the newest one.
    #[inline]
    fn is_millisecond_in(&self, ticks: u32) -> bool {
        self.follower.number().wrapping_add(ticks) == self.millisecond
    }

    /// What was for the tick before alone.
    #[cold]
    fn forget(&mut self) {
        self.once = false;
        let input = &mut self.input;
        (input.reflex, input.asked) = (false, false);
        (input.told, input.set_point) = (None, None);
    }

    /// A safety input is unsafe, or was in the tick before.
    #[cold]
    fn safety(&mut self) {
        self.input.safety = self.inputs.read().unsafe_ones();
    }

    /// For the supervision, or while the timer leads: both counters.
    #[cold]
    fn compare_counters(&mut self, storm: bool) {
        let timer = self.timer.read();
        let used = self.handover.read(self.decoder.snapshot(), timer, storm);
        self.input.encoder = used.raw;
        self.counters = Counters { used, watch: Some(timer), pulses: self.lines.pulses() };
    }

    /// Without a cascade every tick wants the gap voltage.
    #[cold]
    fn take_reading(&mut self) {
        self.fresh |= self.reading.refresh();
        let reading = self.reading.get();
        self.input.gap = (reading.quality == Quality::Valid).then_some(reading.filtered);
    }

    /// The planner is given the estimate of this tick, with the newest gap reading, or the one before, marked as missing.
    #[cold]
    fn hand_over(&mut self) {
        let fresh = self.reading.refresh() | core::mem::take(&mut self.fresh);
        let reading = self.reading.get();
        self.quality = if fresh { reading.quality } else { Quality::Missing };
        let mark = self.handover.mark(self.decoder.mark());
        self.counters.used.mark = mark;
        let (follower, quality) = (&mut self.follower, self.quality);
        self.estimates.write(|slot| follower.estimate(slot, reading, quality, mark));
        self.caller.plan();
    }

    /// A plan has come into force.
    #[cold]
    fn begins(&mut self) {
        let state = self.follower.plan().state;
        if state != self.state {
            self.state = state;
            self.live.enters(state);
            // A retreat may be forced only while the head erodes, or a CNC does with it.
            self.signals.reflex.arm(matches!(state, State::Eroding | State::Guiding));
        }
    }

    /// A millisecond: whom it concerns.
    #[cold]
    fn tell(&mut self, drive: Drive) {
        self.millisecond = self.millisecond.wrapping_add(TICKS_PER_MS);
        // The PWM, which a fault of the bridge disconnects.
        if drive != Drive::Coast && !self.input.safety.is_some_and(|safety| safety.bridge_fault) {
            self.tick.arm();
        }
        let Servo { follower, input, counters, quality, measured, .. } = self;
        measured.write(|(measured, both)| {
            follower.measured(measured, input, *quality);
            *both = *counters;
        });
        self.signals.millisecond.set();
        self.caller.protocol();
        let now = self.clock.now();
        self.signals.task_watchdog.report(SERVO, now);
        let clock = self.clock_fault(now);
        let alive = clock.is_none() && self.signals.task_watchdog.missing(now).is_none();
        let fault = clock.or(self.live.millisecond(self.state, alive));
        // Whoever coasts for another reason has named that.
        if fault.is_some() && self.follower.plan().reaction != Some(Reaction::Coast) {
            self.found = fault;
            self.signals.waiting.set();
        }
    }

    /// What the clock shows against the ticks since the millisecond before. While the flash is written no tick comes.
    fn clock_fault(&mut self, now: u32) -> Option<Fault> {
        let (pace, missing) = self.pace.look(now, self.follower.number());
        if missing > 0 && self.state != State::Disabled {
            let lost = &self.signals.lost_ticks;
            lost.store(lost.load().wrapping_add(missing));
        }
        match pace {
            Pace::Fast if self.state == State::Disabled => None,
            Pace::Slow | Pace::Fast => {
                self.signals.clock_lost.set();
                Some(Fault::ClockLost)
            }
            Pace::Right => None,
        }
    }

    /// Somebody has something for this task, or for the planner.
    #[cold]
    fn waits(&mut self) {
        self.once = true;
        self.input.asked = true;
        self.input.told = self.found.take();
        while let Some(fault) = self.faults.receive() {
            let told = self.input.told.filter(|told| told.reaction() >= fault.reaction());
            self.input.told = told.or(Some(fault));
        }
        self.signals.lost_faults.store(self.faults.lost());
        if self.config.refresh() {
            let ServoConfig { follow, off_time_ns } = self.config.get();
            self.follower.configure(follow);
            self.generator.request_off_time(*off_time_ns);
        }
        if self.previews.refresh() {
            let (point, syncs) = *self.previews.get();
            self.preview = point.map(|point| (point, syncs));
            self.synchronise();
        }
    }

    /// Releases what waits for a SYNC if that has come: counted, or still in the controller.
    #[cold]
    fn synchronise(&mut self) {
        let (signals, sync) = (self.signals, &self.sync);
        let came = |syncs| {
            signals.syncs.read() != syncs || sync.waits().is_some_and(|n| u32::from(n) == signals.sync_length.load())
        };
        if let Some((point, _)) = self.preview.take_if(|(_, syncs)| came(*syncs)) {
            self.once = true;
            self.input.asked = true;
            self.input.set_point = Some(point);
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
