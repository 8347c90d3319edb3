//! The machine: states, fault reactions, supervision; wires the rooms together.
//!
//! [`Head::tick`] is the servo task, 20 000 times a second. [`Supervisor::tick`] judges, once a millisecond, what no single
//! tick can; its verdict comes back through [`Head::raise`]. Commands come in between ticks.

mod command;
mod commissioning;
mod config;
mod fault;
mod machine;
mod measure;
mod permit;
mod positioning;
mod proof;
mod reaction;
mod schedule;
mod state;
mod supervise;
mod trajectory;

pub use command::{Command, Refused};
pub use commissioning::{Config as CommissioningConfig, Finding, Report};
pub use config::{Axis, Config, Lift, Retreat, Seek, Setpoint, Structure};
pub use fault::{Fault, Reaction};
pub use machine::Head;
pub use permit::WritePermit;
pub use positioning::{Home, HomingState, MotionLimits};
pub use state::{Change, ChangeLog, Reason, State};
pub use supervise::{Limits as SupervisionLimits, Supervisor};

use crate::encoder::Snapshot;
use crate::gap::GapReading;
use crate::servo::BackEmf;
use crate::units::{Amps, CountsPerSecond, Fixed, MicrometresPerSecond, Volts};
use edm_hal_shim::bridge::Drive;
use edm_hal_shim::encoder::RawCount;
use edm_hal_shim::safety::{DriveCodes, SafetyInputs};

/// Everything the servo tick sees of the world.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TickInput {
    /// Newest gap reading; between plans ([`Head::wants_gap`]) only its short ticks need be new.
    pub gap: GapReading,
    /// Edge decoder: the count that the loops use. Marks and illegal transitions matter only where
    /// [`Head::looks_at_encoder`] says so.
    pub encoder: Snapshot,
    /// Second counter on the same lines, where both are wired; matters there, too.
    pub watch: Option<RawCount>,
    /// Safety inputs, if any of them is unsafe.
    pub safety: Option<SafetyInputs>,
    /// Motor current and bus voltage.
    pub drive: DriveCodes,
    /// The reflex has begun a retreat since the tick before.
    pub reflex: bool,
}

/// What the tick wants of the world until the next one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TickOutput {
    /// To the H-bridge.
    pub drive: Drive,
    /// To the generator: pulses allowed.
    pub pulses: bool,
    /// The tick did more than its loop: only then can the state have changed, or [`Head::has_looked`] be true.
    pub more: bool,
}

/// What the head knows after a tick: for supervision, hosts and reports.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Status {
    /// Servo tick, wrapping.
    pub tick: u32,
    /// State.
    pub state: State,
    /// The fault whose reaction runs: the newest that was more urgent than the one before.
    pub fault: Option<Fault>,
    /// The fault that this began with. It is another one than `fault` when a second fault has escalated the reaction.
    pub first: Option<Fault>,
    /// The loop is closed over the encoder, in whatever state: the supervision has to judge it.
    pub closed: bool,
    /// Measured position, counts.
    pub position: i64,
    /// Axis setpoint, counts.
    pub setpoint: Fixed,
    /// Setpoint less position, counts.
    pub following: f32,
    /// Measured velocity.
    pub velocity: CountsPerSecond,
    /// Path coordinate, um.
    pub path: Fixed,
    /// Gap reading of this tick.
    pub gap: GapReading,
    /// Gap voltage to keep.
    pub gap_setpoint: Volts,
    /// Open-circuit voltage measured when the seek began.
    pub open_circuit: Volts,
    /// Duty, positive toward the work.
    pub duty: f32,
    /// The duty is at its limit.
    pub saturated: bool,
    /// Motor current, positive toward the work.
    pub current: Amps,
    /// Bus voltage.
    pub bus: Volts,
    /// Second opinion on the velocity.
    pub back_emf: BackEmf,
    /// Safety inputs of this tick.
    pub safety: SafetyInputs,
    /// Illegal encoder transitions since power-up, wrapping.
    pub illegal_transitions: u32,
    /// Absolute positions mean something.
    pub homed: bool,
    /// How homing stands.
    pub homing: HomingState,
    /// Velocity along the path that the state or its feed law asks for, within the law's limits; while positioning, that of
    /// the set point.
    pub feed: MicrometresPerSecond,
    /// Segments waiting behind the one under way.
    pub waiting: u16,
    /// The winding is hot: only its continuous current is allowed.
    pub current_reduced: bool,
}
