//! The chip's own supply: off while the program is still right, reset before it is wrong.
//!
//! At 168 MHz with five wait states the flash wants 2.7 V (RM0090 3.5.1). Brown-out level 3 resets below 2.75 to 2.90 V,
//! falling; the level of a new chip is none, about 1.7 V. The voltage detector reports before that: below 2.85 to 2.99 V,
//! falling, and it is content again above 2.96 to 3.10 V, with which 3.2 V at the least (docs/bring-up.md) leaves room (data
//! sheet, embedded reset and power control block).

use super::exti::exti;
use super::{change, pac, put};
use crate::self_test::SelfTest;

/// Bits of FLASH_OPTCR that hold the brown-out level; 0 is level 3 (RM0090 3.9.10).
const BOR_LEV: u32 = 0b11 << 2;
/// Interrupt line of the detector.
pub const LINE: u32 = 1 << 16;
/// Clock gate of the power controller (RM0090 7.3.13).
const PWR: u32 = 1 << 28;
/// Threshold 6, and the detector on (RM0090 5.4.1).
const PLS: u32 = 0b110 << 5;
const PVDE: u32 = 1 << 4;
/// The supply is below the threshold (RM0090 5.4.2).
const PVDO: u32 = 1 << 2;

/// What the option bytes say.
pub fn brown_out(flash: &pac::FLASH) -> SelfTest {
    if flash.optcr().read().bits() & BOR_LEV == 0 { SelfTest::PASSED } else { SelfTest::BROWN_OUT }
}

/// The voltage detector.
pub struct Supply(pac::PWR);

impl Supply {
    /// Starts the detector behind its interrupt line: a supply that is low already is an edge, too.
    pub fn watch(pwr: pac::PWR, rcc: &pac::RCC) -> Self {
        change!(rcc.apb1enr(), clear 0, set PWR);
        change!(exti().rtsr(), clear 0, set LINE);
        change!(exti().imr(), clear 0, set LINE);
        change!(pwr.cr(), clear 0, set PLS | PVDE);
        Supply(pwr)
    }

    /// Below the threshold now.
    pub fn is_low(&self) -> bool {
        self.0.csr().read().bits() & PVDO != 0
    }
}

/// Acknowledges the interrupt.
#[inline(always)]
pub fn acknowledge() {
    put!(exti().pr(), LINE);
}
