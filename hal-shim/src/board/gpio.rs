//! The pins as types.
//!
//! A pin exists once and is moved into the part that uses it: used twice, it does not compile. On the chip these are the
//! pins of stm32f4xx-hal, which also know which function each can carry; on a PC, where there is no chip to configure,
//! types of the same names stand for them, so that a clash does not compile there either.

/// On the chip.
#[cfg(all(target_arch = "arm", feature = "chip"))]
pub use stm32f4xx_hal::gpio::{Pin, gpioa, gpiob, gpioc, gpiod, gpioe};

/// A pin as an input, which all are after a reset but those that an unused debug port has.
#[cfg(all(target_arch = "arm", feature = "chip"))]
pub fn input<const P: char, const N: u8, M: stm32f4xx_hal::gpio::PinMode>(pin: Pin<P, N, M>) -> Pin<P, N> {
    pin.into_mode()
}

/// The ports that a board may use.
#[cfg_attr(not(target_arch = "arm"), derive(Default))]
#[allow(missing_docs, reason = "a field a port")]
pub struct Ports {
    pub gpioa: gpioa::Parts,
    pub gpiob: gpiob::Parts,
    pub gpioc: gpioc::Parts,
    pub gpiod: gpiod::Parts,
    pub gpioe: gpioe::Parts,
}

#[cfg(not(all(target_arch = "arm", feature = "chip")))]
mod names {
    /// A pin of the chip that nobody has configured yet.
    #[derive(Default)]
    pub struct Pin<const P: char, const N: u8>(());

    /// A pin as an input, which all are here.
    pub fn input<const P: char, const N: u8>(pin: Pin<P, N>) -> Pin<P, N> {
        pin
    }

    macro_rules! ports {
        ($($port:ident $letter:literal { $($field:ident $Pin:ident $number:literal),+ $(,)? })+) => {$(
            /// A port.
            pub mod $port {
                $(
                    /// A pin.
                    pub type $Pin = super::Pin<$letter, $number>;
                )+
                /// Its pins.
                #[derive(Default)]
                #[allow(missing_docs, reason = "a field a pin")]
                pub struct Parts {
                    $(pub $field: $Pin,)+
                }
            }
        )+};
    }

    // Without PA13 and PA14, which are the debugger's.
    ports! {
        gpioa 'A' {
            pa0 PA0 0, pa1 PA1 1, pa2 PA2 2, pa3 PA3 3, pa4 PA4 4, pa5 PA5 5, pa6 PA6 6, pa7 PA7 7,
            pa8 PA8 8, pa9 PA9 9, pa10 PA10 10, pa11 PA11 11, pa12 PA12 12, pa15 PA15 15,
        }
        gpiob 'B' {
            pb0 PB0 0, pb1 PB1 1, pb2 PB2 2, pb3 PB3 3, pb4 PB4 4, pb5 PB5 5, pb6 PB6 6, pb7 PB7 7,
            pb8 PB8 8, pb9 PB9 9, pb10 PB10 10, pb11 PB11 11, pb12 PB12 12, pb13 PB13 13, pb14 PB14 14, pb15 PB15 15,
        }
        gpioc 'C' {
            pc0 PC0 0, pc1 PC1 1, pc2 PC2 2, pc3 PC3 3, pc4 PC4 4, pc5 PC5 5, pc6 PC6 6, pc7 PC7 7,
            pc8 PC8 8, pc9 PC9 9, pc10 PC10 10, pc11 PC11 11, pc12 PC12 12, pc13 PC13 13, pc14 PC14 14, pc15 PC15 15,
        }
        gpiod 'D' {
            pd0 PD0 0, pd1 PD1 1, pd2 PD2 2, pd3 PD3 3, pd4 PD4 4, pd5 PD5 5, pd6 PD6 6, pd7 PD7 7,
            pd8 PD8 8, pd9 PD9 9, pd10 PD10 10, pd11 PD11 11, pd12 PD12 12, pd13 PD13 13, pd14 PD14 14, pd15 PD15 15,
        }
        gpioe 'E' {
            pe0 PE0 0, pe1 PE1 1, pe2 PE2 2, pe3 PE3 3, pe4 PE4 4, pe5 PE5 5, pe6 PE6 6, pe7 PE7 7,
            pe8 PE8 8, pe9 PE9 9, pe10 PE10 10, pe11 PE11 11, pe12 PE12 12, pe13 PE13 13, pe14 PE14 14, pe15 PE15 15,
        }
    }
}
#[cfg(not(all(target_arch = "arm", feature = "chip")))]
pub use names::{Pin, gpioa, gpiob, gpioc, gpiod, gpioe, input};
