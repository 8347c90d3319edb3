//! Digital-to-analogue converter without trigger or wave generation (RM0090 §14).

use crate::error::Fault;

#[derive(Clone, Default)]
pub struct Dac {
    cr: u32,
    hold: [u16; 2],
}

impl Dac {
    /// Code put out by channel 1 or 2 (index 0, 1); zero while the channel is off.
    pub fn code(&self, channel: usize) -> u16 {
        if self.cr >> (16 * channel) & 1 == 1 { self.hold[channel] } else { 0 }
    }

    pub fn read(&self, offset: u32) -> Result<u32, Fault> {
        Ok(match offset {
            0x00 => self.cr,
            0x08 => self.hold[0].into(),
            0x14 => self.hold[1].into(),
            0x2c => self.hold[0].into(),
            0x30 => self.hold[1].into(),
            _ => return Err(Fault::Unmodelled),
        })
    }

    pub fn write(&mut self, offset: u32, value: u32) -> Result<(), Fault> {
        let code = (value & 0xfff) as u16;
        match offset {
            0x00 if value & 0x3ffc_3ffc != 0 => {
                return Err(Fault::Unsupported("DAC trigger, waves and DMA are not modelled"));
            }
            0x00 => self.cr = value,
            0x08 => self.hold[0] = code,
            0x14 => self.hold[1] = code,
            _ => return Err(Fault::Unmodelled),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_channel_puts_out_its_code_only_while_enabled() {
        let mut d = Dac::default();
        d.write(0x08, 0x1fff).unwrap();
        assert_eq!(d.code(0), 0);
        d.write(0x00, 1).unwrap();
        assert_eq!((d.code(0), d.code(1)), (0xfff, 0));
    }
}
