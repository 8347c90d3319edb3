//! The scope, 2010h: four signals recorded once a millisecond or slower, read as a domain.

use super::Drive;
use crate::canopen::objects::Item;

/// Signals.
pub const SIGNALS: usize = 4;
/// Samples that fit.
pub const SAMPLES: usize = 256;
/// Bytes of a sample.
const SAMPLE: usize = SIGNALS * 4;

/// How the scope stands; the number is that of 2010h:9.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Phase {
    /// Nothing recorded, or stopped.
    #[default]
    Idle = 0,
    /// Waits for its trigger.
    Waits = 1,
    /// Records.
    Records = 2,
    /// The record is complete.
    Full = 3,
}

/// What begins a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trigger {
    /// 2010h:6.
    pub kind: i32,
    /// 2010h:7.
    pub level: i32,
}

/// Memory for a record, 4 KiB: too large to be built on a stack and moved from there.
pub type Record = [[i32; SIGNALS]; SAMPLES];
/// A record with nothing in it.
pub const BLANK: Record = [[0; SIGNALS]; SAMPLES];

/// The scope, with its record.
#[derive(Debug)]
pub struct Scope {
    samples: &'static mut Record,
    count: u16,
    phase: Phase,
    /// Calls until the next sample.
    wait: u16,
    last: Option<i32>,
}

impl Scope {
    /// Idle and empty.
    pub const fn new(samples: &'static mut Record) -> Scope {
        Scope { samples, count: 0, phase: Phase::Idle, wait: 0, last: None }
    }

    /// Begins anew.
    pub fn arm(&mut self) {
        (self.count, self.wait, self.last, self.phase) = (0, 0, None, Phase::Waits);
    }

    /// Keeps what there is.
    pub fn stop(&mut self) {
        if self.phase != Phase::Full {
            self.phase = Phase::Idle;
        }
    }

    /// Takes the signals of now.
    pub fn sample(&mut self, signals: [i32; SIGNALS], trigger: Trigger, decimation: u16) {
        let [first, ..] = signals;
        if self.phase == Phase::Waits {
            let last = self.last.replace(first);
            let level = trigger.level;
            let fires = match trigger.kind {
                0 => true,
                1 => last.is_some_and(|last| last < level && first >= level),
                2 => last.is_some_and(|last| last > level && first <= level),
                _ => last.is_some_and(|last| last != first),
            };
            if fires {
                self.phase = Phase::Records;
            }
        }
        if self.phase != Phase::Records {
            return;
        }
        if self.wait > 0 {
            self.wait = self.wait.wrapping_sub(1);
            return;
        }
        self.wait = decimation.saturating_sub(1);
        if let Some(slot) = self.samples.get_mut(usize::from(self.count)) {
            *slot = signals;
            self.count = self.count.wrapping_add(1);
        }
        if usize::from(self.count) >= SAMPLES {
            self.phase = Phase::Full;
        }
    }

    /// How it stands.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Whether it takes samples.
    pub fn runs(&self) -> bool {
        matches!(self.phase, Phase::Waits | Phase::Records)
    }

    /// Samples recorded.
    pub fn count(&self) -> u16 {
        self.count
    }

    /// Length of the record, bytes.
    pub fn length(&self) -> u32 {
        u32::from(self.count).wrapping_mul(SAMPLE as u32)
    }

    /// Bytes of the record from `offset` on.
    pub fn copy(&self, offset: u32, out: &mut [u8]) {
        for (byte, at) in out.iter_mut().zip(offset as usize..) {
            let sample = self.samples.get(at / SAMPLE);
            let signal = sample.and_then(|sample| sample.get(at % SAMPLE / 4));
            let bytes = signal.copied().unwrap_or(0).to_le_bytes();
            *byte = bytes.get(at % 4).copied().unwrap_or(0);
        }
    }
}

impl Drive {
    /// Takes a sample, once a millisecond.
    pub(super) fn record(&mut self) {
        // Reading four objects costs time, a thousand times a second.
        if !self.scope.runs() {
            return;
        }
        let signals = [Item::ScopeSignal1, Item::ScopeSignal2, Item::ScopeSignal3, Item::ScopeSignal4];
        let signals = signals.map(|item| self.signal(self.value(item) as u32));
        let trigger = Trigger { kind: self.value(Item::ScopeTrigger), level: self.value(Item::ScopeLevel) };
        self.scope.sample(signals, trigger, self.value(Item::ScopeDecimation) as u16);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::boxed::Box;

    fn scope() -> Scope {
        Scope::new(Box::leak(Box::new(BLANK)))
    }

    #[test]
    fn a_record_begins_at_its_trigger_and_ends_when_full() {
        let mut scope = scope();
        let trigger = Trigger { kind: 1, level: 10 };
        scope.sample([20, 0, 0, 0], trigger, 1);
        assert_eq!((scope.phase(), scope.count()), (Phase::Idle, 0));
        scope.arm();
        for value in [20, 9, 9, 10, 11] {
            scope.sample([value, -1, 0, 7], trigger, 1);
        }
        assert_eq!((scope.phase(), scope.count()), (Phase::Records, 2));
        let mut bytes = [0; 32];
        scope.copy(0, &mut bytes);
        assert_eq!(bytes[..8], [10, 0, 0, 0, 255, 255, 255, 255]);
        assert_eq!(bytes[16], 11);
        for value in 0..SAMPLES as i32 {
            scope.sample([value, 0, 0, 0], trigger, 1);
        }
        assert_eq!((scope.phase(), scope.length()), (Phase::Full, 4096));
    }

    #[test]
    fn decimation_skips() {
        let mut scope = scope();
        scope.arm();
        for value in 0..10 {
            scope.sample([value, 0, 0, 0], Trigger { kind: 0, level: 0 }, 4);
        }
        let mut bytes = [0; 48];
        scope.copy(0, &mut bytes);
        assert_eq!([bytes[0], bytes[16], bytes[32]], [0, 4, 8]);
        assert_eq!(scope.count(), 3);
    }
}
