//! The edge decoder.

use crate::Board;
use edm_hal_shim::clock::Clock;
use edm_hal_shim::encoder::{Edge, EdgeLines, Line, QuadratureLines};
use edm_servo_head::encoder::{Quadrature, Seen};

/// Decoder and lines. The three encoder interrupts have one priority, so they share it without a lock.
pub struct Decoder<B: Board> {
    pub(crate) lines: B::Lines,
    pub(crate) clock: B::Clock,
    pub(crate) quadrature: Quadrature<B::Published>,
}

impl<B: Board> Decoder<B> {
    /// An edge of one line. What is no plain step goes by one call, which has few registers saved at every edge.
    #[inline(always)]
    pub fn edge(&mut self, line: Line) {
        self.lines.acknowledge(line);
        let seen = self.quadrature.seen(self.lines.levels());
        if seen.is_plain() && self.lines.follows() {
            self.quadrature.step(seen, || self.clock.now());
        } else {
            self.rare(seen);
        }
    }

    /// What is no plain step, or the last edge that is served in a tick, or the first of the next.
    #[cold]
    fn rare(&mut self, seen: Seen) {
        if self.lines.follows() || self.lines.unusual() == Edge::Last {
            self.quadrature.take(seen, || self.clock.now());
        } else {
            self.quadrature.resume(self.lines.levels());
        }
    }
}
