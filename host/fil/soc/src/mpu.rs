//! Memory protection unit (ARMv7-M B3.5): one area without access, of regions that adjoin, and one of code that is read only, above the default map.
//! Whatever else the unit can do is refused: further regions, rights of one privilege, subregions that are left out but for the last ones,
//! less than 4 KiB, itself in HardFault and NMI.

use crate::error::Fault;
use std::ops::Range;

const REGIONS: usize = 8;

mod rasr {
    pub const ENABLE: u32 = 1;
    pub const NEVER_EXECUTED: u32 = 1 << 28;
    pub const ACCESS: u32 = 7 << 24;
    pub const NO_ACCESS: u32 = 0;
    pub const READ_ONLY: u32 = 6 << 24;
}

#[derive(Clone, Default)]
pub struct Mpu {
    control: u32,
    number: u32,
    base: [u32; REGIONS],
    attributes: [u32; REGIONS],
}

impl Mpu {
    fn region(&self) -> usize {
        self.number as usize % REGIONS
    }

    pub fn read(&self, address: u32) -> Result<u32, Fault> {
        Ok(match address {
            0xe000_ed90 => (REGIONS as u32) << 8,
            0xe000_ed94 => self.control,
            0xe000_ed98 => self.number,
            0xe000_ed9c => self.base[self.region()] | self.number,
            0xe000_eda0 => self.attributes[self.region()],
            _ => return Err(Fault::Unmodelled),
        })
    }

    pub fn write(&mut self, address: u32, value: u32) -> Result<(), Fault> {
        match address {
            0xe000_ed94 if !matches!(value & 7, 0 | 4 | 5) => {
                return Err(Fault::Unsupported("the MPU without the default map, or in HardFault and NMI"));
            }
            0xe000_ed94 => self.control = value & 7,
            0xe000_ed98 => self.number = value & 7,
            0xe000_ed9c => {
                // VALID: the number comes with the address.
                if value >> 4 & 1 == 1 {
                    self.number = value & 7;
                }
                self.base[self.region()] = value & !0x1f;
            }
            0xe000_eda0 => {
                let region = self.region();
                self.attributes[region] = value;
                let code = value & (rasr::ACCESS | rasr::NEVER_EXECUTED) == rasr::READ_ONLY;
                let right = code || value & rasr::ACCESS == rasr::NO_ACCESS;
                let (left_out, eighth) = ((value >> 8) as u8, value >> 1 & 0x1f >= 14);
                let last = left_out.leading_ones() == left_out.count_ones() && (left_out == 0 || eighth);
                let simple = right && last && value >> 1 & 0x1f >= 11;
                if value & rasr::ENABLE != 0 && (self.joined(value & rasr::ACCESS).is_none() || !simple) {
                    return Err(Fault::Unsupported(
                        "regions of the MPU other than one area without access and one of read-only code, of 4 KiB or more",
                    ));
                }
            }
            _ => return Err(Fault::Unmodelled),
        }
        Ok(())
    }

    /// The region without access; HardFault and NMI have access.
    pub fn forbidden(&self) -> Option<Range<u32>> {
        self.with(rasr::NO_ACCESS)
    }

    /// The region that may be read and executed, and not written.
    pub fn read_only(&self) -> Option<Range<u32>> {
        self.with(rasr::READ_ONLY)
    }

    fn with(&self, access: u32) -> Option<Range<u32>> {
        self.joined(access).filter(|_| self.control & 1 == 1)
    }

    /// The area of all enabled regions with this access; `None`: there are none, or they are no single one.
    fn joined(&self, access: u32) -> Option<Range<u32>> {
        let wanted = rasr::ENABLE | access;
        let mut areas: Vec<Range<u32>> = (self.attributes.iter().zip(&self.base))
            .filter(|(it, _)| *it & (rasr::ENABLE | rasr::ACCESS) == wanted)
            .map(|(it, base)| {
                let size = 1u32.checked_shl((it >> 1 & 0x1f) + 1)?;
                // An address that is not a multiple of the size counts as the one below that is (B3.5.8).
                let start = base & !(size - 1);
                let left_out = size / 8 * (it >> 8 & 0xff).count_ones();
                Some(start..start.checked_add(size - left_out)?)
            })
            .collect::<Option<_>>()?;
        areas.sort_by_key(|area| area.start);
        let joined = areas.first()?.start..areas.last()?.end;
        areas.windows(2).all(|two| two[0].end == two[1].start).then_some(joined)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CTRL: u32 = 0xe000_ed94;
    const RBAR: u32 = 0xe000_ed9c;
    const RASR: u32 = 0xe000_eda0;

    #[test]
    fn a_region_counts_when_both_enables_are_set() {
        let mut mpu = Mpu::default();
        mpu.write(RBAR, 0x2001_9000 | 1 << 4 | 2).unwrap();
        mpu.write(RASR, 11 << 1 | 1).unwrap();
        assert_eq!((mpu.forbidden(), mpu.read(RBAR)), (None, Ok(0x2001_9002)));
        mpu.write(CTRL, 5).unwrap();
        assert_eq!((mpu.forbidden(), mpu.read_only()), (Some(0x2001_9000..0x2001_a000), None));
        mpu.write(RBAR, 1 << 4 | 1).unwrap();
        mpu.write(RASR, 6 << 24 | 16 << 1 | 1).unwrap();
        assert_eq!((mpu.forbidden(), mpu.read_only()), (Some(0x2001_9000..0x2001_a000), Some(0..0x2_0000)));
        mpu.write(RBAR, 0x2001_9000 | 1 << 4 | 2).unwrap();
        mpu.write(RASR, 11 << 1).unwrap();
        assert_eq!(mpu.forbidden(), None);
    }

    #[test]
    fn what_is_not_modelled_is_refused() {
        let refused = |registers: &[(u32, u32)]| {
            let mut mpu = Mpu::default();
            registers.iter().any(|(address, value)| mpu.write(*address, *value).is_err())
        };
        assert!(refused(&[(CTRL, 1)]) && refused(&[(CTRL, 7)]) && refused(&[(0xe000_eda4, 0)]));
        assert!(refused(&[(RASR, 10 << 1 | 1)]) && refused(&[(RASR, 1 << 28 | 6 << 24 | 11 << 1 | 1)]));
        assert!(refused(&[(RASR, 3 << 24 | 11 << 1 | 1)]));
        assert!(refused(&[(RASR, 11 << 1 | 1), (RBAR, 1 << 4 | 1), (RASR, 11 << 1 | 1)]));
        assert!(!refused(&[(RASR, 11 << 1 | 1), (RASR, 12 << 1 | 1)]));
        // Eighths that are left out: the first one, and of less than 4 KiB.
        assert!(refused(&[(RASR, 1 << 8 | 14 << 1 | 1)]) && refused(&[(RASR, 0x80 << 8 | 13 << 1 | 1)]));
    }

    #[test]
    fn regions_that_adjoin_are_one_area_and_others_are_refused() {
        let two = |lower: u32| {
            let mut mpu = Mpu::default();
            mpu.write(CTRL, 5).unwrap();
            mpu.write(RBAR, 0x2001_0000 | 1 << 4).unwrap();
            mpu.write(RASR, 14 << 1 | 1).unwrap();
            mpu.write(RBAR, lower | 1 << 4 | 2).unwrap();
            mpu.write(RASR, 12 << 1 | 1).map(|()| mpu.forbidden())
        };
        assert_eq!(two(0x2000_e000), Ok(Some(0x2000_e000..0x2001_8000)));
        assert!(two(0x2000_c000).is_err());
        // Without its last eighth, 4 KiB.
        let mut mpu = Mpu::default();
        mpu.write(CTRL, 5).unwrap();
        mpu.write(RBAR, 0x2001_0000 | 1 << 4).unwrap();
        mpu.write(RASR, 0x80 << 8 | 14 << 1 | 1).unwrap();
        assert_eq!(mpu.forbidden(), Some(0x2001_0000..0x2001_7000));
    }
}
