//! From the motion that a state wants to the trajectory that the ticks follow.

use super::super::reaction::Motion;
use super::{Planner, Touching};
use crate::head::commissioning::Commissioning;
use crate::head::config::{Config, Structure};
use crate::head::fault::Fault;
use crate::head::positioning::Task;
use crate::head::restraint::BEGINS;
use crate::head::state::State;
use crate::head::trajectory::{Follow, Trajectory};
use crate::motion::TrajectorySegment;
use crate::path::Path;
use crate::servo::Window;
use crate::units::{CALM_TICKS, Fixed, MicrometresPerSecond, PLAN_TICKS, TICK_HZ, larger, smaller, within};
use core::ops::DerefMut;

/// Following error from which a fast motion waits, of the largest that is allowed.
const FAST: f32 = 0.2;
/// Velocity below which a set point moves by no more than a count between two plans, counts/s.
const CALM: f32 = (TICK_HZ / CALM_TICKS) as f32;
/// Counts by which an axis at rest may be off its set point while its loop hunts.
const NEAR: f32 = 3.0;
/// Ticks for which a set point may wait for the axis: 1 s, in which 10 N lift a face of 25 mm from a gap of 15 um (Stefan).
const WAITS: u32 = TICK_HZ;

impl<P: DerefMut<Target = Path>> Planner<P> {
    pub(super) fn trajectory(&mut self, motion: Motion, current: Window) -> Trajectory {
        let allowed = self.full_window().and(current).and(self.pressing());
        let allowed = Window { high: self.restrained(allowed.high), ..allowed };
        self.status.closed = match motion {
            Motion::Coast => false,
            Motion::Path(..) | Motion::Upward(..) | Motion::Axis(_) | Motion::Jump(..) | Motion::Velocity(_) => true,
            Motion::Gap(_) => true,
            Motion::Duty(_) => false,
            // The strokes of commissioning.
            Motion::Stroke(..) => self.commissioning.as_ref().is_some_and(Commissioning::closes_loop),
        };
        match motion {
            Motion::Coast => {
                self.follow_axis();
                Trajectory::COAST
            }
            Motion::Path(wanted, window) => {
                let wanted = self.governed(wanted);
                let trajectory = self.route.along(wanted, &self.bounds(), window.and(allowed));
                self.status.setpoint = self.route.setpoint();
                // Whatever the encoder says, a retreat that leads upward does not press.
                let upward = self.status.state == State::Retreating && trajectory.velocity.0 < 0.0;
                Trajectory { upward, ..trajectory }
            }
            Motion::Upward(wanted, window) => {
                let trajectory = self.route.along(wanted, &self.bounds(), window.and(allowed));
                self.status.setpoint = self.route.setpoint();
                Trajectory { upward: true, ..trajectory }
            }
            Motion::Axis(segment) => self.beside(&segment, allowed),
            Motion::Jump(segment, duty) => Trajectory { duty, ..self.beside(&segment, allowed) },
            Motion::Velocity(wanted) => {
                self.follow_axis();
                self.route.velocity(wanted, &self.bounds(), allowed)
            }
            Motion::Stroke(velocity, window) => {
                self.follow_axis();
                Trajectory::velocity(velocity, window.and(self.full_window()))
            }
            Motion::Gap(volts) => {
                self.follow_axis();
                self.route.stop();
                // An open upper limit is not run into.
                let low = if self.now.safety.upper_limit { self.config.axis.gains.holding() } else { allowed.low };
                Trajectory::gap(volts, Window { low: larger(allowed.low, low), ..allowed })
            }
            Motion::Duty(duty) => {
                self.follow_axis();
                Trajectory::duty(duty, allowed)
            }
        }
    }

    /// Friction, where a set point is followed for so many ticks, and what a host adds. What a fault's reaction may press is calculated without it.
    pub(super) fn compensate(&mut self, trajectory: &mut Trajectory, ticks: u32) {
        let streams = |task: &Task| matches!(task, Task::Follow { .. });
        let guided = self.guide.as_ref().is_some_and(|guide| guide.is_together() && streams(&guide.task));
        if guided || self.status.state == State::Positioning && self.positioning.as_ref().is_some_and(streams) {
            trajectory.duty += self.push;
        }
        if trajectory.follow == Follow::Setpoint && self.status.state != State::Fault {
            let travel = Fixed(trajectory.travel.0.saturating_mul(ticks.into()));
            trajectory.duty += self.presliding.travel(&self.config.presliding, travel);
        } else {
            self.presliding.forget();
        }
    }

    /// Ticks until the next estimate. Where a set point hardly moves, and no encoder that has died would be missed by its speed, the
    /// feed law loses nothing; whatever is urgent asks for a plan at once.
    pub(super) fn plan_ticks(&self, trajectory: &Trajectory) -> u32 {
        let calm = self.status.state == State::Eroding && self.jump.is_none();
        let slow = trajectory.velocity.0 > -CALM && trajectory.velocity.0 < CALM;
        if calm && slow { CALM_TICKS } else { PLAN_TICKS }
    }

    /// The coordinate waits for the axis, where something resists it: film in a narrow gap, friction, a duty at its limit. Else the
    /// axis would move on to a place that the gap no longer asks for.
    fn governed(&self, wanted: MicrometresPerSecond) -> MicrometresPerSecond {
        let limits = &self.config.supervise;
        let from = match self.status.state {
            State::Seeking | State::Eroding => limits.breakaway.following,
            State::Retreating | State::Lifting => FAST * limits.following,
            _ => return wanted,
        };
        let ahead = if wanted.0 > 0.0 { self.status.following } else { -self.status.following };
        MicrometresPerSecond(wanted.0 * pace(ahead, from))
    }

    /// Share of its velocity that a motion off the path keeps, whose set point is so far ahead; `None` where it has waited
    /// for the axis for too long, which is a following error.
    pub(super) fn awaited(&mut self, ahead: f32) -> Option<f32> {
        let pace = pace(ahead, FAST * self.config.supervise.following);
        (!self.waits_too_long(pace < 1.0)).then_some(pace)
    }

    /// The same for a seek, whose set point stops where something is in the way that nothing else shows.
    pub(super) fn is_stopped(&mut self) -> bool {
        let pace = pace(self.status.following, self.config.supervise.breakaway.following);
        self.waits_too_long(pace <= 0.0)
    }

    fn waits_too_long(&mut self, waits: bool) -> bool {
        self.waited = if waits { self.waited.saturating_add(self.ticks) } else { 0 };
        let long = self.waited >= WAITS;
        if long {
            self.waited = 0;
            self.raise(Fault::FollowingError);
        }
        long
    }

    fn beside(&mut self, segment: &TrajectorySegment, allowed: Window) -> Trajectory {
        self.route.stop();
        if self.guide.is_none() {
            self.status.feed = MicrometresPerSecond(segment.velocity.0 / self.config.axis.counts_per_um);
        }
        self.status.setpoint = segment.from;
        Trajectory::axis(segment, allowed)
    }

    /// Without a position loop path and set point follow the axis.
    fn follow_axis(&mut self) {
        let at = Fixed::whole(self.status.position);
        self.route.follow_axis(at);
        self.status.setpoint = self.route.setpoint();
        self.status.following = 0.0;
    }

    /// Where the gap leads, no more force toward the work than it takes to be led; a reflex and a retreat have all of it, upward.
    /// A gap that leads without a velocity in between leads no faster than a contact may come.
    fn pressing(&self) -> Window {
        let Config { axis, contact, structure, .. } = &self.config;
        if !matches!(self.status.state, State::Seeking | State::Eroding) {
            return self.full_window();
        }
        let velocity = self.status.velocity;
        let emf = axis.plant.back_emf() * larger(velocity.0, 0.0);
        let press = smaller(contact.press + emf, axis.duty_limit);
        let slows = *structure == Structure::SingleLoop && self.status.state == State::Eroding;
        let friction = self.config.supervise.breakaway.friction;
        let nears = axis.gains.nearing(contact.approach, velocity) + friction;
        let high = if slows { smaller(press, nears) } else { press };
        Window { low: -axis.duty_limit, high: larger(high, -axis.duty_limit) }
    }

    /// Whether the loop follows a set point that is no faster than a contact may be, and looks for no end or surface. A faster one is left to
    /// [`Silence`](super::super::silence), and one that no path leads to what leads it.
    pub(super) fn is_restrained(&self) -> bool {
        let Config { restraint, structure, .. } = &self.config;
        let follows = match self.status.state {
            State::Ready | State::Done | State::HoldingPosition | State::Positioning => true,
            State::Eroding => *structure == Structure::Path && restraint.is_thin(),
            _ => false,
        };
        follows
            && self.status.closed
            && self.now.segment.velocity.0 <= restraint.strikes()
            && !self.looks_for_home()
            && self.jump.is_none()
            && self.touching == Touching::No
    }

    /// Largest duty toward the work, of one that would be `high`. Where the set point stands and the axis is hardly off, that is what
    /// begins to move it, and not what a loop that hunts makes of a count or two.
    fn restrained(&self, high: f32) -> f32 {
        if !self.restrained {
            return high;
        }
        let gains = &self.config.axis.gains;
        let high = self.restraint.most(&self.config.restraint, gains, high);
        if self.now.segment.velocity.0 != 0.0 || self.status.following.abs() > NEAR {
            return high;
        }
        let begins = gains.holding() + BEGINS * self.config.supervise.breakaway.friction;
        smaller(high, larger(begins, 0.0))
    }

    pub(super) fn full_window(&self) -> Window {
        Window::symmetric(self.config.axis.duty_limit)
    }

    /// Duties at which the current stays within its limit, at this velocity: one for a whole plan.
    pub(super) fn current_window(&self) -> Window {
        let current = &self.config.axis.current;
        let limit = if self.status.current_reduced { current.continuous } else { current.peak };
        self.config.axis.plant.current_window(limit, self.status.velocity)
    }
}

/// Share of its velocity that a set point keeps which is so far ahead of the axis: all of it up to `from`, none of it at three
/// times as much.
fn pace(ahead: f32, from: f32) -> f32 {
    within((3.0 * from - ahead) / (2.0 * from), 0.0, 1.0)
}
