//! Streams of DMA2 that fill a ring without end.

use super::start::{StartError, within};
use super::{pac, put, reset};
use core::sync::atomic::AtomicU16;

/// A stream that nobody uses yet. What uses it takes it by value.
pub struct Stream<const N: usize>(());

/// The streams in use.
#[allow(missing_docs, reason = "a field a stream")]
pub struct Streams {
    pub s0: Stream<0>,
    pub s2: Stream<2>,
    pub s3: Stream<3>,
    pub s4: Stream<4>,
    pub s7: Stream<7>,
}

/// Resets the controller and hands out its streams.
pub fn streams(_dma: pac::DMA2, rcc: &mut pac::RCC) -> Streams {
    reset::<pac::DMA2>(rcc);
    Streams { s0: Stream(()), s2: Stream(()), s3: Stream(()), s4: Stream(()), s7: Stream(()) }
}

/// Option: interrupts at the middle and at the end of the ring.
pub const INTERRUPT_HALVES: u32 = 1 << 3 | 1 << 4;
/// Option: the highest of four priorities.
pub const URGENT: u32 = 0b11 << 16;
/// Flag: the first half of the ring is full.
pub const HALF: u32 = 1 << 4;
/// Flag: the second half is.
pub const FULL: u32 = 1 << 5;
/// Circular, from peripheral to memory, 16 bits each, memory incremented, enabled (RM0090 10.5.5).
const RING: u32 = 1 << 13 | 1 << 11 | 1 << 10 | 1 << 8 | 1;

fn dma2() -> &'static pac::dma2::RegisterBlock {
    // SAFETY: the register block is always there. Each stream's registers are used through its one token, and the flag
    // registers clear only bits written as 1.
    unsafe { &*pac::DMA2::ptr() }
}

impl<const N: usize> Stream<N> {
    /// Position of its flags in the flag register of its half (RM0090 10.5.1).
    const SHIFT: u32 = [0, 6, 16, 22][N % 4];

    /// Fills `ring` from a data register, without end. `options` are further bits of the stream's configuration.
    pub fn fill(
        &mut self,
        channel: u32,
        options: u32,
        from: *const u32,
        ring: &'static [AtomicU16],
    ) -> Result<(), StartError> {
        let st = dma2().st(N);
        put!(st.cr(), 0);
        within(1000, || st.cr().read().bits() & 1 == 0, StartError::DmaStream)?;
        self.clear(0x3D);
        put!(st.ndtr(), ring.len() as u32);
        // SAFETY: the stream reads a data register and writes `ring`, `len` items of 16 bits, circularly. The ring is static,
        // made of atomics, and in memory that DMA reaches: only `ccm` is not.
        unsafe {
            st.par().write(|w| w.bits(from.addr() as u32));
            st.m0ar().write(|w| w.bits(ring.as_ptr().addr() as u32));
        }
        put!(st.cr(), RING | channel << 25 | options);
        Ok(())
    }

    /// Its flags.
    pub fn flags(&self) -> u32 {
        let register = if N < 4 { dma2().lisr().read().bits() } else { dma2().hisr().read().bits() };
        register >> Self::SHIFT & 0x3D
    }

    /// Clears flags.
    pub fn clear(&mut self, flags: u32) {
        if N < 4 {
            put!(dma2().lifcr(), flags << Self::SHIFT);
        } else {
            put!(dma2().hifcr(), flags << Self::SHIFT);
        }
    }
}

/// Items that stream `N` has still to write before its ring begins anew. For anyone: reading changes nothing.
#[inline(always)]
pub fn left<const N: usize>() -> u32 {
    dma2().st(N).ndtr().read().bits()
}
