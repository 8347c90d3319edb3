//! Simulated NOR flash in 16 KiB sectors, with power cuts.
//!
//! The rules of the STM32F4's flash are enforced: words of four bytes, programming only clears bits, only an erase of the
//! whole sector sets them. An *operation* is one word programmed or one sector erased. A cut falls into an operation and
//! leaves torn cells behind: of a word being programmed, none, any or all of the bits to be cleared; of a sector being
//! erased, anything from what was there to all ones, since its content is undefined.

use crate::storage::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};
use embedded_storage::nor_flash::{check_erase, check_read, check_write};

/// Bytes in a sector.
pub const SECTOR: usize = 16 * 1024;
/// Bytes in a word.
pub const WORD: usize = 4;

/// Why the flash refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlashFault {
    /// No power.
    Off,
    /// A bit that is 0 cannot be programmed to 1.
    NotErased,
    /// Address or length wrong.
    Range(NorFlashErrorKind),
}

impl NorFlashError for FlashFault {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            FlashFault::Range(kind) => *kind,
            FlashFault::Off | FlashFault::NotErased => NorFlashErrorKind::Other,
        }
    }
}

/// Flash of `SECTORS` sectors, erased at first.
#[derive(Clone)]
pub struct TestFlash<const SECTORS: usize> {
    cells: Vec<u8>,
    erases: [u32; SECTORS],
    operations: u32,
    cut: Option<(u32, u64)>,
    off: bool,
}

impl<const SECTORS: usize> Default for TestFlash<SECTORS> {
    fn default() -> Self {
        let cells = vec![0xFF; SECTORS * SECTOR];
        TestFlash { cells, erases: [0; SECTORS], operations: 0, cut: None, off: false }
    }
}

impl<const SECTORS: usize> TestFlash<SECTORS> {
    /// Cuts the power inside the operation that follows the next `operations` ones; `seed` decides how it is torn.
    pub fn cut_after(&mut self, operations: u32, seed: u64) {
        self.cut = Some((self.operations + operations, seed));
    }

    /// Restores the power and forgets a cut that has not happened.
    pub fn power_up(&mut self) {
        self.cut = None;
        self.off = false;
    }

    /// No power.
    pub fn is_off(&self) -> bool {
        self.off
    }

    /// Operations begun so far.
    pub fn operations(&self) -> u32 {
        self.operations
    }

    /// Erases of each sector so far.
    pub fn erases(&self) -> [u32; SECTORS] {
        self.erases
    }

    /// The cells as they are.
    pub fn cells(&mut self) -> &mut [u8] {
        &mut self.cells
    }

    /// Counts an operation; the random numbers that tear it when the power fails in it.
    fn begin(&mut self) -> Option<Random> {
        let torn = self.cut.filter(|&(at, _)| at == self.operations);
        self.operations += 1;
        self.off |= torn.is_some();
        torn.map(|(_, seed)| Random(seed.wrapping_mul(2).wrapping_add(1)))
    }

    fn check(&self, range: Result<(), NorFlashErrorKind>) -> Result<(), FlashFault> {
        if self.off { Err(FlashFault::Off) } else { range.map_err(FlashFault::Range) }
    }
}

impl<const SECTORS: usize> ErrorType for TestFlash<SECTORS> {
    type Error = FlashFault;
}

impl<const SECTORS: usize> ReadNorFlash for TestFlash<SECTORS> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashFault> {
        self.check(check_read(self, offset, bytes.len()))?;
        bytes.copy_from_slice(&self.cells[offset as usize..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.cells.len()
    }
}

impl<const SECTORS: usize> NorFlash for TestFlash<SECTORS> {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashFault> {
        self.check(check_erase(self, from, to))?;
        for sector in from as usize / SECTOR..to as usize / SECTOR {
            let torn = self.begin();
            self.erases[sector] += 1;
            let cells = &mut self.cells[sector * SECTOR..][..SECTOR];
            match torn {
                None => cells.fill(0xFF),
                Some(random) => {
                    random.tear_erase(cells);
                    return Err(FlashFault::Off);
                }
            }
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashFault> {
        self.check(check_write(self, offset, bytes.len()))?;
        for (i, word) in bytes.chunks(WORD).enumerate() {
            let torn = self.begin();
            let cells = &mut self.cells[offset as usize + i * WORD..][..WORD];
            if cells.iter().zip(word).any(|(old, new)| old & new != *new) {
                return Err(FlashFault::NotErased);
            }
            match torn {
                None => cells.copy_from_slice(word),
                Some(mut random) => {
                    // Not begun, just finished, or any bits in between.
                    let keep = [!0, 0, random.next() as u32, random.next() as u32][random.next() as usize % 4];
                    let bytes = cells.iter_mut().zip(word).zip(keep.to_le_bytes());
                    bytes.for_each(|((old, new), keep)| *old &= new | keep);
                    return Err(FlashFault::Off);
                }
            }
        }
        Ok(())
    }
}

/// xorshift64*: enough to tear cells the same way for the same seed.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 32
    }

    /// One of the ways an erase can stop half way.
    fn tear_erase(mut self, cells: &mut [u8]) {
        let half = cells.len() / 2;
        match self.next() % 7 {
            // Not begun, just finished.
            0 => {}
            1 => cells.fill(0xFF),
            // Programmed to zero beforehand, not yet erased.
            2 => cells.fill(0),
            // One end before the other.
            3 => cells[..half].fill(0xFF),
            4 => cells[half..].fill(0xFF),
            // Each bit for itself: half way, nearly done.
            5 => cells.iter_mut().for_each(|cell| *cell |= self.next() as u8),
            _ => cells.iter_mut().for_each(|cell| *cell |= (self.next() | self.next() | self.next()) as u8),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Flash = TestFlash<2>;

    fn word(flash: &mut Flash, offset: u32) -> [u8; 4] {
        let mut bytes = [0; 4];
        flash.read(offset, &mut bytes).unwrap();
        bytes
    }

    #[test]
    fn programming_only_clears_bits() {
        let mut flash = Flash::default();
        flash.write(8, &[0xF0, 0xFF, 0x00, 0xFF]).unwrap();
        flash.write(8, &[0x30, 0xFF, 0x00, 0xFF]).unwrap();
        assert_eq!(word(&mut flash, 8), [0x30, 0xFF, 0x00, 0xFF]);
        assert_eq!(flash.write(8, &[0x40, 0xFF, 0x00, 0xFF]), Err(FlashFault::NotErased));
        flash.erase(0, SECTOR as u32).unwrap();
        assert_eq!(word(&mut flash, 8), [0xFF; 4]);
        assert_eq!(flash.erases(), [1, 0]);
        assert_eq!(flash.operations(), 4);
    }

    #[test]
    fn addresses_are_checked() {
        let mut flash = Flash::default();
        let end = 2 * SECTOR as u32;
        let fault = |kind| Err(FlashFault::Range(kind));
        assert_eq!(flash.write(2, &[0; 4]), fault(NorFlashErrorKind::NotAligned));
        assert_eq!(flash.write(0, &[0; 3]), fault(NorFlashErrorKind::NotAligned));
        assert_eq!(flash.write(end, &[0; 4]), fault(NorFlashErrorKind::OutOfBounds));
        assert_eq!(flash.write(end - 4, &[0; 4]), Ok(()));
        assert_eq!(flash.erase(4, end), fault(NorFlashErrorKind::NotAligned));
        assert_eq!(flash.read(end - 1, &mut [0; 2]), fault(NorFlashErrorKind::OutOfBounds));
    }

    #[test]
    fn a_cut_tears_one_word_and_leaves_its_neighbours() {
        let mut partial = 0;
        for seed in 0..32 {
            let mut flash = Flash::default();
            flash.cut_after(1, seed);
            assert_eq!(flash.write(0, &[0x0F; 12]), Err(FlashFault::Off));
            assert!(flash.is_off());
            assert_eq!(flash.read(0, &mut [0]), Err(FlashFault::Off));
            flash.power_up();
            assert_eq!(word(&mut flash, 0), [0x0F; 4]);
            let torn = word(&mut flash, 4);
            assert!(torn.iter().all(|b| b & 0x0F == 0x0F));
            partial += usize::from(torn != [0x0F; 4] && torn != [0xFF; 4]);
            assert_eq!(word(&mut flash, 8), [0xFF; 4]);
        }
        assert!(partial > 8 && partial < 32, "{partial}");
    }

    #[test]
    fn a_cut_in_an_erase_leaves_the_other_sector_alone() {
        let mut contents = std::collections::BTreeSet::new();
        for seed in 0..64 {
            let mut flash = Flash::default();
            flash.write(0, &[0x55; 8]).unwrap();
            flash.write(SECTOR as u32, &[0xAA; 4]).unwrap();
            flash.cut_after(0, seed);
            assert_eq!(flash.erase(0, SECTOR as u32), Err(FlashFault::Off));
            flash.power_up();
            contents.insert(word(&mut flash, 0));
            assert_eq!(word(&mut flash, SECTOR as u32), [0xAA; 4]);
        }
        assert!(contents.contains(&[0x55; 4]) && contents.contains(&[0xFF; 4]) && contents.len() > 10, "{contents:?}");
    }

    #[test]
    fn power_restored_before_the_cut_forgets_it() {
        let mut flash = Flash::default();
        flash.cut_after(1, 0);
        flash.write(0, &[0; 4]).unwrap();
        flash.power_up();
        flash.write(4, &[0; 4]).unwrap();
        assert!(!flash.is_off());
    }
}
