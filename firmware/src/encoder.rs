//! The encoder's interrupts: vectors beside those of RTIC.
//!
//! A task of RTIC saves BASEPRI and restores it behind a barrier, and needs a frame for that: 20 of 86 cycles, estimated, at
//! each edge. These three need neither. They own nothing that RTIC would have to hand out: the count is a static of atomics,
//! and what is left of the decoder has no bytes. `edm_hal_shim::stm32f4::encoder` gives them the priority of the task table.

use crate::chip::{Chip, Count};
use edm_hal_shim::encoder::Line;
use edm_hal_shim::stm32f4::cycles::Cycles;
use edm_hal_shim::stm32f4::encoder::Lines;
use edm_hal_shim::stm32f4::pac::interrupt;
use edm_runtime::encoder::Decoder;

/// An edge, for a decoder on the state that the assembled one has begun; of one priority, so that none comes between.
#[inline(always)]
fn edge(line: Line) {
    Decoder::<Chip>::beside(Lines::OF_VECTORS, Cycles::STARTED, Count).edge(line);
}

/// `encoder_a`. Deadline: one edge spacing, 3.3 us at 300 kcount/s. Atomics only. Cost: 0.4 us, at each edge. Late: the
/// transition reads as illegal and is counted; far above the rate the lines mask themselves and the timer leads.
#[interrupt]
fn EXTI0() {
    edge(Line::A);
}

/// `encoder_b`. As `encoder_a`.
#[interrupt]
fn EXTI1() {
    edge(Line::B);
}

/// `encoder_index`. As `encoder_a`.
#[interrupt]
fn EXTI2() {
    edge(Line::Index);
}
