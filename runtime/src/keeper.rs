//! What is kept when the power is cut.

use crate::board::{Board, Caller};
use crate::note::Note;
use edm_hal_shim::store::{BUFFER, MAX_IMAGE, Storage};
use edm_hal_shim::watchdog::Watchdog;
use edm_servo_head::canopen::Abort;
use edm_servo_head::canopen::drive::Kept;
use edm_servo_head::head::Leave;

const _: () = assert!(Kept::LENGTH <= MAX_IMAGE);

/// Keeps what a host stores.
pub struct Keeper<B: Board> {
    storage: B::Storage,
    buffer: &'static mut [u8; BUFFER],
    caller: B::Caller,
}

impl<B: Board> Keeper<B> {
    /// The keeper of this storage.
    pub fn new(storage: B::Storage, buffer: &'static mut [u8; BUFFER], caller: B::Caller) -> Keeper<B> {
        Keeper { storage, buffer, caller }
    }

    /// What was stored last. When it cannot be read the log says so, and nothing is: the defaults run, which no guided check
    /// has passed.
    pub fn load(&mut self) -> Kept {
        let (kept, note) = match self.storage.load(self.buffer) {
            Ok(Some(image)) => match Kept::from_bytes(image) {
                Some(kept) => return kept,
                None => (Kept::NOTHING, Note::StoreForeign),
            },
            Ok(None) => (Kept::NOTHING, Note::NothingStored),
            Err(_) => (Kept::NOTHING, Note::StoreUnreadable),
        };
        self.caller.note(&note);
        kept
    }

    /// Does a storage job; `compose` changes what is kept. The processor may stall for half a second.
    ///
    /// # Errors
    /// [`Abort::Hardware`]: nothing was stored; what was before is still there.
    pub fn change(
        &mut self,
        leave: &Leave,
        watchdog: &mut B::Watchdog,
        compose: impl FnOnce(&mut Kept),
    ) -> Result<(), Abort> {
        let mut kept = self.load();
        compose(&mut kept);
        watchdog.erase().map_err(|_| Abort::Hardware)?;
        let result = self.storage.save(kept.bytes(), self.buffer, leave);
        // Before anything else: it must not stay slow. Its own oscillator answers, or it is dead and cannot bite anyway.
        let watched = watchdog.normal();
        self.caller.note(if result.is_ok() { &Note::Stored } else { &Note::NotStored });
        result.map_err(|_| Abort::Hardware).and(watched.map_err(|_| Abort::Hardware))
    }
}
