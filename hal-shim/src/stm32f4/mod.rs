//! The traits on an STM32F405/407. The only place with `unsafe`.
//!
//! stm32f4xx-hal gives registers, pins and their functions, clock gates and resets, interrupt lines, DAC and CAN. Clock tree,
//! DMA, flash and watchdog are written here, because the library waits for them without a bound or does not wait where it
//! must; timers and converters, because their division is computed and checked at compile time and because they trigger one
//! another, which the library does not offer.
//!
//! Each part takes the pins and peripherals it needs by value, so that nothing is configured twice. What several
//! priorities touch is atomic: reflex and stop share no lock with anyone.
//!
//! **Start-up order.** In reset, and with no CPU, every pin floats and the pulls on the board keep the bridge disabled and
//! the pulses off. [`machine::Machine::start`] looks whether the flash holds what was built, and then drives the same levels
//! before anything else is configured. The PWM's main output
//! stays off, and the pulses inhibited, until the servo task drives for the first time; it cannot before clocks, converters,
//! timers and one whole block of conversions have been seen to work.

pub mod backup;
pub mod blocks;
pub mod boot;
pub mod can;
pub mod ccm;
pub mod clocks;
pub mod copy;
pub mod critical;
pub mod cycles;
pub mod dma;
pub mod drive;
pub mod encoder;
pub mod ends;
mod exti;
mod fast;
pub mod flash;
pub mod gap_filter;
pub mod gate;
pub mod gated;
pub mod generator;
pub mod halt;
pub mod lines;
pub mod live;
pub mod machine;
pub mod panic_handler;
pub mod pins;
pub mod pwm;
pub mod registers;
pub mod safety;
pub mod self_test;
pub mod servo_lines;
pub mod stack;
pub mod stage;
pub mod start;
pub mod steps;
pub mod supply;
pub mod timebase;
pub mod watchdog;

pub use bxcan;
pub use stm32f4xx_hal as hal;
pub use stm32f4xx_hal::pac;

use hal::rcc::{Enable, Reset};

pub use crate::board::Board;

/// Clocks a peripheral and puts its registers back to their reset values (RM0090 7.3).
pub(crate) fn reset<P: Enable + Reset>(rcc: &mut pac::RCC) {
    P::enable(rcc);
    P::reset(rcc);
}

/// Writes a whole register. Not for the address registers of a DMA stream.
macro_rules! put {
    ($register:expr, $bits:expr) => {{
        let (register, bits) = (&$register, $bits);
        // SAFETY: `bits` is unsafe because the reference manual, not the type, says which values are allowed; the value is
        // one it allows, and no register but a DMA address can make the hardware touch memory.
        unsafe { register.write(|w| w.bits(bits)) };
    }};
}
pub(crate) use put;

/// Sets and clears bits of a register that only its caller writes. Not for the address registers of a DMA stream.
macro_rules! change {
    ($register:expr, clear $clear:expr, set $set:expr) => {{
        let (register, clear, set): (_, u32, u32) = (&$register, $clear, $set);
        // SAFETY: as for `put`.
        unsafe { register.modify(|r, w| w.bits(r.bits() & !clear | set)) };
    }};
}
pub(crate) use change;
