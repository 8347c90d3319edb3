//! What the loop follows from one plan to the next.
//!
//! The path is stepped only by a plan, by the ticks that have gone since the one before. In between the setpoint goes on in a
//! straight line, at the velocity of the plan and in the direction of the segment under way; the next plan sets it back on
//! the path, from which it can have departed only at a joint, by the travel of four ticks at the most.

use super::TickInput;
use super::commissioning::Commissioning;
use super::machine::Head;
use super::reaction::Motion;
use crate::motion::TrajectorySegment;
use crate::path::Path;
use crate::servo::{Output, Window};
use crate::units::{CountsPerSecond, Fixed, MicrometresPerSecond, PLAN_TICKS, larger, rare};
use core::ops::DerefMut;
use edm_hal_shim::bridge::Drive;

/// What is followed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Follow {
    /// Nothing: the bridge is open.
    #[default]
    Nothing,
    /// The setpoint.
    Setpoint,
    /// A velocity.
    Velocity,
    /// A duty.
    Duty,
}

/// The plan as the ticks carry it out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Trajectory {
    follow: Follow,
    /// Pulses are allowed.
    pulses: bool,
    /// Duties allowed.
    window: Window,
    /// Velocity of the setpoint, or the one to keep.
    velocity: CountsPerSecond,
    duty: f32,
    /// Travel in a tick, along the path and of the axis.
    advance: Fixed,
    travel: Fixed,
    /// Tick of the plan.
    since: u32,
}

impl Trajectory {
    /// The bridge is open, from tick `since` on.
    pub fn new(since: u32) -> Trajectory {
        Trajectory {
            follow: Follow::Nothing,
            pulses: false,
            window: Window::symmetric(0.0),
            velocity: CountsPerSecond(0.0),
            duty: 0.0,
            advance: Fixed(0),
            travel: Fixed(0),
            since,
        }
    }

    /// Whether pulses are allowed.
    #[inline]
    pub fn pulses(&self) -> bool {
        self.pulses
    }

    /// What the set point does since the plan, where it was at `from`.
    pub fn segment(&self, from: Fixed) -> TrajectorySegment {
        if self.follow == Follow::Setpoint {
            TrajectorySegment { from, travel: self.travel, velocity: self.velocity }
        } else {
            TrajectorySegment { from, ..TrajectorySegment::default() }
        }
    }
}

impl<P: DerefMut<Target = Path>> Head<P> {
    /// Plans: brings the path to where the ticks have gone, decides, and sets the trajectory for the ticks to come.
    pub(super) fn plan(&mut self, input: &TickInput) {
        let ticks = self.status.tick.wrapping_sub(self.trajectory.since).clamp(1, PLAN_TICKS);
        self.path.step(Fixed(self.trajectory.advance.0.wrapping_mul(ticks.into())));
        self.trajectory.advance = Fixed(0);
        self.trajectory.since = self.status.tick;
        self.planned = ticks;
        self.urgent = false;
        self.take_in(input);
        if let Some(fault) = self.unsafe_input() {
            self.raise(fault);
        }
        let (motion, pulses) = self.decide();
        self.trajectory.pulses = pulses;
        self.set_trajectory(motion);
        self.status.path = self.path.s();
        self.status.waiting = self.path.waiting() as u16;
        self.urgent = self.plans_every_tick();
    }

    fn set_trajectory(&mut self, motion: Motion) {
        let allowed = Window::symmetric(self.config.axis.duty_limit).and(self.current_window());
        self.trajectory.window = allowed;
        self.status.closed = match motion {
            Motion::Coast => false,
            Motion::Path(..) | Motion::Axis(_) | Motion::Velocity(_) => true,
            // The single loop, closed over the gap; the strokes of commissioning.
            Motion::Duty(_) => {
                self.status.state.follows() || self.commissioning.as_ref().is_some_and(Commissioning::closes_loop)
            }
        };
        self.trajectory.follow = match motion {
            Motion::Coast => {
                self.limiter.stop();
                self.axis.reset();
                self.status.duty = 0.0;
                self.status.saturated = false;
                self.follow_axis();
                Follow::Nothing
            }
            Motion::Path(wanted, window) => {
                self.trajectory.window = window.and(allowed);
                let velocity = self.limited(wanted);
                // One step of 2^-24 um more, so that the last one reaches the end, where the path holds it.
                let more = i64::from(velocity.0 > 0.0) - i64::from(velocity.0 < 0.0);
                self.trajectory.advance = velocity.per_tick().near(Fixed(more));
                let [travel] = self.path.travel(self.trajectory.advance);
                let [direction] = self.path.direction();
                let [setpoint] = self.path.setpoint();
                self.trajectory.travel = travel;
                self.trajectory.velocity = CountsPerSecond(velocity.0 * direction);
                self.status.setpoint = setpoint;
                Follow::Setpoint
            }
            Motion::Axis(segment) => {
                self.limiter.stop();
                self.trajectory.travel = segment.travel;
                self.trajectory.velocity = segment.velocity;
                self.status.feed = MicrometresPerSecond(segment.velocity.0 / self.config.axis.counts_per_um);
                self.status.setpoint = segment.from;
                Follow::Setpoint
            }
            Motion::Velocity(wanted) => {
                self.follow_axis();
                let [direction] = self.path.direction();
                self.trajectory.velocity = CountsPerSecond(self.limited(wanted).0 * direction);
                Follow::Velocity
            }
            Motion::Duty(duty) => {
                self.limiter.stop();
                self.follow_axis();
                self.trajectory.duty = allowed.clamp(duty);
                Follow::Duty
            }
        };
    }

    /// Carries the trajectory out for one tick.
    #[inline]
    pub(super) fn follow(&mut self) -> Drive {
        let (trajectory, gains) = (&self.trajectory, &self.config.axis.gains);
        let velocity = self.status.velocity;
        let duty = if trajectory.follow == Follow::Setpoint {
            self.status.setpoint = self.status.setpoint.near(trajectory.travel);
            self.status.following = self.status.setpoint.from(self.at);
            self.axis.follow(gains, self.status.following, trajectory.velocity, velocity, trajectory.window)
        } else {
            rare();
            match trajectory.follow {
                Follow::Nothing | Follow::Setpoint => return Drive::Coast,
                Follow::Velocity => self.axis.run(gains, trajectory.velocity, velocity, trajectory.window),
                Follow::Duty => Output::new(trajectory.duty, trajectory.window),
            }
        };
        self.status.duty = duty.value;
        self.status.saturated = duty.limited;
        // A duty is a share: it fits.
        let code = (duty.value * self.full) as i32;
        self.sums.duty = self.sums.duty.wrapping_add(code);
        Drive::Duty(code as i16)
    }

    /// Path velocity inside acceleration and stopping distance; an open upper limit is never run into.
    fn limited(&mut self, wanted: MicrometresPerSecond) -> MicrometresPerSecond {
        let wanted = if self.safety.upper_limit { MicrometresPerSecond(larger(wanted.0, 0.0)) } else { wanted };
        let path = &*self.path;
        self.limiter.limit(wanted, self.config.acceleration, self.planned, || path.ahead(), || path.behind())
    }

    /// Without a position loop the path coordinate follows the axis, so that closing the loop makes no jump.
    fn follow_axis(&mut self) {
        let [setpoint] = self.path.setpoint();
        let [direction] = self.path.direction();
        let off = self.at.minus(setpoint).to_f32();
        if direction != 0.0 {
            self.path.step(Fixed::short(off / direction));
        }
        let [setpoint] = self.path.setpoint();
        self.status.setpoint = setpoint;
        self.status.following = 0.0;
    }
}
