//! States of the head, and why they change.

use super::fault::Fault;
use heapless::Deque;

/// State of the head.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum State {
    /// Bridge coasts, pulses off. The mechanics lift or hold the head.
    #[default]
    Disabled,
    /// Commissioning runs: open loop under its own duty limit, pulses only for its gap step.
    Commissioning,
    /// Position held, pulses off, waiting for a move.
    Ready,
    /// Pulses on, going along the path until sparks begin.
    Seeking,
    /// Pulses on, the feed law leads.
    Eroding,
    /// Pulses on, going back along the path from a short.
    Retreating,
    /// End of the path reached; position held, pulses off.
    Done,
    /// Stopped by command; position held, pulses off.
    HoldingPosition,
    /// Pulses off and latched; the fault's reaction moves or holds the head.
    Fault,
    /// Pulses off, positioning the axis: to a position, or along a host's set points.
    Positioning,
    /// Pulses off, looking for a reference; limit switches are what it may be looking for.
    Homing,
    /// Pulses on, along the set points of a host, which goes by the feed that the gap asks for.
    Guiding,
    /// Pulses off, open loop with limited force: an encoder that a fault has cast doubt on proves itself before a loop is
    /// closed over it.
    Proving,
    /// Pulses off, out of the work and back: a jump.
    Jumping,
    /// Pulses off, going back along the path after its end.
    Lifting,
    /// Pulses off, looking for the surface of the work by touching it.
    Touching,
    /// Pulses off, out of the work while a coarse axis carries the head on: the inch-worm.
    Inching,
    /// Pulses off, moving to measure motor, mass and friction, or the response of the loop: an identification or a tuning.
    Identifying,
}

impl State {
    /// Every state.
    pub const ALL: [State; 18] = [
        State::Disabled,
        State::Commissioning,
        State::Ready,
        State::Seeking,
        State::Eroding,
        State::Retreating,
        State::Done,
        State::HoldingPosition,
        State::Fault,
        State::Positioning,
        State::Homing,
        State::Guiding,
        State::Proving,
        State::Jumping,
        State::Lifting,
        State::Touching,
        State::Inching,
        State::Identifying,
    ];

    /// Name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            State::Disabled => "disabled",
            State::Commissioning => "commissioning",
            State::Ready => "ready",
            State::Positioning => "positioning",
            State::Homing => "homing",
            State::Seeking => "seeking",
            State::Eroding => "eroding",
            State::Retreating => "retreating",
            State::Guiding => "guiding",
            State::Proving => "proving",
            State::Jumping => "jumping",
            State::Lifting => "lifting",
            State::Touching => "touching",
            State::Inching => "inching",
            State::Identifying => "identifying",
            State::Done => "done",
            State::HoldingPosition => "holding_position",
            State::Fault => "fault",
        }
    }

    /// Whether the generator may pulse.
    pub const fn pulses(self) -> bool {
        matches!(self, State::Seeking | State::Eroding | State::Retreating | State::Guiding)
    }

    /// Whether an erosion is under way: with pulses, in a jump or a move of the coarse axis between them, or in the lift after them.
    pub const fn works(self) -> bool {
        self.pulses() || matches!(self, State::Jumping | State::Inching | State::Lifting)
    }

    /// Whether the axis moves by itself, off the path and with pulses off.
    pub const fn positions(self) -> bool {
        matches!(self, State::Positioning | State::Homing | State::Touching | State::Identifying)
    }

    /// Whether the head works in a closed loop: what a host may move and has to keep watch over. A fault's reaction may have
    /// closed one as well: [`Status::closed`](super::Status::closed).
    pub const fn follows(self) -> bool {
        !matches!(self, State::Disabled | State::Commissioning | State::Fault | State::Proving)
    }
}

/// Why a state was left.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Reason {
    /// Commanded: enable.
    Enabled,
    /// Commanded: disable.
    Disabled,
    /// Commanded: start.
    Started,
    /// Commanded: hold.
    Held,
    /// Commanded: axis positioning.
    Positioned,
    /// Its target is reached.
    Arrived,
    /// Electrode and work have touched, which was asked for, and are clear of each other again.
    Touched,
    /// No surface was found.
    NotTouched,
    /// Commanded: homing.
    HomingStarted,
    /// The reference was found.
    Homed,
    /// There is no reference where it could be.
    NotHomed,
    /// Commanded: enable, or commissioning, of a head whose encoder has to prove itself first.
    ProofStarted,
    /// Commanded: commissioning.
    CommissioningStarted,
    /// Commissioning came to its end.
    CommissioningEnded,
    /// Gap voltage fell below the seek threshold.
    WorkFound,
    /// A short lasted for the set time.
    Short,
    /// The short is gone and the head is clear of it.
    GapRecovered,
    /// The end of the path.
    PathEnd,
    /// A stop on the path.
    PathStop,
    /// The end of the path, where discharges have become rare.
    SparkedOut,
    /// The end of the path, where discharges continue and the time of the spark-out is over.
    SparkOutTime,
    /// Discharges have become rare before the end of the path: the electrode is through.
    BrokenThrough,
    /// Out of the work after the end of an erosion.
    Lifted,
    /// A fault.
    Fault(Fault),
    /// Commanded: fault reset.
    FaultReset,
    /// Commanded, or due: a jump.
    Jumped,
    /// Due: a jump, lower than it is set to be for want of room above.
    JumpedLow,
    /// A jump is back at the float point.
    Returned,
    /// The end of the stroke, before that of the path: the coarse axis is needed.
    StrokeEnd,
    /// The coarse axis has carried the head on.
    Carried,
    /// The host has refused to move the coarse axis.
    CarryRefused,
    /// Commanded: identification.
    IdentificationStarted,
    /// Everything is measured, and the head is back where it began.
    Identified,
    /// Commanded: tuning.
    TuningStarted,
    /// The response is measured, and the head is back where it began.
    Tuned,
}

/// Every change of state there is and what it is made for, but for two rules: a fault is entered from every state, and
/// `disable` leads from every state but a fault to disabled.
///
/// For the picture docs/pictures/states.svg. A test drives heads through all of them, and finds no other.
pub const TRANSITIONS: &[(State, State, Reason)] = &[
    (State::Disabled, State::Ready, Reason::Enabled),
    (State::Disabled, State::Proving, Reason::ProofStarted),
    (State::Disabled, State::Commissioning, Reason::CommissioningStarted),
    (State::Proving, State::Ready, Reason::Enabled),
    (State::Proving, State::Commissioning, Reason::CommissioningStarted),
    (State::Commissioning, State::Disabled, Reason::CommissioningEnded),
    (State::Ready, State::Positioning, Reason::Positioned),
    (State::Ready, State::Homing, Reason::HomingStarted),
    (State::Ready, State::Seeking, Reason::Started),
    (State::Ready, State::Guiding, Reason::Started),
    (State::Ready, State::HoldingPosition, Reason::Held),
    (State::Done, State::Positioning, Reason::Positioned),
    (State::Done, State::Homing, Reason::HomingStarted),
    (State::Done, State::Seeking, Reason::Started),
    (State::Done, State::Guiding, Reason::Started),
    (State::Done, State::HoldingPosition, Reason::Held),
    (State::HoldingPosition, State::Positioning, Reason::Positioned),
    (State::HoldingPosition, State::Homing, Reason::HomingStarted),
    (State::HoldingPosition, State::Seeking, Reason::Started),
    (State::HoldingPosition, State::Guiding, Reason::Started),
    (State::Positioning, State::Ready, Reason::Arrived),
    (State::Positioning, State::Ready, Reason::Touched),
    (State::Positioning, State::Ready, Reason::Held),
    (State::Positioning, State::Homing, Reason::HomingStarted),
    (State::Positioning, State::Guiding, Reason::Started),
    (State::Homing, State::Ready, Reason::Homed),
    (State::Homing, State::Ready, Reason::NotHomed),
    (State::Homing, State::Positioning, Reason::Held),
    (State::Ready, State::Touching, Reason::Positioned),
    (State::Done, State::Touching, Reason::Positioned),
    (State::HoldingPosition, State::Touching, Reason::Positioned),
    (State::Touching, State::Ready, Reason::Touched),
    (State::Touching, State::Ready, Reason::NotTouched),
    (State::Touching, State::Positioning, Reason::Held),
    (State::Seeking, State::Eroding, Reason::WorkFound),
    (State::Seeking, State::Retreating, Reason::Short),
    (State::Seeking, State::Done, Reason::PathEnd),
    (State::Seeking, State::Lifting, Reason::PathEnd),
    (State::Seeking, State::Done, Reason::PathStop),
    (State::Seeking, State::Lifting, Reason::PathStop),
    (State::Seeking, State::HoldingPosition, Reason::Held),
    (State::Eroding, State::Retreating, Reason::Short),
    (State::Eroding, State::Done, Reason::PathEnd),
    (State::Eroding, State::Done, Reason::PathStop),
    (State::Eroding, State::Done, Reason::SparkedOut),
    (State::Eroding, State::Done, Reason::SparkOutTime),
    (State::Eroding, State::Done, Reason::BrokenThrough),
    (State::Eroding, State::Lifting, Reason::PathEnd),
    (State::Eroding, State::Lifting, Reason::PathStop),
    (State::Eroding, State::Lifting, Reason::SparkedOut),
    (State::Eroding, State::Lifting, Reason::SparkOutTime),
    (State::Eroding, State::Lifting, Reason::BrokenThrough),
    (State::Lifting, State::Done, Reason::Lifted),
    (State::Lifting, State::HoldingPosition, Reason::Held),
    (State::Eroding, State::HoldingPosition, Reason::Held),
    (State::Eroding, State::Jumping, Reason::Jumped),
    (State::Eroding, State::Jumping, Reason::JumpedLow),
    (State::Jumping, State::Eroding, Reason::Returned),
    (State::Jumping, State::HoldingPosition, Reason::Held),
    (State::Jumping, State::Positioning, Reason::Held),
    (State::Seeking, State::Inching, Reason::StrokeEnd),
    (State::Eroding, State::Inching, Reason::StrokeEnd),
    (State::Inching, State::Seeking, Reason::Carried),
    (State::Inching, State::Eroding, Reason::Carried),
    (State::Inching, State::HoldingPosition, Reason::CarryRefused),
    (State::Inching, State::HoldingPosition, Reason::NotTouched),
    (State::Inching, State::HoldingPosition, Reason::Held),
    (State::Inching, State::Positioning, Reason::Held),
    (State::Guiding, State::Retreating, Reason::Short),
    (State::Guiding, State::HoldingPosition, Reason::Held),
    (State::Guiding, State::Positioning, Reason::Held),
    (State::Retreating, State::Seeking, Reason::GapRecovered),
    (State::Retreating, State::Eroding, Reason::GapRecovered),
    (State::Retreating, State::Guiding, Reason::GapRecovered),
    (State::Retreating, State::HoldingPosition, Reason::Held),
    (State::Ready, State::Identifying, Reason::IdentificationStarted),
    (State::Done, State::Identifying, Reason::IdentificationStarted),
    (State::HoldingPosition, State::Identifying, Reason::IdentificationStarted),
    (State::Identifying, State::Ready, Reason::Identified),
    (State::Ready, State::Identifying, Reason::TuningStarted),
    (State::Done, State::Identifying, Reason::TuningStarted),
    (State::HoldingPosition, State::Identifying, Reason::TuningStarted),
    (State::Identifying, State::Ready, Reason::Tuned),
    (State::Identifying, State::Positioning, Reason::Held),
    (State::Fault, State::Disabled, Reason::FaultReset),
];

/// One change of state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Change {
    /// Servo tick, wrapping.
    pub tick: u32,
    /// State left.
    pub from: State,
    /// State entered.
    pub to: State,
    /// Why.
    pub reason: Reason,
}

/// Changes not yet read; the oldest give way, and are counted.
#[derive(Debug, Default)]
pub struct ChangeLog {
    changes: Deque<Change, 16>,
    lost: u32,
}

impl ChangeLog {
    /// Adds a change.
    pub fn push(&mut self, change: Change) {
        while self.changes.push_back(change).is_err() {
            self.changes.pop_front();
            self.lost = self.lost.wrapping_add(1);
        }
    }

    /// Takes the oldest change.
    pub fn pop(&mut self) -> Option<Change> {
        self.changes.pop_front()
    }

    /// Changes that were never read.
    pub fn lost(&self) -> u32 {
        self.lost
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_log_keeps_the_newest_changes_and_counts_the_lost() {
        let mut log = ChangeLog::default();
        for tick in 0..20 {
            log.push(Change { tick, from: State::Ready, to: State::Seeking, reason: Reason::Started });
        }
        assert_eq!(log.lost(), 4);
        assert_eq!(log.pop().unwrap().tick, 4);
    }
}
