//! The pins of the board, and those that must be reached without owning them.

use super::hal::gpio::{self, GpioExt};
use super::{pac, put};
use crate::board::Pin as Place;
use crate::board::gpio::Ports;

/// An input without a pull of its own: the board has one. Which pin is part of the type: reading it is a load from a constant
/// address.
pub type Input<const P: char, const N: u8> = gpio::Pin<P, N, gpio::Input>;
/// A push-pull output.
pub type Output<const P: char, const N: u8> = gpio::Pin<P, N, gpio::Output>;

/// The port registers; taking them by value makes sure that the pins exist once.
pub type Gpio = (pac::GPIOA, pac::GPIOB, pac::GPIOC, pac::GPIOD, pac::GPIOE);

/// Clocks the ports, puts them back to their reset state and hands out their pins.
pub fn ports((a, b, c, d, e): Gpio, rcc: &mut pac::RCC) -> Ports {
    Ports { gpioa: a.split(rcc), gpiob: b.split(rcc), gpioc: c.split(rcc), gpiod: d.split(rcc), gpioe: e.split(rcc) }
}

/// Registers of a pin's port.
#[inline(always)]
pub(super) fn port(pin: Place) -> &'static pac::gpioa::RegisterBlock {
    // The ports lie side by side (RM0090 2.3); a pin's port is A to E because only those are handed out.
    let offset = (pac::GPIOB::ptr().addr() - pac::GPIOA::ptr().addr()) * (pin.port as usize - 'A' as usize);
    let address = pac::GPIOA::ptr().wrapping_byte_add(offset);
    // SAFETY: the register blocks are there for ever and alike from port to port. Only the input register and the set-reset
    // register are used through this reference, where a store changes nothing but the pins it names.
    unsafe { &*address }
}

#[inline(always)]
pub(super) fn high(pin: Place) {
    put!(port(pin).bsrr(), 1 << pin.number);
}

#[inline(always)]
pub(super) fn low(pin: Place) {
    put!(port(pin).bsrr(), 1 << (pin.number + 16));
}

#[inline(always)]
pub(super) fn is_high(pin: Place) -> bool {
    port(pin).idr().read().bits() >> pin.number & 1 == 1
}
