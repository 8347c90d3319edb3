//! The core's cycle counter as the clock of the head.

use crate::board::CORE_HZ;
use crate::clock::Clock;
use cortex_m::peripheral::{DCB, DWT};

/// DEMCR.TRCENA and DWT_CTRL.CYCCNTENA (ARMv7-M C1.6.5, C1.8.7).
const TRACE: u32 = 1 << 24;
const COUNT: u32 = 1;

/// Core clock cycles, wrapping every 25.6 s.
#[derive(Clone, Copy)]
pub struct Cycles(());

impl Cycles {
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

    fn restart(&self) {
        // SAFETY: the register blocks are always there; the two enables are set here and at the start alone, where nothing
        // runs beside it, and cleared by a debugger.
        let (dcb, dwt) = unsafe { (&*DCB::PTR, &*DWT::PTR) };
        // SAFETY: as above.
        unsafe {
            dcb.demcr.modify(|demcr| demcr | TRACE);
            dwt.ctrl.modify(|ctrl| ctrl | COUNT);
        }
    }
}
