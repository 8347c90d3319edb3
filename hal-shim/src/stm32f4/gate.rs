//! TIM8: stamps of the edges of gate and comparators, stored by DMA.
//!
//! The counter runs free in phase with the servo tick and wraps every seven ticks. Each edge, rising or falling, stores the
//! count; DMA moves it into a ring. No pulse costs the processor anything, at any pulse rate.

use super::dma::{self, Stream};
use super::hal::gpio::PushPull;
use super::hal::gpio::alt::tim8::{Ch1, Ch3, Ch4};
use super::start::StartError;
use super::timebase::APERTURE_PHASE;
use super::{ends, lines, pac, put, reset};
use crate::board::EDGE_MODULUS;
use crate::edges::{Seen, age, block_began, gate_mask, take};
use crate::gap::{self, GapBlock};
use crate::reflex::EDGE_COUNT;
use core::sync::atomic::{AtomicU16, AtomicU32, Ordering::Relaxed};

/// Stamps kept of each line.
const RING: usize = EDGE_COUNT as usize;
static GATE: Ring = Ring([const { AtomicU16::new(0) }; RING]);
static HIGH: Ring = Ring([const { AtomicU16::new(0) }; RING]);
static LOW: Ring = Ring([const { AtomicU16::new(0) }; RING]);

/// What was [`Seen`] a block ago.
static SEEN: AtomicU32 = AtomicU32::new(0);

/// Written by DMA, read by tasks: atomics, because both are outside the compiler's sight.
struct Ring([AtomicU16; RING]);

impl Ring {
    /// Stamp of one of the newest of so many: 1 for the newest.
    #[inline(always)]
    fn newest(&self, written: u32, back: u32) -> u32 {
        let index = written.wrapping_sub(back) as usize % RING;
        self.0.get(index).map_or(0, |stamp| stamp.load(Relaxed).into())
    }

    /// Moves what is not `taken` of `count` stamps into a block that began at the count `began`. Gives how many there were, and when
    /// the first came that belongs to the next block.
    #[inline(always)]
    fn take(&self, edges: &mut gap::Edges, began: u32, taken: &mut u32, count: u32) -> (u32, u32) {
        let new = count.wrapping_sub(*taken);
        let stamp = |number: u32| self.0.get(number as usize % RING).map_or(0, |stamp| stamp.load(Relaxed));
        let (next, later) = take::<EDGE_COUNT>(edges, began, *taken, count, stamp);
        *taken = next;
        (new, later)
    }
}

/// Moves the stamps of both lines: those of the gate, how many there were, when the first came that belongs to the next block; then how
/// many of the high comparator. Both in one call, out of the way of the task's registers.
#[inline(never)]
fn take_both(block: &mut GapBlock, began: u32, [gate, high]: &mut [u32; 2], counts: [u32; 2]) -> ([u32; 2], u32) {
    let (gates, later) = GATE.take(&mut block.gate_edges, began, gate, counts[0]);
    let (highs, _) = HIGH.take(&mut block.high_edges, began, high, counts[1]);
    ([gates, highs], later)
}

/// Items written since the stream was enabled, modulo the ring.
#[inline(always)]
fn written<const N: usize>() -> u32 {
    (RING as u32).wrapping_sub(dma::left::<N>()) % RING as u32
}

/// The edge timer and its rings.
pub struct Edges {
    tim: pac::TIM8,
    /// Edges that are in blocks already: of gate and high comparator, modulo the ring; and rises of the low one.
    taken: [u32; 2],
    lows: u32,
    /// With the newest block.
    seen: Seen,
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
        Ok(Edges { tim, taken: [0; 2], lows: 0, seen: Seen::default(), _pins: pins, _streams: streams })
    }

    /// The timer, for the time base to start.
    pub fn timer(&self) -> &pac::TIM8 {
        &self.tim
    }

    /// The lines now. At the beginning of the work on a block; [`Edges::fill`] takes it at least [`SETTLED`] cycles later.
    #[inline]
    pub fn look(&self) -> GateSample {
        GateSample {
            counts: [written::<2>(), written::<4>()],
            levels: lines::gate_and_high(),
            now: self.tim.cnt().read().bits(),
        }
    }

    /// The edges of the block just completed, and which of its conversions lie in the on-time. Once a block, after its last
    /// conversion and before the next block's.
    #[inline]
    pub fn fill(&mut self, mut look: GateSample, block: &mut GapBlock) {
        let lows = written::<7>();
        block.low_rises = (lows.wrapping_sub(core::mem::replace(&mut self.lows, lows)) % RING as u32) as u8;
        block.above_low = lines::is_above_low();
        // The levels belong to the counts only if no edge was on its way into a ring: they must still be so a little later.
        for _ in 0..LOOKS {
            let GateSample { counts, levels: [open, high], now } = look;
            // More edges than a block holds: it rings, and to tell its pulses apart would take longer than the block.
            if counts[0].wrapping_sub(self.taken[0]) as usize % RING > gap::EDGES {
                break;
            }
            if ([written::<2>(), written::<4>()], lines::gate_and_high()) == (counts, [open, high]) {
                let began = block_began(now, APERTURE_PHASE);
                let ([gates, highs], later) = take_both(block, began, &mut self.taken, counts);
                ends::calm(gates);
                block.gate_was_open = open ^ odd(gates);
                block.was_high = high ^ odd(highs);
                block.gate = gate_mask(block.gate_was_open, block.gate_edges.times(), later);
                SEEN.store(self.seen.word(), Relaxed);
                self.seen = self.seen.block(self.taken, block);
                return;
            }
            look = self.look();
            cortex_m::asm::delay(SETTLED);
        }
        // A gate that never rests, or rings, is no gate.
        ends::calm(u32::MAX);
        self.forget();
        (block.gate, block.gate_edges.count, block.high_edges.count) = (0, 0, 0);
    }

    /// Blocks were lost: what the rings hold may be older than the wrap.
    pub fn forget(&mut self) {
        self.taken = [written::<2>(), written::<4>()];
    }
}

/// Looks at a line that changes before it is taken for noise. Of a gate of 100 kHz and its comparator a look in ten finds an edge on
/// its way: three looks lost six blocks of 10 000 where pulses and blocks kept step (simulated).
const LOOKS: u32 = 10;

/// Cycles in which an edge reaches the ring: longer than the input filter and a DMA transfer.
const SETTLED: u32 = 32;

/// The lines at a moment: edges so far and levels of gate and high comparator, edge timer.
#[derive(Clone, Copy)]
pub struct GateSample {
    counts: [u32; 2],
    levels: [bool; 2],
    now: u32,
}

#[inline(always)]
fn odd(count: u32) -> bool {
    count & 1 == 1
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
    let crossed = HIGH.newest(high, 1);
    // Of the two newest edges of the gate, the one nearer before the crossing.
    let gate_to_high = age(crossed, GATE.newest(gate, 1)).min(age(crossed, GATE.newest(gate, 2)));
    Captures { gate, high, low, gate_to_high }
}

/// Edges of the high comparator and rises of the low one so far, modulo [`EDGE_COUNT`].
pub fn comparators() -> [u8; 2] {
    [written::<4>() as u8, written::<7>() as u8]
}

/// Edges of the high comparator so far, modulo [`EDGE_COUNT`]: for the end of a pulse.
#[inline(always)]
pub(super) fn high_edges() -> u32 {
    written::<4>()
}

/// Stamp of the newest of so many edges of the high comparator.
#[inline(always)]
pub(super) fn high_at(edges: u32) -> u32 {
    HIGH.newest(edges, 1)
}

/// Stamp of the newest but one of so many edges of the gate.
#[inline(always)]
pub(super) fn gate_before(edges: u32) -> u32 {
    GATE.newest(edges, 2)
}

/// Which edges are too old for their stamps.
#[inline(always)]
pub(super) fn seen() -> Seen {
    Seen::of(SEEN.load(Relaxed))
}

/// Count of the edge timer.
#[inline(always)]
pub(super) fn now() -> u32 {
    // SAFETY: the register block is always there, and reading the counter changes nothing.
    let tim8 = unsafe { &*pac::TIM8::ptr() };
    tim8.cnt().read().bits()
}

/// Edges of the gate so far, modulo [`EDGE_COUNT`]: for the reflex and the end of a pulse, which must not share a lock with the gap task.
#[inline(always)]
pub fn gate_edges() -> u32 {
    written::<2>()
}
