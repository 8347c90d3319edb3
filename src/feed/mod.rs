//! Feed laws: how fast to go along the path, given the gap.
//!
//! *Gap error* is the filtered gap voltage less its setpoint: positive when the gap is too wide. A law answers with a path
//! velocity, positive (feed) when the error is positive, negative (retreat) when it is negative. Limits come after the law,
//! in [`Limiter`], so every law has the same ones.
//!
//! Another law is a file here, a line in [`laws!`](self) and its settings: CONTRIBUTING.md.

mod limiter;

pub use limiter::{Limiter, Limits};

use crate::units::{MicrometresPerSecond, Volts};

/// Turns a gap error into a path velocity, at every plan while the head erodes or is guided.
///
/// A law starts again from its numbers after each seek, retreat and jump.
pub trait FeedLaw {
    /// Path velocity until the next call, um/s: positive feeds, negative retreats. `error` is the gap error, positive when the
    /// gap is too wide; `ticks` servo ticks of 50 us have passed since the last call: 5, or fewer after an urgent event.
    /// [`Limits`] apply to the answer.
    fn velocity(&mut self, error: Volts, ticks: u32) -> MicrometresPerSecond;
}

/// Declares the laws: `number file::Law;`. The file's name is the law's name to a host, the number its value on CAN: numbers
/// count from 0 and, once released, stay.
macro_rules! laws {
    ($($(#[doc = $doc:literal])+ $number:literal $name:ident::$law:ident;)+) => {
        $(
            mod $name;
            pub use $name::$law;
        )+

        /// The law in force.
        #[derive(Clone, Copy, Debug, PartialEq)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub enum Law {
            $($(#[doc = $doc])+ $law($law),)+
        }

        impl FeedLaw for Law {
            fn velocity(&mut self, error: Volts, ticks: u32) -> MicrometresPerSecond {
                match self { $(Law::$law(law) => law.velocity(error, ticks),)+ }
            }
        }

        /// A law by name, before it has its numbers.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum LawName {
            $($(#[doc = $doc])+ $law = $number,)+
        }

        impl LawName {
            /// Every law, by number.
            pub const ALL: &'static [LawName] = &[$(LawName::$law),+];
            /// Their names, by number.
            pub const NAMES: &'static [&'static str] = &[$(stringify!($name)),+];

            /// The law with the numbers that it takes of `settings`.
            pub fn build<'a, S>(self, settings: &'a S) -> Law
            where
                $($law: From<&'a S>,)+
            {
                match self { $(LawName::$law => Law::$law(settings.into()),)+ }
            }
        }
    };
}

laws! {
    /// Section 6.7.1 of \[R\].
    0 fixed_rate::FixedRate;
    /// Section 6.7.2 of \[R\].
    1 rate_by_error::RateByError;
    /// Section 6.7.3 of \[R\], the default.
    2 increment_by_error::IncrementByError;
    /// 2TAV of \[G\]; with `feed.band_v` = 0 its 1TAV.
    3 two_thresholds::TwoThresholds;
}
