//! The circuit behind the live signal: a world that has it around the chip.

use crate::wires::{ARM, ARMED, LIVE};
use edm_hal_shim::double::live::Circuit;
use edm_soc::{Change, Drive, NEVER, Pin, TICK_HZ};

/// How long the monostable runs: nominal value of docs/wiring.md.
pub const MONOSTABLE: u64 = TICK_HZ * 4 / 10_000;

/// Monostable and latch at the chip's pins.
#[derive(Clone, Debug)]
pub struct Latch {
    /// The circuit.
    pub circuit: Circuit,
    /// How long the monostable runs, ticks.
    pub time: u64,
    /// Level that the chip last received.
    reported: Option<bool>,
}

impl Default for Latch {
    fn default() -> Self {
        Self { circuit: Circuit::default(), time: MONOSTABLE, reported: None }
    }
}

impl Latch {
    /// The chip drives `pin` from `at` on. What is due before has been taken.
    pub fn drive(&mut self, at: u64, pin: Pin, drive: Drive) {
        let high = drive == Drive::Level(true);
        self.circuit.pass(at);
        match pin {
            LIVE => self.circuit.live(at, self.time, high),
            ARM => self.circuit.arm(high),
            _ => (),
        }
    }

    /// When its output changes next; 0 when it has changed.
    pub fn next_change(&self) -> u64 {
        if self.reported == Some(self.circuit.reads()) { self.circuit.expires().unwrap_or(NEVER) } else { 0 }
    }

    /// What has changed until `at`.
    pub fn take_change(&mut self, at: u64) -> Option<Change> {
        self.circuit.pass(at);
        let level = self.circuit.reads();
        (self.reported.replace(level) != Some(level)).then_some(Change::Level(ARMED, Some(level)))
    }

    /// Pulses and bridge may go on.
    pub fn enables(&self) -> bool {
        self.circuit.enables()
    }
}
