//! A machine at a moment, to continue from it repeatedly.
//!
//! The engine keeps what it has translated, so that going back costs a copy of the memories and no more. What the engine has
//! translated of the flash stays valid as long as all of it is the same.

use super::chip::{Chip, Moment};
use super::{Machine, R, engine};
use anyhow::Result;
use edm_soc::{Region, Soc, World};
use std::sync::atomic::Ordering::Relaxed;
use unicorn_engine::RegisterARM;

/// What an ARMv7-M processor with the main stack alone consists of, in the order in which it is put back: the mode before what
/// depends on it.
const REGISTERS: [RegisterARM; 22] = [
    R::CONTROL,
    R::PRIMASK,
    R::BASEPRI,
    R::FAULTMASK,
    R::XPSR,
    R::IPSR,
    R::FPSCR,
    R::R0,
    R::R1,
    R::R2,
    R::R3,
    R::R4,
    R::R5,
    R::R6,
    R::R7,
    R::R8,
    R::R9,
    R::R10,
    R::R11,
    R::R12,
    R::LR,
    R::SP,
];
/// Single-precision registers of the FPU.
const FLOATS: i32 = 32;

/// The complete state of a machine.
pub struct Snapshot<W: World + 'static> {
    soc: Soc<W>,
    moment: Moment,
    registers: [u32; REGISTERS.len()],
    floats: Vec<u32>,
    pc: u32,
}

fn copy(from: &Region, to: &Region) {
    for (from, to) in from.words().iter().zip(to.words()) {
        to.store(from.load(Relaxed), Relaxed);
    }
}

impl<W: World + Clone + 'static> Machine<W> {
    /// The machine as it is now, between two calls of [`Machine::run_until`].
    ///
    /// # Errors
    /// When the engine refuses.
    pub fn snapshot(&self) -> Result<Snapshot<W>> {
        let mut registers = [0; REGISTERS.len()];
        for (value, register) in registers.iter_mut().zip(REGISTERS) {
            *value = self.get(register)?;
        }
        let floats = (0..FLOATS).map(|i| self.float(i)).collect::<Result<_>>()?;
        let chip = self.uc.get_data();
        Ok(Snapshot { soc: chip.soc.clone(), moment: chip.moment(), registers, floats, pc: self.get(R::PC)? })
    }

    /// Goes back to a moment of this machine.
    ///
    /// # Errors
    /// When the engine refuses.
    pub fn restore(&mut self, snapshot: &Snapshot<W>) -> Result<()> {
        let chip: &mut Chip<W> = self.uc.get_data_mut();
        // The engine has mapped the memories that are there.
        let (kept, memory) = (&snapshot.soc.memory, &chip.soc.memory);
        let words = kept.flash.words().iter().zip(memory.flash.words());
        let same = words.into_iter().all(|(kept, now)| kept.load(Relaxed) == now.load(Relaxed));
        copy(&kept.flash, &memory.flash);
        copy(&kept.sram, &memory.sram);
        copy(&kept.ccm, &memory.ccm);
        let mut soc = snapshot.soc.clone();
        std::mem::swap(&mut soc.memory, &mut chip.soc.memory);
        chip.soc = soc;
        chip.go_on_from(&snapshot.moment);
        if !same {
            chip.forget_code();
        }
        if std::mem::take(&mut chip.code_in_ram) || !same {
            // What was there is not there any more.
            self.uc.ctl_flush_tb().map_err(engine("flush"))?;
            self.uc.ctl_flush_tlb().map_err(engine("flush"))?;
        }
        for (value, register) in snapshot.registers.iter().zip(REGISTERS) {
            self.set(register, *value)?;
        }
        for (i, value) in (0..).zip(&snapshot.floats) {
            self.set_float(i, *value)?;
        }
        self.set(R::PC, snapshot.pc | 1)
    }
}
