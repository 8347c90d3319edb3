//! The lines that stop everything, and the counts of the pulses, as the servo task sees them.

use super::gate::{comparators, gate_edges};
use super::gated::{conversions, newest, retreats, shorts};
use super::lines::{self, Forced};
use crate::reflex::{ForcedLines, PulseCounts};

/// See the module.
pub struct ServoLines(pub(super) ());

impl ForcedLines for ServoLines {
    type Mark = Forced;

    #[inline(always)]
    fn forced(&self) -> Forced {
        lines::forced()
    }

    #[inline(always)]
    fn bridge_forced(&self, earlier: Forced, later: Forced) -> bool {
        earlier.bridge_differs(later)
    }

    #[inline(always)]
    fn settle(&mut self, seen: Forced) {
        lines::settle(seen);
    }

    fn stop(&mut self) {
        lines::stop();
    }

    #[inline(always)]
    fn retreats(&self) -> u32 {
        retreats()
    }

    fn pulses(&self) -> PulseCounts {
        PulseCounts {
            edges: gate_edges() as u8,
            conversions: conversions() as u8,
            shorts: shorts() as u8,
            comparators: comparators(),
            newest: newest(),
        }
    }
}
