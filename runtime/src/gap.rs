//! Blocks of conversions become gap readings.

use crate::Board;
use crate::board::{Caller, Tunable};
use crate::crossings::{GAP, Signals};
use edm_crossing::latest::{Reader, Writer};
use edm_hal_shim::clock::Clock;
use edm_hal_shim::gap::{GapBlock, GapFrontEnd};
use edm_servo_head::gap::{GapReading, GapSource, voltage};

/// Front end and source.
pub struct Gap<B: Board> {
    pub(crate) blocks: B::FrontEnd,
    pub(crate) source: B::Source,
    pub(crate) clock: B::Clock,
    pub(crate) caller: B::Caller,
    pub(crate) signals: &'static Signals,
    /// The newest block, written in place: a debugger, or the emulated chip, may look at it.
    pub(crate) block: Option<GapBlock>,
    /// There has been one: blocks that came before anybody could take them are not lost.
    pub(crate) begun: bool,
    pub(crate) reading: Writer<'static, GapReading>,
    pub(crate) settings: Reader<'static, voltage::Active>,
    /// Run of the teach-in that it collects for; 0: none.
    pub(crate) run: u32,
}

impl<B: Board> Gap<B> {
    /// A block is complete.
    #[inline(always)]
    pub fn block(&mut self) {
        let begin = self.clock.now();
        self.blocks.block(&mut self.block);
        self.source.permit(self.signals.permitted.load() != 0);
        let reading = self.source.update(self.block.as_ref());
        self.reading.write(|slot| *slot = reading);
        if self.block.is_some() {
            self.begun = true;
        } else if self.begun {
            self.lost();
        }
        self.signals.short_ticks.store(reading.short_ticks);
        self.signals.touches.store(reading.touches.into());
        let (turn, word) = self.source.slow();
        if let Some(slow) = self.signals.slow.get(turn) {
            slow.store(word);
        }
        // One tick of four: all parts have had their turn within 6 ms.
        if turn % 4 == 0 && !self.source.is_intact() {
            self.signals.settings_damaged.set();
        }
        let run = self.signals.teaching.run();
        if run != 0 || self.source.has_news() {
            self.look(run);
        }
        if self.settings.is_fresh() {
            self.retune();
        }
        let end = self.clock.now();
        self.signals.times[GAP].ran(end.wrapping_sub(begin));
        self.signals.task_watchdog.report(GAP, end);
    }

    /// What makes readings of the blocks.
    pub fn source(&self) -> &B::Source {
        &self.source
    }

    /// There was no block, or more than one.
    #[cold]
    fn lost(&mut self) {
        let lost = &self.signals.lost_blocks;
        lost.store(lost.load().wrapping_add(1));
    }

    /// A teach-in collects pulses, or what was seen of them has changed.
    #[cold]
    fn look(&mut self, run: u32) {
        let teaching = &self.signals.teaching;
        if core::mem::replace(&mut self.run, run) != run {
            self.source.collect(run != 0);
            // One that goes on keeps what it has.
            if run != 0 && teaching.burned().0 != run {
                teaching.begin(run);
            }
        }
        let (levels, shown) = self.source.look();
        teaching.levels.store(levels);
        if let Some(shown) = shown {
            teaching.add(&shown);
        }
    }

    /// Other settings, once the reading is out.
    #[cold]
    fn retune(&mut self) {
        self.settings.refresh();
        self.source.retune(self.settings.get());
        self.settings.accept();
        self.caller.protocol();
    }
}
