//! Guiding: a host's set points followed with pulses on.
//!
//! The *reference* goes where the host leads: in a straight line from one set point to the next, or on a profile. Head and
//! reference are *together*, and the head follows it exactly, until a short has led the head away, or the reference has changed
//! its velocity by more than the acceleration allows. Then a profile closes the distance between both, in the frame of the
//! moving reference: no change of velocity exceeds the acceleration, and a head that comes alongside does not go past. One that
//! is alongside when the host stops or turns harder than the acceleration allows goes past and comes back, within the travel.

use super::positioning::{Step, Task, When, plan, until};
use crate::motion::{Profile, Ramp, Seen, TrajectorySegment};
use crate::units::{CountsPerSecond, Fixed};

/// Distance from a set point, counts, at which the reference has reached it.
const THERE: f32 = 1.0 / 256.0;

/// How a head stands to the host that guides it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Guidance {
    /// Nobody guides it.
    #[default]
    No,
    /// It follows the host.
    Follows,
    /// It rests where the host has led it.
    Rests,
    /// It retreats from a short or returns from there.
    Leads,
    /// It has braked: the next set point is late.
    Waits,
}

/// A head that is guided.
#[derive(Clone, Copy, Debug)]
pub(super) struct Guide {
    /// What the host wants.
    pub task: Task,
    reference: TrajectorySegment,
    together: bool,
    /// The set points have stopped while they led on.
    waits: bool,
}

impl Guide {
    /// Goes on with what is under way, `from` what is followed until now.
    pub fn new(task: Task, from: TrajectorySegment) -> Guide {
        Guide { task, reference: from, together: true, waits: false }
    }

    /// The host wants something else from now on.
    pub fn lead(&mut self, task: Task) {
        (self.task, self.waits) = (task, false);
    }

    /// The head goes its own way.
    pub fn part(&mut self) {
        (self.together, self.waits) = (false, false);
    }

    /// The head could not go where the reference goes.
    pub fn diverge(&mut self) {
        self.together = false;
    }

    /// Whether head and reference are together.
    pub fn is_together(&self) -> bool {
        self.together
    }

    /// How the head stands to the host.
    pub fn guidance(&self) -> Guidance {
        match self {
            Guide { waits: true, .. } => Guidance::Waits,
            Guide { together: false, .. } => Guidance::Leads,
            _ if self.reference.travel == Fixed(0) => Guidance::Rests,
            _ => Guidance::Follows,
        }
    }

    /// Moves the reference on for the next plan; `from` is what the head follows until then. Whether a set point has become late.
    pub fn refer(&mut self, from: &TrajectorySegment, seen: &Seen, limit: CountsPerSecond, when: When) -> bool {
        let before = self.reference;
        let gone = Fixed(before.travel.0.wrapping_mul(when.ticks.into()));
        let at = TrajectorySegment { from: Fixed(before.from.0.wrapping_add(gone.0)), ..before };
        let at = if self.together { *from } else { at };
        self.reference = match plan(&mut self.task, &at, seen, limit, when) {
            Step::Moves(segment) => segment,
            Step::Ends(_) | Step::Found(..) | Step::Missed(_) => {
                TrajectorySegment { from: at.from, ..TrajectorySegment::default() }
            }
        };
        let arrived = |to: Fixed| to.minus(at.from).to_f32().abs() < THERE;
        let ends = matches!(self.task, Task::Follow { to, due } if until(due, when.now) == 0 && arrived(to));
        let late = ends && before.travel != Fixed(0) && !self.waits;
        self.waits |= late;
        late
    }

    /// What the head follows for the next plan: `ramp` is how it comes alongside.
    pub fn follow(&mut self, from: &TrajectorySegment, ramp: &Ramp, ticks: u32) -> TrajectorySegment {
        let reference = self.reference;
        let travel = Fixed(from.travel.0.wrapping_sub(reference.travel.0));
        let gone = Fixed(travel.0.wrapping_mul(ticks.into()));
        let apart = TrajectorySegment {
            from: Fixed(from.from.minus(reference.from).0.wrapping_sub(gone.0)),
            travel,
            velocity: CountsPerSecond(from.velocity.0 - reference.velocity.0),
        };
        let apart = Profile::along(apart).toward(Fixed(0), ramp, ticks);
        self.together = apart == TrajectorySegment::default();
        TrajectorySegment {
            from: reference.from.plus(apart.from),
            travel: Fixed(reference.travel.0.wrapping_add(apart.travel.0)),
            velocity: CountsPerSecond(reference.velocity.0 + apart.velocity.0),
        }
    }
}
