//! Settings in the flash of a board, as its own firmware would have stored them: written by the store that the firmware
//! reads them with.

use anyhow::{Result, anyhow};
use edm_hal_shim::storage::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use edm_hal_shim::store::{BUFFER, Permit, Store};
use edm_servo_head::canopen::drive::{BLANK, DEVICE, Drive, Identity};
use edm_servo_head::canopen::{BusSettings, Group, Node, NodeId};
use edm_servo_head::settings::Settings;
use edm_servo_head::stored::StoredImage;
use edm_soc::Region;

/// Sectors 1 and 2 (RM0090 table 5), which memory.x keeps free for the settings.
pub const BASE: u32 = 0x0800_4000;
const SECTOR: usize = 16 * 1024;
/// Bytes of both.
pub const LENGTH: usize = 2 * SECTOR;

/// A board that is not running.
struct Off;

impl Permit for Off {
    fn holds(&self) -> bool {
        true
    }
}

struct Sectors<'a>(&'a Region);

impl Sectors<'_> {
    fn write_bytes(&self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        self.0.fill(BASE + offset, bytes).ok_or(NorFlashErrorKind::OutOfBounds)
    }
}

impl ErrorType for Sectors<'_> {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Sectors<'_> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        for (address, byte) in (BASE + offset..).zip(bytes) {
            *byte = self.0.load(address, 1).ok_or(NorFlashErrorKind::OutOfBounds)? as u8;
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        LENGTH
    }
}

impl NorFlash for Sectors<'_> {
    // The unit of the firmware's driver: it decides how records are padded.
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        self.write_bytes(from, &vec![0xff; (to - from) as usize])
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        self.write_bytes(offset, bytes)
    }
}

/// What a host has stored with 1010h:3 on a head with these settings, which was given this node-ID, if any, by layer setting.
fn image(settings: &Settings, id: Option<NodeId>) -> Result<StoredImage> {
    let record = Box::leak(Box::new(BLANK));
    let drive = Drive::new(*settings, Identity::default(), record).map_err(|e| anyhow!("settings: {e}"))?;
    let node = Node::new(&DEVICE, BusSettings::at_1_mbit(id), 0);
    let mut image = StoredImage::NOTHING;
    for group in [Group::Application, Group::Bus] {
        image.keep(group, &drive, &node).map_err(|_| anyhow!("settings: no room"))?;
    }
    Ok(image)
}

/// Stores settings in a flash, for a head that is node 1.
///
/// # Errors
/// When the store fails.
pub fn commission(flash: &Region, settings: &Settings) -> Result<()> {
    commission_as(flash, settings, Some(NodeId::FIRST))
}

/// The same for a head with another node-ID, or one that waits for it.
///
/// # Errors
/// When the store fails.
pub fn commission_as(flash: &Region, settings: &Settings, id: Option<NodeId>) -> Result<()> {
    let failed = |e| anyhow!("settings: {e}");
    let mut store = Store::<_, Off>::new(Sectors(flash), 0).map_err(failed)?;
    store.save(image(settings, id)?.bytes(), &mut [0; BUFFER], &Off).map_err(failed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use edm_servo_head::stored::Outcome;
    use edm_soc::Memory;

    #[test]
    fn what_was_stored_is_what_a_firmware_loads() {
        let memory = Memory::new();
        let settings = Settings { commissioned: true, gap_setpoint: 51.0, ..Settings::default() };
        commission(&memory.flash, &settings).unwrap();
        let mut store = Store::<_, Off>::new(Sectors(&memory.flash), 0).unwrap();
        let mut buffer = [0; BUFFER];
        let mut image = StoredImage::NOTHING;
        assert_eq!(image.load(store.load(&mut buffer).unwrap()), Outcome::Newest);
        assert_eq!(image.communication().count(), 0);
        let record = Box::leak(Box::new(BLANK));
        let mut drive = Drive::new(Settings::default(), Identity::default(), record).unwrap();
        assert!(drive.restart(Settings::default(), &image).is_whole());
        assert_eq!(*drive.settings(), settings);
    }
}
