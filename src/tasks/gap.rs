//! Blocks of conversions become gap readings.

use super::{GAP, READING, ROLL, timers};
use edm_hal_shim::clock::Clock;
use edm_hal_shim::gap::{GapBlock, GapFrontEnd};
use edm_hal_shim::stm32f4::blocks::Blocks;
use edm_hal_shim::stm32f4::cycles::Cycles;
use edm_servo_head::gap::{GapSource, Voltage, voltage};
use heapless::spsc::Consumer;

/// Front end and source.
pub struct Gap {
    pub(super) blocks: Blocks,
    pub(super) source: Voltage,
    pub(super) clock: Cycles,
    /// The newest block, written in place: a debugger, or the emulated chip, may look at it.
    pub(super) block: Option<GapBlock>,
    pub(super) settings: Consumer<'static, voltage::Active>,
}

impl Gap {
    /// A block is complete.
    #[inline(always)]
    pub fn block(&mut self) {
        let begin = self.clock.now();
        self.blocks.block(&mut self.block);
        READING.write(&self.source.update(self.block.as_ref()));
        if self.settings.ready() {
            self.retune();
        }
        let end = self.clock.now();
        timers::ran(GAP, end.wrapping_sub(begin));
        ROLL.report(GAP, end);
    }

    /// Other settings, once the reading is out.
    #[cold]
    fn retune(&mut self) {
        if let Some(active) = self.settings.dequeue() {
            self.source.retune(active);
        }
    }
}
