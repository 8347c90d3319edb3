//! The pins of the board, and those that must be reached without owning them.

use super::hal::gpio::{self, GpioExt};
use super::{Board, pac, put};
use crate::board::Pin as Place;
use crate::board::gpio::Ports;
use crate::self_test::SelfTest;

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
    // SAFETY: the register blocks are always there and alike from port to port. Only the input register, the set-reset
    // register, where a store changes nothing but the pins it names, and the lock register are used through this reference.
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

/// Two inputs of one port, at one moment.
#[inline(always)]
pub(super) fn levels(one: Place, other: Place) -> [bool; 2] {
    let levels = port(one).idr().read().bits();
    [levels >> one.number & 1 == 1, levels >> other.number & 1 == 1]
}

/// What could drive, or let pulses through.
const DRIVING: [Place; 6] = [
    Board::TABLE.pin("allow_pulses"),
    Board::TABLE.pin("forward"),
    Board::TABLE.pin("reverse"),
    Board::TABLE.pin("pwm"),
    Board::TABLE.pin("live"),
    Board::TABLE.pin("arm"),
];

/// Keeps what could drive as it is until the next reset: inputs, as after the last one, whatever a damaged program does.
pub fn bar() {
    for place in DRIVING {
        let same_port = DRIVING.iter().filter(|other| other.port == place.port);
        lock(place, same_port.fold(0, |pins, other| pins | 1 << other.number));
    }
}

/// Keeps every pin what it is until the next reset. The short path and whatever switches off write levels, which are not
/// locked.
pub fn freeze() -> SelfTest {
    let locked = ['A', 'B', 'C', 'D', 'E'].map(|port| lock(Place { port, number: 0 }, 0xFFFF));
    if locked == [true; 5] { SelfTest::PASSED } else { SelfTest::UNLOCKED }
}

/// The lock key, with the read that ends it (RM0090 8.4.8). Whether the port is locked now; it is once until a reset.
fn lock(place: Place, pins: u32) -> bool {
    const KEY: u32 = 1 << 16;
    let register = port(place).lckr();
    for value in [KEY | pins, pins, KEY | pins] {
        put!(register, value);
    }
    register.read();
    register.read().bits() & KEY != 0
}
