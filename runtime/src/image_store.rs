//! What is stored when the power is cut.

use crate::board::{Board, Caller};
use crate::note::Note;
use edm_hal_shim::store::{BUFFER, Loaded, Storage};
use edm_hal_shim::watchdog::Watchdog;
use edm_servo_head::canopen::Abort;
use edm_servo_head::head::WritePermit;
use edm_servo_head::stored::{Full, Outcome, StoredImage};

/// Keeps what a host stores.
pub struct ImageStore<B: Board> {
    storage: B::Storage,
    buffer: &'static mut [u8; BUFFER],
    image: &'static mut StoredImage,
    caller: B::Caller,
}

impl<B: Board> ImageStore<B> {
    /// The image_store of this storage; buffer and image are where it works.
    pub fn new(
        storage: B::Storage,
        buffer: &'static mut [u8; BUFFER],
        image: &'static mut StoredImage,
        caller: B::Caller,
    ) -> ImageStore<B> {
        ImageStore { storage, buffer, image, caller }
    }

    /// What was stored last, or what is left of it.
    pub fn load(&mut self) -> &StoredImage {
        let found = match self.storage.load(self.buffer) {
            Ok(found) => found,
            Err(_) => {
                self.caller.note(&Note::StoreUnreadable);
                Loaded::Damaged
            }
        };
        if self.image.load(found) == Outcome::Nothing {
            self.caller.note(&Note::NothingStored);
        }
        self.image
    }

    /// The same for a head that runs: reading takes some milliseconds, in which nothing feeds the watchdog, and the closest
    /// watch allows eleven.
    pub fn load_watched(&mut self, watchdog: &mut B::Watchdog) -> &StoredImage {
        let patient = watchdog.erase();
        self.load();
        if patient.and(watchdog.normal()).is_err() {
            self.caller.note(&Note::WatchdogStuck);
        }
        self.image
    }

    /// Does a storage job; `compose` changes what is stored. The processor may stall for half a second.
    ///
    /// # Errors
    /// [`Abort::Hardware`], [`Abort::OutOfMemory`]: nothing was stored; what was before is still there.
    pub fn change(
        &mut self,
        permit: &WritePermit,
        watchdog: &mut B::Watchdog,
        compose: impl FnOnce(&mut StoredImage) -> Result<(), Full>,
    ) -> Result<(), Abort> {
        self.load();
        compose(self.image).map_err(|_| Abort::OutOfMemory)?;
        watchdog.erase().map_err(|_| Abort::Hardware)?;
        let result = self.storage.save(self.image.bytes(), self.buffer, permit);
        // Before anything else: it must not stay slow. Its own oscillator answers, or it is dead and cannot bite anyway.
        let watched = watchdog.normal();
        self.caller.note(if result.is_ok() { &Note::Stored } else { &Note::NotStored });
        result.map_err(|_| Abort::Hardware).and(watched.map_err(|_| Abort::Hardware))
    }
}
