//! A recorder: samples go round in a bank until what it waits for has come and the rest of the ring is full.

use super::bank::Bank;
use super::signal::{Signal, View};
use super::{SIGNALS, bank};
use crate::head::{Fault, State};

/// What begins a record.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Trigger {
    /// Nothing: at once.
    #[default]
    Now,
    /// A signal rises to the level.
    Rises,
    /// A signal falls to the level.
    Falls,
    /// The state changes.
    State,
    /// A fault.
    Fault,
    /// A short retreats, by the reflex or by its duration.
    Short,
}

impl Trigger {
    /// The trigger of a number.
    pub const fn numbered(number: i32) -> Trigger {
        match number {
            1 => Trigger::Rises,
            2 => Trigger::Falls,
            3 => Trigger::State,
            4 => Trigger::Fault,
            5 => Trigger::Short,
            _ => Trigger::Now,
        }
    }
}

/// What is to be recorded.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Setup {
    /// Number of the order; a record has that of its order.
    pub serial: u32,
    /// Begin; else keep what there is.
    pub on: bool,
    /// Signals; none behind the first that is none.
    pub signals: [Option<Signal>; SIGNALS],
    /// Calls from one sample to the next.
    pub every: u16,
    /// What begins it.
    pub trigger: Trigger,
    /// Which of the signals is compared with the level, from 0.
    pub source: u8,
    /// The level, in steps of that signal.
    pub level: i32,
    /// Share of the ring from before the trigger, percent.
    pub before: u8,
}

/// How a recorder stands; the number is that of 2019h:15.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Phase {
    /// Nothing recorded.
    #[default]
    Idle = 0,
    /// Waits for its trigger, and records what is before it.
    Waits = 1,
    /// Records what comes behind it.
    Records = 2,
    /// The record is complete.
    Complete = 3,
}

/// Samples the signals of its setup around a trigger, into its bank.
#[derive(Debug)]
pub struct Recorder {
    bank: Bank,
    /// Servo ticks from one call to the next.
    step: u16,
    setup: Setup,
    phase: Phase,
    /// Signals, and samples of them that fit.
    width: u32,
    ring: u32,
    /// Place of the next sample, samples in the ring, and samples to come since the trigger.
    at: u32,
    filled: u32,
    left: u32,
    /// Samples from the trigger on.
    after: u32,
    /// Ticks until the next sample.
    wait: u16,
    gap: bool,
    /// Of the sample before.
    last: Option<i32>,
    state: State,
    faulty: bool,
    fault: u8,
    tick: u32,
}

impl Recorder {
    /// Over a bank, whatever is in it; called every `step` servo ticks.
    pub fn new(bank: Bank, step: u16) -> Recorder {
        let phase = if bank.serial().is_some() { Phase::Complete } else { Phase::Idle };
        Recorder {
            bank,
            step,
            setup: Setup::default(),
            phase,
            width: 1,
            ring: 1,
            at: 0,
            filled: 0,
            left: 0,
            after: 0,
            wait: 0,
            gap: false,
            last: None,
            state: State::Disabled,
            faulty: false,
            fault: 0,
            tick: 0,
        }
    }

    /// Goes on in another bank.
    pub(super) fn turn(&mut self, bank: Bank) {
        self.bank = bank;
    }

    /// Does what an order says.
    #[cold]
    pub fn order(&mut self, setup: &Setup, view: &View<'_>) {
        if !setup.on {
            self.stop();
            self.setup.serial = setup.serial;
            return;
        }
        let width = setup.signals.iter().take_while(|signal| signal.is_some()).count() as u32;
        if width == 0 {
            return;
        }
        self.bank.clear();
        self.setup = *setup;
        (self.width, self.ring) = (width, self.bank.ring(width));
        (self.at, self.filled, self.wait, self.last) = (0, 0, 0, None);
        // The sample of the trigger is there in any case.
        let before = self.ring.wrapping_mul(setup.before.min(100).into()) / 100;
        self.after = self.ring.saturating_sub(before).max(1);
        self.gap = setup.signals.iter().flatten().any(|signal| signal.is_of_gap());
        let plan = view.follower.plan();
        (self.state, self.faulty) = (plan.state, plan.fault.is_some());
        self.phase = Phase::Waits;
        if setup.trigger == Trigger::Now {
            self.after = self.ring;
            self.fire(view);
        }
    }

    /// Ends the record with what there is.
    fn stop(&mut self) {
        match self.phase {
            Phase::Waits => self.complete(0, self.filled),
            Phase::Records => {
                self.complete(self.cause(), self.filled.saturating_sub(self.after.wrapping_sub(self.left)))
            }
            Phase::Idle | Phase::Complete => {}
        }
    }

    fn cause(&self) -> u8 {
        (self.setup.trigger as u8).wrapping_add(1)
    }

    /// It takes samples.
    #[inline(always)]
    pub fn runs(&self) -> bool {
        matches!(self.phase, Phase::Waits | Phase::Records)
    }

    /// It records something of the gap reading.
    #[inline]
    pub fn wants_gap(&self) -> bool {
        self.gap
    }

    /// How it stands, with the number of the order.
    pub fn phase(&self) -> (Phase, u32) {
        (self.phase, self.setup.serial)
    }

    /// One tick of a recorder that runs; whether it stands otherwise afterwards.
    pub fn tick(&mut self, view: &View<'_>) -> bool {
        let before = self.phase;
        if self.phase == Phase::Waits && self.has_come(view) {
            self.fire(view);
        }
        if self.wait > 0 {
            self.wait = self.wait.wrapping_sub(1);
            return self.phase != before;
        }
        self.wait = self.setup.every.saturating_sub(1);
        let first = self.at.wrapping_mul(self.width);
        let mut compared = 0;
        for ((signal, at), number) in self.setup.signals.iter().zip(first..).zip(0u8..) {
            let Some(signal) = signal else { break };
            let value = signal.read(view);
            self.bank.store(at, value);
            if number == self.setup.source {
                compared = value;
            }
        }
        self.at = self.at.wrapping_add(1);
        if self.at >= self.ring {
            self.at = 0;
        }
        self.filled = self.ring.min(self.filled.wrapping_add(1));
        let last = self.last.replace(compared);
        if self.phase == Phase::Waits && self.crosses(last, compared) {
            self.fire(view);
        }
        if self.phase == Phase::Records {
            self.left = self.left.wrapping_sub(1);
            if self.left == 0 {
                self.complete(self.cause(), self.filled.saturating_sub(self.after));
            }
        }
        self.phase != before
    }

    /// An event that is waited for is in this tick.
    #[inline]
    fn has_come(&mut self, view: &View<'_>) -> bool {
        let plan = view.follower.plan();
        match self.setup.trigger {
            Trigger::State => core::mem::replace(&mut self.state, plan.state) != plan.state,
            Trigger::Fault => !core::mem::replace(&mut self.faulty, plan.fault.is_some()) && self.faulty,
            Trigger::Short => view.follower.is_shorted(view.input),
            Trigger::Now | Trigger::Rises | Trigger::Falls => false,
        }
    }

    fn crosses(&self, last: Option<i32>, value: i32) -> bool {
        let level = self.setup.level;
        match self.setup.trigger {
            Trigger::Rises => last.is_some_and(|last| last < level && value >= level),
            Trigger::Falls => last.is_some_and(|last| last > level && value <= level),
            _ => false,
        }
    }

    /// The trigger has come: it belongs to the sample of this tick, or to the next one.
    fn fire(&mut self, view: &View<'_>) {
        self.phase = Phase::Records;
        self.left = self.after;
        self.tick = view.follower.number();
        self.fault = view.follower.plan().fault.map_or(0, Fault::number);
    }

    fn complete(&mut self, cause: u8, trigger: u32) {
        let mut signals = [0; SIGNALS];
        for (number, signal) in signals.iter_mut().zip(self.setup.signals.iter().map_while(|signal| *signal)) {
            *number = signal as u8;
        }
        let full = self.filled >= self.ring;
        self.bank.seal(&bank::Contents {
            signals,
            width: self.width,
            cause,
            fault: self.fault,
            every: u32::from(self.setup.every.max(1)).wrapping_mul(self.step.into()),
            samples: self.filled,
            trigger,
            tick: self.tick,
            first: if full { self.at } else { 0 },
            serial: self.setup.serial,
        });
        self.phase = Phase::Complete;
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Memory, STREAM_HEADER, Scales};
    use super::*;
    use crate::gap::GapReading;
    use crate::head::{Follower, TickInput};
    use crate::settings::Settings;
    use crate::units::Volts;
    use std::vec::Vec;

    struct Rig {
        memory: Memory,
        recorder: Recorder,
        follower: Follower,
        input: TickInput,
        reading: GapReading,
    }

    impl Rig {
        fn new() -> Rig {
            let memory = Memory::leak();
            let follower = Follower::new(Settings::default().build().unwrap().head.follow());
            let recorder = Recorder::new(memory.record, 1);
            Rig { memory, recorder, follower, input: TickInput::default(), reading: GapReading::default() }
        }

        fn order(&mut self, setup: Setup) {
            let scales = Scales::default();
            let Rig { follower, input, reading, .. } = self;
            self.recorder.order(&setup, &View { follower, input, reading, scales: &scales });
        }

        /// A tick with this gap voltage.
        fn tick(&mut self, volts: f32) {
            self.reading.block = Volts(volts);
            let scales = Scales::default();
            self.follower.tick(&self.input, |_| None);
            let Rig { follower, input, reading, .. } = self;
            if self.recorder.runs() {
                self.recorder.tick(&View { follower, input, reading, scales: &scales });
            }
        }

        /// Header and values of the record.
        fn record(&self) -> (Vec<u32>, Vec<i32>) {
            let mut bytes = std::vec![0; self.memory.record.length() as usize];
            // As a transfer reads it: seven bytes at a time.
            for (at, piece) in (0..).step_by(7).zip(bytes.chunks_mut(7)) {
                self.memory.record.copy(at, piece);
            }
            let words: Vec<u32> = bytes.chunks(4).map(|word| u32::from_le_bytes(word.try_into().unwrap())).collect();
            let (header, data) = words.split_at(STREAM_HEADER);
            (header.to_vec(), data.iter().map(|word| word.cast_signed()).collect())
        }
    }

    fn signals(signals: &[Signal]) -> [Option<Signal>; SIGNALS] {
        std::array::from_fn(|at| signals.get(at).copied())
    }

    fn setup(trigger: Trigger, before: u8) -> Setup {
        let signals = signals(&[Signal::State, Signal::GapBlock]);
        Setup { serial: 7, on: true, signals, every: 1, trigger, source: 1, level: 5000, before }
    }

    #[test]
    fn a_record_of_a_level_has_its_share_from_before_and_the_trigger_where_the_level_is_reached() {
        let mut rig = Rig::new();
        rig.order(setup(Trigger::Rises, 25));
        // Longer than the ring of 2048 samples, so that it has gone round; above the level from the beginning is no rise.
        (0..3000).for_each(|_| rig.tick(60.0));
        assert_eq!(rig.recorder.phase(), (Phase::Waits, 7));
        (0..3000).for_each(|tick| rig.tick(tick as f32 * 0.01));
        (0..1535).for_each(|tick| rig.tick(50.0 + tick as f32 * 0.01));
        assert_eq!(rig.recorder.phase().0, Phase::Records);
        rig.tick(99.0);
        assert_eq!(rig.recorder.phase().0, Phase::Complete);
        let (header, values) = rig.record();
        assert_eq!((header[0], header[1] & 0xFFFF, header[4], header[5]), (0x4353_0001, 2 | 2 << 8, 1, 2048));
        assert_eq!(header[2], 10 | 8 << 8);
        let volts: Vec<i32> = values.chunks(2).map(|sample| sample[1]).collect();
        let at = header[6] as usize;
        assert_eq!((volts.len(), at), (2048, 512));
        assert_eq!((volts[at - 1], volts[at], volts[2047]), (2999, 5000, 9900));
        assert!(volts[at - 512..at].windows(2).all(|pair| (0..=2).contains(&(pair[1] - pair[0]))));
    }

    #[test]
    fn a_trigger_that_comes_early_makes_a_shorter_record_and_an_event_is_not_missed_between_samples() {
        let mut rig = Rig::new();
        rig.order(Setup { every: 4, ..setup(Trigger::Short, 50) });
        (0..10).for_each(|_| rig.tick(1.0));
        rig.input.reflex = true;
        rig.tick(2.0);
        rig.input.reflex = false;
        (0..5000).for_each(|_| rig.tick(3.0));
        let (header, values) = rig.record();
        // Samples of ticks 0, 4 and 8, then the event in tick 10, whose sample is that of tick 12.
        assert_eq!((header[4], header[5], header[6]), (4, 3 + 1024, 3));
        assert_eq!(header[1] & 0xFFFF, 2 | 6 << 8);
        assert_eq!([values[1], values[5], values[7]], [100, 100, 300]);
        assert_eq!(header[7], 11, "the tick of the event");
    }

    #[test]
    fn a_record_at_once_is_full_after_as_many_samples_as_fit_and_one_that_is_stopped_keeps_what_it_has() {
        let mut rig = Rig::new();
        let all = signals(&[Signal::Position; SIGNALS]);
        rig.order(Setup { signals: all, ..setup(Trigger::Now, 90) });
        (0..511).for_each(|_| rig.tick(0.0));
        assert_eq!((rig.recorder.phase().0, rig.memory.record.length()), (Phase::Records, 0));
        rig.tick(0.0);
        assert_eq!((rig.recorder.phase().0, rig.memory.record.length()), (Phase::Complete, 16384 + 32));
        assert_eq!(rig.record().0[6], 0);

        rig.order(setup(Trigger::Fault, 50));
        assert_eq!(rig.memory.record.length(), 0, "the one before is gone");
        (0..100).for_each(|_| rig.tick(0.0));
        rig.order(Setup { on: false, serial: 8, ..Setup::default() });
        assert_eq!(rig.recorder.phase(), (Phase::Complete, 8));
        let (header, _) = rig.record();
        assert_eq!((header[1] >> 8 & 0xFF, header[5], header[6]), (0, 100, 100), "without a trigger");
    }

    #[test]
    fn what_noise_has_left_is_no_record_and_what_was_complete_still_is() {
        let mut rig = Rig::new();
        rig.order(setup(Trigger::Now, 0));
        (0..2048).for_each(|_| rig.tick(4.0));
        assert_eq!(Recorder::new(rig.memory.record, 1).phase().0, Phase::Complete);
        rig.memory.clear();
        assert_eq!(Recorder::new(rig.memory.record, 1).phase().0, Phase::Idle);
        // Every single bit that has changed in what says how much there is.
        rig.order(setup(Trigger::Now, 0));
        (0..2048).for_each(|_| rig.tick(4.0));
        for bit in 0..32 {
            rig.memory.record.flip(5, bit);
            assert_eq!(rig.memory.record.length(), 0, "bit {bit}");
            rig.memory.record.flip(5, bit);
        }
        assert_eq!(rig.memory.record.length(), 16384 + 32);
    }
}
