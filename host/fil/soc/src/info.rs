//! Read-only identity of the chip: unique id, flash size, factory calibration, debug id.

/// What the factory wrote. RM0090 §39 (unique id, flash size), DS8626 §5.3.21..24 (calibration addresses), §38.6.1 (IDCODE).
pub fn system_memory(address: u32) -> Option<u32> {
    Some(match address & !3 {
        0x1fff_7a10 => 0x0032_0047,
        0x1fff_7a14 => 0x3436_5102,
        0x1fff_7a18 => 0x3730_3934,
        // Flash size in KiB in the upper half of the word at ...20 (address ...22); the lower half is not defined.
        0x1fff_7a20 => 1024 << 16 | 0xffff,
        // VREFINT_CAL at ...2A: 1.21 V at 3.3 V supply is 1502 of 4095; the lower half of the word is not defined.
        0x1fff_7a28 => 1502 << 16 | 0xffff,
        // TS_CAL1 (30 degrees, 0.76 V) and TS_CAL2 (110 degrees, 0.96 V).
        0x1fff_7a2c => 1191 << 16 | 943,
        _ => return None,
    })
}

/// DBGMCU (RM0090 §38.16): IDCODE of device 0x413, revision Y; of the freeze registers only the bit of the independent watchdog
/// acts.
#[derive(Clone, Default)]
pub struct Dbgmcu {
    control: [u32; 3],
}

impl Dbgmcu {
    /// The independent watchdog stops while the core is halted: DBG_IWDG_STOP.
    pub fn freezes_watchdog(&self) -> bool {
        self.control[1] >> 12 & 1 == 1
    }

    /// Reads the register at `offset`.
    pub fn read(&self, offset: u32) -> Option<u32> {
        match offset {
            0 => Some(0x100f_6413),
            4 | 8 | 12 => self.control.get(offset as usize / 4 - 1).copied(),
            _ => None,
        }
    }

    /// Writes the register at `offset`.
    pub fn write(&mut self, offset: u32, value: u32) -> Option<()> {
        let slot = self.control.get_mut((offset as usize / 4).checked_sub(1)?)?;
        *slot = value;
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flash_size_and_device_id_are_those_of_an_f405xg() {
        assert_eq!(system_memory(0x1fff_7a22).map(|w| w >> 16), Some(1024));
        assert_eq!(Dbgmcu::default().read(0).map(|v| v & 0xfff), Some(0x413));
        assert_eq!(system_memory(0x1fff_7a40), None);
    }
}
