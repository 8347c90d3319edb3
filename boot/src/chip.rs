//! Flash and CRC unit of an STM32F405/407 (RM0090 sections 3 and 4), for the boot loader and, limited to the stage, for the
//! program.

use crate::{FLASH_END, Flash, PROGRAM};
use core::ptr::{with_exposed_provenance, with_exposed_provenance_mut};

/// Registers of the flash interface.
const ACR: usize = 0x4002_3C00;
const KEYR: usize = 0x4002_3C04;
const SR: usize = 0x4002_3C0C;
const CR: usize = 0x4002_3C10;
/// Registers of the CRC unit, and its clock gate in RCC.
const CRC_DR: usize = 0x4002_3000;
const CRC_CR: usize = 0x4002_3008;
const AHB1ENR: usize = 0x4002_3830;
const CRC_CLOCK: u32 = 1 << 12;

/// FLASH_CR and FLASH_SR (RM0090 3.9): programming.
pub const PG: u32 = 1;
/// Erase of a sector.
pub const SER: u32 = 1 << 1;
/// Words of 32 bits.
pub const PSIZE: u32 = 0b10 << 8;
/// Start of an erase.
pub const START: u32 = 1 << 16;
/// The registers are locked.
pub const LOCK: u32 = 1 << 31;
/// Alignment, parallelism, sequence, protection, operation.
pub const ERRORS: u32 = 0xF2;
/// Erasing or programming.
pub const BUSY: u32 = 1 << 16;
/// Data cache: enabled, and reset.
const CACHE: u32 = 1 << 10;
const CACHE_RESET: u32 = 1 << 12;
/// Polls of a busy flash: each stalls until it answers, so that even an erase takes few.
pub const POLLS: u32 = 1 << 24;

fn get(address: usize) -> u32 {
    // SAFETY: a register of this module, or a word of the flash: always there, and reading it changes nothing.
    unsafe { with_exposed_provenance::<u32>(address).read_volatile() }
}

fn put(address: usize, value: u32) {
    // SAFETY: a register of this module, which belongs to whoever made the [`Chip`], or a word of the flash that was checked
    // to be in its range: nothing refers to what it holds.
    unsafe { with_exposed_provenance_mut::<u32>(address).write_volatile(value) }
}

/// The flash from one address on.
pub struct Chip {
    from: u32,
}

impl Chip {
    /// The flash from `from` on, PROGRAM or later, for erasing and writing; all of it for reading.
    ///
    /// # Safety
    /// Flash interface and CRC unit are used by nobody else while a method runs, and nothing that is erased or written is code or
    /// a constant that the caller, or what interrupts it, uses.
    pub const unsafe fn new(from: u32) -> Chip {
        Chip { from: if from < PROGRAM { PROGRAM } else { from } }
    }

    fn unlocked(run: impl FnOnce() -> bool) -> bool {
        put(KEYR, 0x4567_0123);
        put(KEYR, 0xCDEF_89AB);
        put(SR, ERRORS);
        let done = run();
        put(CR, LOCK);
        done
    }

    fn wait() -> bool {
        for _ in 0..POLLS {
            let status = get(SR);
            if status & BUSY == 0 {
                return status & ERRORS == 0;
            }
        }
        false
    }

    /// Forgets what was read before it was erased or written.
    fn fresh() {
        let control = get(ACR);
        if control & CACHE != 0 {
            put(ACR, control & !CACHE);
            put(ACR, control & !CACHE | CACHE_RESET);
            put(ACR, control);
        }
    }
}

impl Flash for Chip {
    fn word(&self, address: u32) -> u32 {
        get(address as usize & !3)
    }

    fn sum(&mut self, from: u32, to: u32) -> u32 {
        Self::fresh();
        put(AHB1ENR, get(AHB1ENR) | CRC_CLOCK);
        put(CRC_CR, 1);
        for address in (from..to).step_by(4) {
            put(CRC_DR, self.word(address));
        }
        get(CRC_DR)
    }

    fn erase(&mut self, sector: u32) -> bool {
        let first = match sector {
            3 => PROGRAM,
            4 => 0x0801_0000,
            5..=11 => 0x0802_0000 + (sector - 5) * 0x2_0000,
            _ => return false,
        };
        if first < self.from {
            return false;
        }
        let done = Self::unlocked(|| {
            put(CR, SER | PSIZE | sector << 3);
            put(CR, SER | PSIZE | sector << 3 | START);
            Self::wait()
        });
        Self::fresh();
        done
    }

    fn write(&mut self, address: u32, words: &[u32]) -> bool {
        let end = address.saturating_add(4 * words.len() as u32);
        if !address.is_multiple_of(4) || address < self.from || end > FLASH_END {
            return false;
        }
        Self::unlocked(|| {
            put(CR, PG | PSIZE);
            (address..).step_by(4).zip(words).filter(|(_, word)| **word != u32::MAX).all(|(address, word)| {
                put(address as usize, *word);
                Self::wait()
            })
        })
    }
}
