//! The edge decoder.

use super::{ENCODER, Published};
use core::borrow::Borrow;
use edm_hal_shim::clock::Clock;
use edm_hal_shim::encoder::QuadratureLines;
use edm_hal_shim::stm32f4::cycles::Cycles;
use edm_hal_shim::stm32f4::encoder::{Edge, Line, Lines};
use edm_servo_head::encoder::Quadrature;

/// The published count: a place that the compiler knows, where a reference would have to be loaded at every edge.
pub struct Shared;

impl Borrow<Published> for Shared {
    #[inline(always)]
    fn borrow(&self) -> &Published {
        &ENCODER
    }
}

/// Decoder and lines. The three encoder interrupts have one priority, so they share it without a lock.
pub struct Decoder {
    pub(super) lines: Lines,
    pub(super) clock: Cycles,
    pub(super) quadrature: Quadrature<Shared>,
}

impl Decoder {
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
