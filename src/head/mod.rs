//! The machine: estimate, plan, follow; states, fault reactions, supervision.
//!
//! ```text
//!               encoder, drive                    gap reading, commands
//!                    |                                    |
//! servo tick   estimate -> follow -> duty     plan task: states, law, limits, path
//! 20 kHz           |          ^               2 or 4 kHz  |         ^
//!                  |          +---- plan, two ticks later-+         |
//!                  +--------------- estimate of a tick -------------+
//! ```
//!
//! Each has a state of its own and sees of the others only what is handed over: [`Estimate`] down, [`Plan`] up, [`Measured`] to
//! the [`Supervisor`], which looks at drive and encoder once a millisecond, checks what no single tick can, and reports
//! [`Monitored`] values and faults. On chip and PC each runs in its task; [`Head`] composes them for one thread.

mod command;
mod commissioning;
mod compose;
mod config;
mod ends;
mod estimate;
mod fault;
mod follow;
mod guide;
mod identified;
mod identify;
mod inch;
mod jump;
mod orbit;
mod permit;
mod plan;
mod planner;
mod positioning;
mod probe;
mod proof;
mod reaction;
mod restraint;
mod rhythm;
mod route;
mod silence;
mod state;
mod steps;
mod supervise;
mod tick;
mod touch;
mod trajectory;
mod transfer;
mod tune;

pub use command::{Command, Refused};
pub use commissioning::{Config as CommissioningConfig, Contradiction, Finding, Report, Weighed};
pub use compose::{Head, Inputs};
pub use config::{Axis, Config, Contact, Escape, Lift, Retreat, Seek, Setpoint, Structure};
pub use ends::Config as EndsConfig;
pub use estimate::{Estimate, Estimator, Sums};
pub use fault::{Fault, Reaction};
pub use follow::{FollowConfig, Follower, LEAD};
pub use guide::Guidance;
pub use identified::{Identified, Scale};
pub use identify::{Config as IdentifyConfig, Stage, Summed};
pub use inch::{Carry, Config as InchConfig, Inch, SeenBy};
pub use jump::Config as JumpConfig;
pub use orbit::{Config as OrbitConfig, OrbitShape};
pub use permit::WritePermit;
pub use plan::{Hazards, Plan, Touch};
pub use planner::{Evidence, Planner};
pub use positioning::{Home, HomingState, MotionLimits};
pub use probe::{Edge, Latched, PROBES, Probe, ProbeInputs, Source, Wanted};
pub use restraint::{Config as RestraintConfig, Truth, strike};
pub use rhythm::Config as JumpRhythm;
pub use state::{Change, ChangeLog, Reason, State, TRANSITIONS};
pub use steps::{Config as StepConfig, Unfollowed};
pub use supervise::{
    Breakaway, Config as SupervisionConfig, Counters, Limits as SupervisionLimits, Measured, Monitored, Row, Supervisor,
};
pub use tick::{SetPoint, TickInput, TickOutput};
pub use touch::{Config as TouchConfig, Search};
pub use trajectory::{Follow, Trajectory};
pub use tune::{Config as TuneConfig, POINTS, Point, Step as TuneStep, WORDS as POINT_WORDS};

use crate::gap::GapReading;
use crate::gap::senses::Senses;
use crate::path::Bound;
use crate::servo::BackEmf;
use crate::units::{Amps, CALM_TICKS, CountsPerSecond, Fixed, MicrometresPerSecond, Volts};
use edm_hal_shim::safety::SafetyInputs;

/// Ticks that a plan counts since the one before at the most: a head that was stalled continues from where it is.
const TICKS_MOST: u32 = 2 * CALM_TICKS;

/// What the head knows after a plan: for hosts and reports.
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
    /// The reaction to a fault still moves the head: it cannot be reset.
    pub reacting: bool,
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
    /// Times that the path has begun anew.
    pub paths: u32,
    /// Set points of X and Y when the newest plan comes into force, um.
    pub beside: [Fixed; 2],
    /// What has ended the newest working retreat that ran out of path, since the start; a fault keeps it.
    pub retreat_ended: Option<Bound>,
    /// Newest gap reading.
    pub gap: GapReading,
    /// What its pulses say of the gap.
    pub senses: Senses,
    /// Gap error that the feed law was given last.
    pub gap_error: Volts,
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
    /// Safety inputs.
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
    /// Plans that were late since power-up, wrapping.
    pub late_plans: u32,
    /// The set point is held back: toward the work, where the axis has not been, it may only go at the approach velocity.
    pub approaching: bool,
    /// Position of the newest contact that was asked for, counts.
    pub touched: i64,
    /// Position at which the gap was first the one to keep on the newest path that has led to work, counts.
    pub found: i64,
    /// How the newest search for a surface stands, and the counts by which the axis was beyond the place found.
    pub search: Search,
    /// See [`search`](Status::search).
    pub overshoot: u32,
    /// What the touch probes have kept.
    pub probes: [Latched; PROBES],
    /// The newest jump that was due in this erosion was lower than it is set to be, or left out, for want of room above or of a home.
    pub cramped: bool,
    /// How it stands to a host that guides it.
    pub guidance: Guidance,
    /// What an identification does.
    pub stage: Stage,
    /// What a tuning does.
    pub tunes: TuneStep,
    /// Set points of a guiding host that were late, since power-up, wrapping.
    pub late_set_points: u32,
    /// How it stands to the coarse axis.
    pub inch: Inch,
    /// Distance by which the coarse axis has carried the head since the home was found, counts, as the head counts it.
    pub carried: i64,
    /// The same by the host's scale of the coarse axis, and where that was asked to go last.
    pub coarse: i64,
    /// See [`coarse`](Status::coarse).
    pub carry_to: i64,
    /// Moves of the coarse axis that the head has gone on after, since power-up, wrapping.
    pub inches: u32,
    /// How much farther than asked it has moved, as the newest touch of the bottom says, counts.
    pub inch_error: i64,
    /// Why the steps of a host, which were to be followed last, are not.
    pub unfollowed: Unfollowed,
    /// They become path, and the head takes more of them.
    pub records: bool,
    /// See [`records`](Status::records); also while they are followed.
    pub takes_steps: bool,
}
