//! The edge decoder.

use super::Published;
use edm_hal_shim::clock::Clock;
use edm_hal_shim::encoder::QuadratureLines;
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
        if self.lines.acknowledge(line) {
            self.quadrature.edge(self.lines.levels(), self.clock.now());
        } else {
            self.unusual();
        }
    }

    #[cold]
    #[inline(never)]
    fn unusual(&mut self) {
        let edge = self.lines.unusual();
        let levels = self.lines.levels();
        match edge {
            Edge::Last => self.quadrature.edge(levels, self.clock.now()),
            Edge::AfterStorm => self.quadrature.resume(levels),
        }
    }
}
