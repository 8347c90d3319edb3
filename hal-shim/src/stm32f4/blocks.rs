//! ADC1: the gap voltage at a fixed rate, in blocks of one tick, moved by DMA.

use super::dma::{FULL, HALF, INTERRUPT_HALVES, Stream, URGENT};
use super::gate::Edges;
use super::hal::rcc::{Enable, Reset};
use super::start::{StartError, within};
use super::{Board, pac, put};
use crate::board::{ADC, CORE_HZ, GAP_SAMPLING};
use crate::gap::{BLOCK, GapBlock, GapFrontEnd};
use core::sync::atomic::{AtomicU16, Ordering::Relaxed};

/// Two blocks; the converter fills one while the other is read.
static CODES: [[AtomicU16; BLOCK]; 2] = [const { [const { AtomicU16::new(0) }; BLOCK] }; 2];

/// Place of the newest conversion of the gap voltage in the ring, from its end.
#[inline(always)]
pub(super) fn newest() -> u32 {
    super::dma::left::<0>()
}

/// Code of the conversion before the one at a place.
#[inline(always)]
pub(super) fn code_before(place: u32) -> u16 {
    const LAST: usize = 2 * BLOCK - 1;
    let codes = CODES.as_flattened();
    let place = place as usize;
    // As many are left as the ring has when it has just begun anew: the newest is then its last.
    let before = if place > LAST { LAST - 1 } else { LAST.wrapping_sub(1).wrapping_sub(place) };
    // Before the first of the ring comes its last.
    codes.get(before).or(codes.last()).map_or(0, |code| code.load(Relaxed))
}

/// Sampling time of a channel: its register and the bits in it (RM0090 13.13.4).
pub(super) fn sampling(adc: &pac::adc1::RegisterBlock, channel: u32, smpr: u8) {
    let bits = u32::from(smpr) << (3 * (channel % 10));
    let mask = 0b111 << (3 * (channel % 10));
    if channel < 10 {
        super::change!(adc.smpr2(), clear mask, set bits);
    } else {
        super::change!(adc.smpr1(), clear mask, set bits);
    }
}

/// Resets the three converters and sets their common clock. Before any of them.
pub fn common(common: &pac::ADC_COMMON, rcc: &mut pac::RCC) {
    pac::ADC1::enable(rcc);
    pac::ADC2::enable(rcc);
    pac::ADC3::enable(rcc);
    // One reset serves all three.
    pac::ADC1::reset(rcc);
    put!(common.ccr(), u32::from(ADC.adcpre) << 16);
}

/// Switches a converter on and waits its stabilisation time, 3 us.
pub(super) fn power_up(adc: &pac::adc1::RegisterBlock) {
    super::change!(adc.cr2(), clear 0, set 1);
    cortex_m::asm::delay(3 * (CORE_HZ / 1_000_000));
}

/// Channel of an ADC from the table's words, such as ADC1_IN10.
pub(super) const fn channel(signal: &str) -> u32 {
    Board::TABLE.adc_channel(signal) as u32
}

/// The fixed-rate converter and the edge stamps that gate it.
pub struct Blocks {
    edges: Edges,
    _adc: pac::ADC1,
    stream: Stream<0>,
}

impl Blocks {
    /// Configures the converter; it waits for the trigger of the time base.
    pub fn new(adc: pac::ADC1, mut stream: Stream<0>, edges: Edges) -> Result<Self, StartError> {
        const CHANNEL: u32 = channel("gap_voltage");
        sampling(&adc, CHANNEL, GAP_SAMPLING.smpr);
        put!(adc.sqr3(), CHANNEL);
        power_up(&adc);
        stream.fill(0, INTERRUPT_HALVES | URGENT, adc.dr().as_ptr().cast_const(), CODES.as_flattened())?;
        // Rising edge of TIM3's trigger output; DMA without end.
        put!(adc.cr2(), 1 | 1 << 8 | 1 << 9 | 0b1000 << 24 | 0b01 << 28);
        Ok(Blocks { edges, _adc: adc, stream })
    }

    /// Waits for the first block: nothing may drive before the gap can be seen.
    pub fn first(&self) -> Result<(), StartError> {
        // Two ticks of 8400 cycles; a poll takes more than four.
        within(5000, || self.stream.flags() & (HALF | FULL) != 0, StartError::NoConversions)
    }

    /// The edge stamps.
    pub fn edges(&self) -> &Edges {
        &self.edges
    }
}

/// Two codes of the ring, at any of its places.
#[repr(C, packed(2))]
struct Pair(u32);

/// The codes of a block, two at a time: the compiler does not join atomics.
#[inline(always)]
fn copy(half: &[AtomicU16; BLOCK], codes: &mut [u16; BLOCK]) {
    let from = half.as_ptr().cast::<Pair>();
    let (pairs, rest) = codes.as_chunks_mut::<2>();
    for (i, pair) in pairs.iter_mut().enumerate() {
        // SAFETY: both codes are in `half`, and a word may begin at any half word (the core reads it by one instruction). Only DMA
        // writes them, which the compiler does not see: volatile.
        let Pair(word) = unsafe { from.add(i).read_volatile() };
        *pair = [word as u16, (word >> 16) as u16];
    }
    for (code, converted) in rest.iter_mut().zip(&half[2 * (BLOCK / 2)..]) {
        *code = converted.load(Relaxed);
    }
}

impl GapFrontEnd for Blocks {
    #[inline]
    fn block(&mut self, block: &mut Option<GapBlock>) {
        let flags = self.stream.flags() & (HALF | FULL);
        self.stream.clear(flags);
        let half = match flags {
            0 => return *block = None,
            HALF => &CODES[0],
            FULL => &CODES[1],
            _ => {
                // A whole block late: neither half is certain to be one block any more.
                self.edges.forget();
                return *block = None;
            }
        };
        let look = self.edges.look();
        let block = block.get_or_insert(GapBlock::EMPTY);
        copy(half, &mut block.codes);
        self.edges.fill(look, block);
    }
}
