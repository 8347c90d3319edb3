//! Axis positioning, pulses off: to a position, along a host's set points, to a reference.
//!
//! The loop then follows a profile instead of the path; when it rests the path begins anew where it stands. An open
//! limit switch stops motion toward it, here as everywhere; while homing, it is what is looked for and no fault.

use super::state::Reason;
use crate::motion::{Homing, Method, Missed, Outcome, Profile, Ramp, Seen, TrajectorySegment};
use crate::units::{
    CountsPerSecond, CountsPerSecond2, Fixed, MicrometresPerSecond, MicrometresPerSecond2, Nanometres, PLAN_TICKS,
};

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
    /// No such place, or one that would lie outside the travel, or something in the way.
    Failed(Missed),
}

/// What is positioned.
#[derive(Clone, Copy, Debug)]
pub(super) enum Task {
    /// To a position.
    Go(Fixed, Ramp),
    /// To a set point, reached after the tick [`due`].
    Follow { to: Fixed, due: u32 },
    /// To rest.
    Brake(CountsPerSecond2),
    /// To a reference, which is then at this position.
    Home(Homing, Fixed),
}

/// The next step of a positioning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Step {
    /// It moves.
    Moves(TrajectorySegment),
    /// It stands.
    Ends(Reason),
    /// It stands; the reference is at the first position, and is to be at the second.
    Found(i64, Fixed),
    /// It stands, and there is no reference.
    Missed(Missed),
}

/// Tick after which a set point of a stream is reached, of which one comes every `ticks`, when it is followed after the tick
/// `now`; the one before it is due in `before`.
///
/// The axis is half a period behind the host, and a plan more. So a set point that is late by up to half a period still comes
/// before the one before it is reached, and is due when it would have been due in time: the velocity stays. By a tick each, set
/// points come back to the middle where a host's clock has drifted away. One that is off by more begins anew.
pub(super) fn due(before: u32, now: u32, ticks: u32) -> u32 {
    let half = ticks >> 1;
    let in_time = now.wrapping_add(half).wrapping_add(PLAN_TICKS);
    let off = before.wrapping_sub(in_time).cast_signed();
    let due = match off.unsigned_abs() {
        most if most > half => in_time,
        some if some > half >> 1 => before.wrapping_sub(off.signum().cast_unsigned()),
        _ => before,
    };
    due.wrapping_add(ticks)
}

/// Ticks from `now` to another one; 0 when that is over.
pub(super) fn until(tick: u32, now: u32) -> u32 {
    tick.wrapping_sub(now).cast_signed().max(0).cast_unsigned()
}

/// When a task continues: after the tick `now`, `ticks` after the plan before.
#[derive(Clone, Copy, Debug)]
pub(super) struct When {
    pub now: u32,
    pub ticks: u32,
}

/// Goes on with a task. `from` is what is followed until then.
pub(super) fn plan(task: &mut Task, from: &TrajectorySegment, seen: &Seen, limit: CountsPerSecond, when: When) -> Step {
    let When { now, ticks } = when;
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
        Task::Follow { to, due } => profile.reach(*to, until(*due, now), limit, ticks),
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
            Outcome::Missed(missed) => return Step::Missed(missed),
        },
    };
    if !homes && seen.upper && segment.velocity.0 < 0.0 { Step::Ends(Reason::Held) } else { Step::Moves(segment) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: u32 = 20;

    #[test]
    fn set_points_late_or_early_by_half_a_period_are_due_when_they_would_have_been() {
        let now = u32::MAX - 7;
        let first = due(now.wrapping_sub(1000), now, PERIOD);
        assert_eq!(until(first, now), PERIOD + PERIOD / 2 + PLAN_TICKS);
        for off in -10i32..=10 {
            let next = due(first, now.wrapping_add(PERIOD).wrapping_add_signed(off), PERIOD);
            // The clock of the host is followed by a tick.
            let steers = if off.abs() > 5 { off.signum() } else { 0 };
            assert_eq!(next, first.wrapping_add(PERIOD).wrapping_add_signed(steers), "{off}");
        }
        for off in [-11, 11, 500] {
            let now = now.wrapping_add(PERIOD).wrapping_add_signed(off);
            assert_eq!(until(due(first, now, PERIOD), now), PERIOD + PERIOD / 2 + PLAN_TICKS, "{off}: anew");
        }
    }

    #[test]
    fn what_is_over_has_no_ticks_left() {
        assert_eq!((until(5, 5), until(4, 5), until(5, u32::MAX)), (0, 0, 6));
    }
}
