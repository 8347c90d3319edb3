//! Positioning of the axis off the path, homing, and the origin of its counts.

use super::states::REST;
use super::{Planner, Touching};
use crate::encoder::Mark;
use crate::head::positioning::{self, HomingState, Step, Task};
use crate::head::reaction::Motion;
use crate::head::state::{Reason, State};
use crate::motion::{Missed, Seen, TrajectorySegment};
use crate::path::Path;
use crate::units::{CountsPerSecond, Fixed};
use core::ops::DerefMut;

impl<P: DerefMut<Target = Path>> Planner<P> {
    /// Goes on with axis positioning.
    pub(super) fn position_axis(&mut self) -> Motion {
        let touches = self.looks_for_home() && self.now.short;
        if touches {
            self.status.touched = self.status.position;
            self.touching = Touching::Done;
        }
        let blocked = self.is_blocked();
        if blocked {
            // The set point has gone on without the axis.
            self.reset_loop();
            self.restart_path();
        }
        let from = self.segment();
        let seen = Seen { touches, blocked, ..self.seen() };
        let limit = self.config.axis.gains.velocity_limit();
        let when = self.when();
        let stepped = self.lead_by_steps(when);
        let Some(task) = &mut self.positioning else {
            self.enter(State::Ready, Reason::Arrived);
            return self.along(REST);
        };
        // A host that leads does not wait, and what looks for a place is to notice what is in its way.
        let waits = matches!(task, Task::Go(..));
        let homes = matches!(task, Task::Home(..));
        if let (Task::Go(to, _), Touching::Asked, true) = (&mut *task, self.touching, self.now.short) {
            self.status.touched = self.status.position;
            *to = Fixed::whole(self.status.position.saturating_sub(self.config.retreat.clearance));
            self.touching = Touching::Done;
        }
        let reason = match positioning::plan(task, &from, &seen, limit, when) {
            Step::Moves(segment) => {
                let ahead = self.status.following.copysign(self.status.following * segment.velocity.0);
                let Some(pace) = self.awaited(if waits { ahead } else { 0.0 }) else { return self.react() };
                let slowed = segment.at(CountsPerSecond(segment.velocity.0 * pace));
                let segment = self.approach(if pace < 1.0 { slowed } else { segment });
                if let Some((to, held)) = stepped {
                    self.status.approaching |= held;
                    if self.falls_behind(to, &segment) {
                        return self.react();
                    }
                }
                return Motion::Axis(segment);
            }
            Step::Ends(Reason::Arrived) if self.touching == Touching::Done => Reason::Touched,
            Step::Ends(reason) => reason,
            Step::Found(found, at) => {
                let homed = self.declare(found, at);
                self.status.homing = if homed { HomingState::Done } else { HomingState::Failed(Missed::OutOfTravel) };
                if homed { Reason::Homed } else { Reason::NotHomed }
            }
            Step::Missed(missed) => {
                self.status.homing = HomingState::Failed(missed);
                Reason::NotHomed
            }
        };
        if homes {
            // It may have come to rest beyond the edge of the switch.
            self.upper_limit_excused = self.now.safety.upper_limit;
        }
        self.enter(State::Ready, reason);
        Motion::Axis(TrajectorySegment { from: self.segment().from, ..TrajectorySegment::default() })
    }

    /// Toward the work faster than the approach only where the axis has been.
    #[inline(never)]
    pub(super) fn approach(&mut self, segment: TrajectorySegment) -> TrajectorySegment {
        let most = self.toward(segment.from);
        self.status.approaching = segment.velocity.0 > most.0;
        if !self.status.approaching {
            return segment;
        }
        segment.at(most)
    }

    /// Gives the place `found` the position `at`; false where that would put the axis outside its travel.
    fn declare(&mut self, found: i64, at: Fixed) -> bool {
        let shift = at.round().saturating_sub(found);
        let position = self.status.position.saturating_add(shift);
        let axis = &self.config.axis;
        let (min, max) = axis.travel;
        // The edge of a switch at the end of the travel: the axis may stand a little beyond it.
        let margin = axis.off_limit;
        let inside = position >= axis.counts(min).round().saturating_sub(margin)
            && position <= axis.counts(max).round().saturating_add(margin);
        if inside {
            let here = self.segment().from.plus(Fixed::whole(shift));
            self.move_origin(position);
            self.forget_carrying();
            self.restart_path_at(here);
            self.status.homed = true;
        }
        inside
    }

    /// The axis is at this position from now on.
    pub(super) fn move_origin(&mut self, position: i64) {
        self.cleared = self.cleared.saturating_add(position.saturating_sub(self.status.position));
        self.offset = self.offset.saturating_add(position.saturating_sub(self.status.position));
        self.status.position = position;
    }

    pub(super) fn seen(&self) -> Seen {
        let offset = self.offset.wrapping_sub(self.now.offset);
        let Mark { count, toward_work, crossings } = self.now.mark;
        Seen {
            position: self.status.position,
            upper: self.now.safety.upper_limit,
            lower: self.now.safety.lower_limit,
            mark: Mark { count, toward_work, crossings },
            marked: self.now.marked.wrapping_add(offset),
            ..Seen::default()
        }
    }
}
