//! The core's cycle counter as the clock of the head.

use crate::board::CORE_HZ;
use crate::clock::Clock;
use cortex_m::peripheral::{DCB, DWT};

/// Core clock cycles, wrapping every 25.6 s.
#[derive(Clone, Copy)]
pub struct Cycles(());

impl Cycles {
    /// The counter, for a vector that is not unmasked before it has been started.
    pub const STARTED: Self = Cycles(());

    /// Starts the counter.
    pub fn start(dcb: &mut DCB, dwt: &mut DWT) -> Self {
        dcb.enable_trace();
        dwt.set_cycle_count(0);
        dwt.enable_cycle_counter();
        Cycles(())
    }
}

impl Clock for Cycles {
    const HZ: u32 = CORE_HZ;

    #[inline(always)]
    fn now(&self) -> u32 {
        DWT::cycle_count()
    }
}
