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
use edm_servo_head::encoder::{DecoderCount, Handover, Snapshot, TimerCount};
use edm_servo_head::gap::{GapReading, Quality};
use edm_servo_head::head::{
    Counters, Estimate, Fault, Follower, Measured, Plan, ProbeInputs, Reaction, SetPoint, State, TickInput, TickOutput,
};
use edm_servo_head::scope::{Recorder, Scales, Setup, Snapshots, View};
use edm_servo_head::units::{PLAN_TICKS, TICKS_PER_MS};

/// Tick in which the first chore is due: the estimates begin with tick 1, and the supervision is then given what it judges when a
/// millisecond is over.
pub(crate) const FIRST_CHORE: u32 = TICKS_PER_MS - 6;

/// What the servo task does once a millisecond.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Chore {
    /// Has the next tick compare, if that is to do nothing else.
    Announce,
    /// Both counters are read before anything else.
    Compare,
    /// Gives the supervision what it judges.
    Measure,
    /// Takes a sample of what is kept around a fault.
    Record,
    /// Tells of the millisecond.
    Tell,
    /// Looks at the settings.
    CheckSettings,
}

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
    /// The probes have looked in this tick.
    pub(crate) sighted: bool,
    /// Quality of the newest gap reading.
    pub(crate) quality: Quality,
    /// Something in the input was for its tick alone.
    pub(crate) once: bool,
    /// Tick from which on the next chore of a millisecond is due, and which that is.
    pub(crate) millisecond: u32,
    pub(crate) chore: Chore,
    /// What the next SYNC releases, and how many had come before.
    pub(crate) preview: Option<(SetPoint, u32)>,
    /// The scope: what a host wants recorded, and what is recorded around faults.
    pub(crate) recorder: Recorder,
    pub(crate) snapshots: Snapshots,
    pub(crate) scales: Scales,
    pub(crate) setups: Reader<'static, Setup>,
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
            self.chore(output.drive);
        }
        if self.recorder.runs() {
            self.record();
        }
        self.signals.times[SERVO].ran(self.tick.since_due());
        self.live.toggle();
    }

    #[inline(always)]
    fn inputs(&mut self) {
        let storm = self.guard.serve();
        if storm || self.handover.timer_leads() {
            self.input.encoder = self.read_counters(storm).raw;
        } else {
            self.input.encoder = self.handover.count(self.decoder.read());
        }
        if self.follower.wants_gap() {
            self.take_reading();
        }
        self.sighted = self.follower.probes();
        if self.sighted {
            self.sight();
        }
        let (input, signals) = (&mut self.input, self.signals);
        input.short_ticks = signals.short_ticks.load();
        input.touches = signals.touches.load() != 0;
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

    /// What was for the tick before alone.
    #[cold]
    fn forget(&mut self) {
        self.once = self.preview.is_some();
        let input = &mut self.input;
        (input.reflex, input.asked) = (false, false);
        (input.reported, input.set_point) = (None, None);
        // Before what waits, which may have come after that SYNC.
        self.synchronise();
        if self.chore == Chore::Compare {
            self.compare();
        }
    }

    /// A safety input is unsafe, or was in the tick before.
    #[cold]
    fn safety(&mut self) {
        self.input.safety = self.inputs.read().unsafe_ones();
    }

    /// For the supervision, or while the timer leads: both counters.
    #[cold]
    fn read_counters(&mut self, storm: bool) -> &Snapshot {
        let timer = self.timer.read();
        self.counters.used = self.handover.read(self.decoder.snapshot(), timer, storm);
        self.counters.watch = Some(timer);
        &self.counters.used
    }

    /// Without a cascade every tick wants the gap voltage.
    #[cold]
    fn take_reading(&mut self) {
        self.fresh |= self.reading.refresh();
        let reading = self.reading.get();
        self.input.gap = (reading.quality == Quality::Valid).then_some(reading.filtered);
    }

    /// Touch probes want the newest block and mark in every tick.
    #[cold]
    fn sight(&mut self) {
        self.fresh |= self.reading.refresh();
        let reading = self.reading.get();
        let block = (reading.quality == Quality::Valid).then_some(reading.block);
        let mark = self.handover.mark(self.decoder.mark());
        self.counters.used.mark = mark;
        self.input.sight = ProbeInputs { mark, block };
    }

    /// The planner is given the estimate of this tick, with the newest gap reading, or the one before, marked as missing.
    #[cold]
    fn hand_over(&mut self) {
        let fresh = self.reading.refresh() | core::mem::take(&mut self.fresh);
        let reading = self.reading.get();
        self.quality = if fresh { reading.quality } else { Quality::Missing };
        // A tick sees one mark: what comes after the probes have looked belongs to the next.
        let mark = if self.sighted { self.input.sight.mark } else { self.handover.mark(self.decoder.mark()) };
        self.counters.used.mark = mark;
        let (follower, quality) = (&mut self.follower, self.quality);
        if self.estimates.is_unread() {
            follower.unread();
        }
        self.estimates.write(|slot| follower.estimate(slot, reading, quality, &mark));
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

    /// What is to be done once a millisecond, each in a tick of its own that neither hands over nor begins.
    #[cold]
    fn chore(&mut self, drive: Drive) {
        self.chore = match self.chore {
            // Estimates may follow each other so closely that no two plain ticks do.
            Chore::Announce if self.follower.is_next_plain() || self.is_late(PLAN_TICKS) => {
                self.once = true;
                Chore::Compare
            }
            Chore::Announce => Chore::Announce,
            Chore::Compare => Chore::Measure,
            Chore::Measure => {
                self.measure();
                Chore::Record
            }
            Chore::Record => {
                self.snapshot();
                Chore::Tell
            }
            Chore::Tell => {
                self.millisecond(drive);
                Chore::CheckSettings
            }
            Chore::CheckSettings => {
                self.look_at_settings();
                self.millisecond = self.millisecond.wrapping_add(TICKS_PER_MS);
                Chore::Announce
            }
        };
    }

    fn is_late(&self, ticks: u32) -> bool {
        self.follower.number().wrapping_sub(self.millisecond) >= ticks
    }

    /// What the supervision compares. The drive's converter is looked at before the tick starts its next pair.
    fn compare(&mut self) {
        // While the timer leads the tick has read them already.
        if !self.handover.timer_leads() {
            self.read_counters(false);
        }
        self.counters.pulses = self.lines.pulses();
        self.counters.drive_stands = self.drive.stands();
    }

    /// The supervision is given what it judges.
    fn measure(&mut self) {
        let Servo { follower, input, counters, reading, quality, measured, .. } = self;
        measured.write(|(measured, both)| {
            follower.measured(measured, input, reading.get(), *quality);
            // One field after the other: the whole would be moved by a function.
            let Counters { used, watch, pulses, drive_stands } = both;
            *used = counters.used;
            *watch = counters.watch;
            *pulses = counters.pulses;
            *drive_stands = counters.drive_stands;
        });
    }

    /// A sample of what a host wants recorded.
    #[cold]
    #[inline(never)]
    fn record(&mut self) {
        if self.recorder.wants_gap() {
            self.fresh |= self.reading.refresh();
        }
        let Servo { follower, input, reading, scales, recorder, .. } = self;
        if recorder.tick(&View { follower, input, reading: reading.get(), scales }) {
            self.say_record();
        }
    }

    /// How the record stands: behind its last word, so that whoever is told may read all of them.
    fn say_record(&mut self) {
        let (phase, serial) = self.recorder.phase();
        self.signals.record.store(serial << 8 | phase as u32);
    }

    /// A sample of what is kept around a fault.
    fn snapshot(&mut self) {
        let Servo { follower, input, reading, scales, snapshots, .. } = self;
        if snapshots.tick(&View { follower, input, reading: reading.get(), scales }) {
            self.signals.snapshot.store(self.snapshots.kept().word());
        }
    }

    /// A millisecond: arms the bridge, calls the protocol, drives the live signal.
    fn millisecond(&mut self, drive: Drive) {
        // The PWM, which a fault of the bridge disconnects.
        if drive != Drive::Coast && !self.input.safety.is_some_and(|safety| safety.bridge_fault) {
            self.tick.arm();
        }
        self.signals.millisecond.set();
        self.caller.protocol();
        let now = self.clock.now();
        self.signals.task_watchdog.report(SERVO, now);
        let clock = self.clock_fault(now);
        let alive = clock.is_none() && self.signals.task_watchdog.missing(now).is_none();
        let live = self.live.millisecond(self.state, alive);
        let damaged = self.signals.settings_damaged.is_set();
        let fault = clock.or(live).or(damaged.then_some(Fault::SettingsDamaged));
        // Whoever coasts for another reason has named that.
        if fault.is_some() && self.follower.plan().reaction != Some(Reaction::Coast) {
            self.found = fault;
            self.signals.waiting.set();
        }
    }

    fn look_at_settings(&mut self) {
        if !self.follower.is_intact() {
            self.signals.settings_damaged.set();
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
        self.input.reported = self.found.take();
        while let Some(fault) = self.faults.receive() {
            let reported = self.input.reported.filter(|reported| reported.reaction() >= fault.reaction());
            self.input.reported = reported.or(Some(fault));
        }
        self.signals.lost_faults.store(self.faults.lost());
        if self.config.refresh() {
            let ServoConfig { follow, off_time_ns, scales } = self.config.get();
            self.scales = *scales;
            self.follower.configure(follow);
            self.generator.request_off_time(*off_time_ns);
        }
        if self.setups.refresh() {
            let Servo { follower, input, reading, scales, recorder, setups, .. } = self;
            recorder.order(setups.get(), &View { follower, input, reading: reading.get(), scales });
            self.say_record();
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
        self.signals.permitted.store(output.pulses.into());
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
