//! Registers that are written once, and stay: a bit that flips in one stops a timer, a stream or a task without a word. And the code
//! that was copied into RAM, which has no parity.

use super::fast::Copied;
use super::flash::access_is_settled;
use super::pac;
use crate::self_test::Registers as Contract;

/// Reads the register of a place, the bits of it that stay; `None` behind the last.
macro_rules! registers {
    ($($block:ident: $($register:ident $(& $mask:expr)?),+;)+) => {
        fn register(place: usize) -> Option<u32> {
            let mut turn = 0..;
            $({
                // SAFETY: the register block is always there, and reading one of these changes nothing.
                let block = unsafe { &*pac::$block::ptr() };
                $(if turn.next() == Some(place) {
                    return Some(block.$register().read().bits() $(& $mask)?);
                })+
            })+
            None
        }

        const REGISTERS: usize = [$($(stringify!($block, $register),)+)+].len();
    };
}

/// Lines of the encoder, which a storm of edges masks for a while.
const STORM: u32 = 0b111;
/// Main output enable, which a fault of the bridge clears.
const MOE: u32 = 1 << 15;
/// Which way the encoder goes.
const DIRECTION: u32 = 1 << 4;
/// Software starts, which end by themselves.
const STARTS: u32 = 1 << 30 | 1 << 22;

registers! {
    TIM1: cr1, cr2, dier, psc, arr, ccer, bdtr & !MOE;
    TIM2: cr1, smcr, ccmr1_input, ccmr2_input, ccer, dier, arr;
    TIM3: cr1, cr2, smcr, psc, arr;
    TIM4: smcr, ccmr1_input, ccmr2_output, ccer;
    TIM5: cr1 & !DIRECTION, smcr, ccmr1_input, ccer, arr;
    TIM6: dier, psc;
    TIM7: cr1, dier, psc, arr;
    TIM8: cr1, smcr, ccmr1_input, ccmr2_input, ccer, dier, arr;
    ADC1: cr1, cr2 & !STARTS, smpr1, smpr2, sqr1, sqr3;
    ADC2: cr1, cr2 & !STARTS, smpr1, smpr2, sqr1, sqr3;
    ADC3: cr1, cr2 & !STARTS, smpr1, smpr2, jsqr;
    DAC: cr;
    EXTI: imr & !STORM, rtsr, ftsr;
    SYSCFG: memrmp, exticr1, exticr2, exticr3, exticr4;
    RCC: cfgr, ahb1enr, apb1enr, apb2enr;
    FLASH: acr;
    PWR: cr;
}

/// Configuration of the streams of DMA2 in use, and of that of DMA1.
fn stream(n: usize) -> Option<u32> {
    // SAFETY: as above.
    let dma = unsafe { &*pac::DMA2::ptr() };
    let stream = match n {
        0 => dma.st(0),
        1 => dma.st(2),
        2 => dma.st(3),
        3 => dma.st(4),
        4 => dma.st(7),
        // SAFETY: as above.
        5 => unsafe { &*pac::DMA1::ptr() }.st(1),
        _ => return None,
    };
    Some(stream.cr().read().bits())
}
const STREAMS: usize = 6;

/// Interrupts of the chip that are enabled, 32 to a register (RM0090 table 62).
fn enabled(n: usize) -> Option<u32> {
    // SAFETY: as above.
    let nvic = unsafe { &*pac::NVIC::PTR };
    let ends = super::ends::INTERRUPT as usize;
    let switched = if n == ends / 32 { 1 << (ends % 32) } else { 0 };
    Some(nvic.iser.get(n)?.read() & !switched)
}
const COUNT: usize = REGISTERS + STREAMS + 3;

fn look(place: usize) -> u32 {
    let further = place.saturating_sub(REGISTERS);
    let other = |n: usize| stream(n).or_else(|| enabled(n.saturating_sub(STREAMS)));
    register(place).or_else(|| other(further)).unwrap_or(0)
}

/// One register after the other, all of them in some ninety looks.
pub struct Registers {
    place: usize,
    /// Of what was seen in this round so far.
    sum: u32,
    /// That of the whole first round, with everything running.
    first: Option<u32>,
    code: Copied,
}

impl Registers {
    /// None has been looked at.
    pub(super) const fn new() -> Registers {
        Registers { place: 0, sum: 0, first: None, code: Copied::NEW }
    }
}

impl Contract for Registers {
    fn is_intact(&mut self) -> bool {
        if !self.code.is_intact() {
            return false;
        }
        if !access_is_settled() {
            return true;
        }
        // One that differs makes another sum, wherever it is.
        self.sum = self.sum.rotate_left(5) ^ look(self.place);
        self.place += 1;
        if self.place < COUNT {
            return true;
        }
        let round = core::mem::take(&mut self.sum);
        self.place = 0;
        *self.first.get_or_insert(round) == round
    }
}
