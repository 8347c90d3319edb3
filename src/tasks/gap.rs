//! Blocks of conversions become gap readings.

use super::{GAP, ROLL};
use core::hint::black_box;
use edm_hal_shim::clock::Clock;
use edm_hal_shim::gap::{GapBlock, GapFrontEnd};
use edm_hal_shim::stm32f4::blocks::Blocks;
use edm_hal_shim::stm32f4::cycles::Cycles;
use edm_servo_head::gap::{GapReading, GapSource, Voltage};
use heapless::spsc::Producer;

/// Front end and source.
pub struct Gap {
    pub(super) blocks: Blocks,
    pub(super) source: Voltage,
    pub(super) clock: Cycles,
    pub(super) readings: Producer<'static, GapReading>,
    /// The newest block: a debugger, or the emulated chip, may look at it.
    pub(super) block: Option<GapBlock>,
}

impl Gap {
    /// A block is complete.
    #[inline(always)]
    pub fn block(&mut self) {
        self.block = self.blocks.block();
        let reading = self.source.update(black_box(&self.block).as_ref());
        // Full only when the servo task has missed three ticks; its roll call tells.
        let _ = self.readings.enqueue(reading);
        ROLL.report(GAP, self.clock.now());
    }
}
