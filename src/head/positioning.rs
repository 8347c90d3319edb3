//! Axis positioning, pulses off: to a position, along a host's set points, to a reference.
//!
//! The loop then follows a profile instead of the path; when it comes to rest the path begins anew where it stands. An open
//! limit switch stops motion toward it, here as everywhere; while homing, it is what is looked for and no fault.

use super::state::Reason;
use crate::motion::{Homing, Method, Outcome, Profile, Ramp, Seen, TrajectorySegment};
use crate::units::{CountsPerSecond, CountsPerSecond2, Fixed, MicrometresPerSecond, MicrometresPerSecond2, Nanometres};

/// Limits of an axis positioning, positive.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct MotionLimits {
    /// Velocity.
    pub velocity: MicrometresPerSecond,
    /// Acceleration.
    pub acceleration: MicrometresPerSecond2,
    /// Deceleration.
    pub deceleration: MicrometresPerSecond2,
}

/// How to home.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Home {
    /// What is looked for.
    pub method: Method,
    /// Velocity toward a switch.
    pub fast: MicrometresPerSecond,
    /// Velocity toward an edge or a mark.
    pub slow: MicrometresPerSecond,
    /// Acceleration and deceleration.
    pub acceleration: MicrometresPerSecond2,
    /// Position that the place found is to have.
    pub at: Nanometres,
}

/// How homing stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum HomingState {
    /// Never asked for, or given up.
    #[default]
    No,
    /// Under way.
    Runs,
    /// The place was found, and has its position.
    Done,
    /// No such place, or one that would lie outside the travel.
    Failed,
}

/// What is positioned.
#[derive(Clone, Copy, Debug)]
pub(super) enum Task {
    /// To a position.
    Go(Fixed, Ramp),
    /// To a set point, in so many ticks.
    Follow { to: Fixed, left: u32 },
    /// To rest.
    Brake(CountsPerSecond2),
    /// To a reference, which is then at this position.
    Home(Homing, Fixed),
}

/// How positioning goes on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Step {
    /// It moves.
    Moves(TrajectorySegment),
    /// It stands.
    Ends(Reason),
    /// It stands; the reference is at the first position, and is to be at the second.
    Found(i64, Fixed),
}

/// Goes on with a task. `from` is what is followed until now, `ticks` have passed since the plan before.
pub(super) fn plan(task: &mut Task, from: &TrajectorySegment, seen: &Seen, limit: CountsPerSecond, ticks: u32) -> Step {
    // The profile goes on by these ticks first.
    let gone = Fixed(from.travel.0.wrapping_mul(ticks.into()));
    let mut profile = Profile::along(TrajectorySegment { from: Fixed(from.from.0.wrapping_sub(gone.0)), ..*from });
    let profile = &mut profile;
    let homes = matches!(task, Task::Home(..));
    let segment = match task {
        Task::Go(to, ramp) => {
            let segment = profile.toward(*to, ramp, ticks);
            if profile.stands() && segment.from == *to {
                return Step::Ends(Reason::Arrived);
            }
            segment
        }
        Task::Follow { to, left } => {
            *left = left.saturating_sub(ticks);
            profile.reach(*to, *left, limit, ticks)
        }
        Task::Brake(deceleration) => {
            let segment = profile.stop(*deceleration, ticks);
            if profile.stands() {
                return Step::Ends(Reason::Held);
            }
            segment
        }
        Task::Home(homing, at) => match homing.plan(profile, seen, ticks) {
            Outcome::Moves(segment) => segment,
            Outcome::Found(found) => return Step::Found(found, *at),
            Outcome::Missed => return Step::Ends(Reason::NotHomed),
        },
    };
    if !homes && seen.upper && segment.velocity.0 < 0.0 { Step::Ends(Reason::Held) } else { Step::Moves(segment) }
}
