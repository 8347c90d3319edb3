//! TIM8: stamps of the edges of gate and comparators, stored by DMA.
//!
//! The counter runs free in phase with the servo tick and wraps every seven ticks. Each edge, rising or falling, stores the
//! count; DMA moves it into a ring. No pulse costs the processor anything, at any pulse rate.

use super::dma::{self, Stream};
use super::hal::gpio::PushPull;
use super::hal::gpio::alt::tim8::{Ch1, Ch3, Ch4};
use super::start::StartError;
use super::timebase::APERTURE_PHASE;
use super::{lines, pac, put, reset};
use crate::board::EDGE_MODULUS;
use crate::edges::{age, gate_mask};
use crate::reflex::EDGE_COUNT;
use core::sync::atomic::{AtomicU16, Ordering::Relaxed};

/// Stamps kept of each line.
const RING: usize = EDGE_COUNT as usize;
static GATE: Ring = Ring([const { AtomicU16::new(0) }; RING]);
static HIGH: Ring = Ring([const { AtomicU16::new(0) }; RING]);
static LOW: Ring = Ring([const { AtomicU16::new(0) }; RING]);

/// Written by DMA, read by tasks: atomics, because both are outside the compiler's sight.
struct Ring([AtomicU16; RING]);

/// Items written since the stream was enabled, modulo the ring.
#[inline(always)]
fn written<const N: usize>() -> u32 {
    (RING as u32).wrapping_sub(dma::left::<N>()) % RING as u32
}

/// The edge timer and its rings.
pub struct Edges {
    tim: pac::TIM8,
    /// Edges of the gate up to the last block, and of the block before: their stamps are younger than the wrap.
    seen: u32,
    recent: u32,
    _pins: (Ch1<PushPull>, Ch3<PushPull>, Ch4<PushPull>),
    _streams: (Stream<2>, Stream<4>, Stream<7>),
}

impl Edges {
    /// Configures timer, pins (gate, high and low comparator) and rings. It counts only when the time base starts it.
    pub fn new(
        tim: pac::TIM8,
        pins: (impl Into<Ch1<PushPull>>, impl Into<Ch3<PushPull>>, impl Into<Ch4<PushPull>>),
        mut streams: (Stream<2>, Stream<4>, Stream<7>),
        rcc: &mut pac::RCC,
    ) -> Result<Self, StartError> {
        reset::<pac::TIM8>(rcc);
        let pins = (pins.0.into(), pins.1.into(), pins.2.into());
        put!(tim.arr(), EDGE_MODULUS - 1);
        put!(tim.egr(), 1);
        // Channels 1, 3, 4: input from their own pin, filtered over 8 samples (48 ns); DMA at each capture. Both edges of
        // gate and high comparator; rising edges of the low one, whose channel knows no other way (RM0090 17.4.9).
        put!(tim.ccmr1_input(), 0b0011 << 4 | 0b01);
        put!(tim.ccmr2_input(), 0b0011 << 4 | 0b01 | 0b0011 << 12 | 0b01 << 8);
        put!(tim.ccer(), 0b1011 | 0b1011 << 8 | 0b0001 << 12);
        put!(tim.dier(), 1 << 9 | 1 << 11 | 1 << 12);
        // Trigger mode from TIM1.
        put!(tim.smcr(), 0b110);
        let from = |n: usize| tim.ccr(n).as_ptr().cast_const();
        streams.0.fill(7, 0, from(0), &GATE.0)?;
        streams.1.fill(7, 0, from(2), &HIGH.0)?;
        streams.2.fill(7, 0, from(3), &LOW.0)?;
        Ok(Edges { tim, seen: 0, recent: 0, _pins: pins, _streams: streams })
    }

    /// The timer, for the time base to start.
    pub fn timer(&self) -> &pac::TIM8 {
        &self.tim
    }

    /// The gate now. At the beginning of the work on a block; [`Edges::mask`] takes it at least [`SETTLED`] cycles later.
    #[inline]
    pub fn look(&self) -> GateSample {
        GateSample { count: written::<2>(), open: lines::gate_is_open(), now: self.tim.cnt().read().bits() }
    }

    /// Which conversions of the block just completed lie in the on-time. Once a block, after its last conversion and before
    /// the next block's.
    #[inline]
    pub fn mask(&mut self, mut look: GateSample) -> u32 {
        // The level belongs to the count only if no edge was on its way into the ring: it must still be so a little later.
        for _ in 0..3 {
            let GateSample { count, open, now } = look;
            if (written::<2>(), lines::gate_is_open()) == (count, open) {
                let new = count.wrapping_sub(self.seen) % RING as u32;
                let young = new + self.recent;
                (self.seen, self.recent) = (count, new);
                let newest_first = (1..young.min(RING as u32) + 1).map(|back| {
                    let index = count.wrapping_sub(back) % RING as u32;
                    GATE.0.get(index as usize).map_or(0, |stamp| stamp.load(Relaxed))
                });
                return gate_mask(now, open, newest_first, APERTURE_PHASE);
            }
            look = self.look();
            cortex_m::asm::delay(SETTLED);
        }
        // A gate that never rests is no gate.
        (self.seen, self.recent) = (written::<2>(), 0);
        0
    }

    /// Blocks were lost: what the rings hold may be older than the wrap.
    pub fn forget(&mut self) {
        (self.seen, self.recent) = (written::<2>(), 0);
    }
}

/// Cycles in which an edge reaches the ring: longer than the input filter and a DMA transfer.
const SETTLED: u32 = 32;

/// The gate at a moment: edges so far, level, edge timer.
#[derive(Clone, Copy)]
pub struct GateSample {
    count: u32,
    open: bool,
    now: u32,
}

/// What the timer has captured so far.
#[derive(Clone, Copy, Debug, PartialEq, Eq, defmt::Format)]
pub struct Captures {
    /// Edges of the gate, modulo [`EDGE_COUNT`].
    pub gate: u32,
    /// Edges of the high comparator, modulo [`EDGE_COUNT`].
    pub high: u32,
    /// Rises of the low comparator, modulo [`EDGE_COUNT`].
    pub low: u32,
    /// From the newest edge of the gate before it to the newest edge of the high comparator, cycles of the core; right within
    /// [`EDGE_MODULUS`]. After a rise of both it is the time in which the gap charged.
    pub gate_to_high: u32,
}

/// The captures now. For a slower task's log.
pub fn captures() -> Captures {
    let (gate, high, low) = (written::<2>(), written::<4>(), written::<7>());
    let stamp = |ring: &Ring, back: u32, written: u32| {
        let index = written.wrapping_sub(back) % RING as u32;
        ring.0.get(index as usize).map_or(0, |stamp| u32::from(stamp.load(Relaxed)))
    };
    let crossed = stamp(&HIGH, 1, high);
    // Of the two newest edges of the gate, the one nearer before the crossing.
    let gate_to_high = age(crossed, stamp(&GATE, 1, gate)).min(age(crossed, stamp(&GATE, 2, gate)));
    Captures { gate, high, low, gate_to_high }
}

/// Edges of the high comparator and rises of the low one so far, modulo [`EDGE_COUNT`].
pub fn comparators() -> [u8; 2] {
    [written::<4>() as u8, written::<7>() as u8]
}

/// Edges of the gate so far, modulo [`EDGE_COUNT`]: for the reflex, which must not share a lock with the gap task.
#[inline(always)]
pub fn gate_edges() -> u32 {
    written::<2>()
}
