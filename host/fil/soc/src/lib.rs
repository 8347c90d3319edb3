//! Model of the STM32F405 as the servo head uses it: peripherals, interrupt controller and system registers, without an
//! emulator. A processor (or a test) reads and writes registers through [`Soc::read`] and [`Soc::write`], lets time pass
//! with [`Soc::advance`] and asks [`Soc::preempting`] what to run next. The outside is a [`World`].
//!
//! Terms. A *tick* is 1/168 MHz; all times are ticks since reset. A peripheral is *due* at the tick of its next event; the
//! model jumps from event to event, so an idle peripheral costs nothing.
//!
//! Rules. What is modelled follows the reference manual RM0090 (sections are cited where a fact is used, Rev 19) and, for
//! the processor's system registers, the Armv7-M Architecture Reference Manual DDI 0403 ("ARMv7-M"). What is not modelled
//! is an [`Error`] that names peripheral, offset and access: never a silent zero. An access to a peripheral whose clock is
//! off is an error too; the chip would ignore it.
//!
//! Not modelled anywhere: synchroniser latency of timer and EXTI inputs (2..3 clocks), bus wait states, metastability,
//! and the electrical behaviour of pins.
#![forbid(unsafe_code)]

mod adc;
mod backup;
mod can;
mod core_regs;
mod crc;
mod dac;
mod dma;
mod error;
mod exti;
mod flash;
mod gpio;
mod info;
mod iwdg;
mod memory;
mod mpu;
mod nvic;
mod pins;
mod rcc;
mod soc;
mod timer;
mod world;

pub use can::Frame;
pub use core_regs::CoreRegs;
pub use error::{Access, Error, Fault};
pub use memory::{Memory, Region};
pub use nvic::{Exception, Masks, Nvic, exception};
pub use soc::{Reset, Soc};
pub use world::{CanReply, Change, Drive, Pin, World};

/// Ticks per second.
pub const TICK_HZ: u64 = 168_000_000;
/// Never.
pub const NEVER: u64 = u64::MAX;
