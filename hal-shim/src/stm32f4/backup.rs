//! The backup SRAM: 4 KiB on VBAT, which keep their words over a reset and a power cut (RM0090 5.1.2, 5.1.3).
//!
//! Without its regulator (BRE) the words would go with VDD; without DBP a write has no effect. Nobody waits for the regulator: until it is
//! ready the words are those of a memory that VDD supplies.

use super::{change, pac};
use crate::backup::{BackupMemory, WORDS};

/// Where it is (RM0090 table 1).
const BASE: *mut u32 = 0x4002_4000 as *mut u32;
/// Clock gates of the power controller (RM0090 7.3.13) and of the memory (7.3.10).
const PWR: u32 = 1 << 28;
const BKPSRAMEN: u32 = 1 << 18;
/// Writes to the backup domain are allowed (RM0090 5.4.1).
const DBP: u32 = 1 << 8;
/// The regulator of the memory is on (RM0090 5.4.2).
const BRE: u32 = 1 << 9;

/// The memory.
pub struct BackupSram(());

impl BackupSram {
    /// Opens it, and keeps it supplied.
    pub fn start(pwr: &pac::PWR, rcc: &pac::RCC) -> BackupSram {
        change!(rcc.apb1enr(), clear 0, set PWR);
        change!(pwr.cr(), clear 0, set DBP);
        change!(pwr.csr(), clear 0, set BRE);
        change!(rcc.ahb1enr(), clear 0, set BKPSRAMEN);
        BackupSram(())
    }
}

impl BackupMemory for BackupSram {
    fn read(&self, place: usize) -> u32 {
        if place >= WORDS {
            return 0;
        }
        // SAFETY: the memory is clocked and has so many words.
        unsafe { BASE.add(place).read_volatile() }
    }

    fn write(&mut self, place: usize, word: u32) {
        if place < WORDS {
            // SAFETY: as above; nobody else has it.
            unsafe { BASE.add(place).write_volatile(word) };
        }
    }
}
