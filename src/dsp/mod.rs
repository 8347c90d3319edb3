//! Filters of the servo tick: coefficients and state apart.
//!
//! Everything here runs at [`TICK_HZ`](crate::units::TICK_HZ) in f32, by additions and multiplications that every IEEE
//! machine rounds alike (no fused multiply-add, no f64, no division in a tick), so the chip, its model and the PC give
//! the same bits. Coefficients are built between ticks.

pub mod chain;
pub mod decimate;
pub mod svf;
pub mod tracking;

use core::fmt;

/// A parameter that a filter or a gap source cannot be built with.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct OutOfRange {
    /// Which parameter, and its unit.
    pub name: &'static str,
    /// Smallest value, included.
    pub min: f32,
    /// Largest value, included.
    pub max: f32,
}

impl fmt::Display for OutOfRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} must be from {} to {}", self.name, self.min, self.max)
    }
}

impl core::error::Error for OutOfRange {}

/// Refuses what lies outside `min..=max`; a NaN lies outside everything.
pub(crate) fn in_range(name: &'static str, value: f32, min: f32, max: f32) -> Result<f32, OutOfRange> {
    if (min..=max).contains(&value) { Ok(value) } else { Err(OutOfRange { name, min, max }) }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::string::ToString;

    #[test]
    fn both_ends_of_a_range_belong_to_it_and_nothing_beyond_or_unordered_does() {
        assert_eq!(in_range("x", 1.0, 1.0, 2.0), Ok(1.0));
        assert_eq!(in_range("x", 2.0, 1.0, 2.0), Ok(2.0));
        for bad in [1.0_f32.next_down(), 2.0_f32.next_up(), f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert_eq!(in_range("x", bad, 1.0, 2.0), Err(OutOfRange { name: "x", min: 1.0, max: 2.0 }));
        }
    }

    #[test]
    fn the_error_says_what_is_allowed() {
        let error = in_range("corner (Hz)", 5.0, 20.0, 2000.0).unwrap_err();
        assert_eq!(error.to_string(), "corner (Hz) must be from 20 to 2000");
    }
}
