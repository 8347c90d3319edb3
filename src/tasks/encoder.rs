//! The edge decoder.

use super::Published;
use edm_hal_shim::clock::Clock;
use edm_hal_shim::encoder::{Levels, QuadratureLines};
use edm_hal_shim::stm32f4::cycles::Cycles;
use edm_hal_shim::stm32f4::encoder::{Edge, Line, Lines};
use edm_servo_head::encoder::Quadrature;

/// Decoder and lines. The three encoder interrupts have one priority, so they share it without a lock.
pub struct Decoder {
    pub(super) lines: Lines,
    pub(super) clock: Cycles,
    pub(super) quadrature: Quadrature<&'static Published>,
}

impl Decoder {
    /// An edge of one line.
    #[inline(always)]
    pub fn edge(&mut self, line: Line) {
        self.lines.acknowledge(line);
        let (levels, now) = (self.lines.levels(), self.clock.now());
        if self.lines.follows() {
            self.quadrature.edge(levels, now);
        } else {
            self.unusual(levels, now);
        }
    }

    #[cold]
    #[inline(never)]
    fn unusual(&mut self, levels: Levels, now: u32) {
        match self.lines.unusual() {
            Edge::Last => self.quadrature.edge(levels, now),
            Edge::AfterStorm => self.quadrature.resume(levels),
        }
    }
}
