//! Gap sources: converter codes in, one [`GapReading`] out.
//!
//! *Gap voltage* is the voltage between electrode and workpiece. Under good sparking its mean lies between the burn
//! voltage and the open-circuit voltage, and falls as the gap closes because the ignition delay shortens; a short reads
//! zero (Roberts). A source averages, filters and judges; it does not decide what the head does about it.
//!
//! Another source is another file that implements [`GapSource`], and its `mod` line.

mod blend;
pub mod charging;
pub mod controlled;
mod gated;
mod gates;
pub mod likelihood;
mod open_circuit;
mod pulse_watch;
pub mod pulses;
pub mod senses;
mod surrogate;
pub mod teach;
pub mod voltage;

pub use open_circuit::OpenCircuit;
pub use pulse_watch::{PulseFault, PulseSeen, PulseWatch, Sight};
pub use surrogate::{Config as SurrogateConfig, Surrogate};
pub use voltage::Voltage;

use crate::units::Volts;
use edm_hal_shim::gap::GapBlock;

/// How far a reading can be trusted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Quality {
    /// Nothing was converted since the last reading.
    #[default]
    Missing,
    /// Fit for control.
    Valid,
    /// Gated source: no on-time within the hold limit; the last value is held.
    NoGate,
    /// Converter at the end of its range.
    Saturated,
    /// Voltage of the wrong sign: the gap leads are swapped.
    Reversed,
    /// What burns cannot be told from the open circuit.
    Unclear,
}

/// What a gap source knows at a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct GapReading {
    /// Gap voltage after low-pass and notch; what the feed law sees.
    pub filtered: Volts,
    /// Gap voltage of this block before the filters (held through off-time by a gated source).
    pub block: Volts,
    /// Mean of the blocks of the last whole millisecond: what a reader slower than the blocks is told, whatever the pulses.
    pub mean: Volts,
    /// How far to trust them.
    pub quality: Quality,
    /// The block has no gate and almost no voltage: with pulses off, the sense supply shows that electrode and work touch.
    /// Never where no sense supply is fitted.
    pub touches: bool,
    /// Servo ticks for which the gap was short, without interruption; off-time neither begins nor ends a run
    /// but counts as time once the run has begun, up to the hold limit: a generator that suspends its pulses after
    /// shorts (Roberts) must not lengthen the run. Unfiltered: this is the fast path to a retreat.
    pub short_ticks: u32,
    /// Newest code of the converter, of which noise changes the last bits; 0 where there is none.
    pub code: u16,
    /// By which share the same gap reads higher than with the average at power-up; 0 until that is changed between pulses.
    pub regauged: f32,
    /// Every pulse since the start, by class, up to the end of the newest block.
    pub pulses: pulses::Counts,
}

/// Turns blocks of conversions into readings; one file a source.
pub trait GapSource {
    /// Takes the newest block (`None` when the front end had none) and gives the reading for this tick.
    fn update(&mut self, block: Option<&GapBlock>) -> GapReading;
}
