//! The edge decoder.

use crate::Board;
use edm_hal_shim::clock::Clock;
use edm_hal_shim::encoder::{Edge, EdgeLines, Line, QuadratureLines};
use edm_servo_head::encoder::Quadrature;

/// Decoder and lines. The three encoder interrupts have one priority, so they share it without a lock.
pub struct Decoder<B: Board> {
    pub(crate) lines: B::Lines,
    pub(crate) clock: B::Clock,
    pub(crate) quadrature: Quadrature<B::Published>,
}

impl<B: Board> Decoder<B> {
    /// An edge of one line.
    #[inline(always)]
    pub fn edge(&mut self, line: Line) {
        self.lines.acknowledge(line);
        // Loads in a row take a cycle each.
        let (levels, now) = (self.lines.levels(), self.clock.now());
        if self.lines.follows() {
            self.quadrature.edge(levels, now);
        } else {
            self.unusual();
        }
    }

    #[cold]
    fn unusual(&mut self) {
        let (levels, now) = (self.lines.levels(), self.clock.now());
        match self.lines.unusual() {
            Edge::Last => self.quadrature.edge(levels, now),
            Edge::AfterStorm => self.quadrature.resume(levels),
        }
    }
}
