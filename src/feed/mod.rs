//! Feed laws: how fast to go along the path, given the gap.
//!
//! *Gap error* is the filtered gap voltage less its setpoint: positive when the gap is too wide. A law answers with a path
//! velocity, positive (feed) when the error is positive, negative (retreat) when it is negative. Limits come after the law,
//! in [`Limiter`], so every law has the same ones.
//!
//! Another law is another file and one line in [`laws!`](self).

mod fixed_rate;
mod increment_by_error;
mod limiter;
mod rate_by_error;

pub use fixed_rate::FixedRate;
pub use increment_by_error::IncrementByError;
pub use limiter::{Limiter, Limits};
pub use rate_by_error::RateByError;

use crate::units::{MicrometresPerSecond, Volts};

/// Turns a gap error into a path velocity, once every few servo ticks.
pub trait FeedLaw {
    /// Path velocity from now on; `ticks` have passed since the last call.
    fn velocity(&mut self, error: Volts, ticks: u32) -> MicrometresPerSecond;
}

macro_rules! laws {
    ($($(#[$doc:meta])* $law:ident),+ $(,)?) => {
        /// The law in force.
        #[derive(Clone, Copy, Debug, PartialEq)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub enum Law {
            $($(#[$doc])* $law($law),)+
        }

        impl FeedLaw for Law {
            fn velocity(&mut self, error: Volts, ticks: u32) -> MicrometresPerSecond {
                match self { $(Law::$law(law) => law.velocity(error, ticks),)+ }
            }
        }
    };
}

laws! {
    /// Section 6.7.1 of \[R\].
    FixedRate,
    /// Section 6.7.2 of \[R\].
    RateByError,
    /// Section 6.7.3 of \[R\], the default.
    IncrementByError,
}
