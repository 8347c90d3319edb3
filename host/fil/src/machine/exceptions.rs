//! Exception entry and return (ARMv7-M B1.5.6..8), faults (B1.5.14), lazy saving of the FPU context (B1.5.7).
//!
//! Only the main stack is modelled: thread mode on the process stack is refused.

use super::chip::Chip;
use super::{Machine, R};
use anyhow::{Result, bail};
use edm_soc::{Exception, Masks, World, exception};
use unicorn_engine::Unicorn;

/// Registers of the basic frame, in its order; xPSR follows.
const BASIC: [R; 7] = [R::R0, R::R1, R::R2, R::R3, R::R12, R::LR, R::PC];
/// Bytes of the frames without and with FPU registers.
const FRAME: u32 = 0x20;
const FLOAT_FRAME: u32 = 0x68;
/// Cycles of entry, return and tail-chaining (DDI 0439 section 3.9), and of saving or restoring the FPU registers.
const ENTRY: u64 = 12;
const RETURN: u64 = 10;
const TAIL: u64 = 6;
const FLOAT: u64 = 17;

impl<W: World> Machine<W> {
    /// The exception that is being handled.
    fn running(&mut self) -> Option<Exception> {
        self.uc.get_data_mut().soc.nvic().nesting().last().copied()
    }

    fn push(&mut self, address: u32, words: &[u32]) -> Result<()> {
        let memory = &self.uc.get_data().soc.memory;
        for (i, w) in words.iter().enumerate() {
            let at = address + 4 * i as u32;
            if memory.sram.store(at, 4, *w).or_else(|| memory.ccm.store(at, 4, *w)).is_none() {
                bail!("stack pointer left the RAM: no memory at {at:#010x} for an exception frame");
            }
        }
        Ok(())
    }

    /// Enters exception `e`.
    pub(super) fn enter(&mut self, e: Exception) -> Result<()> {
        if self.get(R::CONTROL)? & 3 != 0 {
            bail!("thread mode on the process stack or without privilege is not modelled");
        }
        let extended = self.uc.get_data().fpca;
        let size = if extended { FLOAT_FRAME } else { FRAME };
        let sp = self.get(R::SP)?;
        let frame = (sp - size) & !7;
        let mut xpsr = self.get(R::XPSR)? & !(0x1ff | 1 << 9) | 1 << 24;
        xpsr |= u32::from(self.running().unwrap_or(0)) | u32::from(sp & 4 != 0) << 9;
        let mut words = [0; 8];
        for (w, r) in words.iter_mut().zip(BASIC) {
            *w = self.get(r)?;
        }
        // The engine shows PC with its Thumb bit; the frame has it clear.
        words[6] &= !1;
        words[7] = xpsr;
        // A frame that the MPU refuses is lost, and the fault comes first; that of HardFault is lost with it (B1.5.11).
        let lost = self.refuses(frame, FRAME);
        let e = if lost { self.stacking_fault(e)? } else { e };
        if !lost {
            self.push(frame, &words)?;
        }
        let thread = self.running().is_none();
        let lr = 0xffff_ffe1 | u32::from(!extended) << 4 | u32::from(thread) << 3;
        self.set(R::SP, frame)?;
        let chip = self.uc.get_data_mut();
        chip.spend(ENTRY);
        if extended {
            chip.fpca = false;
            chip.lazy = Some(frame + FRAME);
            if chip.soc.core().fpccr >> 30 & 1 == 0 {
                chip.spend_float(FLOAT);
                save_float(&mut self.uc);
            }
        }
        self.take(e, lr)
    }

    /// A fault of the MPU where the frame of exception `e` was to be: what is entered instead.
    fn stacking_fault(&mut self, e: Exception) -> Result<Exception> {
        let core = self.uc.get_data_mut().soc.core();
        core.cfsr |= 1 << 4;
        if core.nvic.enables(exception::MEM_MANAGE) {
            bail!("a handler of its own for a fault of the MPU while an exception is entered is not modelled");
        }
        if e <= exception::HARD_FAULT {
            return Ok(e);
        }
        core.hfsr |= 1 << 30;
        core.nvic.pend(exception::HARD_FAULT);
        Ok(exception::HARD_FAULT)
    }

    /// Starts the handler of `e`; the frame is on the stack.
    fn take(&mut self, e: Exception, lr: u32) -> Result<()> {
        let chip = self.uc.get_data_mut();
        chip.soc.nvic().enter(e);
        chip.record_entry(e);
        chip.thread = false;
        chip.stats.entries[usize::from(e)] += 1;
        chip.stats.nesting = chip.stats.nesting.max(chip.soc.nvic().nesting().len());
        let vtor = chip.soc.core().vtor;
        let handler = self.load(vtor + 4 * u32::from(e))?;
        if handler & 1 == 0 {
            bail!("vector of exception {e} is {handler:#010x}, no Thumb address");
        }
        let xpsr = self.get(R::XPSR)?;
        self.set(R::XPSR, xpsr & 0xf80f_0000 | 1 << 24 | u32::from(e))?;
        self.set(R::IPSR, e.into())?;
        self.set(R::LR, lr)?;
        self.set(R::PC, handler)?;
        self.uc.get_data_mut().jump(handler);
        Ok(())
    }

    /// The handler has branched to an EXC_RETURN value.
    pub(super) fn leave(&mut self) -> Result<()> {
        let exc_return = self.get(R::PC)? | 1;
        let Some(e) = self.running() else {
            bail!("branch to {exc_return:#010x} in thread mode: INVPC");
        };
        let thread = self.uc.get_data_mut().soc.nvic().nesting().len() == 1;
        let expected = if thread { 0x9 } else { 0x1 };
        if exc_return & 0xf != expected || exc_return & 0xffff_ffe0 != 0xffff_ffe0 {
            bail!("EXC_RETURN {exc_return:#010x} from exception {e} is invalid here");
        }
        if e != exception::NMI {
            self.set(R::FAULTMASK, 0)?;
            self.uc.get_data_mut().masks.iter_mut().for_each(|masks| masks.faultmask = false);
        }
        let masks = self.masks()?;
        let chip = self.uc.get_data_mut();
        chip.soc.nvic().exit(e);
        chip.fpca = false;
        if let Some(next) = chip.due_exception(masks) {
            chip.spend(TAIL);
            chip.stats.tail_chained += 1;
            chip.record_exit();
            return self.take(next, exc_return);
        }
        self.unstack(exc_return)
    }

    fn unstack(&mut self, exc_return: u32) -> Result<()> {
        let extended = exc_return & 0x10 == 0;
        let frame = self.get(R::SP)?;
        let mut words = [0; 8];
        for (i, w) in words.iter_mut().enumerate() {
            *w = self.load(frame + 4 * i as u32)?;
        }
        for (r, w) in BASIC.into_iter().zip(words).take(6) {
            self.set(r, w)?;
        }
        self.uc.get_data_mut().spend(RETURN);
        if extended {
            // Registers nobody has touched were never saved and need no restoring.
            if self.uc.get_data_mut().lazy.take().is_none() {
                self.uc.get_data_mut().spend_float(FLOAT);
                for i in 0..16 {
                    let value = self.load(frame + FRAME + 4 * i)?;
                    self.set_float(i as i32, value)?;
                }
                let fpscr = self.load(frame + FRAME + 64)?;
                self.set(R::FPSCR, fpscr)?;
            }
        }
        let (pc, xpsr) = (words[6], words[7]);
        let size = if extended { FLOAT_FRAME } else { FRAME };
        self.set(R::XPSR, xpsr)?;
        self.set(R::IPSR, xpsr & 0x1ff)?;
        self.set(R::SP, frame + size + if xpsr & 1 << 9 != 0 { 4 } else { 0 })?;
        self.set(R::PC, pc | 1)?;
        let chip = self.uc.get_data_mut();
        chip.record_exit();
        chip.fpca = extended;
        chip.thread = chip.soc.nvic().nesting().is_empty();
        chip.jump(pc);
        // SLEEPONEXIT: back to sleep when thread mode is reached.
        chip.sleeping = chip.soc.nvic().nesting().is_empty() && chip.soc.core().scr & 2 != 0;
        Ok(())
    }

    /// A fault of kind `e` with `status` in CFSR; becomes a HardFault when its handler is not enabled or may not run.
    pub(super) fn fault(&mut self, e: Exception, status: u32, address: Option<u32>) -> Result<()> {
        let masks = self.masks()?;
        let core = self.uc.get_data_mut().soc.core();
        core.cfsr |= status;
        match address {
            Some(a) if e == exception::MEM_MANAGE => core.mmfar = a,
            Some(a) => core.bfar = a,
            None => (),
        }
        core.nvic.pend(e);
        if core.nvic.preempting(masks) == Some(e) {
            return self.enter_fault(e);
        }
        core.nvic.unpend(1 << e);
        core.hfsr |= 1 << 30;
        self.enter_fault(exception::HARD_FAULT)
    }

    pub(super) fn enter_fault(&mut self, e: Exception) -> Result<()> {
        let masks = self.masks()?;
        let core = self.uc.get_data_mut().soc.core();
        if e == exception::HARD_FAULT && core.nvic.execution_priority(Masks { primask: false, basepri: 0, ..masks }) < 0
        {
            let (cfsr, hfsr, bfar) = (core.cfsr, core.hfsr, core.bfar);
            let pc = self.get(R::PC)?;
            bail!("lock-up at {pc:#010x}: fault in a fault handler, CFSR {cfsr:#x}, HFSR {hfsr:#x}, BFAR {bfar:#x}");
        }
        core.nvic.pend(e);
        self.enter(e)
    }
}

/// Saves the FPU registers into the space reserved for them.
fn save_float<W: World>(uc: &mut Unicorn<Chip<W>>) {
    let Some(at) = uc.get_data_mut().lazy.take() else { return };
    for i in 0..17u32 {
        let value = if i < 16 { uc.reg_read(R::S0 as i32 + i as i32) } else { uc.reg_read(R::FPSCR) };
        let memory = &uc.get_data().soc.memory;
        let (value, place) = (value.unwrap_or(0) as u32, at + 4 * i);
        // The frame was checked when it was reserved, up to its start; RAM has no holes below the stack pointer.
        let _ = memory.sram.store(place, 4, value).or_else(|| memory.ccm.store(place, 4, value));
    }
}

/// First FPU instruction since the exception entry: saves what is still in the registers, starts a context of its own.
pub(super) fn new_float_context<W: World>(uc: &mut Unicorn<Chip<W>>) {
    if uc.get_data().lazy.is_some() {
        uc.get_data_mut().spend_float(FLOAT);
        save_float(uc);
    }
    let core = uc.get_data_mut().soc.core();
    // ASPEN: hardware keeps track of the context.
    if core.fpccr >> 31 == 1 {
        let fpdscr = core.fpdscr;
        let _ = uc.reg_write(R::FPSCR, fpdscr.into());
        uc.get_data_mut().fpca = true;
    }
}
