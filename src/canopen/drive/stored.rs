//! What 1010h stores of the drive: the settings as they store themselves, and behind them the values of the profile that
//! the table marks as stored, in its order.

use super::Drive;
use crate::canopen::objects::{Item, rows};
use crate::settings::{self, SettingError, Settings};

/// Values that are stored.
const STORED: usize = 4 * 64;
/// Length of the image, bytes.
pub const IMAGE: usize = settings::IMAGE_LENGTH + 1 + STORED;
/// Version of the part behind the settings.
const VERSION: u8 = 1;

impl Drive {
    /// What is to be stored, and its length: [`IMAGE`] at the most.
    pub fn image(&self) -> [u8; IMAGE] {
        let mut image = [0; IMAGE];
        let (front, rest) = image.split_at_mut(settings::IMAGE_LENGTH);
        front.copy_from_slice(&self.settings.image());
        if let Some((version, values)) = rest.split_first_mut() {
            *version = VERSION;
            let stored = rows().iter().filter(|row| row.is_stored());
            for (slot, row) in values.chunks_exact_mut(4).zip(stored) {
                slot.copy_from_slice(&self.value(row.item()).to_le_bytes());
            }
        }
        image
    }

    /// Takes over what was stored, whole or not at all.
    pub(super) fn load(&mut self, image: &[u8]) -> Result<(), SettingError> {
        let (front, rest) = image.split_at_checked(settings::IMAGE_LENGTH).unwrap_or((image, &[]));
        let settings = Settings::from_image(front).map_err(|_| SettingError::UnknownKey)?;
        self.adopt(settings)?;
        let Some((&VERSION, values)) = rest.split_first() else { return Ok(()) };
        let stored = rows().iter().filter(|row| row.is_stored());
        for (bytes, row) in values.chunks_exact(4).zip(stored) {
            let value = bytes.try_into().map_or(0, i32::from_le_bytes);
            if row.check(row.widened(value)).is_ok() && row.item() != Item::Mode {
                self.set(row.item(), value);
            }
        }
        Ok(())
    }

    /// Runs other settings, if they fit together.
    pub(super) fn adopt(&mut self, settings: Settings) -> Result<(), SettingError> {
        self.active = settings.build()?;
        self.settings = settings;
        self.configure();
        Ok(())
    }
}
