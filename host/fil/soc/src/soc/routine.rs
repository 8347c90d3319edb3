//! Conversions that nothing takes note of: a timer triggers a converter, whose stream stores the codes. Between two flags of
//! the stream they need no events. They are made when anything else happens, or when a register is read or written: all in one step,
//! each with the code of its own instant.

use super::wires::{ADC_STREAMS, DMA2, slaves};
use super::{Soc, slot};
use crate::adc::{Routine, Trigger};
use crate::dma::Transfer;
use crate::timer::KINDS;
use crate::world::World;

/// See the module.
#[derive(Clone, Copy)]
pub(super) struct Conversions {
    pub(super) timer: usize,
    adc: usize,
    /// Stream and its channel.
    stream: (usize, u32),
    routine: Routine,
    period: u64,
    /// Trigger of the next one, and when it is done.
    trigger: u64,
    done: u64,
    /// How many have been made, and the code of the last.
    made: u64,
    code: u32,
}

impl<W: World> Soc<W> {
    /// From here on a converter that has just ended a conversion may need no events.
    pub(super) fn begin_routine(&mut self, adc: usize) {
        let Some(routine) = self.adcs[adc].routine().filter(|_| self.routine.is_none()) else { return };
        let Trigger::Trgo(number) = routine.source else { return };
        let timer = usize::from(number) - 1;
        let Some(period) = self.timers[timer].routine().filter(|period| routine.done < *period) else { return };
        let controller = &self.dma[DMA2];
        let Some((stream, next)) = ADC_STREAMS[adc].iter().find_map(|&(s, c)| Some(((s, c), controller.next(s, c)?)))
        else {
            return;
        };
        let before = controller.before_flag(stream.0);
        if self.shared(adc, number) || before == 0 || !self.stores(adc, next, before) {
            return;
        }
        let trigger = self.timers[timer].due();
        let done = trigger + routine.done;
        self.routine = Some(Conversions { timer, adc, stream, routine, period, trigger, done, made: 0, code: 0 });
        // The timer triggers again, as an event, when the flag is near.
        self.due[slot::TIMER + timer] = trigger + u64::from(before) * period;
    }

    /// Whether the trigger output of a timer starts anything but a converter.
    fn shared(&self, adc: usize, timer: u8) -> bool {
        let slave = slaves(timer).iter().any(|&(slave, itr)| self.timers[slave - 1].listens(itr));
        slave || (0..3).any(|other| other != adc && self.adcs[other].listens(Trigger::Trgo(timer)))
    }

    /// Whether these items go from the converter's data register into memory.
    fn stores(&self, adc: usize, next: Transfer, items: u32) -> bool {
        let last = next.to.saturating_add(items * next.size as u32);
        let fits = |address| self.memory.sram.load(address, next.size).is_some();
        next.from == 0x4001_204c + 0x100 * adc as u32 && fits(next.to) && fits(last)
    }

    /// Makes the conversions that are done by tick `to`; those at that tick only if they come before `slot`.
    pub(super) fn make_conversions(&mut self, to: u64, slot: usize) {
        let Some(mut c) = self.routine.filter(|c| c.done <= to) else { return };
        while c.done < to || c.done == to && slot > slot::ADC + c.adc {
            let at = c.trigger + c.routine.sampled;
            c.code = u32::from(self.world.sample(c.adc as u8 + 1, c.routine.channel, at)).min(0xfff);
            let (stream, channel) = c.stream;
            if let Some(transfer) = self.dma[DMA2].next(stream, channel) {
                let moved = self.memory.dma_store(transfer.to, transfer.size, c.code).is_some();
                self.dma[DMA2].done(stream, moved);
            }
            c.made += 1;
            (c.trigger, c.done) = (c.trigger + c.period, c.done + c.period);
        }
        self.routine = Some(c);
    }

    /// They are events again, from now on.
    pub(super) fn end_routine(&mut self) {
        let Some(c) = self.routine.take() else { return };
        let running = c.trigger <= self.now;
        // The trigger that each update gives has been taken.
        let mut taken = self.spare.pop().unwrap_or_default();
        self.timers[c.timer].done_routine(c.made + u64::from(running), c.period, &mut taken);
        taken.clear();
        self.spare.push(taken);
        if c.made > 0 {
            self.adcs[c.adc].done_routine(c.code);
        }
        if running {
            self.adcs[c.adc].trigger(c.routine.source, true, c.trigger);
        }
        self.set_due(slot::TIMER + c.timer, self.timers[c.timer].due());
        self.set_due(slot::ADC + c.adc, self.adcs[c.adc].due());
    }

    /// The same if a register of a converter, or of all, is about to be read or written.
    pub(super) fn end_routine_of(&mut self, adc: usize) {
        if self.routine.is_some_and(|c| c.adc == adc || adc >= self.adcs.len()) {
            self.end_routine();
        }
    }

    /// The same if a register of a stream is about to be written.
    pub(super) fn end_routine_by(&mut self, controller: usize, offset: u32) {
        if controller == DMA2 && offset >= 0x10 {
            self.end_routine();
        }
    }

    /// The same if its trigger now starts something else as well.
    pub(super) fn end_shared_routine(&mut self) {
        if self.routine.is_some_and(|c| self.shared(c.adc, KINDS[c.timer].number)) {
            self.end_routine();
        }
    }
}
