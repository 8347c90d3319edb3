//! Memories of the chip, shared between the processor that runs from them and the DMA that writes into them.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// One memory. Words are atomics so that an emulator may map the same store; the model itself is single-threaded. Bytes lie
/// in a word as on the chip, which is little-endian, as every host of the emulator is.
pub struct Region {
    base: u32,
    words: Box<[AtomicU32]>,
}

impl Clone for Region {
    fn clone(&self) -> Self {
        let words = self.words.iter().map(|word| AtomicU32::new(word.load(Relaxed))).collect();
        Self { base: self.base, words }
    }
}

#[cfg(target_endian = "big")]
compile_error!("the emulator maps words of the host as memory of a little-endian chip");

impl Region {
    /// `len` bytes, a multiple of four.
    fn new(base: u32, len: usize, fill: u8) -> Self {
        Self { base, words: (0..len / 4).map(|_| AtomicU32::new(u32::from_le_bytes([fill; 4]))).collect() }
    }

    /// First address.
    pub fn base(&self) -> u32 {
        self.base
    }

    /// The store, for an emulator to map.
    pub fn words(&self) -> &[AtomicU32] {
        &self.words
    }

    /// Word that `address` lies in, and the place of its byte there, bits.
    fn place(&self, address: u32) -> Option<(&AtomicU32, u32)> {
        let offset = address.checked_sub(self.base)?;
        Some((self.words.get(offset as usize / 4)?, offset % 4 * 8))
    }

    /// Little-endian value of `size` (1, 2 or 4) bytes at `address`; `None` outside.
    pub fn load(&self, address: u32, size: usize) -> Option<u32> {
        let (word, shift) = self.place(address)?;
        let value = word.load(Relaxed) >> shift;
        let missing = (shift as usize / 8 + size).saturating_sub(4);
        if missing == 0 {
            return Some(if size == 4 { value } else { value & ((1 << (8 * size)) - 1) });
        }
        let upper = self.load(address.checked_add((size - missing) as u32)?, missing)?;
        Some(value | upper << (8 * (size - missing)))
    }

    /// Stores the low `size` bytes of `value`; `None` outside.
    pub fn store(&self, address: u32, size: usize, value: u32) -> Option<()> {
        let last = address.checked_add(size.checked_sub(1)? as u32)?;
        self.place(last)?;
        let (word, shift) = self.place(address)?;
        if shift == 0 && size == 4 {
            word.store(value, Relaxed);
            return Some(());
        }
        for (at, byte) in (address..=last).zip(value.to_le_bytes()) {
            let (word, shift) = self.place(at)?;
            word.store(word.load(Relaxed) & !(0xff << shift) | u32::from(byte) << shift, Relaxed);
        }
        Some(())
    }

    /// Copies `data` to `address`; `None` when it does not fit.
    pub fn fill(&self, address: u32, data: &[u8]) -> Option<()> {
        if let Some(last) = data.len().checked_sub(1) {
            let last = address.checked_add(u32::try_from(last).ok()?)?;
            self.place(last)?;
            for (at, byte) in (address..=last).zip(data) {
                self.store(at, 1, (*byte).into())?;
            }
        }
        Some(())
    }
}

/// Memory map of STM32F405xG (RM0090 §2.3, figure of the memory map in the data sheet DS8626).
#[derive(Clone)]
pub struct Memory {
    /// Flash, 1 MiB.
    pub flash: Region,
    /// SRAM1 and SRAM2, 112 + 16 KiB, contiguous.
    pub sram: Region,
    /// Core-coupled memory, 64 KiB, not reachable by DMA (RM0090 §2.3.1).
    pub ccm: Region,
}

impl Memory {
    /// Erased flash; RAM filled with a pattern, because the chip's is not zero at power-up.
    pub fn new() -> Self {
        Self {
            flash: Region::new(0x0800_0000, 0x10_0000, 0xff),
            sram: Region::new(0x2000_0000, 0x2_0000, 0xa5),
            ccm: Region::new(0x1000_0000, 0x1_0000, 0xa5),
        }
    }

    /// The RAM that an address is in: core-coupled, or else SRAM, which may not have it either.
    pub fn ram(&self, address: u32) -> &Region {
        if self.ccm.place(address).is_some() { &self.ccm } else { &self.sram }
    }

    /// RAM has been without power.
    pub fn scramble(&self, seed: u64) {
        let words = self.sram.words.iter().chain(&*self.ccm.words);
        crate::backup::noise(seed).zip(words).for_each(|(noise, word)| word.store(noise, Relaxed));
    }

    /// What a DMA transfer from `address` reads; `None` is a bus error.
    pub fn dma_load(&self, address: u32, size: usize) -> Option<u32> {
        self.sram.load(address, size).or_else(|| self.flash.load(address, size))
    }

    /// A DMA write; `None` is a bus error.
    pub fn dma_store(&self, address: u32, size: usize, value: u32) -> Option<()> {
        self.sram.store(address, size, value)
    }
}

impl Default for Memory {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memories_begin_and_end_where_the_manual_says() {
        let m = Memory::new();
        assert!(m.flash.load(0x080f_fffc, 4).is_some() && m.flash.load(0x0810_0000, 1).is_none());
        assert!(m.sram.load(0x2001_fffc, 4).is_some() && m.sram.load(0x2002_0000, 1).is_none());
        assert!(m.ccm.load(0x1000_fffc, 4).is_some() && m.ccm.load(0x0fff_ffff, 1).is_none());
    }

    #[test]
    fn values_lie_little_endian_at_any_address() {
        let m = Memory::new();
        for (size, value, all) in [(1, 0x11, 0xa5a5_a511u32), (2, 0x2211, 0xa5a5_2211), (4, 0x4433_2211, 0x4433_2211)] {
            for at in 0x2000_0100..0x2000_0108 {
                m.sram.fill(0x2000_0100, &[0xa5; 12]).unwrap();
                m.sram.store(at, size, value | if size == 4 { 0 } else { 0xff << 24 }).unwrap();
                let bytes: Vec<_> = (0..4).map(|i| m.sram.load(at + i, 1).unwrap() as u8).collect();
                assert_eq!(bytes, all.to_le_bytes(), "{size} at {at:#x}");
                assert_eq!((m.sram.load(at, size), m.sram.load(at, 4)), (Some(value), Some(all)));
                assert_eq!(m.sram.load(at - 1, 1), Some(0xa5));
            }
        }
        // Nothing is stored when not all of it fits.
        assert_eq!(m.sram.store(0x2001_fffe, 4, 0), None);
        assert_eq!(m.sram.fill(0x2001_fffe, &[0; 3]), None);
        assert_eq!((m.sram.load(0x2001_fffe, 2), m.sram.load(0x2001_fffe, 4)), (Some(0xa5a5), None));
        assert_eq!(m.sram.fill(0x2001_fffe, &[1, 2]), Some(()));
    }

    #[test]
    fn dma_does_not_reach_core_coupled_memory() {
        let m = Memory::new();
        assert!(m.dma_store(0x1000_0000, 2, 1).is_none());
        assert!(m.dma_store(0x2000_0002, 2, 0xbeef).is_some());
        assert_eq!(m.dma_load(0x2000_0000, 4), Some(0xbeef_a5a5));
    }
}
