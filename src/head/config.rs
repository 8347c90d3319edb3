//! What the head's tick runs: built from the settings, swapped whole.

use super::follow::FollowConfig;
use super::{commissioning, ends, identify, inch, jump, orbit, restraint, steps, supervise, touch, tune};
use crate::encoder::{MarkSpacing, PlausibilityLimits};
use crate::feed::{Law, Limits};
use crate::gap::controlled::Controlled;
use crate::kept::parts;
use crate::path::AXES;
use crate::servo::{CurrentLimits, Gains, PidGains, Plant, PreslidingConfig};
use crate::units::{
    Amps, CountsPerSecond, Fixed, Micrometres, MicrometresPerSecond, MicrometresPerSecond2, Nanometres, Seconds, Volts,
};

/// How the gap error becomes a duty (\[R\] sections 6.6 and 6.7, in the order they were built).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Structure {
    /// Gap error -> PID -> duty.
    SingleLoop,
    /// Gap error -> velocity -> velocity loop.
    VelocityCascade,
    /// Gap error -> path coordinate -> setpoint -> position and velocity loop.
    Path,
}

/// The gap voltage to keep.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Setpoint {
    /// So many volts.
    Volts(Volts),
    /// A share of the open-circuit voltage measured when the seek began.
    ShareOfOpen(f32),
}

impl Setpoint {
    /// In volts, where the open circuit is known; none of a voltage not measured yet.
    pub fn volts(&self, open_circuit: Volts) -> Volts {
        match self {
            Setpoint::Volts(volts) => *volts,
            Setpoint::ShareOfOpen(share) => Volts(open_circuit.0 * share),
        }
    }
}

/// Approach until sparks begin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seek {
    /// Path velocity.
    pub velocity: MicrometresPerSecond,
    /// The work is found when the gap voltage falls below this share of open circuit.
    pub threshold: f32,
    /// Time at rest, to measure the open-circuit voltage.
    pub settle: Seconds,
    /// Lowest open-circuit voltage to accept.
    pub open_min: Volts,
}

/// Going back from a short.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Retreat {
    /// Servo ticks of uninterrupted short before the retreat begins.
    pub trigger: u32,
    /// Path velocity, positive.
    pub velocity: MicrometresPerSecond,
    /// Counts to go back at least.
    pub clearance: i64,
    /// Length to go back at most; still shorted there means a persistent short.
    pub limit: Fixed,
    /// Servo ticks after which a short is persistent.
    pub persistent: u32,
    /// Safe height: length behind the point where the work was found.
    pub safe: Fixed,
    /// Length to retract off an open lower limit switch.
    pub off_limit: Fixed,
    /// Where it leads instead of back along the path.
    pub escape: Option<Escape>,
}

/// The line that a retreat from a short takes off the path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Escape {
    /// Where it leads at the most, from where it begins, nm: down, X, Y.
    pub by: [i32; AXES],
    /// Travel of the axis on the way back, counts per um of the line.
    pub down: f32,
}

/// What the head lifts with when it cannot or must not close the loop: duties that are never toward the work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lift {
    /// Duty that lifts: weight plus 20 %, and friction, but no more than `limited` beyond the holding duty.
    pub duty: f32,
    /// Duty that holds afterwards: weight plus 10 %.
    pub hold: f32,
    /// Servo ticks of lifting at the most.
    pub ticks: u32,
    /// Largest force of a force-limited retract, as a duty on either side of the holding duty.
    pub limited: f32,
    /// Bus voltage below which lifting on stored energy ends.
    pub bus_dead: Volts,
}

/// Motion toward the work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// A sense supply shows a contact.
    pub sensed: bool,
    /// Largest velocity with pulses off where the axis has not been since the loop was closed.
    pub approach: CountsPerSecond,
    /// Largest duty at rest while the gap leads: weight, friction, and what the electrode may press into what does not
    /// conduct, or into the work when no sense shows it.
    pub press: f32,
}

/// The axis as wired.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// The actuator.
    pub plant: Plant,
    /// Loop gains.
    pub gains: Gains,
    /// Encoder counts per um.
    pub counts_per_um: f32,
    /// nm per encoder count.
    pub nm_per_count: i64,
    /// What the scale's index marks promise.
    pub marks: MarkSpacing,
    /// When the encoder is not believed.
    pub plausibility: PlausibilityLimits,
    /// Encoder counts down when moving toward the work.
    pub encoder_reversed: bool,
    /// A positive duty moves away from the work.
    pub motor_reversed: bool,
    /// Largest duty either way.
    pub duty_limit: f32,
    /// What the winding may carry.
    pub current: CurrentLimits,
    /// Upper and lower end of the travel once homed.
    pub travel: (Nanometres, Nanometres),
    /// Length to retract off an open limit switch, counts.
    pub off_limit: i64,
    /// Length that an unhomed head may go back past the point of enabling.
    pub escape: Micrometres,
    /// Motor current per converter code about mid-scale.
    pub amps_per_code: Amps,
    /// Bus voltage per converter code.
    pub bus_per_code: Volts,
}

impl Axis {
    /// A length in counts, fractions included.
    pub fn counts(&self, length: Nanometres) -> Fixed {
        let limit = Fixed::MAX_WHOLE;
        let scaled = Fixed::whole(length.0.clamp(-limit, limit));
        Fixed(scaled.0.checked_div(self.nm_per_count).unwrap_or(0))
    }

    /// Whether a loop may stay closed from this one to another: all but gains, limit of the duty and clearance is the same.
    pub fn is_wired_as(&self, other: &Axis) -> bool {
        Axis { gains: other.gains, duty_limit: other.duty_limit, off_limit: other.off_limit, ..*self } == *other
    }
}

/// Everything the head's tick runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Gap voltage to keep.
    pub setpoint: Setpoint,
    /// What is kept at its set point.
    pub controlled: Controlled,
    /// Share of the error of another controlled variable that fades in a plan.
    pub transfer: f32,
    /// Shape of the loop.
    pub structure: Structure,
    /// Law that leads while eroding, unless the single loop does.
    pub law: Law,
    /// Gains of the single loop, duty per volt.
    pub single: PidGains,
    /// Limits of path velocity under a feed law.
    pub limits: Limits,
    /// Change of path velocity in every motion.
    pub acceleration: MicrometresPerSecond2,
    /// Motion toward the work with pulses off.
    pub contact: Contact,
    /// Search for a surface.
    pub touch: touch::Config,
    /// Approach.
    pub seek: Seek,
    /// Retreat.
    pub retreat: Retreat,
    /// Jump.
    pub jump: jump::Config,
    /// What is made of a depth instead of a straight line.
    pub orbit: Option<orbit::Config>,
    /// How a coarse axis carries the head.
    pub inch: inch::Config,
    /// How steps of a host move the axis.
    pub step: steps::Config,
    /// End of an erosion.
    pub ends: ends::Config,
    /// Open-loop lift.
    pub lift: Lift,
    /// Friction that is compensated along the path.
    pub presliding: PreslidingConfig,
    /// The axis.
    pub axis: Axis,
    /// Limits of the supervision.
    pub supervise: supervise::Limits,
    /// What may push toward the work without counts.
    pub restraint: restraint::Config,
    /// Commissioning.
    pub commissioning: commissioning::Config,
    /// Identification.
    pub identify: identify::Config,
    /// Tuning.
    pub tune: tune::Config,
    /// Whether commissioning has passed with these settings.
    pub commissioned: bool,
}

parts!(it: Config {
    setpoint, controlled, transfer, structure, law, single, limits, acceleration, contact, touch, seek, retreat, jump, orbit, inch, step, ends, lift, presliding, axis,
    supervise, restraint, commissioning, identify, tune, commissioned,
} by
    [it.setpoint, it.structure, it.limits, it.acceleration, it.contact, it.touch],
    [it.law, it.controlled, it.transfer],
    [it.single, it.commissioned],
    [it.seek],
    [it.retreat],
    [it.jump, it.orbit, it.inch, it.step, it.ends],
    [it.lift, it.presliding, it.restraint],
    [it.axis],
    [it.supervise],
    [it.commissioning, it.identify, it.tune],
);

impl Config {
    /// What the follower runs.
    pub fn follow(&self) -> FollowConfig {
        FollowConfig {
            gains: self.axis.gains,
            single: self.single,
            encoder_reversed: self.axis.encoder_reversed,
            motor_reversed: self.axis.motor_reversed,
            trigger: self.retreat.trigger,
        }
    }

    /// What the supervision looks at and judges by.
    pub fn supervision(&self) -> supervise::Config {
        let axis = &self.axis;
        supervise::Config {
            limits: self.supervise,
            plant: axis.plant,
            current: axis.current,
            plausibility: axis.plausibility,
            marks: axis.marks,
            encoder_reversed: axis.encoder_reversed,
            motor_reversed: axis.motor_reversed,
            amps_per_code: axis.amps_per_code,
            bus_per_code: axis.bus_per_code,
        }
    }
}
