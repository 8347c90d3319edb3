//! Flash interface: wait states, unlocking, erase and program with the times they take (RM0090 §3, DS8626 §5.3.12).
//!
//! The processor stalls while an operation runs, because its code is in the same bank (§3.5.2: any read during a write
//! stalls the bus). Instructions that happen to be cached would run on; the model does not count on it.

use crate::TICK_HZ;
use crate::error::Fault;
use crate::memory::Region;

const US: u64 = TICK_HZ / 1_000_000;
const MS: u64 = TICK_HZ / 1000;
/// Typical word programming time, any parallelism.
const PROGRAM: u64 = 16 * US;
/// Typical erase times of a 16, 64 and 128 KiB sector, ms, by parallelism 8, 16, 32 bits.
const ERASE_MS: [[u64; 3]; 3] = [[400, 300, 250], [1200, 700, 550], [2000, 1300, 1000]];

/// Option bytes of a new chip: brown-out reset off (§3.9.10).
const FACTORY: u32 = 0x0fff_aaed;

mod cr {
    pub const PG: u32 = 1;
    pub const SER: u32 = 2;
    pub const MER: u32 = 4;
    pub const STRT: u32 = 1 << 16;
    pub const LOCK: u32 = 1 << 31;
}

/// First address and length of sector `n`, 0..=11 (§3.3, table 5).
pub fn sector(n: u32) -> Option<(u32, u32)> {
    Some(match n {
        0..=3 => (0x0800_0000 + n * 0x4000, 0x4000),
        4 => (0x0801_0000, 0x1_0000),
        5..=11 => (0x0802_0000 + (n - 5) * 0x2_0000, 0x2_0000),
        _ => return None,
    })
}

#[derive(Clone)]
pub struct Flash {
    acr: u32,
    sr: u32,
    cr: u32,
    keys: u8,
    /// Tick at which the running operation ends.
    pub busy_until: u64,
    /// Option bytes, as FLASH_OPTCR reads them.
    options: u32,
    /// Erases of each sector since reset: wear, and a check that only the reserved ones are touched.
    pub erases: [u32; 12],
    /// Erases and programmed words so far; in which one the power fails; and whether it just has.
    pub operations: u64,
    pub cut: Option<u64>,
    pub failed: bool,
}

impl Flash {
    pub fn new() -> Self {
        Self {
            acr: 0,
            sr: 0,
            cr: cr::LOCK,
            keys: 0,
            busy_until: 0,
            options: FACTORY,
            erases: [0; 12],
            operations: 0,
            cut: None,
            failed: false,
        }
    }

    /// Counts an operation; whether the power fails in it.
    fn begins(&mut self) -> bool {
        self.failed = self.cut == Some(self.operations);
        self.operations += 1;
        self.failed
    }

    /// Registers after reset; option bytes and wear stay.
    pub fn reset(&mut self) {
        let Self { erases, options, operations, .. } = *self;
        *self = Self { erases, options, operations, ..Self::new() };
    }

    /// Sets the brown-out level of the option bytes, 0 (off) to 3 (§3.9.10).
    pub fn set_brown_out(&mut self, level: u32) {
        self.options = self.options & !(3 << 2) | (3 - level.min(3)) << 2;
    }

    /// Wait states set.
    pub fn latency(&self) -> u32 {
        self.acr & 7
    }

    /// Whether it reads ahead and keeps instructions and data: PRFTEN, ICEN, DCEN (RM0090 §3.9.1).
    pub fn accelerated(&self) -> bool {
        self.acr >> 8 & 7 == 7
    }

    pub fn read(&self, offset: u32, now: u64) -> Result<u32, Fault> {
        Ok(match offset {
            0x00 => self.acr,
            0x0c => self.sr | u32::from(now < self.busy_until) << 16,
            0x10 => self.cr,
            0x14 => self.options,
            _ => return Err(Fault::Unmodelled),
        })
    }

    pub fn write(&mut self, offset: u32, value: u32, now: u64, flash: &Region) -> Result<(), Fault> {
        match offset {
            0x00 => self.acr = value & 0x1f07,
            // §3.6.1: KEY1 then KEY2; anything else locks the register until reset.
            0x04 => match (self.keys, value) {
                (0, 0x4567_0123) => self.keys = 1,
                (1, 0xcdef_89ab) => (self.keys, self.cr) = (0, self.cr & !cr::LOCK),
                _ => return Err(Fault::Unsupported("wrong flash key: bus error, locked until reset")),
            },
            0x0c => self.sr &= !(value & 0xf3),
            // A locked register ignores writes (§3.6.1).
            0x10 if self.cr & cr::LOCK != 0 => (),
            0x10 => {
                if value & (1 << 24 | 1 << 25) != 0 {
                    return Err(Fault::Unsupported("flash interrupts are not modelled"));
                }
                self.cr = value & 0x8000_03ff;
                if value & cr::STRT != 0 {
                    self.start(now, flash)?;
                }
            }
            _ => return Err(Fault::Unmodelled),
        }
        Ok(())
    }

    fn start(&mut self, now: u64, flash: &Region) -> Result<(), Fault> {
        if self.cr & (cr::SER | cr::MER) != cr::SER {
            return Err(Fault::Unsupported("only sector erase is modelled"));
        }
        let n = self.cr >> 3 & 15;
        let (base, len) = sector(n).ok_or(Fault::Unsupported("no such flash sector"))?;
        let size = [0x4000, 0x1_0000, 0x2_0000].iter().position(|&l| l == len).unwrap_or(0);
        let width = (self.cr >> 8 & 3) as usize;
        let time = ERASE_MS[size].get(width).ok_or(Fault::Unsupported("64-bit erase needs external Vpp"))?;
        // A cut leaves half of it as it was.
        let end = base + if self.begins() { len / 2 } else { len };
        for word in (base..end).step_by(4) {
            flash.store(word, 4, u32::MAX);
        }
        self.erases[n as usize] += 1;
        self.busy_until = now + time * MS;
        Ok(())
    }

    /// A write of the processor into the flash array.
    pub fn program(&mut self, address: u32, size: usize, value: u32, now: u64, flash: &Region) {
        if self.cr & cr::LOCK != 0 || self.cr & cr::PG == 0 {
            self.sr |= 1 << 7; // PGSERR: no programming was set up
        } else if size != 1 << (self.cr >> 8 & 3) {
            self.sr |= 1 << 6; // PGPERR: width is not PSIZE
        } else if let Some(old) = flash.load(address, size) {
            // Programming only clears bits; a cut leaves some of them.
            let kept = if self.begins() { 0x5a5a_a5a5 } else { 0 };
            flash.store(address, size, old & (value | kept));
            self.busy_until = now + PROGRAM;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Memory;

    fn unlocked() -> (Flash, Memory) {
        let (mut f, m) = (Flash::new(), Memory::new());
        f.write(4, 0x4567_0123, 0, &m.flash).unwrap();
        f.write(4, 0xcdef_89ab, 0, &m.flash).unwrap();
        (f, m)
    }

    #[test]
    fn sectors_tile_one_mebibyte() {
        let mut next = 0x0800_0000;
        for n in 0..12 {
            let (base, len) = sector(n).unwrap();
            assert_eq!(base, next);
            next += len;
        }
        assert_eq!((next, sector(12)), (0x0810_0000, None));
    }

    #[test]
    fn option_bytes_outlive_a_reset_and_are_those_of_a_new_chip_before() {
        let mut f = Flash::new();
        assert_eq!(f.read(0x14, 0).unwrap() >> 2 & 3, 3);
        for (level, bits) in [(3, 0), (2, 1), (1, 2), (0, 3)] {
            f.set_brown_out(level);
            f.reset();
            assert_eq!(f.read(0x14, 0).unwrap(), 0x0fff_aae1 | bits << 2);
        }
    }

    #[test]
    fn a_locked_flash_neither_erases_nor_programs() {
        let (mut f, m) = (Flash::new(), Memory::new());
        f.write(0x10, cr::PG | 2 << 8, 0, &m.flash).unwrap();
        f.program(0x0800_4000, 4, 0, 0, &m.flash);
        assert_eq!(m.flash.load(0x0800_4000, 4), Some(u32::MAX));
        assert_eq!(f.read(0x0c, 0), Ok(1 << 7));
        assert!(f.write(4, 1, 0, &m.flash).is_err());
    }

    #[test]
    fn programming_clears_bits_and_takes_16_us() {
        let (mut f, m) = unlocked();
        f.write(0x10, cr::PG | 2 << 8, 0, &m.flash).unwrap();
        f.program(0x0800_4000, 4, 0xffff_00ff, 0, &m.flash);
        f.program(0x0800_4000, 4, 0x0fff_ffff, 0, &m.flash);
        assert_eq!(m.flash.load(0x0800_4000, 4), Some(0x0fff_00ff));
        assert_eq!(f.read(0x0c, PROGRAM - 1), Ok(1 << 16));
        assert_eq!(f.read(0x0c, PROGRAM), Ok(0));
    }

    #[test]
    fn a_write_of_another_width_than_psize_is_refused() {
        let (mut f, m) = unlocked();
        f.write(0x10, cr::PG | 2 << 8, 0, &m.flash).unwrap();
        f.program(0x0800_4000, 2, 0, 0, &m.flash);
        assert_eq!((m.flash.load(0x0800_4000, 2), f.read(0x0c, 0)), (Some(0xffff), Ok(1 << 6)));
    }

    #[test]
    fn erasing_sector_1_takes_a_quarter_second_and_touches_no_other() {
        let (mut f, m) = unlocked();
        for a in [0x0800_3fff, 0x0800_4000, 0x0800_7fff, 0x0800_8000] {
            m.flash.store(a, 1, 0);
        }
        f.write(0x10, cr::SER | 1 << 3 | 2 << 8 | cr::STRT, 0, &m.flash).unwrap();
        let byte = |a| m.flash.load(a, 1).unwrap();
        assert_eq!([byte(0x0800_3fff), byte(0x0800_4000), byte(0x0800_7fff), byte(0x0800_8000)], [0, 0xff, 0xff, 0]);
        assert_eq!((f.busy_until, f.erases[1]), (250 * MS, 1));
    }
}
