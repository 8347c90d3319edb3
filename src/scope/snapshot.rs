//! Snapshots: what the head has done around a fault, without anybody having asked.

use super::bank::{Bank, Memory};
use super::recorder::{Phase, Recorder, Setup, Trigger};
use super::signal::{Signal, View};
use super::{SIGNALS, SNAPSHOT};
use crate::units::TICKS_PER_MS;

/// Signals of a snapshot.
pub const SNAPSHOT_SIGNALS: [Signal; SIGNALS] = [
    Signal::Position,
    Signal::Following,
    Signal::Velocity,
    Signal::Duty,
    Signal::Current,
    Signal::GapVoltage,
    Signal::Feed,
    Signal::State,
];
/// Milliseconds from one sample to the next.
const EVERY: u16 = 2;
/// Share of it from before the fault, percent.
const BEFORE: u8 = 75;

/// The last snapshot: its number, 0 for none, and the bank that it is in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Kept {
    serial: u32,
    bank: u32,
}

impl Kept {
    /// As one word: it crosses between tasks.
    pub fn word(self) -> u32 {
        self.serial << 1 | self.bank & 1
    }

    /// Of such a word.
    pub fn of(word: u32) -> Kept {
        Kept { serial: word >> 1, bank: word & 1 }
    }

    /// Number of the snapshot, since the power came; 0: none.
    pub fn serial(self) -> u32 {
        self.serial
    }

    /// The bank that does not have it.
    fn other(self) -> u32 {
        if self.serial == 0 || self.bank == 1 { 0 } else { 1 }
    }

    /// Its bank, if there is one.
    pub fn bank(self, memory: &Memory) -> Option<Bank> {
        let [first, second] = memory.snapshots;
        (self.serial != 0).then_some(if self.bank == 0 { first } else { second })
    }
}

/// Records around each fault: [`tick`](Snapshots::tick) is called once a millisecond.
#[derive(Debug)]
pub struct Snapshots {
    memory: Memory,
    recorder: Recorder,
    kept: Kept,
}

impl Snapshots {
    /// With the one that the run before has left.
    pub fn new(memory: Memory) -> Snapshots {
        let [first, second] = memory.snapshots;
        let serials = [first, second].map(|bank| bank.serial().unwrap_or(0));
        let kept = match serials {
            [a, b] if b > a => Kept { serial: b, bank: 1 },
            [a, _] => Kept { serial: a, bank: 0 },
        };
        let recorder = Recorder::new(if kept.other() == 0 { first } else { second }, TICKS_PER_MS as u16);
        Snapshots { memory, recorder, kept }
    }

    /// The last one.
    pub fn kept(&self) -> Kept {
        self.kept
    }

    /// A millisecond; whether there is another snapshot.
    pub fn tick(&mut self, view: &View<'_>) -> bool {
        if self.recorder.runs() {
            let ends = self.recorder.tick(view) && self.recorder.phase().0 == Phase::Complete;
            if ends {
                self.kept = Kept { serial: self.kept.serial.wrapping_add(1), bank: self.kept.other() };
            }
            return ends;
        }
        // A fault that lasts has its snapshot.
        if view.follower.plan().fault.is_none() {
            self.begin(view);
        }
        false
    }

    /// Waits for the next fault, in the bank that does not have the last snapshot.
    fn begin(&mut self, view: &View<'_>) {
        let [first, second] = self.memory.snapshots;
        self.recorder.turn(if self.kept.other() == 0 { first } else { second });
        let setup = Setup {
            serial: self.kept.serial.wrapping_add(1),
            on: true,
            signals: SNAPSHOT_SIGNALS.map(Some),
            every: EVERY,
            trigger: Trigger::Fault,
            source: 0,
            level: 0,
            before: BEFORE,
        };
        self.recorder.order(&setup, view);
    }
}

const _: () = assert!(SNAPSHOT.is_multiple_of(SIGNALS));
