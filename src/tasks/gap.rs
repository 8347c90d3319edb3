//! Blocks of conversions become gap readings.

use super::{GAP, READING, ROLL};
use edm_hal_shim::clock::Clock;
use edm_hal_shim::gap::{GapBlock, GapFrontEnd};
use edm_hal_shim::stm32f4::blocks::Blocks;
use edm_hal_shim::stm32f4::cycles::Cycles;
use edm_servo_head::gap::{GapSource, Voltage};

/// Front end and source.
pub struct Gap {
    pub(super) blocks: Blocks,
    pub(super) source: Voltage,
    pub(super) clock: Cycles,
    /// The newest block, written in place: a debugger, or the emulated chip, may look at it.
    pub(super) block: Option<GapBlock>,
}

impl Gap {
    /// A block is complete.
    #[inline(always)]
    pub fn block(&mut self) {
        self.blocks.block(&mut self.block);
        READING.write(&self.source.update(self.block.as_ref()));
        ROLL.report(GAP, self.clock.now());
    }
}
