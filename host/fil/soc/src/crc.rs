//! CRC calculation unit (RM0090 §4): words, most significant bit first. A word is taken as done at once; the chip holds up the
//! bus for its four cycles.

use crate::error::Fault;

const POLYNOMIAL: u32 = 0x04c1_1db7;

#[derive(Clone)]
pub struct Crc {
    data: u32,
    independent: u8,
}

impl Crc {
    pub fn new() -> Self {
        Self { data: u32::MAX, independent: 0 }
    }

    pub fn read(&self, offset: u32) -> Result<u32, Fault> {
        Ok(match offset {
            0x00 => self.data,
            0x04 => self.independent.into(),
            0x08 => 0,
            _ => return Err(Fault::Unmodelled),
        })
    }

    pub fn write(&mut self, offset: u32, value: u32) -> Result<(), Fault> {
        match offset {
            0x00 => {
                self.data = (0..32).fold(self.data ^ value, |sum, _| {
                    let carry = if sum >> 31 == 1 { POLYNOMIAL } else { 0 };
                    sum << 1 ^ carry
                });
            }
            0x04 => self.independent = value as u8,
            0x08 if value & 1 == 1 => self.data = u32::MAX,
            0x08 => (),
            _ => return Err(Fault::Unmodelled),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of CRC-32/MPEG-2, which is the same over bytes.
    #[test]
    fn words_go_in_most_significant_byte_first() {
        let mut crc = Crc::new();
        assert_eq!(crc.read(0), Ok(u32::MAX));
        crc.write(0, 0).unwrap();
        assert_eq!(crc.read(0), Ok(0xc704_dd7b));
        crc.write(8, 1).unwrap();
        crc.write(0, u32::from_be_bytes(*b"1234")).unwrap();
        crc.write(0, u32::from_be_bytes(*b"5678")).unwrap();
        assert_eq!(crc.read(0), Ok(0x49e3_c2fb));
        assert!(crc.read(12).is_err());
    }
}
