//! The two flash sectors that hold the settings.
//!
//! The flash is one bank: while it is written or erased the core stalls, for 16 us a word and up to half a second a sector
//! (data sheet). So this goes to the settings store alone, which writes only under the permit of the head
//! ([`Permit`](crate::store::Permit)): disabled, inhibited, with a longer watchdog time-out. Not the library's: it waits for a
//! busy flash without a time-out.

use super::pac;
use super::{change, put};
use crate::storage::{ErrorType, MultiwriteNorFlash, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};
use core::sync::atomic::{AtomicBool, Ordering::SeqCst};
use edm_boot::chip::{BUSY, ERRORS, LOCK, PG, POLLS, PSIZE, SER, START};

/// First of the two sectors; memory.x keeps the program out of them.
const FIRST_SECTOR: u32 = 1;
/// A sector, bytes.
const SECTOR: u32 = 16 * 1024;
const BASE: usize = 0x0800_0000 + (FIRST_SECTOR * SECTOR) as usize;
const SIZE: usize = 2 * SECTOR as usize;

/// The caches are being emptied: the supervision, which comes between, does not look at their register then.
static CACHES_CHANGE: AtomicBool = AtomicBool::new(false);

/// Whether FLASH_ACR is what it is to be.
pub fn access_is_settled() -> bool {
    !CACHES_CHANGE.load(SeqCst)
}

/// Why the flash refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, defmt::Format)]
pub enum FlashError {
    /// Beyond the sectors.
    OutOfBounds,
    /// Not on a word or sector.
    NotAligned,
    /// The flash reports an error, with its status.
    Failed(u32),
    /// The flash stays busy.
    Busy,
}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            FlashError::OutOfBounds => NorFlashErrorKind::OutOfBounds,
            FlashError::NotAligned => NorFlashErrorKind::NotAligned,
            _ => NorFlashErrorKind::Other,
        }
    }
}

/// The two sectors.
pub struct SettingsFlash(pac::FLASH);

impl SettingsFlash {
    /// Takes the flash interface, after the clocks have set its wait states.
    pub fn new(flash: pac::FLASH) -> Self {
        SettingsFlash(flash)
    }

    /// Address of `length` bytes at `offset`, both whole multiples of `unit`.
    fn address(offset: u32, length: usize, unit: usize) -> Result<usize, FlashError> {
        let offset = offset as usize;
        if offset > SIZE || length > SIZE - offset {
            return Err(FlashError::OutOfBounds);
        }
        if !offset.is_multiple_of(unit) || !length.is_multiple_of(unit) {
            return Err(FlashError::NotAligned);
        }
        Ok(BASE + offset)
    }

    /// Unlocks, runs, locks.
    fn unlocked(&mut self, run: impl FnOnce(&mut Self) -> Result<(), FlashError>) -> Result<(), FlashError> {
        put!(self.0.keyr(), 0x4567_0123);
        put!(self.0.keyr(), 0xCDEF_89AB);
        put!(self.0.sr(), ERRORS);
        let result = run(self);
        put!(self.0.cr(), LOCK);
        // What was read before may sit in the caches.
        CACHES_CHANGE.store(true, SeqCst);
        change!(self.0.acr(), clear 1 << 9 | 1 << 10, set 0);
        change!(self.0.acr(), clear 0, set 1 << 11 | 1 << 12);
        change!(self.0.acr(), clear 1 << 11 | 1 << 12, set 1 << 9 | 1 << 10);
        CACHES_CHANGE.store(false, SeqCst);
        result
    }

    fn wait(&self) -> Result<(), FlashError> {
        for _ in 0..POLLS {
            let status = self.0.sr().read().bits();
            if status & BUSY == 0 {
                return if status & ERRORS == 0 { Ok(()) } else { Err(FlashError::Failed(status)) };
            }
        }
        Err(FlashError::Busy)
    }
}

impl ErrorType for SettingsFlash {
    type Error = FlashError;
}

impl ReadNorFlash for SettingsFlash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        let address = Self::address(offset, bytes.len(), 1)?;
        for (i, byte) in bytes.iter_mut().enumerate() {
            // SAFETY: inside the two sectors (checked above), which are flash that nothing else refers to.
            *byte = unsafe { core::ptr::with_exposed_provenance::<u8>(address + i).read_volatile() };
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        SIZE
    }
}

impl NorFlash for SettingsFlash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SECTOR as usize;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        let length = to.checked_sub(from).ok_or(FlashError::OutOfBounds)? as usize;
        Self::address(from, length, Self::ERASE_SIZE)?;
        self.unlocked(|flash| {
            for sector in from / SECTOR..to / SECTOR {
                put!(flash.0.cr(), SER | PSIZE | (FIRST_SECTOR + sector) << 3);
                put!(flash.0.cr(), SER | PSIZE | (FIRST_SECTOR + sector) << 3 | START);
                flash.wait()?;
            }
            Ok(())
        })
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        let address = Self::address(offset, bytes.len(), Self::WRITE_SIZE)?;
        self.unlocked(|flash| {
            put!(flash.0.cr(), PG | PSIZE);
            let (words, _) = bytes.as_chunks::<4>();
            for (i, word) in words.iter().enumerate() {
                let to = core::ptr::with_exposed_provenance_mut::<u32>(address + 4 * i);
                // SAFETY: inside the two sectors (checked above), aligned to a word, and unlocked for programming.
                unsafe { to.write_volatile(u32::from_le_bytes(*word)) };
                flash.wait()?;
            }
            Ok(())
        })
    }
}

// A word may be written again with further bits cleared (RM0090 3.6.3).
impl MultiwriteNorFlash for SettingsFlash {}
