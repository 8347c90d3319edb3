//! Pins and their modes (RM0090 8.4).
//!
//! Each function consumes the pin and gives back what it has become. They run at start-up only, with interrupts off.

use super::{change, pac, put};
use crate::board::Pin as Place;
use crate::board::gpio::{Carries, Pin, Ports};
use core::convert::Infallible;
use embedded_hal::digital::{ErrorType, InputPin, OutputPin};

/// An input. Which one is part of the type: reading it is a load from a constant address.
pub struct Input<const P: char, const N: u8>(());
/// A push-pull output.
pub struct Output<const P: char, const N: u8>(());

const INPUT: u32 = 0b00;
const OUTPUT: u32 = 0b01;
const ALTERNATE: u32 = 0b10;
const ANALOG: u32 = 0b11;

/// The port registers; taking them by value makes sure that the pins exist once.
pub type Gpio = (pac::GPIOA, pac::GPIOB, pac::GPIOC, pac::GPIOD, pac::GPIOE);

/// Clocks the ports and hands out their pins.
pub fn ports(_gpio: Gpio, rcc: &pac::RCC) -> Ports {
    // GPIOA to GPIOE.
    change!(rcc.ahb1enr(), clear 0, set 0b1_1111);
    Ports::new()
}

/// Registers of a pin's port.
#[inline(always)]
pub(super) fn port(pin: Place) -> &'static pac::gpioa::RegisterBlock {
    // The ports lie side by side (RM0090 2.3); a pin's port is A to E because only those are handed out.
    let offset = (pac::GPIOB::ptr().addr() - pac::GPIOA::ptr().addr()) * (pin.port as usize - 'A' as usize);
    let address = pac::GPIOA::ptr().wrapping_byte_add(offset);
    // SAFETY: the register blocks are there for ever and alike from port to port. Configuration is written at start-up only;
    // after it, only the input register and the set-reset register are used, where a store changes nothing but the pins it
    // names.
    unsafe { &*address }
}

fn mode(pin: Place, mode: u32) {
    let shift = 2 * pin.number;
    change!(port(pin).moder(), clear 0b11 << shift, set mode << shift);
}

/// Gives the pin to the function that it carries.
pub fn alternate<F, const P: char, const N: u8>(_pin: Pin<P, N>)
where
    Pin<P, N>: Carries<F>,
{
    let pin = Pin::<P, N>::PIN;
    let (shift, af) = (4 * (pin.number % 8), u32::from(<Pin<P, N> as Carries<F>>::AF));
    if pin.number < 8 {
        change!(port(pin).afrl(), clear 0xF << shift, set af << shift);
    } else {
        change!(port(pin).afrh(), clear 0xF << shift, set af << shift);
    }
    mode(pin, ALTERNATE);
}

/// Makes the pin an input of a converter or an output of the DAC.
pub fn analog<const P: char, const N: u8>(_pin: Pin<P, N>) {
    mode(Pin::<P, N>::PIN, ANALOG);
}

/// Makes the pin an input, without a pull of its own: the board has one.
pub fn input<const P: char, const N: u8>(_pin: Pin<P, N>) -> Input<P, N> {
    mode(Pin::<P, N>::PIN, INPUT);
    Input(())
}

/// Makes the pin an output that is low before it drives.
pub fn output_low<const P: char, const N: u8>(_pin: Pin<P, N>) -> Output<P, N> {
    low(Pin::<P, N>::PIN);
    mode(Pin::<P, N>::PIN, OUTPUT);
    Output(())
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

impl<const P: char, const N: u8> ErrorType for Input<P, N> {
    type Error = Infallible;
}

impl<const P: char, const N: u8> InputPin for Input<P, N> {
    #[inline]
    fn is_high(&mut self) -> Result<bool, Infallible> {
        Ok(is_high(Pin::<P, N>::PIN))
    }

    #[inline]
    fn is_low(&mut self) -> Result<bool, Infallible> {
        self.is_high().map(|high| !high)
    }
}

impl<const P: char, const N: u8> ErrorType for Output<P, N> {
    type Error = Infallible;
}

impl<const P: char, const N: u8> OutputPin for Output<P, N> {
    #[inline]
    fn set_low(&mut self) -> Result<(), Infallible> {
        low(Pin::<P, N>::PIN);
        Ok(())
    }

    #[inline]
    fn set_high(&mut self) -> Result<(), Infallible> {
        high(Pin::<P, N>::PIN);
        Ok(())
    }
}
