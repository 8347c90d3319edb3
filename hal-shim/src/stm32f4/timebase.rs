//! One start for tick, conversions and edge stamps.
//!
//! TIM1 (servo tick) starts TIM3 (trigger of ADC1) and TIM8 (edge stamps) by its enable; all three divide the same clock,
//! so their phases never drift. The counters are preset so that a block of conversions is complete 6 us
//! before the tick: the gap task is done when the servo task begins.

use super::{change, pac, put, reset};
use crate::board::{ADC, CORE_HZ, EDGE_MODULUS, GAP_SAMPLING, SAMPLE, SERVO, SUPERVISE};
use crate::edges::TRIGGER_TO_END;
use crate::tick::Period;

/// Cycles from the end of a block's last conversion to the servo tick: 6 us, the deadline of the gap task.
const HEADSTART: u32 = 3 * SAMPLE_CYCLES;
/// Cycles from one conversion to the next.
const SAMPLE_CYCLES: u32 = 2 * SAMPLE.steps() as u32;
/// Cycles from a trigger to the end of its conversion.
const CONVERSION: u32 = GAP_SAMPLING.sequence_cycles * (CORE_HZ / ADC.hz);
/// Count of TIM1 at the last trigger of a block.
const LAST_TRIGGER: u32 = SERVO.steps() as u32 - HEADSTART - CONVERSION;
/// Count of TIM1, and of TIM8 modulo a tick, at the end of the last aperture of a block.
pub const APERTURE_PHASE: u32 = LAST_TRIGGER + TRIGGER_TO_END;

/// Trigger mode, from internal trigger 0, which is TIM1 for TIM3 and for TIM8 (RM0090 tables 93 and 97).
const SLAVE: u32 = 0b110;

/// Configures TIM3. Its update is its trigger output, and triggers ADC1.
pub fn trigger(tim: &pac::TIM3, rcc: &mut pac::RCC) {
    reset::<pac::TIM3>(rcc);
    put!(tim.psc(), u32::from(SAMPLE.prescaler));
    put!(tim.arr(), SAMPLE.reload);
    put!(tim.egr(), 1);
    // After the update that loaded the registers, which must not trigger a conversion.
    put!(tim.cr2(), 0b010 << 4);
    put!(tim.smcr(), SLAVE);
}

/// Starts everything. Converters and DMA must wait for their first trigger already.
///
/// The first trigger after the start must be the first of a block, so TIM1 starts just after the last trigger of the block
/// that is not there.
pub fn start(trigger: &pac::TIM3, stamps: &pac::TIM8) {
    // SAFETY: TIM1 belongs to the bridge, which nobody uses yet: interrupts are off. Counter and enable only.
    let tim1 = unsafe { &*pac::TIM1::ptr() };
    let begin = (LAST_TRIGGER + SAMPLE_CYCLES / 2) % SERVO.steps() as u32;
    put!(tim1.cnt(), begin);
    put!(stamps.cnt(), begin % EDGE_MODULUS);
    put!(trigger.cnt(), SAMPLE.steps() as u32 / 2);
    // Auto-reload preloaded, counter enabled.
    change!(tim1.cr1(), clear 0, set 1 << 7 | 1);
}

/// Supervision at 1 kHz.
pub struct Millisecond(pac::TIM7);

impl Millisecond {
    /// Starts the timer and its interrupt.
    pub fn new(tim: pac::TIM7, rcc: &mut pac::RCC) -> Self {
        reset::<pac::TIM7>(rcc);
        put!(tim.psc(), u32::from(SUPERVISE.prescaler));
        put!(tim.arr(), SUPERVISE.reload);
        put!(tim.egr(), 1);
        put!(tim.sr(), 0);
        put!(tim.dier(), 1);
        put!(tim.cr1(), 1);
        Millisecond(tim)
    }
}

impl Period for Millisecond {
    fn begins(&mut self) -> bool {
        let begins = self.0.sr().read().bits() & 1 != 0;
        put!(self.0.sr(), 0);
        begins
    }
}
