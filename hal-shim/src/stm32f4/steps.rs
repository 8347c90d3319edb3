//! TIM2 and a stream of DMA1: pulses of a host, as [`crate::steps`] counts them.

use super::start::{StartError, within};
use super::{Board, pac, pins, put, reset};
use crate::board::Pin;
use crate::steps::{Account, Counted, Found, Polarity, Ring, STAMPS, StepInput};
use core::sync::atomic::AtomicU32;

const STEP: Pin = Board::TABLE.pin("step");
const DIRECTION: Pin = Board::TABLE.pin("step_direction");
// The edge detector is that of channel 1.
const _: () = assert!(Board::TABLE.timer_channel("step") == 1);

/// Samples of the input filter: 6 at half the timer's clock (RM0090 18.4.7, IC1F), 143 ns. Shorter pulses are none, and a direction
/// may change 50 ns before or after a step begins.
const FILTER: u32 = 0b0100;
/// Channel 3, from the pin of channel 3 or of channel 4, which has its own filter.
const CAPTURE: u32 = match Board::TABLE.timer_channel("step_direction") {
    3 => FILTER << 4 | 0b01,
    4 => FILTER << 12 | 0b01 << 8 | 0b10,
    _ => panic!("the direction of steps is captured from channel 3 or 4"),
};
/// Cycles after which the filter shows the level of a line at rest.
const SETTLED: u32 = 168;

/// Stream and channel that serve TIM2_CH3 (RM0090 table 42).
const STREAM: usize = 1;
const CHANNEL: u32 = 3;
/// Circular, from peripheral to memory, 32 bits each, memory incremented, enabled (RM0090 10.5.5).
const CIRCULAR: u32 = 0b10 << 13 | 0b10 << 11 | 1 << 10 | 1 << 8 | 1;

static RING: Ring = [const { AtomicU32::new(0) }; STAMPS];

/// The counter of steps.
pub struct Counter {
    tim: pac::TIM2,
    account: Account,
}

impl Counter {
    /// Starts the timer, whose pins are connected to it already, and the stream.
    pub fn new(tim: pac::TIM2, _dma: pac::DMA1, rcc: &mut pac::RCC) -> Result<Counter, StartError> {
        reset::<pac::TIM2>(rcc);
        reset::<pac::DMA1>(rcc);
        let st = dma1().st(STREAM);
        within(1000, || st.cr().read().bits() & 1 == 0, StartError::DmaStream)?;
        put!(st.ndtr(), STAMPS as u32);
        // SAFETY: the stream reads the capture register and writes `RING`, 64 items of 32 bits, circularly. The ring is static, made
        // of atomics, and in memory that DMA reaches: only `ccm` is not.
        unsafe {
            st.par().write(|w| w.bits(tim.ccr(2).as_ptr().addr() as u32));
            st.m0ar().write(|w| w.bits(RING.as_ptr().addr() as u32));
        }
        put!(st.cr(), CIRCULAR | CHANNEL << 25);
        put!(tim.arr(), u32::MAX);
        put!(tim.ccmr1_input(), FILTER << 4 | 0b01);
        put!(tim.ccmr2_input(), CAPTURE);
        // Channel 3 captures both edges (18.4.9), and each capture is a request.
        put!(tim.ccer(), 0b1011 << 8);
        put!(tim.dier(), 1 << 11);
        // External clock mode 1 from TI1F_ED.
        put!(tim.smcr(), 0b100 << 4 | 0b111);
        put!(tim.cr1(), 1);
        cortex_m::asm::delay(SETTLED);
        // From here on the lowest bit is the level of the line.
        put!(tim.cnt(), u32::from(pins::is_high(STEP)));
        let now = counted(&tim);
        Ok(Counter { tim, account: Account::new(now, &RING) })
    }
}

fn dma1() -> &'static pac::dma2::RegisterBlock {
    // SAFETY: the register block is always there. Nobody else uses the controller.
    unsafe { &*pac::DMA1::ptr() }
}

fn counted(tim: &pac::TIM2) -> Counted {
    // In this order: a stamp that is older than the count is in the ring then, but for the time of its transfer.
    let half = tim.cnt().read().bits();
    let high = pins::is_high(DIRECTION);
    let left = dma1().st(STREAM).ndtr().read().bits();
    Counted { stamps: (STAMPS as u32).wrapping_sub(left) % STAMPS as u32, half, high }
}

impl StepInput for Counter {
    #[inline]
    fn read(&mut self, polarity: Polarity, run: impl FnMut(i32)) -> Found {
        self.account.read(counted(&self.tim), &RING, polarity, run)
    }
}
