//! Guided motion: a host streams set points, and the head follows them as fast as the gap allows.

use super::Planner;
use super::states::REST;
use crate::head::config::Config;
use crate::head::fault::Fault;
use crate::head::positioning::MotionLimits;
use crate::head::reaction::Motion;
use crate::head::state::{Reason, State};
use crate::motion::TrajectorySegment;
use crate::path::Path;
use crate::units::{CountsPerSecond, Fixed, MicrometresPerSecond, larger, smaller, within};
use core::ops::DerefMut;

impl<P: DerefMut<Target = Path>> Planner<P> {
    /// Follows the host, and reports to it the feed that the gap asks for: none forward while the head leads.
    pub(super) fn guide(&mut self) -> Motion {
        self.refer();
        self.measure_open();
        let (error, unknown) = self.gap_error();
        let (feed, blind) = self.feed(error);
        if self.is_blind(unknown || blind) {
            self.raise(Fault::GapSignalInvalid);
            return self.react();
        }
        let ramp = self.ramp(&MotionLimits {
            velocity: self.config.retreat.velocity,
            acceleration: self.config.acceleration,
            deceleration: self.config.acceleration,
        });
        let (from, ticks) = (self.segment(), self.ticks);
        let Some(guide) = &mut self.guide else {
            self.enter(State::HoldingPosition, Reason::Held);
            return self.along(REST);
        };
        let segment = guide.follow(&from, &ramp, ticks);
        let leads = !guide.is_together();
        self.status.feed = if leads { MicrometresPerSecond(smaller(feed.0, 0.0)) } else { feed };
        let bounded = self.within_reach(segment);
        if let Some(guide) = self.guide.as_mut().filter(|_| bounded != segment) {
            guide.diverge();
        }
        Motion::Axis(self.approach(bounded))
    }

    /// The host's set point advances, also while the head leads.
    pub(super) fn refer(&mut self) {
        let (from, seen, when) = (self.segment(), self.seen(), self.when());
        let limit = self.config.axis.gains.velocity_limit();
        if let Some(guide) = &mut self.guide {
            let late = guide.refer(&from, &seen, limit, when);
            self.status.late_set_points = self.status.late_set_points.wrapping_add(late.into());
        }
    }

    /// A guided head that has a set point in shares of the open circuit, and has not sought: the gap is open where it begins.
    fn measure_open(&mut self) {
        if self.status.gap_setpoint.0 > 0.0 {
            return;
        }
        match self.open.volts() {
            None => self.open.observe(&self.status.gap, self.ticks),
            Some(open) if open < self.config.seek.open_min => self.raise(Fault::OpenCircuitLow),
            Some(open) => self.status.open_circuit = open,
        }
    }

    /// No faster than the axis may go, and slow enough to stop by the acceleration before the ends of the travel.
    fn within_reach(&self, segment: TrajectorySegment) -> TrajectorySegment {
        let Config { axis, acceleration, .. } = &self.config;
        let limit = axis.gains.velocity_limit().0;
        // A tenth is left for what the plan sees late.
        let twice = 1.8 * acceleration.0 * axis.counts_per_um;
        let stops = |room: Fixed| match self.status.homed {
            true => smaller(limit, libm::sqrtf(twice * larger(room.to_f32(), 0.0))),
            false => limit,
        };
        let (min, max) = self.travel();
        let up = stops(segment.from.minus(axis.counts(min)));
        let down = stops(axis.counts(max).minus(segment.from));
        let velocity = within(segment.velocity.0, -up, down);
        if velocity == segment.velocity.0 { segment } else { segment.at(CountsPerSecond(velocity)) }
    }
}
