//! Pins as markers, for a PC: the names of stm32f4xx-hal without its hardware.

use core::marker::PhantomData;

/// A pin after reset.
pub struct Input;
/// A pin that the debugger holds after reset.
pub struct Debugger;
/// A pin of a port.
pub struct Pin<const P: char, const N: u8, M = Input>(PhantomData<M>);

macro_rules! port {
    ($port:ident, $letter:literal, $($field:ident $Pin:ident $number:literal $mode:ident),+ $(,)?) => {
        /// A port.
        pub mod $port {
            use super::{Debugger, Input, Pin};
            use core::marker::PhantomData;

            $(
                /// A pin.
                pub type $Pin<M = Input> = Pin<$letter, $number, M>;
            )+
            /// All pins of the port.
            #[allow(missing_docs, reason = "a field a pin")]
            pub struct Parts {
                $(pub $field: $Pin<$mode>,)+
            }

            impl Parts {
                /// The pins of a port that exists only as types.
                pub fn marker() -> Self {
                    Parts { $($field: Pin(PhantomData),)+ }
                }
            }
            /// A port may have no pin of either kind.
            #[allow(dead_code, reason = "a port may have no pin in this mode after reset")]
            type Modes = (Input, Debugger);
        }
    };
}

port! {
    gpioa, 'A',
    pa0 PA0 0 Input,
    pa1 PA1 1 Input,
    pa2 PA2 2 Input,
    pa3 PA3 3 Input,
    pa4 PA4 4 Input,
    pa5 PA5 5 Input,
    pa6 PA6 6 Input,
    pa7 PA7 7 Input,
    pa8 PA8 8 Input,
    pa9 PA9 9 Input,
    pa10 PA10 10 Input,
    pa11 PA11 11 Input,
    pa12 PA12 12 Input,
    pa13 PA13 13 Debugger,
    pa14 PA14 14 Debugger,
    pa15 PA15 15 Debugger,
}
port! {
    gpiob, 'B',
    pb0 PB0 0 Input,
    pb1 PB1 1 Input,
    pb2 PB2 2 Input,
    pb3 PB3 3 Debugger,
    pb4 PB4 4 Debugger,
    pb5 PB5 5 Input,
    pb6 PB6 6 Input,
    pb7 PB7 7 Input,
    pb8 PB8 8 Input,
    pb9 PB9 9 Input,
    pb10 PB10 10 Input,
    pb11 PB11 11 Input,
    pb12 PB12 12 Input,
    pb13 PB13 13 Input,
    pb14 PB14 14 Input,
    pb15 PB15 15 Input,
}
port! {
    gpioc, 'C',
    pc0 PC0 0 Input,
    pc1 PC1 1 Input,
    pc2 PC2 2 Input,
    pc3 PC3 3 Input,
    pc4 PC4 4 Input,
    pc5 PC5 5 Input,
    pc6 PC6 6 Input,
    pc7 PC7 7 Input,
    pc8 PC8 8 Input,
    pc9 PC9 9 Input,
    pc10 PC10 10 Input,
    pc11 PC11 11 Input,
    pc12 PC12 12 Input,
    pc13 PC13 13 Input,
    pc14 PC14 14 Input,
    pc15 PC15 15 Input,
}
port! {
    gpiod, 'D',
    pd0 PD0 0 Input,
    pd1 PD1 1 Input,
    pd2 PD2 2 Input,
    pd3 PD3 3 Input,
    pd4 PD4 4 Input,
    pd5 PD5 5 Input,
    pd6 PD6 6 Input,
    pd7 PD7 7 Input,
    pd8 PD8 8 Input,
    pd9 PD9 9 Input,
    pd10 PD10 10 Input,
    pd11 PD11 11 Input,
    pd12 PD12 12 Input,
    pd13 PD13 13 Input,
    pd14 PD14 14 Input,
    pd15 PD15 15 Input,
}
port! {
    gpioe, 'E',
    pe0 PE0 0 Input,
    pe1 PE1 1 Input,
    pe2 PE2 2 Input,
    pe3 PE3 3 Input,
    pe4 PE4 4 Input,
    pe5 PE5 5 Input,
    pe6 PE6 6 Input,
    pe7 PE7 7 Input,
    pe8 PE8 8 Input,
    pe9 PE9 9 Input,
    pe10 PE10 10 Input,
    pe11 PE11 11 Input,
    pe12 PE12 12 Input,
    pe13 PE13 13 Input,
    pe14 PE14 14 Input,
    pe15 PE15 15 Input,
}
