//! The stage of the next program: sectors 8 to 11. See [`crate::stage`].
//!
//! The flash is one bank. The core stands still while a sector is erased, 1 to 2 s (data sheet), and for 16 us a word, as do the
//! tasks. So this goes to idle alone, which has the permit of the head then, and a patient watchdog.

use super::{Board, lines, self_test};
use crate::stage::{Flash, STAGE, Stage};
use cortex_m::peripheral::SCB;
use edm_boot::chip::Chip;

/// The stage. Who has the settings' sectors has this.
pub struct StageFlash(Chip);

impl StageFlash {
    /// For the task that stores the settings, and no other.
    pub(super) fn new() -> StageFlash {
        // SAFETY: the program ends before the stage. The flash interface is used by this and by the settings' sectors alone,
        // which one task has and uses in turns; the CRC unit only by the self-test, which is over.
        StageFlash(unsafe { Chip::new(STAGE) })
    }
}

impl Flash for StageFlash {
    fn word(&self, address: u32) -> u32 {
        self.0.word(address)
    }

    fn sum(&mut self, from: u32, to: u32) -> u32 {
        self.0.sum(from, to)
    }

    fn erase(&mut self, sector: u32) -> bool {
        self.0.erase(sector)
    }

    fn write(&mut self, address: u32, words: &[u32]) -> bool {
        self.0.write(address, words)
    }
}

impl Stage for StageFlash {
    fn board(&self) -> u32 {
        const { Board::TABLE.chip() }
    }

    fn id(&self) -> u32 {
        self_test::seal().crc
    }

    fn restart(&mut self) {
        lines::kill();
        SCB::sys_reset()
    }
}
