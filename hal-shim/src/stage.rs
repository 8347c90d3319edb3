//! Where the next program is staged, and what is known of the one that runs.

pub use edm_boot::{DONE, FLASH_END, Flash, Header, READY, STAGE, STAGE_SECTORS, Wrong, clear, mark, staged};

/// The upper half of the flash, seen from the program that runs. Nothing outside of it is erased or written.
pub trait Stage: Flash {
    /// Number of the board's chip, such as 405: for which board an update has to be.
    fn board(&self) -> u32;

    /// By which the program that runs is known: the sum in its seal.
    fn id(&self) -> u32;

    /// Lets the boot loader have what is marked. On a chip this does not return; elsewhere the node begins anew.
    fn restart(&mut self);
}
