//! The settings in flash.

use edm_hal_shim::stm32f4::flash::{FlashError, SettingsFlash};
use edm_hal_shim::stm32f4::start::StartError;
use edm_hal_shim::stm32f4::watchdog::Watchdog;
use edm_hal_shim::store::{BUFFER, Store, StoreError};
use edm_servo_head::head::Leave;
use edm_servo_head::settings::{Active, Settings};

/// Keeps the settings.
pub struct Keeper {
    store: Store<SettingsFlash, Leave>,
    buffer: &'static mut [u8; BUFFER],
    settings: Settings,
}

impl Keeper {
    /// Loads what was stored last. None there, refused or at odds with itself: the log says so, and the defaults run, which no
    /// guided check has passed.
    pub fn load(flash: SettingsFlash, buffer: &'static mut [u8; BUFFER]) -> Result<(Keeper, Active), StartError> {
        let mut store = Store::new(flash, 0).map_err(|_| StartError::Settings)?;
        let stored = match store.load(buffer) {
            Ok(Some(image)) => Settings::from_image(image)
                .map_err(|error| defmt::error!("settings: the stored ones are refused, {}", error))
                .ok(),
            Ok(None) => {
                defmt::info!("settings: none stored");
                None
            }
            Err(error) => {
                defmt::error!("settings: {}", error);
                None
            }
        };
        let built = stored.and_then(|settings| match settings.build() {
            Ok(active) => Some((settings, active)),
            Err(error) => {
                defmt::error!("settings: the stored ones are refused, {}", error);
                None
            }
        });
        let (settings, active) = match built {
            Some(both) => {
                defmt::info!("settings: the stored ones");
                both
            }
            None => {
                defmt::warn!("settings: defaults");
                let settings = Settings::default();
                (settings, settings.build().map_err(|_| StartError::Settings)?)
            }
        };
        Ok((Keeper { store, buffer, settings }, active))
    }

    /// Stores the settings with the result of the guided check. The processor may stall for half a second.
    pub fn save(&mut self, leave: &Leave, watchdog: &mut Watchdog) -> Result<(), StoreError<FlashError>> {
        self.settings.commissioned = leave.commissioned();
        watchdog.erase().map_err(|_| StoreError::Refused)?;
        let result = self.store.save(&self.settings.image(), self.buffer, leave);
        // Before anything else: it must not stay slow. Its own oscillator answers, or it is dead and cannot bite anyway.
        watchdog.normal().map_err(|_| StoreError::Defect).and(result)
    }
}
