//! Memories of the chip, shared between the processor that runs from them and the DMA that writes into them.

use std::sync::atomic::{AtomicU8, Ordering::Relaxed};

/// One memory. Bytes are atomics so that an emulator may map the same store; the model itself is single-threaded.
pub struct Region {
    base: u32,
    bytes: Box<[AtomicU8]>,
}

impl Region {
    fn new(base: u32, len: usize, fill: u8) -> Self {
        Self { base, bytes: (0..len).map(|_| AtomicU8::new(fill)).collect() }
    }

    /// First address.
    pub fn base(&self) -> u32 {
        self.base
    }

    /// The store, for an emulator to map.
    pub fn bytes(&self) -> &[AtomicU8] {
        &self.bytes
    }

    fn slice(&self, address: u32, size: usize) -> Option<&[AtomicU8]> {
        let start = address.checked_sub(self.base)? as usize;
        self.bytes.get(start..start.checked_add(size)?)
    }

    /// Little-endian value of `size` (1, 2 or 4) bytes at `address`; `None` outside.
    pub fn load(&self, address: u32, size: usize) -> Option<u32> {
        let bytes = self.slice(address, size)?;
        Some(bytes.iter().rev().fold(0, |v, b| v << 8 | u32::from(b.load(Relaxed))))
    }

    /// Stores the low `size` bytes of `value`; `None` outside.
    pub fn store(&self, address: u32, size: usize, value: u32) -> Option<()> {
        for (byte, v) in self.slice(address, size)?.iter().zip(value.to_le_bytes()) {
            byte.store(v, Relaxed);
        }
        Some(())
    }

    /// Copies `data` to `address`; `None` when it does not fit.
    pub fn fill(&self, address: u32, data: &[u8]) -> Option<()> {
        for (byte, v) in self.slice(address, data.len())?.iter().zip(data) {
            byte.store(*v, Relaxed);
        }
        Some(())
    }
}

/// Memory map of STM32F405xG (RM0090 §2.3, figure of the memory map in the data sheet DS8626).
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
    fn dma_does_not_reach_core_coupled_memory() {
        let m = Memory::new();
        assert!(m.dma_store(0x1000_0000, 2, 1).is_none());
        assert!(m.dma_store(0x2000_0002, 2, 0xbeef).is_some());
        assert_eq!(m.dma_load(0x2000_0000, 4), Some(0xbeef_a5a5));
    }
}
