//! What each state does, and when it is left.

use super::super::positioning::{self, HomingState, MotionLimits, Step, Task};
use super::super::reaction::Motion;
use super::{Planner, Touching};
use crate::encoder::Mark;
use crate::feed::FeedLaw;
use crate::gap::Quality;
use crate::head::command::Refused;
use crate::head::commissioning::Demand;
use crate::head::config::{Config, Structure};
use crate::head::ends::{Ends, Place};
use crate::head::fault::{Fault, Reaction};
use crate::head::jump::Jump;
use crate::head::proof::{Goal, Outcome};
use crate::head::state::{Reason, State};
use crate::motion::{Missed, Seen, TrajectorySegment};
use crate::path::Path;
use crate::units::{CountsPerSecond, Fixed, MicrometresPerSecond, Nanometres, Volts, larger, smaller, within};
use core::ops::DerefMut;

/// At rest.
const REST: MicrometresPerSecond = MicrometresPerSecond(0.0);

/// Jumps for arcs, one after the other, after which arcs that are still there stay.
const ARC_JUMPS: u8 = 3;

impl<P: DerefMut<Target = Path>> Planner<P> {
    /// State transitions, then the motion of the state and whether it needs pulses.
    pub(super) fn decide(&mut self) -> (Motion, bool) {
        self.upper_limit_excused &= self.now.safety.upper_limit;
        match self.status.state {
            State::Seeking => self.seek(),
            State::Eroding => self.watch_short(State::Eroding),
            State::Guiding => self.watch_short(State::Guiding),
            State::Retreating => self.end_retreat(),
            _ => {}
        }
        let motion = match self.status.state {
            State::Disabled => Motion::Coast,
            // Whatever was raised: nothing moves while the processor may stall.
            State::Fault if self.write_permitted => Motion::Coast,
            State::Commissioning => return self.run_commissioning(),
            State::Proving => self.run_proof(),
            State::Ready | State::Done | State::HoldingPosition => self.along(REST),
            State::Positioning | State::Homing => self.position_axis(),
            State::Jumping => self.jump_on(),
            State::Touching => self.touch_on(),
            State::Lifting => self.lift_on(),
            State::Seeking if self.open.volts().is_none() => self.along(REST),
            State::Seeking => self.along(self.config.seek.velocity),
            State::Eroding => self.erode(),
            State::Guiding => self.guide(),
            State::Retreating => {
                self.refer();
                self.along(MicrometresPerSecond(-self.config.retreat.velocity.0))
            }
            State::Fault => self.react(),
        };
        // The state of now: a path that ended in this plan has ended its pulses too.
        (motion, self.status.state.pulses())
    }

    fn along(&self, velocity: MicrometresPerSecond) -> Motion {
        Motion::Path(velocity, self.full_window())
    }

    /// The motion of the reaction under way; that of a second fault in the plan in which it shows.
    fn react(&mut self) -> Motion {
        let (situation, ticks) = (self.situation(), self.ticks);
        let motion = |planner: &mut Self| {
            planner.reacting.as_mut().map(|reacting| reacting.plan(&planner.config, &situation, ticks))
        };
        match motion(self) {
            None => Motion::Coast,
            Some(Ok(motion)) => motion,
            Some(Err((fault, reaction))) => {
                self.react_with(fault, reaction);
                motion(self).and_then(Result::ok).unwrap_or(Motion::Coast)
            }
        }
    }

    fn run_proof(&mut self) -> Motion {
        let Some(proof) = &mut self.proof else { return Motion::Coast };
        match proof.plan(&self.config, self.status.position, self.now.safety.upper_limit, self.ticks) {
            Outcome::Push(duty) => Motion::Duty(duty),
            Outcome::Hold => {
                if !self.status.closed {
                    self.reset_loop();
                    self.restart_path();
                }
                self.along(REST)
            }
            Outcome::Proved(goal) => {
                self.doubt = None;
                self.proof = None;
                self.descents = 0;
                match goal {
                    Goal::Ready => self.close_loop(),
                    Goal::Commissioning => self.begin_commissioning(),
                }
                self.along(REST)
            }
            // The lift is a push of the same sign: where that goes the wrong way there is none.
            Outcome::Failed(Fault::PolarityWrong) => {
                self.react_with(Fault::PolarityWrong, Reaction::Coast);
                Motion::Coast
            }
            Outcome::Failed(fault) => {
                let descended = proof.is_descending() && !self.now.safety.upper_limit;
                self.descents = self.descents.saturating_add(descended.into());
                self.raise(fault);
                self.react()
            }
        }
    }

    fn run_commissioning(&mut self) -> (Motion, bool) {
        let Some(commissioning) = &mut self.commissioning else { return (Motion::Coast, false) };
        let status = &self.status;
        let Config { commissioning: config, axis, .. } = &self.config;
        let seen = (status.position, status.duty);
        let (wish, result) = commissioning.plan(config, &axis.plant, seen, &status.gap, self.ticks);
        if let Some(result) = result {
            self.adopt(Config { commissioned: result.is_ok(), ..self.config });
            self.commissioned = Some(result);
            self.commissioning = None;
            self.enter(State::Disabled, Reason::CommissioningEnded);
            return (Motion::Coast, false);
        }
        match wish {
            Demand::Duty(duty) => (Motion::Duty(duty), false),
            Demand::Pulses => (Motion::Duty(0.0), true),
            Demand::Stroke(velocity, window) => (Motion::Stroke(velocity, window), false),
        }
    }

    fn seek(&mut self) {
        self.watch_short(State::Seeking);
        if self.status.state != State::Seeking || self.is_stopped() {
            return;
        }
        let gap = self.status.gap;
        let Some(open) = self.open.volts() else {
            self.open.observe(&gap, self.ticks);
            return;
        };
        self.status.open_circuit = open;
        if open < self.config.seek.open_min {
            self.raise(Fault::OpenCircuitLow);
            return;
        }
        let valid = gap.quality == Quality::Valid;
        if valid && gap.filtered.0 < open.0 * self.config.seek.threshold {
            if self.route.found_work() {
                (self.status.found, self.meets) = (self.status.position, true);
            }
            (self.good, self.eroded, self.ends) = (self.route.s(), 0, Ends::default());
            (self.arc_jumps, self.status.cramped) = (0, false);
            self.law = self.config.law;
            if self.config.structure == Structure::SingleLoop {
                self.reset_loop();
            }
            self.enter(State::Eroding, Reason::WorkFound);
        } else if let Some(reason) = self.reached().filter(|_| self.arrived()) {
            self.end(reason);
        }
    }

    /// What of the path's ends is reached.
    fn reached(&self) -> Option<Reason> {
        match () {
            () if self.route.at_end() => Some(Reason::PathEnd),
            () if self.route.at_stop() => Some(Reason::PathStop),
            () => None,
        }
    }

    /// The axis is on the count that the path asks for.
    fn arrived(&self) -> bool {
        self.status.position == self.route.setpoint().round()
    }

    /// The fast path to a retreat: the reflex has begun one, or the unfiltered gap was shorted for a set time.
    fn watch_short(&mut self, from: State) {
        if self.now.short || self.status.gap.short_ticks >= self.config.retreat.trigger {
            self.retreat = (from, self.status.position);
            self.good = self.good.max(self.route.s());
            self.enter(State::Retreating, Reason::Short);
            if let Some(guide) = &mut self.guide {
                guide.part();
            }
        }
    }

    fn end_retreat(&mut self) {
        let (back_to, began) = self.retreat;
        let gone = began.saturating_sub(self.status.position);
        let shorted = self.status.gap.short_ticks > 0;
        let clear = gone >= self.config.retreat.clearance || self.route.at_beginning();
        if !shorted && clear {
            self.law = self.config.law;
            self.enter(back_to, Reason::GapRecovered);
        } else if shorted
            && (self.status.tick.wrapping_sub(self.entered) > self.config.retreat.persistent
                || self.route.is_exhausted())
        {
            self.raise(Fault::PersistentShort);
        }
    }

    /// Gap voltage above the setpoint. A reading that is not valid is no reason to move, and neither is a setpoint that is a
    /// share of a voltage not measured yet; supervision decides how long a bad reading may last.
    fn gap_error(&self) -> Volts {
        let setpoint = self.status.gap_setpoint;
        match self.status.gap.quality {
            Quality::Valid if setpoint.0 > 0.0 => Volts(self.status.gap.filtered.0 - setpoint.0),
            _ => Volts(0.0),
        }
    }

    fn erode(&mut self) -> Motion {
        if let Some(reason) = self.ended() {
            self.end(reason);
            return self.along(REST);
        }
        if self.jump_is_due() && self.begin_jump(false).is_ok() {
            return self.jump_on();
        }
        let arcs = self.judged.arcs;
        match arcs {
            // Jumps have not helped.
            Some(true) if self.arc_jumps >= ARC_JUMPS => {
                self.raise(Fault::PersistentArc);
                return self.react();
            }
            Some(true) if self.begin_jump(false).is_ok() => {
                self.arc_jumps = self.arc_jumps.saturating_add(1);
                return self.jump_on();
            }
            Some(false) => self.arc_jumps = 0,
            _ => {}
        }
        let error = self.gap_error();
        if self.meets && self.status.gap.quality == Quality::Valid && error.0 <= 0.0 {
            (self.status.found, self.meets) = (self.status.position, false);
        }
        match self.config.structure {
            // In every tick, and not in every plan.
            Structure::SingleLoop => Motion::Gap(self.status.gap_setpoint),
            structure => {
                let wanted = self.config.limits.clamp(self.law.velocity(error, self.ticks));
                let wanted = self.hastened(wanted);
                self.status.feed = wanted;
                if structure == Structure::Path { self.along(wanted) } else { Motion::Velocity(wanted) }
            }
        }
    }

    /// Why the erosion is over, if it is.
    fn ended(&mut self) -> Option<Reason> {
        let Config { ends, .. } = &self.config;
        let deep = |from: Fixed| self.route.is_at_front() && self.route.s().minus(self.route.work()) > from;
        let reached = self.reached().filter(|_| self.ends.spark_out() || self.arrived());
        let place = match (reached, ends.through) {
            (Some(reason), _) => Place::End(reason),
            (None, from) if from > 0 && deep(Fixed::whole(from.into())) => Place::Deep,
            _ => Place::Known,
        };
        let gap = (self.status.gap.quality == Quality::Valid).then_some(self.status.gap.filtered);
        self.ends.plan(ends, place, gap, self.status.open_circuit, self.ticks)
    }

    /// The erosion is over: out of the work, or at rest where it is.
    fn end(&mut self, reason: Reason) {
        self.lifts_to = self.route.s().minus(Fixed::whole(self.config.ends.lift.into()));
        let lifts = self.config.ends.lift > 0;
        if lifts && self.config.structure != Structure::Path {
            // The loop is closed over the axis from here on.
            self.reset_loop();
        }
        self.route.pass_stop();
        self.enter(if lifts { State::Lifting } else { State::Done }, reason);
    }

    /// Goes on with the lift after the end.
    fn lift_on(&mut self) -> Motion {
        if self.route.s() > self.lifts_to && !self.route.at_beginning() {
            return self.along(MicrometresPerSecond(-self.config.retreat.velocity.0));
        }
        if self.now.along.0 == 0.0 {
            self.enter(State::Done, Reason::Lifted);
        }
        self.along(REST)
    }

    /// Far behind the last good place, and with nothing in the way, the head goes as fast as it came back.
    fn hastened(&self, wanted: MicrometresPerSecond) -> MicrometresPerSecond {
        let behind = self.good.minus(self.route.s());
        let fast = behind > Fixed::whole(self.config.jump.float.into()) && wanted.0 >= self.config.limits.feed.0;
        if fast { MicrometresPerSecond(larger(self.config.retreat.velocity.0, wanted.0)) } else { wanted }
    }

    /// So much erosion since the last jump.
    fn jump_is_due(&mut self) -> bool {
        self.eroded = self.eroded.saturating_add(self.ticks);
        let every = self.config.jump.every;
        let due = every > 0 && self.eroded >= every;
        // One for which there is no room at all is left out.
        self.eroded = if due { 0 } else { self.eroded };
        due
    }

    /// Begins a jump. One that is commanded is as high as it is set to be, or refused; of the others a low one, which leaves the
    /// float distance free at the top, is better than none.
    pub(super) fn begin_jump(&mut self, commanded: bool) -> Result<(), Refused> {
        if !self.status.homed {
            self.status.cramped |= !commanded;
            return Err(Refused::NotHomed);
        }
        if self.now.safety.upper_limit {
            return Err(Refused::StillFaulty(Fault::UpperLimit));
        }
        let axis = &self.config.axis;
        let (top, _) = axis.travel;
        let from = self.segment().from;
        let free = from.minus(axis.counts(top));
        let height = Fixed::whole(self.config.jump.height.into());
        let margin = Fixed::whole((self.config.jump.float as f32 * axis.counts_per_um) as i64);
        let cramped = free < height;
        let led = if cramped { free.minus(margin) } else { height };
        if !commanded {
            self.status.cramped = cramped;
        }
        if cramped && (commanded || led < margin) {
            let nm = |counts: Fixed| Nanometres(counts.round().saturating_mul(axis.nm_per_count));
            return Err(Refused::NoRoom { height: nm(height), free: nm(free) });
        }
        let float = self.route.s().minus(Fixed::whole(self.config.jump.float.into()));
        self.jump = Some(Jump::new(led, float));
        self.eroded = 0;
        self.enter(State::Jumping, if cramped { Reason::JumpedLow } else { Reason::Jumped });
        Ok(())
    }

    /// Goes on with a jump.
    fn jump_on(&mut self) -> Motion {
        let from = self.segment().from;
        let rests = self.now.segment.velocity.0 == 0.0;
        let ahead = self.jump.as_ref().map_or(0.0, |jump| jump.ahead(self.status.following));
        let Some(pace) = self.awaited(ahead) else { return self.react() };
        let Some(jump) = &mut self.jump else {
            self.enter(State::HoldingPosition, Reason::Held);
            return self.along(REST);
        };
        if !jump.is_away() && !rests {
            return self.along(REST);
        }
        self.route.go_back_to(jump.float);
        let places = [from, self.route.setpoint()];
        if let Some((segment, acceleration)) = jump.plan(&self.config.jump, places, pace, self.ticks) {
            return Motion::Jump(segment, self.config.axis.plant.accelerating(acceleration));
        }
        let holds = jump.holds;
        self.jump = None;
        self.law = self.config.law;
        if holds {
            self.enter(State::HoldingPosition, Reason::Held);
        } else {
            self.enter(State::Eroding, Reason::Returned);
        }
        self.along(REST)
    }

    /// Follows the host, and tells it the feed that the gap asks for: none forward while the head leads.
    fn guide(&mut self) -> Motion {
        self.refer();
        self.measure_open();
        let error = self.gap_error();
        let feed = self.config.limits.clamp(self.law.velocity(error, self.ticks));
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

    /// No faster than the axis may go, and than what comes to rest by the acceleration before the ends of the travel.
    fn within_reach(&self, segment: TrajectorySegment) -> TrajectorySegment {
        let Config { axis, acceleration, .. } = &self.config;
        let limit = axis.gains.velocity_limit().0;
        // A tenth is left for what the plan sees late.
        let twice = 1.8 * acceleration.0 * axis.counts_per_um;
        let stops = |room: Fixed| match self.status.homed {
            true => smaller(limit, libm::sqrtf(twice * larger(room.to_f32(), 0.0))),
            false => limit,
        };
        let (min, max) = axis.travel;
        let up = stops(segment.from.minus(axis.counts(min)));
        let down = stops(axis.counts(max).minus(segment.from));
        let velocity = within(segment.velocity.0, -up, down);
        if velocity == segment.velocity.0 { segment } else { segment.at(CountsPerSecond(velocity)) }
    }

    /// The host goes on, whoever leads.
    fn refer(&mut self) {
        let (from, seen, when) = (self.segment(), self.seen(), self.when());
        let limit = self.config.axis.gains.velocity_limit();
        if let Some(guide) = &mut self.guide {
            let late = guide.refer(&from, &seen, limit, when);
            self.status.late_set_points = self.status.late_set_points.wrapping_add(late.into());
        }
    }

    /// Goes on with axis positioning.
    fn position_axis(&mut self) -> Motion {
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
                return Motion::Axis(self.approach(if pace < 1.0 { slowed } else { segment }));
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
