//! CAN frames: the traits of the embedded-can project, as they stand.
pub use embedded_can::{ExtendedId, Frame, Id, StandardId, nb::Can};
/// What [`Can`] answers with.
pub use nb;
