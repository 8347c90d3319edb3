//! The pins as types, and which function each can carry.
//!
//! A pin exists once and is moved into the part that uses it. What it may be connected to is a trait: a timer that takes
//! `impl Carries<Tim1Ch1>` cannot be given any other pin, and learns the number of the alternate function from it
//! (data sheet DS8626, table 9).

/// A pin of the chip that nobody has configured yet.
pub struct Pin<const P: char, const N: u8>(());

impl<const P: char, const N: u8> Pin<P, N> {
    /// Where it is.
    pub const PIN: super::Pin = super::Pin { port: P, number: N };
}

macro_rules! ports {
    ($($port:ident $letter:literal { $($field:ident $Pin:ident $number:literal),+ $(,)? })+) => {
        /// The ports that a board may use.
        #[allow(missing_docs, reason = "a field a port")]
        pub struct Ports {
            $(pub $port: $port::Parts,)+
        }

        impl Ports {
            /// All pins. On the chip only the part that owns the port registers makes them.
            #[cfg_attr(not(target_arch = "arm"), doc(hidden))]
            #[cfg(not(target_arch = "arm"))]
            pub const fn marker() -> Self {
                Self::new()
            }

            #[allow(dead_code, reason = "without a board there is nobody to make them")]
            pub(crate) const fn new() -> Self {
                Ports { $($port: $port::Parts { $($field: Pin(()),)+ },)+ }
            }
        }

        $(
            /// A port.
            pub mod $port {
                $(
                    /// A pin.
                    pub type $Pin = super::Pin<$letter, $number>;
                )+
                /// Its pins.
                #[allow(missing_docs, reason = "a field a pin")]
                pub struct Parts {
                    $(pub $field: $Pin,)+
                }
            }
            pub use $port::{$($Pin),+};
        )+
    };
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

/// A pin that can carry a function.
///
/// ```
/// # use edm_hal_shim::board::gpio::{Carries, PA8, PA9, Tim1Ch1};
/// fn pwm<P: Carries<Tim1Ch1>>() {}
/// pwm::<PA8>();
/// ```
/// ```compile_fail
/// # use edm_hal_shim::board::gpio::{Carries, PA8, PA9, Tim1Ch1};
/// # fn pwm<P: Carries<Tim1Ch1>>() {}
/// pwm::<PA9>();
/// ```
pub trait Carries<F> {
    /// Number of the alternate function.
    const AF: u8;
}

macro_rules! functions {
    ($($(#[$doc:meta])* $Function:ident $af:literal: $($Pin:ident),+;)+) => {$(
        $(#[$doc])*
        pub enum $Function {}
        $(impl Carries<$Function> for $Pin {
            const AF: u8 = $af;
        })+
    )+};
}

functions! {
    /// TIM1 channel 1.
    Tim1Ch1 1: PA8, PE9;
    /// TIM1 break input.
    Tim1Bkin 1: PA6, PB12, PE15;
    /// TIM4 channel 2.
    Tim4Ch2 2: PB7, PD13;
    /// TIM5 channel 1.
    Tim5Ch1 2: PA0;
    /// TIM5 channel 2.
    Tim5Ch2 2: PA1;
    /// TIM8 channel 1.
    Tim8Ch1 3: PC6;
    /// TIM8 channel 3.
    Tim8Ch3 3: PC8;
    /// TIM8 channel 4.
    Tim8Ch4 3: PC9;
    /// CAN1 reception.
    Can1Rx 9: PA11, PB8, PD0;
    /// CAN1 transmission.
    Can1Tx 9: PA12, PB9, PD1;
}
