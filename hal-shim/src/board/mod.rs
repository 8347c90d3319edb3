//! Boards: which pin carries which signal, and what of the chip is used for what.
//!
//! One table a board, made with [`board!`](crate::board!): it is at once the struct that owns the pins by type, the check that
//! nothing is used twice, and the text that documents and the firmware on a PC print. Crystal, bit rate and
//! defaults of settings that are the board's stand in it too. The pins are the same types on the chip and on a PC, so that
//! a clash fails to compile on both. Another board is a file and a line in [`boards!`](self): CONTRIBUTING.md.
//!
//! *Pull*: the resistor on the board that holds a line while the chip is in reset or dead. Outputs that could drive the
//! bridge or let pulses through are pulled to the harmless level; inputs are pulled to the unsafe reading, so that a
//! broken wire stops the head.

mod chip;
mod disc;
mod f405;
pub mod gpio;
mod table;

pub use chip::{
    ADC, ADC_HZ, APB1_HZ, APB2_HZ, BLANKING_CLOCK, BLANKING_MOST, BUS_PRESCALERS, CORE_HZ, DAC_STEPS, EDGE_MODULUS,
    FAST, FLASH_WAITS, GAP_SAMPLING, GATED_SAMPLING, LOGS, Pll, RAM_END, SAMPLE, SERVO, SHARED, STACK, STACK_GUARD,
    STREAMS, SUPERVISE, Stream, TASKS, TICK_HZ, TIMER1_HZ, TIMER2_HZ, TIMERS, Task, Timer, can_btr, pll, priority,
    write_chip,
};
pub use disc::Disc;
pub use f405::F405;
pub use table::{Pin, Row, Table};

/// Lists the boards: feature of the packages edm-hal-shim and edm-firmware, and struct.
macro_rules! boards {
    ($($feature:literal => $Board:ident,)+) => {
        /// Every board: the feature that an image for it is built with, and its table.
        pub const BOARDS: &[(&str, Table)] = &[$(($feature, $Board::TABLE)),+];

        $(
            /// The board this image is for; with a second feature of a board this does not compile.
            #[cfg(all(target_arch = "arm", feature = $feature))]
            pub type Board = $Board;
        )+
    };
}

boards! {
    "board-f405" => F405,
    "board-f407-disc" => Disc,
}

/// Declares a board: crystal in Hz, bit rate of CAN in bit/s, defaults of settings where they differ from those of
/// docs/settings.md; then for each signal a pin, what it does there, and what is connected to it outside.
///
/// ```
/// edm_hal_shim::board! {
///     pub struct Sound {
///         name: "a board without a clash",
///         crystal_hz: 8_000_000,
///         can_bit_rate: 1_000_000,
///         defaults: {},
///         a: gpioa.pa0 PA0, "TIM5_CH1, EXTI0", "";
///         b: gpiob.pb1 PB1, "GPIO, EXTI1", "";
///     }
/// }
/// Sound::new(edm_hal_shim::board::gpio::Ports::default());
/// ```
///
/// A crystal or bit rate that the clock tree cannot use exactly does not compile. A pin used twice does not compile: the second
/// use is the use of a moved value. Here `b` is on the pin of `a`:
///
/// ```compile_fail
/// edm_hal_shim::board! {
///     pub struct Clash {
///         name: "a board that uses a pin twice",
///         crystal_hz: 8_000_000,
///         can_bit_rate: 1_000_000,
///         defaults: {},
///         a: gpioa.pa0 PA0, "TIM5_CH1, EXTI0", "";
///         b: gpioa.pa0 PA0, "GPIO", "";
///     }
/// }
/// ```
///
/// Nor does an EXTI line that is used twice, here line 1:
///
/// ```compile_fail
/// edm_hal_shim::board! {
///     pub struct Clash {
///         name: "a board that uses an interrupt line twice",
///         crystal_hz: 8_000_000,
///         can_bit_rate: 1_000_000,
///         defaults: {},
///         a: gpioa.pa1 PA1, "GPIO, EXTI1", "";
///         b: gpiob.pb1 PB1, "GPIO, EXTI1", "";
///     }
/// }
/// ```
#[macro_export]
macro_rules! board {
    ($(#[$outer:meta])* $vis:vis struct $Board:ident {
        name: $name:literal,
        crystal_hz: $crystal:literal,
        can_bit_rate: $bit_rate:literal,
        defaults: { $($key:literal = $default:literal),* $(,)? },
        $($signal:ident: $port:ident.$field:ident $Pin:ident, $function:literal, $outside:literal;)+
    }) => {
        $(#[$outer])*
        #[allow(missing_docs, reason = "the table documents each signal")]
        $vis struct $Board {
            $(pub $signal: $crate::board::gpio::$port::$Pin,)+
        }

        impl $Board {
            /// The table.
            pub const TABLE: $crate::board::Table = $crate::board::Table {
                name: $name,
                crystal_hz: $crystal,
                pll: match $crate::board::pll($crystal) {
                    Some(pll) => pll,
                    None => panic!("a crystal has 4 to 26 MHz in steps of 2 MHz"),
                },
                bit_rate: match $crate::board::can_btr($bit_rate) {
                    Some(_) => $bit_rate,
                    None => panic!("a bit rate is one of edm_hal_shim::timing::can::BIT_RATES"),
                },
                defaults: &[$(($key, $default)),*],
                rows: &[$($crate::board::Row {
                    signal: stringify!($signal),
                    pin: $crate::board::Pin::parse(stringify!($Pin)),
                    function: $function,
                    outside: $outside,
                },)+],
            };

            /// Takes the pins it uses from the ports; the others can never be configured.
            pub fn new(ports: $crate::board::gpio::Ports) -> Self {
                $Board { $($signal: $crate::board::gpio::input(ports.$port.$field),)+ }
            }
        }

        const _: () = $Board::TABLE.check();
    };
}
