//! The fast scope, 2019h: what the servo task records of its own ticks, and the snapshot of the last fault.
//!
//! A host writes what is to be recorded and arms. The order goes to the servo task, and until that has taken it the state reads
//! *waits*. A record and a snapshot are read as a domain each: eight words (mark and version; signals, cause, fault by bytes; numbers of the
//! signals; servo ticks a sample; samples; sample of the trigger; tick of it), then the samples.

use super::Drive;
use crate::canopen::Abort;
use crate::canopen::objects::Item;
use crate::scope::{Kept, Memory, Phase, SIGNALS, Setup, Signal, Trigger};

/// Bits of the phase in the word that the servo task announces.
const PHASE: u32 = 8;

/// See the [module](self).
#[derive(Debug, Default)]
pub(super) struct Fast {
    memory: Option<Memory>,
    /// Newest order, and whether it is still to be handed on.
    setup: Setup,
    ordered: bool,
    /// What the servo task says.
    record: u32,
    kept: Kept,
}

impl Fast {
    /// 2019h:15. Orders that are not taken yet count.
    pub fn phase(&self) -> u32 {
        let taken = self.record >> PHASE == self.setup.serial;
        match (taken, self.setup.on) {
            (true, _) => self.record & ((1 << PHASE) - 1),
            (false, true) => Phase::Waits as u32,
            (false, false) => Phase::Records as u32,
        }
    }

    /// 2019h:17.
    pub fn snapshots(&self) -> u32 {
        self.kept.serial()
    }

    /// Length of a domain, bytes.
    pub fn length(&self, item: Item) -> u32 {
        let Some(memory) = &self.memory else { return 0 };
        match item {
            Item::FastData if self.phase() != Phase::Complete as u32 => 0,
            Item::FastData => memory.record.length(),
            _ => self.kept.bank(memory).map_or(0, |bank| bank.length()),
        }
    }

    /// Bytes of a domain.
    pub fn copy(&self, item: Item, offset: u32, out: &mut [u8]) {
        let Some(memory) = &self.memory else { return };
        match item {
            Item::FastData => memory.record.copy(offset, out),
            _ => {
                if let Some(bank) = self.kept.bank(memory) {
                    bank.copy(offset, out);
                }
            }
        }
    }
}

impl Drive {
    /// The servo task records here.
    pub fn set_scope(&mut self, memory: Memory) {
        self.fast.memory = Some(memory);
    }

    /// Takes what the servo task says of record and last snapshot, once a millisecond.
    pub fn set_recorded(&mut self, record: u32, snapshot: u32) {
        (self.fast.record, self.fast.kept) = (record, Kept::of(snapshot));
    }

    /// What the servo task is to record from now on, once.
    pub fn recording(&mut self) -> Option<Setup> {
        core::mem::take(&mut self.fast.ordered).then_some(self.fast.setup)
    }

    /// 2019h:14.
    pub(super) fn arm_fast(&mut self, on: bool) -> Result<(), Abort> {
        let items = [
            Item::FastSignal1,
            Item::FastSignal2,
            Item::FastSignal3,
            Item::FastSignal4,
            Item::FastSignal5,
            Item::FastSignal6,
            Item::FastSignal7,
            Item::FastSignal8,
        ];
        let mut signals: [Option<Signal>; SIGNALS] = [None; SIGNALS];
        for (signal, item) in signals.iter_mut().zip(items) {
            *signal = Signal::numbered(self.value(item) as u8);
        }
        let width = signals.iter().take_while(|signal| signal.is_some()).count();
        let source = (self.value(Item::FastSource) as u8).saturating_sub(1);
        let trigger = Trigger::numbered(self.value(Item::FastTrigger));
        let compares = matches!(trigger, Trigger::Rises | Trigger::Falls);
        if self.fast.memory.is_none() || on && (width == 0 || compares && usize::from(source) >= width) {
            return Err(Abort::DeviceState);
        }
        self.fast.setup = Setup {
            // What the announced word has room for.
            serial: self.fast.setup.serial.wrapping_add(1) & (u32::MAX >> PHASE),
            on,
            signals,
            every: self.value(Item::FastEvery) as u16,
            trigger,
            source,
            level: self.value(Item::FastLevel),
            before: self.value(Item::FastBefore) as u8,
        };
        self.fast.ordered = true;
        Ok(())
    }
}
