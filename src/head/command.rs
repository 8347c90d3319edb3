//! What a host may ask, and why it may be refused. A refused command changes nothing.

use super::fault::Fault;
use super::inch::Carry;
use super::positioning::{Home, MotionLimits};
use super::probe::{PROBES, Probe};
use super::state::State;
use crate::path::{self, Piece};
use crate::units::{MicrometresPerSecond, MicrometresPerSecond2, Nanometres, Newtons};
use core::fmt;

/// A request from host, keyboard or test.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Command {
    /// Close the loop where the head is. After a lost encoder, a wrong polarity or a following error the encoder has to prove
    /// itself first, by a small move.
    Enable,
    /// Open the loop; the mechanics hold.
    Disable,
    /// Declare the present position.
    SetHome(Nanometres),
    /// Queue a straight move to a position.
    MoveTo(Nanometres),
    /// Queue a straight move by a distance, from the end of the queue.
    MoveBy(Nanometres),
    /// Queue a piece of path that ends at a position; X and Y are the host's.
    AppendTo(Piece),
    /// Queue a piece of path that ends as far away from the end of the queue.
    AppendBy(Piece),
    /// Forget the queue; the path begins anew where the axis is.
    ClearPath,
    /// Move to a position on a profile, pulses off unless the head is guided. A new target may be given on the way.
    Position(Nanometres, MotionLimits),
    /// The same, to touch: contact with the work is its end, and not a fault. It goes back from there by the clearance of a
    /// retreat.
    Touch(Nanometres, MotionLimits),
    /// Find the surface of the work: touch it twice, no farther away than this; 0 is the whole way to the end of the travel.
    FindSurface(Nanometres),
    /// Reach a host's next set point in so many servo ticks, pulses off unless the head is guided. Those of a stream may be late
    /// by half of them.
    Follow(Nanometres, u32),
    /// Follow the steps of a host from here on, between two positions, pulses off. While they are followed: other bounds.
    Step(Nanometres, Nanometres),
    /// The steps of a host become path from here on, along which the head erodes. Anything that ends the erosion but its end ends it.
    Record,
    /// Look for a reference. Not while pulses are on, nor with a path to go.
    Home(Home),
    /// What the touch probes are to do from now on, whatever the head does. One that is armed anew has another number.
    Probe([Probe; PROBES]),
    /// Add this force, positive toward the work, while a stream of set points is followed.
    Push(Newtons),
    /// Come to rest with this deceleration, pulses off, and hold.
    Brake(MicrometresPerSecond2),
    /// Pulses on; seek the work and erode along the queue.
    Start,
    /// Pulses on; report the feed that the gap asks for, and continue with [`Follow`](Command::Follow) and
    /// [`Position`](Command::Position): a host keeps the path. From a short the head goes straight up, and comes back to where the
    /// host is then.
    Guide,
    /// While eroding: straight up and back, pulses off meanwhile.
    Jump,
    /// What the coarse axis that carries the head has done. To a head that has asked it is the answer; one at rest takes it as where
    /// it is now.
    Carry(Carry),
    /// Pulses off; hold the position. A jump comes back before, and a head that waits for the coarse axis when its host has answered.
    Hold,
    /// Commission: check encoder, motor, gap and stroke.
    Commission,
    /// Measure motor, mass and friction: straight up over the travel of `identify.travel_um`, and back.
    Identify,
    /// Measure the frequency response of the loop: straight up over the travel of `tune.travel_um`, and back.
    Tune,
    /// Acknowledge a fault whose cause is gone and whose reaction has ended. A head that was lifted without its
    /// encoder has no home any more; what casts doubt on the encoder is not gone before it has proved itself.
    ResetFault,
}

/// Why a command was refused.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Refused {
    /// Not in this state.
    State(State),
    /// Commissioning has not passed since the settings it depends on were changed.
    NotCommissioned,
    /// An absolute move needs a home.
    NotHomed,
    /// The target lies outside the travel.
    OutOfTravel {
        /// Target asked for.
        target: Nanometres,
        /// Upper end of the travel.
        min: Nanometres,
        /// Lower end of the travel.
        max: Nanometres,
    },
    /// The path does not take it; while its queue is full, try again when a segment is done.
    Path(path::Refused),
    /// Steps come already: from which of them on they were followed nobody would know.
    StepsCome,
    /// Nothing queued.
    NoPath,
    /// The cause of this fault is still there.
    StillFaulty(Fault),
    /// The reaction to this fault still moves the head.
    Reacting(Fault),
    /// Settings are being stored.
    Storing,
    /// A fault has cast doubt on the encoder: it has to prove itself first, which it does when the head is enabled.
    Doubted(Fault),
    /// A path is under way or queued: where it has got to is no reference.
    PathActive,
    /// Other axes follow a path coordinate, and this `feed.structure` has none.
    Alone,
    /// No sense supply is fitted that would show a contact.
    NoSense,
    /// The work would be touched faster than what may be stopped by it.
    TooFast {
        /// Velocity of the first touch.
        velocity: MicrometresPerSecond,
        /// Largest velocity toward the work.
        most: MicrometresPerSecond,
    },
    /// A jump, an identification or a tuning would lead beyond the upper end of the travel.
    NoRoom {
        /// Its height.
        height: Nanometres,
        /// What is free above the head.
        free: Nanometres,
    },
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Refused::State(state) => write!(f, "not possible while {}", state.name()),
            Refused::NotCommissioned => f.write_str("commissioning (commission) has not passed yet"),
            Refused::NotHomed => {
                f.write_str("an absolute move, a jump, an identification or a tuning needs a homed axis")
            }
            Refused::OutOfTravel { target, min, max } => {
                write!(f, "target {} um is outside the travel of {} to {} um", target.um().0, min.um().0, max.um().0)
            }
            Refused::Path(refused) => write!(f, "{refused}"),
            Refused::StepsCome => f.write_str("steps come already: they have to rest for 10 ms"),
            Refused::NoPath => f.write_str("no move is queued"),
            Refused::StillFaulty(fault) => write!(f, "the cause is still there: {}", fault.name()),
            Refused::Reacting(fault) => write!(f, "the reaction to {} still moves the head", fault.name()),
            Refused::Storing => f.write_str("settings are being stored"),
            Refused::PathActive => f.write_str("a path is under way or queued: clear it first"),
            Refused::Alone => f.write_str("only with feed.structure = path other axes go along"),
            Refused::NoRoom { height, free } => {
                write!(
                    f,
                    "a motion of {:.0} um upward is longer than the {:.0} um that are free above",
                    height.um().0,
                    free.um().0
                )
            }
            Refused::NoSense => f.write_str("no contact is sensed: contact.below_v is 0"),
            Refused::TooFast { velocity, most } => write!(
                f,
                "a touch at {:.0} um/s is faster than the {:.0} um/s of contact.approach_mm_s",
                velocity.0, most.0
            ),
            Refused::Doubted(fault) => write!(f, "after {} the head has to be enabled first", fault.name()),
        }
    }
}

impl core::error::Error for Refused {}
