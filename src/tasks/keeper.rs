//! What is kept in flash.

use edm_hal_shim::stm32f4::flash::SettingsFlash;
use edm_hal_shim::stm32f4::start::StartError;
use edm_hal_shim::stm32f4::watchdog::Watchdog;
use edm_hal_shim::store::{BUFFER, MAX_IMAGE, Store};
use edm_servo_head::canopen::Abort;
use edm_servo_head::canopen::drive::Kept;
use edm_servo_head::head::Leave;

const _: () = assert!(Kept::LENGTH <= MAX_IMAGE);

/// Keeps what a host stores.
pub struct Keeper {
    store: Store<SettingsFlash, Leave>,
    buffer: &'static mut [u8; BUFFER],
}

impl Keeper {
    /// The keeper of this flash.
    pub fn new(flash: SettingsFlash, buffer: &'static mut [u8; BUFFER]) -> Result<Keeper, StartError> {
        let store = Store::new(flash, 0).map_err(|_| StartError::Settings)?;
        Ok(Keeper { store, buffer })
    }

    /// What was stored last. When it cannot be read the log says so, and nothing is: the defaults run, which no guided check
    /// has passed.
    pub fn load(&mut self) -> Kept {
        match self.store.load(self.buffer) {
            Ok(Some(image)) => Kept::from_bytes(image).unwrap_or_else(|| {
                defmt::error!("settings: the stored ones are of another firmware");
                Kept::NOTHING
            }),
            Ok(None) => {
                defmt::info!("settings: none stored");
                Kept::NOTHING
            }
            Err(error) => {
                defmt::error!("settings: {}", error);
                Kept::NOTHING
            }
        }
    }

    /// Does a chore; `compose` changes what is kept. The processor may stall for half a second.
    pub fn change(
        &mut self,
        leave: &Leave,
        watchdog: &mut Watchdog,
        compose: impl FnOnce(&mut Kept),
    ) -> Result<(), Abort> {
        let mut kept = self.load();
        compose(&mut kept);
        watchdog.erase().map_err(|_| Abort::Hardware)?;
        let result = self.store.save(kept.bytes(), self.buffer, leave);
        // Before anything else: it must not stay slow. Its own oscillator answers, or it is dead and cannot bite anyway.
        let watched = watchdog.normal();
        match &result {
            Ok(()) => defmt::info!("settings: stored"),
            Err(error) => defmt::error!("settings: not stored, {}", error),
        }
        result.map_err(|_| Abort::Hardware).and(watched.map_err(|_| Abort::Hardware))
    }
}
