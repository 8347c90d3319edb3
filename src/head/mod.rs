//! The machine: states, fault reactions, supervision; wires the rooms together.

use crate::gap::GapReading;
use edm_hal_shim::bridge::Drive;
use edm_hal_shim::encoder::RawCount;
use edm_hal_shim::safety::{DriveCodes, SafetyInputs};

/// Everything the servo tick sees of the world.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TickInput {
    /// Newest gap reading.
    pub gap: GapReading,
    /// Position counter that the loops use.
    pub encoder: RawCount,
    /// Second counter on the same lines, where both are wired.
    pub watch: Option<RawCount>,
    /// Illegal transitions seen by the decoder since power-up, wrapping.
    pub illegal_transitions: u32,
    /// Safety inputs.
    pub safety: SafetyInputs,
    /// Motor current and bus voltage.
    pub drive: DriveCodes,
}

/// What the tick wants of the world until the next one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TickOutput {
    /// To the H-bridge.
    pub drive: Drive,
    /// To the generator: pulses allowed.
    pub pulses: bool,
}
