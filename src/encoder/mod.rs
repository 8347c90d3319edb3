//! Quadrature decoding, index marks, velocity, plausibility.
//!
//! ```text
//! edges --> Quadrature --> Shared --> DecoderCount --+--> Position --> counts, signed 64 bit
//! (interrupt)                                        +--> Velocity --> counts/s
//!                                                    +--> MarkCheck
//!                                                    +--> Plausibility <-- TimerCount <-- timer in encoder mode
//! ```
//!
//! Two counters watch the same lines. The decoder sees illegal transitions and times each edge, but an edge that is not
//! served in time is lost to it; the timer keeps up with any speed, but times nothing and notices nothing. Both are an
//! [`EdgeCounter`](edm_hal_shim::encoder::EdgeCounter) and are compared every millisecond; [`Handover`] picks the one that
//! leads.
//!
//! A count is one edge of A or B, four per encoder line; positive is toward the work, where A leads B. Raw counts wrap at
//! 32 bits and only their differences mean anything; [`Position`] alone says where the axis is.
//!
//! Trouble that \[R\] had (sections 6.6.2 and 6.7.3) and where it is made impossible: four counts lost per trip to a
//! divide-by-two (here every edge counts, both ways: [`quadrature`]), an unsigned count that ran away below zero
//! ([`position`]), a frequency that stayed high at standstill ([`velocity`]).

pub mod handover;
pub mod index;
pub mod plausibility;
pub mod position;
pub mod quadrature;
pub mod shared;
pub mod timer;
pub mod velocity;

pub use handover::Handover;
pub use index::{Mark, MarkCheck, MarkSpacing, WrongDistance};
pub use plausibility::{EncoderFault, Plausibility, PlausibilityLimits};
pub use position::Position;
pub use quadrature::{Quadrature, Seen};
pub use shared::{DecoderCount, Shared, Snapshot};
pub use timer::TimerCount;
pub use velocity::Velocity;
