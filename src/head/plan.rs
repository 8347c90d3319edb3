//! Plan: what the planner decides, and prepares for what is urgent.

use super::probe::Wanted;
use super::trajectory::Trajectory;
use super::{Fault, Reaction, State};
use crate::servo::Window;
use crate::units::{CountsPerSecond, Fixed, PLAN_TICKS};
use edm_hal_shim::safety::SafetyInputs;

/// Which safety inputs are a hazard in a state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Hazards {
    /// Any at all: not while disabled.
    pub any: bool,
    /// A single limit switch: not where switches are what is looked for.
    pub limits: bool,
    /// The upper one: a head that was enabled there may leave it.
    pub upper: bool,
    /// The dielectric: with pulses.
    pub dielectric: bool,
}

impl Hazards {
    /// The most urgent fault that safety inputs show.
    pub fn hazard(&self, safety: &SafetyInputs) -> Option<Fault> {
        let upper = safety.upper_limit && self.upper;
        match safety {
            _ if !self.any => None,
            SafetyInputs { supply_low: true, .. } => Some(Fault::SupplyLow),
            SafetyInputs { bridge_fault: true, .. } => Some(Fault::BridgeFault),
            SafetyInputs { emergency_stop: true, .. } => Some(Fault::EmergencyStop),
            SafetyInputs { lower_limit: true, .. } if upper => Some(Fault::BothLimits),
            _ if upper && self.limits => Some(Fault::UpperLimit),
            SafetyInputs { lower_limit: true, .. } if self.limits => Some(Fault::LowerLimit),
            SafetyInputs { dielectric: true, .. } if self.dielectric => Some(Fault::DielectricNotOk),
            _ => None,
        }
    }
}

/// What a contact with the work means, in a motion toward it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Touch {
    /// Nothing: pulses are on, or nobody moves.
    #[default]
    Ignored,
    /// A fault.
    Fault,
    /// The end of the motion.
    End,
}

/// What the planner decides, and has made ready for what is urgent.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Plan {
    /// Of the estimate that it was made of.
    pub generation: u32,
    /// Ticks from that estimate to the next at the most.
    pub ticks: u32,
    /// What to follow.
    pub trajectory: Trajectory,
    /// Path coordinate and set point when it comes into force.
    pub path: Fixed,
    /// See [`path`](Plan::path).
    pub setpoint: Fixed,
    /// Position less the count since the start: a home.
    pub offset: i64,
    /// How often the path has begun anew: coordinates of another one mean nothing.
    pub paths: u32,
    /// How often the loop's integrator had to be cleared.
    pub resets: u32,
    /// How often the encoder was to be believed anew.
    pub trusts: u32,
    /// State that it belongs to.
    pub state: State,
    /// The loop is closed over the encoder.
    pub closed: bool,
    /// Pulses are allowed.
    pub pulses: bool,
    /// A reference is looked for: positions of index marks are wanted, and whatever is in the way is no fault.
    pub homes: bool,
    /// The head is known to be below the upper end of its travel: no stop is in its way.
    pub free: bool,
    /// Nothing shows that the work is near: see [`Measured::open`](super::Measured::open).
    pub open: bool,
    /// What the touch probes wait for.
    pub probes: Wanted,
    /// A set point that a SYNC releases may be followed, toward the work at this velocity at most.
    pub set_points: bool,
    /// See [`set_points`](Plan::set_points).
    pub toward: CountsPerSecond,
    /// By how much it may change the velocity at the most, and the tick after which the set point before it is reached.
    pub slew: CountsPerSecond,
    /// See [`slew`](Plan::slew).
    pub due: u32,
    /// What a contact means.
    pub touch: Touch,
    /// Hazards.
    pub hazards: Hazards,
    /// Reaction under way.
    pub reaction: Option<Reaction>,
    /// Fault that it is for.
    pub fault: Option<Fault>,
    /// No loop may be closed in a reaction.
    pub doubted: bool,
    /// For a short, where the state cares.
    pub retreat: Option<Trajectory>,
    /// That leaves the path: an escape.
    pub escapes: bool,
    /// For a fault whose reaction closes the loop: the way to rest; and the duties of one with limited force.
    pub stop: Trajectory,
    /// See [`stop`](Plan::stop).
    pub limited: Window,
    /// For a fault whose reaction lifts.
    pub lift: Trajectory,
}

impl Plan {
    /// Of a head that is disabled.
    pub const DISABLED: Plan = Plan {
        generation: 0,
        ticks: PLAN_TICKS,
        trajectory: Trajectory::COAST,
        path: Fixed(0),
        setpoint: Fixed(0),
        offset: 0,
        paths: 0,
        resets: 0,
        trusts: 0,
        state: State::Disabled,
        closed: false,
        pulses: false,
        homes: false,
        free: false,
        open: false,
        probes: Wanted::OFF,
        set_points: false,
        toward: CountsPerSecond(0.0),
        slew: CountsPerSecond(0.0),
        due: 0,
        touch: Touch::Ignored,
        hazards: Hazards { any: false, limits: false, upper: false, dielectric: false },
        reaction: None,
        fault: None,
        doubted: false,
        retreat: None,
        escapes: false,
        stop: Trajectory::COAST,
        limited: Window { low: 0.0, high: 0.0 },
        lift: Trajectory::COAST,
    };

    /// What is done at once about a fault, and its reaction; `None` where the one under way is as strong.
    pub(super) fn answer(&self, fault: Fault) -> Option<(Reaction, Trajectory)> {
        // A reaction that runs says itself what escalates it: the planner judges the same.
        let lifts = self.doubted && self.reaction.is_none();
        let least = if lifts { Reaction::OpenLoopLift } else { Reaction::Retrace };
        let reaction = fault.reaction().max(least);
        if self.reaction.is_some_and(|under_way| under_way >= reaction) {
            return None;
        }
        let trajectory = match reaction {
            Reaction::Coast => Trajectory::COAST,
            Reaction::OpenLoopLift | Reaction::LiftOnStored | Reaction::EmergencyLift => self.lift,
            Reaction::ForceLimitedRetract => Trajectory { window: self.limited, ..self.stop },
            _ => self.stop,
        };
        Some((reaction, trajectory))
    }
}

impl Default for Plan {
    fn default() -> Plan {
        Plan::DISABLED
    }
}
