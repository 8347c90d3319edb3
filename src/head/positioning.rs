//! Axis positioning, pulses off: to a position, along a host's set points, to a reference.
//!
//! The loop then follows a profile instead of the path; when it comes to rest the path begins anew where it stands. An open
//! limit switch stops motion toward it, here as everywhere; while homing, it is what is looked for and no fault.

use super::command::Refused;
use super::machine::Head;
use super::reaction::Motion;
use super::{Reason, State};
use crate::encoder::Mark;
use crate::motion::{Homing, Method, Outcome, Profile, Ramp, Seen, TrajectorySegment};
use crate::path::Path;
use crate::units::{CountsPerSecond, CountsPerSecond2, Fixed, MicrometresPerSecond, MicrometresPerSecond2, Nanometres};
use core::ops::DerefMut;

/// Limits of axis positioning, positive.
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

/// What positions the axis.
#[derive(Debug)]
pub(super) struct Positioning {
    profile: Profile,
    task: Task,
}

#[derive(Debug)]
enum Task {
    Go(Fixed, Ramp),
    Follow { to: Fixed, left: u32 },
    Brake(CountsPerSecond2),
    Home(Homing, Fixed),
}

/// Ticks by which a set point may come late without the axis stopping for it.
const LATE: u32 = 5;

impl<P: DerefMut<Target = Path>> Head<P> {
    /// Whether the axis may be positioned.
    fn may_position(&self, state: State) -> Result<(), Refused> {
        match state {
            State::Ready | State::HoldingPosition | State::Done | State::Positioning => Ok(()),
            state => Err(Refused::State(state)),
        }
    }

    /// Moves to a position on a profile, from whatever positioning is under way.
    pub(super) fn position(&mut self, state: State, to: Nanometres, limits: &MotionLimits) -> Result<(), Refused> {
        self.may_position(state)?;
        self.within_travel(to)?;
        let task = Task::Go(self.fixed(to), self.ramp(limits));
        self.take_up(State::Positioning, task);
        Ok(())
    }

    /// Reaches a set point in so many ticks. Beyond the travel it is held at its end.
    pub(super) fn follow_to(&mut self, state: State, to: Nanometres, ticks: u32) -> Result<(), Refused> {
        self.may_position(state)?;
        let (min, max) = self.config.axis.travel;
        let to = if self.status.homed { to.max(min).min(max) } else { to };
        let task = Task::Follow { to: self.fixed(to), left: ticks.saturating_add(LATE) };
        self.take_up(State::Positioning, task);
        Ok(())
    }

    /// Comes to rest on a ramp; what moves along the path stops by the acceleration of the path.
    pub(super) fn brake(&mut self, state: State, deceleration: MicrometresPerSecond2) -> Result<(), Refused> {
        let deceleration = self.counts2(deceleration);
        match (&mut self.positioning, state) {
            (Some(positioning), State::Positioning | State::Homing) => {
                positioning.task = Task::Brake(deceleration);
                if state == State::Homing {
                    self.status.homing = HomingState::No;
                    self.enter(State::Positioning, Reason::Held);
                }
                Ok(())
            }
            _ if state.follows() => {
                if state.pulses() {
                    self.enter(State::HoldingPosition, Reason::Held);
                }
                Ok(())
            }
            _ => Err(Refused::State(state)),
        }
    }

    /// Looks for a reference.
    pub(super) fn home(&mut self, state: State, home: &Home) -> Result<(), Refused> {
        self.may_position(state)?;
        // The bottom of a hole that is to be gone on with is no place for a home. axis positioning ends the path.
        if state != State::Positioning && !self.path.at_end() {
            return Err(Refused::PathActive);
        }
        let (min, max) = self.config.axis.travel;
        if home.at < min || home.at > max {
            return Err(Refused::OutOfTravel { target: home.at, min, max });
        }
        // A stroke and a fifth.
        let stroke = self.fixed(Nanometres(max.0.saturating_sub(min.0))).round();
        let distance = stroke.saturating_add(stroke.wrapping_div(5));
        let acceleration = self.counts2(home.acceleration);
        let homing = Homing::new(
            home.method,
            self.counts(home.fast),
            self.counts(home.slow),
            acceleration,
            distance,
            &self.seen(self.mark),
        );
        self.status.homing = HomingState::Runs;
        let task = Task::Home(homing, self.fixed(home.at));
        self.take_up(State::Homing, task);
        Ok(())
    }

    fn take_up(&mut self, state: State, task: Task) {
        let profile = match &self.positioning {
            Some(positioning) => positioning.profile,
            None => {
                // The path may still be coming to rest.
                let [from] = self.path.setpoint();
                Profile::along(self.trajectory.segment(from))
            }
        };
        self.positioning = Some(Positioning { profile, task });
        self.urgent = true;
        if self.status.state != state {
            let reason = if state == State::Homing { Reason::HomingStarted } else { Reason::Positioned };
            self.enter(state, reason);
        }
    }

    /// Plans the axis positioning.
    pub(super) fn plan_positioning(&mut self) -> Motion {
        let Some(mut positioning) = self.positioning.take() else {
            self.enter(State::Ready, Reason::Arrived);
            return Motion::Path(MicrometresPerSecond(0.0), self.full_window());
        };
        let ticks = self.planned;
        let limit = self.config.axis.gains.velocity_limit();
        let profile = &mut positioning.profile;
        let mut end = None;
        let segment = match &mut positioning.task {
            Task::Go(to, ramp) => {
                let segment = profile.toward(*to, ramp, ticks);
                if profile.stands() && segment.from == *to {
                    end = Some(Reason::Arrived);
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
                    end = Some(Reason::Held);
                }
                segment
            }
            Task::Home(homing, at) => {
                let seen = self.seen(self.mark);
                match homing.plan(profile, &seen, ticks) {
                    Outcome::Moves(segment) => segment,
                    Outcome::Found(found) => {
                        let homed = self.declare(found, *at, profile);
                        self.status.homing = if homed { HomingState::Done } else { HomingState::Failed };
                        end = Some(if homed { Reason::Homed } else { Reason::NotHomed });
                        rest(profile)
                    }
                    Outcome::Missed => {
                        self.status.homing = HomingState::Failed;
                        end = Some(Reason::NotHomed);
                        rest(profile)
                    }
                }
            }
        };
        let homes = matches!(positioning.task, Task::Home(..));
        let blocked = !homes && self.safety.upper_limit && segment.velocity.0 < 0.0;
        let segment = if blocked {
            *profile = Profile::at(segment.from);
            end = Some(Reason::Held);
            rest(profile)
        } else {
            segment
        };
        self.positioning = Some(positioning);
        if let Some(reason) = end {
            if homes {
                // It may have come to rest beyond the edge of the switch.
                self.upper_limit_excused = self.safety.upper_limit;
            }
            self.enter(State::Ready, reason);
        }
        Motion::Axis(segment)
    }

    /// Ends axis positioning: the path begins where the set point is.
    pub(super) fn end_positioning(&mut self) {
        if let Some(positioning) = self.positioning.take() {
            if self.status.homing == HomingState::Runs {
                self.status.homing = HomingState::No;
            }
            self.restart_path_at(positioning.profile.position());
        }
    }

    /// Gives the place `found` the position `at`; false where that would put the axis outside its travel.
    fn declare(&mut self, found: i64, at: Fixed, profile: &mut Profile) -> bool {
        let shift = at.round().saturating_sub(found);
        let position = self.status.position.saturating_add(shift);
        let (min, max) = self.config.axis.travel;
        // The edge of a switch at the end of the travel: the axis may stand a little beyond it.
        let margin = (self.config.retreat.off_limit.to_f32() * self.config.axis.counts_per_um) as i64;
        let inside = position >= self.fixed(min).round().saturating_sub(margin)
            && position <= self.fixed(max).round().saturating_add(margin);
        let Some(tracking) = self.tracking.as_mut().filter(|_| inside) else { return false };
        tracking.position.set_position(position);
        self.at = Fixed::whole(position);
        self.status.position = position;
        self.status.homed = true;
        profile.shift(Fixed::whole(shift));
        true
    }

    fn seen(&self, mark: Mark) -> Seen {
        let count = if self.config.axis.encoder_reversed { mark.count.wrapping_neg() } else { mark.count };
        let marked = self.tracking.as_ref().map_or(0, |tracking| tracking.position.at(count));
        Seen {
            position: self.status.position,
            upper: self.safety.upper_limit,
            lower: self.safety.lower_limit,
            mark,
            marked,
        }
    }

    fn within_travel(&self, to: Nanometres) -> Result<(), Refused> {
        let (min, max) = self.config.axis.travel;
        if self.status.homed && (to < min || to > max) {
            return Err(Refused::OutOfTravel { target: to, min, max });
        }
        Ok(())
    }

    fn counts(&self, velocity: MicrometresPerSecond) -> CountsPerSecond {
        let limit = self.config.axis.gains.velocity_limit().0;
        CountsPerSecond((velocity.0 * self.config.axis.counts_per_um).abs().min(limit))
    }

    fn counts2(&self, acceleration: MicrometresPerSecond2) -> CountsPerSecond2 {
        // A ramp of nothing would never end.
        CountsPerSecond2((acceleration.0 * self.config.axis.counts_per_um).max(1.0))
    }

    fn ramp(&self, limits: &MotionLimits) -> Ramp {
        Ramp {
            velocity: self.counts(limits.velocity),
            acceleration: self.counts2(limits.acceleration),
            deceleration: self.counts2(limits.deceleration),
        }
    }
}

fn rest(profile: &Profile) -> TrajectorySegment {
    TrajectorySegment { from: profile.position(), ..TrajectorySegment::default() }
}
