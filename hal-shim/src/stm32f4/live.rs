//! The live signal on three pins.

use super::pins::{Input, Output, high, is_high, low, port};
use super::{Board, put};
use crate::board::Pin as Place;
use crate::board::gpio::Pin;
use crate::live::Live;

const LIVE: Place = Board::TABLE.pin("live");
const ARM: Place = Board::TABLE.pin("arm");
const ARMED: Place = Board::TABLE.pin("armed");
/// What the set-reset register takes to drive the line high; rotated by 16, low.
const HIGH: u32 = 1 << LIVE.number;

/// The three lines. Owned by the servo task.
pub struct Signal {
    /// What the next tick writes; 0, which changes nothing, while there are to be no edges.
    next: u32,
    _live: Output<{ LIVE.port }, { LIVE.number }>,
    _arm: Output<{ ARM.port }, { ARM.number }>,
    _armed: Input<{ ARMED.port }, { ARMED.number }>,
}

impl Signal {
    /// Takes the pins. Both outputs are low, and stay so. The input loses the pull that it has after a reset where it is a pin
    /// of JTAG: a circuit that is not there must read low.
    pub fn new(
        live: Pin<{ LIVE.port }, { LIVE.number }>,
        arm: Pin<{ ARM.port }, { ARM.number }>,
        armed: Input<{ ARMED.port }, { ARMED.number }>,
    ) -> Self {
        let armed = armed.into_floating_input();
        Signal { next: 0, _live: live.into_push_pull_output(), _arm: arm.into_push_pull_output(), _armed: armed }
    }
}

impl Live for Signal {
    /// A store that waits for no decision: a port's set-reset register changes nothing but the pins it names.
    #[inline(always)]
    fn toggle(&mut self) {
        put!(port(LIVE).bsrr(), self.next);
        self.next = self.next.rotate_left(16);
    }

    fn run(&mut self, runs: bool) {
        if runs != (self.next != 0) {
            self.next = if runs { HIGH } else { 0 };
        }
    }

    fn arm(&mut self, level: bool) {
        if level { high(ARM) } else { low(ARM) }
    }

    fn armed(&self) -> bool {
        is_high(ARMED)
    }
}
