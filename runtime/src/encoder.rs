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
    /// For a vector of its own: goes on with the state that the assembled decoder has begun.
    pub const fn beside(lines: B::Lines, clock: B::Clock, published: B::Published) -> Self {
        Decoder { lines, clock, quadrature: Quadrature::beside(published) }
    }

    /// An edge of one line.
    #[inline(always)]
    pub fn edge(&mut self, line: Line) {
        self.lines.acknowledge(line);
        let seen = self.quadrature.seen(self.lines.levels());
        if self.lines.follows() {
            self.quadrature.take(seen, || self.clock.now());
        } else {
            self.unusual();
        }
    }

    #[cold]
    fn unusual(&mut self) {
        let levels = self.lines.levels();
        match self.lines.unusual() {
            Edge::Last => self.quadrature.edge(levels, || self.clock.now()),
            Edge::AfterStorm => self.quadrature.resume(levels),
        }
    }
}
