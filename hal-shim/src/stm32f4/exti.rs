//! The interrupt lines of inputs, encoder and supply.

use super::pac;

pub(super) fn exti() -> &'static pac::exti::RegisterBlock {
    // SAFETY: the register block is always there. The mask and edge registers are changed at start-up, with interrupts
    // off, and afterwards only by the encoder's storm guard; the pending register clears only bits written as 1.
    unsafe { &*pac::EXTI::ptr() }
}
