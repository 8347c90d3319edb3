//! What a servo tick sees, and what it wants of the hardware.

use super::Fault;
use super::probe::ProbeInputs;
use crate::units::{Fixed, Nanometres, Volts};
use edm_hal_shim::bridge::Drive;
use edm_hal_shim::encoder::RawCount;
use edm_hal_shim::safety::{DriveCodes, SafetyInputs};

/// A set point that a SYNC releases.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SetPoint {
    /// Where.
    pub to: Nanometres,
    /// The same in counts.
    pub counts: Fixed,
    /// Servo ticks in which it is to be reached.
    pub ticks: u32,
}

/// What a servo tick sees.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TickInput {
    /// The count that the loops use.
    pub encoder: RawCount,
    /// Ticks of uninterrupted short, of the newest gap reading.
    pub short_ticks: u32,
    /// With pulses off: electrode and work touch.
    pub touches: bool,
    /// Filtered gap voltage, if there is a valid one; where [`Follower::wants_gap`](super::Follower::wants_gap) says so.
    pub gap: Option<Volts>,
    /// For the touch probes, where [`Follower::probes`](super::Follower::probes) says so.
    pub sight: ProbeInputs,
    /// Motor current and bus voltage.
    pub drive: DriveCodes,
    /// Safety inputs, if any of them is unsafe.
    pub safety: Option<SafetyInputs>,
    /// The reflex has begun a retreat since the tick before.
    pub reflex: bool,
    /// A fault that another task has found.
    pub reported: Option<Fault>,
    /// A SYNC has released it.
    pub set_point: Option<SetPoint>,
    /// Somebody wants something of the planner.
    pub asked: bool,
}

/// What the tick wants of the world until the next one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TickOutput {
    /// To the H-bridge.
    pub drive: Drive,
    /// To the generator: pulses allowed.
    pub pulses: bool,
    /// The planner is to be given an estimate.
    pub hands_over: bool,
    /// A plan has come into force, or was late.
    pub begins: bool,
}
