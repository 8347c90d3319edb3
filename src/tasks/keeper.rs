//! What is kept in flash.

use edm_hal_shim::stm32f4::flash::SettingsFlash;
use edm_hal_shim::stm32f4::start::StartError;
use edm_hal_shim::stm32f4::watchdog::Watchdog;
use edm_hal_shim::store::{BUFFER, Loaded, Store};
use edm_servo_head::canopen::Abort;
use edm_servo_head::head::Leave;
use edm_servo_head::stored::{Full, Outcome, StoredImage};

/// Keeps what a host stores.
pub struct Keeper {
    store: Store<SettingsFlash, Leave>,
    buffer: &'static mut [u8; BUFFER],
    image: &'static mut StoredImage,
}

impl Keeper {
    /// The keeper of this flash.
    pub fn new(
        flash: SettingsFlash,
        buffer: &'static mut [u8; BUFFER],
        image: &'static mut StoredImage,
    ) -> Result<Keeper, StartError> {
        let store = Store::new(flash, 0).map_err(|_| StartError::Settings)?;
        Ok(Keeper { store, buffer, image })
    }

    /// What was stored last, or what is left of it.
    #[inline(never)]
    pub fn load(&mut self) -> &StoredImage {
        let found = self.store.load(self.buffer).unwrap_or_else(|error| {
            defmt::error!("settings: {}", error);
            Loaded::Damaged
        });
        if self.image.load(found) == Outcome::Nothing {
            defmt::info!("settings: none stored");
        }
        self.image
    }

    /// Does a chore; `compose` changes what is kept. The processor may stall for half a second.
    #[inline(never)]
    pub fn change(
        &mut self,
        leave: &Leave,
        watchdog: &mut Watchdog,
        compose: impl FnOnce(&mut StoredImage) -> Result<(), Full>,
    ) -> Result<(), Abort> {
        self.load();
        compose(self.image).map_err(|_| Abort::OutOfMemory)?;
        watchdog.erase().map_err(|_| Abort::Hardware)?;
        let result = self.store.save(self.image.bytes(), self.buffer, leave);
        // Before anything else: it must not stay slow. Its own oscillator answers, or it is dead and cannot bite anyway.
        let watched = watchdog.normal();
        match &result {
            Ok(()) => defmt::info!("settings: stored"),
            Err(error) => defmt::error!("settings: not stored, {}", error),
        }
        result.map_err(|_| Abort::Hardware).and(watched.map_err(|_| Abort::Hardware))
    }
}
