//! What a host may ask of a planner.

use super::{Planner, Touching};
use crate::feed::After;
use crate::gap::OpenCircuit;
use crate::head::command::{Command, Refused};
use crate::head::commissioning::Commissioning;
use crate::head::config::Structure;
use crate::head::fault::Fault;
use crate::head::guide::Guide;
use crate::head::permit::WritePermit;
use crate::head::plan::Hazards;
use crate::head::positioning::{self, Home, HomingState, MotionLimits, Task};
use crate::head::probe::{PROBES, Probe, Source};
use crate::head::proof::{Goal, Proof};
use crate::head::reaction::Reacting;
use crate::head::state::{Reason, State};
use crate::motion::{Clearance, Homing, Method, Ramp};
use crate::path::{Path, Piece, Shape};
use crate::units::{
    CountsPerSecond, CountsPerSecond2, Fixed, MicrometresPerSecond, MicrometresPerSecond2, Nanometres, larger,
};
use core::ops::DerefMut;

impl<P: DerefMut<Target = Path>> Planner<P> {
    /// Carries out a command, or refuses it and changes nothing.
    pub fn command(&mut self, command: Command) -> Result<(), Refused> {
        let state = self.status.state;
        match command {
            Command::Enable => self.enable(state),
            Command::Disable => {
                if state == State::Fault {
                    return Err(Refused::State(state));
                }
                self.enter(State::Disabled, Reason::Disabled);
                Ok(())
            }
            Command::SetHome(at) => self.set_home(state, at),
            Command::MoveTo(_) if !self.status.homed => Err(Refused::NotHomed),
            Command::MoveTo(to) => self.queue(state, self.config.axis.counts(to)),
            Command::MoveBy(by) => {
                let end = self.route.end();
                self.queue(state, end.plus(self.config.axis.counts(by)))
            }
            Command::AppendTo(_) if !self.status.homed => Err(Refused::NotHomed),
            Command::AppendTo(piece) => self.append(state, &piece),
            Command::AppendBy(piece) => {
                let mut to = self.route.end_nm();
                for (to, by) in to.iter_mut().zip(piece.to) {
                    *to = to.saturating_add(by);
                }
                self.append(state, &Piece { to, ..piece })
            }
            Command::ClearPath => {
                if !matches!(state, State::Ready | State::HoldingPosition | State::Done) {
                    return Err(Refused::State(state));
                }
                let here = self.segment().from;
                self.restart_path_at(here);
                Ok(())
            }
            Command::Position(to, limits) => self.position(state, to, &limits, false),
            Command::Touch(to, limits) => self.position(state, to, &limits, true),
            Command::FindSurface(reach) => self.find_surface(state, reach),
            Command::Follow(to, ticks) => self.follow_to(state, to, ticks),
            Command::Record => self.begin_record(state),
            Command::Step(least, most) => self.follow_steps(state, least, most),
            Command::Home(home) => self.home(state, &home),
            Command::Probe(probes) => self.probe(&probes),
            Command::Brake(deceleration) => self.brake(state, deceleration),
            Command::Push(force) => {
                self.push = self.config.axis.plant.duty(force);
                Ok(())
            }
            Command::Carry(carry) => self.carry(state, carry),
            Command::Start if self.ask_again() => Ok(()),
            Command::Start => {
                if !matches!(state, State::Ready | State::HoldingPosition | State::Done) {
                    return Err(Refused::State(state));
                }
                if self.route.at_end() {
                    return Err(Refused::NoPath);
                }
                self.refuse_hazard(true)?;
                // It was held there.
                self.route.pass_stop();
                let above = self.cleared.saturating_sub(self.status.position) as f32;
                if above > self.config.jump.float as f32 * self.config.axis.counts_per_um {
                    // In the open, and the generator may have been set anew since.
                    self.open = OpenCircuit::new(self.config.seek.settle);
                } else {
                    self.open.begin();
                }
                self.route.forget_bound();
                self.enter(State::Seeking, Reason::Started);
                Ok(())
            }
            Command::Guide => {
                self.may_position(state)?;
                // Nor out of a touch, which would go on into the work, nor while the head still moves along the path.
                let moves = self.positioning.is_none() && self.now.along.0 != 0.0;
                if self.touching != Touching::No || moves {
                    return Err(Refused::State(state));
                }
                self.refuse_hazard(true)?;
                self.open = OpenCircuit::new(self.config.seek.settle);
                let from = self.segment();
                // Positioning goes on; where a path has ended in rest, it begins anew.
                let task = self.positioning.take();
                if task.is_none() {
                    self.restart_path_at(from.from);
                }
                self.route.forget_bound();
                self.enter(State::Guiding, Reason::Started);
                self.lead(|_| After::Start);
                let rests = Task::Brake(self.counts2(self.config.acceleration));
                self.guide = Some(Guide::new(task.unwrap_or(rests), from));
                Ok(())
            }
            Command::Jump if state == State::Eroding => self.begin_jump(true),
            Command::Jump => Err(Refused::State(state)),
            Command::Hold => {
                if !state.follows() {
                    return Err(Refused::State(state));
                }
                if let Some(jump) = &mut self.jump {
                    jump.holds = true;
                    return Ok(());
                }
                if self.hold_inch() {
                    return Ok(());
                }
                let beside = self.search.is_some() || self.measures();
                if self.positioning.is_some() || self.guide.is_some() || beside {
                    return self.brake(state, self.config.acceleration);
                }
                self.enter(State::HoldingPosition, Reason::Held);
                Ok(())
            }
            Command::Identify => self.identify(state),
            Command::Tune => self.tune(state),
            Command::Commission => {
                if state != State::Disabled {
                    return Err(Refused::State(state));
                }
                self.refuse_while_storing()?;
                self.refuse_hazard(true)?;
                if self.doubt.is_some() {
                    self.begin_proof(Goal::Commissioning);
                } else {
                    self.begin_commissioning();
                }
                Ok(())
            }
            Command::ResetFault => {
                if state != State::Fault {
                    return Err(Refused::State(state));
                }
                self.refuse_hazard(true)?;
                if let Some(reacting) = self.reacting.filter(Reacting::moves) {
                    return Err(Refused::Reacting(reacting.fault()));
                }
                if self.doubt == Some(Fault::EncoderLost) {
                    // The counters have parted; they are taken to agree from here on.
                    self.trusts = self.trusts.wrapping_add(1);
                }
                self.reacting = None;
                self.status.fault = None;
                self.status.first = None;
                self.enter(State::Disabled, Reason::FaultReset);
                Ok(())
            }
        }
    }

    fn enable(&mut self, state: State) -> Result<(), Refused> {
        if state != State::Disabled {
            return Err(Refused::State(state));
        }
        if !self.config.commissioned {
            return Err(Refused::NotCommissioned);
        }
        self.refuse_while_storing()?;
        self.refuse_hazard(false)?;
        if self.doubt.is_some() {
            self.begin_proof(Goal::Ready);
        } else {
            self.reset_loop();
            self.restart_path();
            self.close_loop();
        }
        Ok(())
    }

    /// The loop is closed where the path begins.
    pub(super) fn close_loop(&mut self) {
        self.upper_limit_excused = self.now.safety.upper_limit;
        self.open = OpenCircuit::new(self.config.seek.settle);
        self.cleared = self.status.position;
        self.enter(State::Ready, Reason::Enabled);
    }

    pub(super) fn begin_commissioning(&mut self) {
        self.commissioned = None;
        self.commissioning = Some(Commissioning::new(self.status.position));
        self.enter(State::Commissioning, Reason::CommissioningStarted);
    }

    fn begin_proof(&mut self, goal: Goal) {
        self.proof = Some(Proof::new(&self.config, self.status.position, goal, self.descents));
        self.enter(State::Proving, Reason::ProofStarted);
    }

    /// A head may leave its upper limit downward, so that one alone is no reason to refuse; the dielectric matters only
    /// where pulses follow.
    pub(super) fn refuse_hazard(&self, pulses: bool) -> Result<(), Refused> {
        let only_upper = self.now.safety.upper_limit && !self.now.safety.lower_limit;
        let hazards = Hazards { any: true, limits: true, upper: !only_upper, dielectric: pulses };
        let sagging = self.status.bus < self.config.supervise.bus_min;
        match hazards.hazard(&self.now.safety) {
            _ if self.self_test_failed => Err(Refused::StillFaulty(Fault::SelfTestFailed)),
            Some(fault) => Err(Refused::StillFaulty(fault)),
            None if sagging => Err(Refused::StillFaulty(Fault::BusSag)),
            None => Ok(()),
        }
    }

    fn set_home(&mut self, state: State, at: Nanometres) -> Result<(), Refused> {
        if !matches!(state, State::Disabled | State::Ready) {
            return Err(Refused::State(state));
        }
        if let Some(fault) = self.doubt {
            return Err(Refused::Doubted(fault));
        }
        let (min, max) = self.config.axis.travel;
        if at < min || at > max {
            return Err(Refused::OutOfTravel { target: at, min, max });
        }
        self.move_origin(self.config.axis.counts(at).round());
        self.forget_carrying();
        self.status.homed = true;
        self.restart_path();
        Ok(())
    }

    fn may_queue(&self, state: State) -> Result<(), Refused> {
        let beside = state.positions() || state == State::Lifting || self.guide.is_some();
        if !state.follows() || beside {
            return Err(Refused::State(state));
        }
        if self.orbit.is_some_and(|(_, begun)| begun == self.route.begun()) {
            return Err(Refused::PathActive);
        }
        Ok(())
    }

    fn append(&mut self, state: State, piece: &Piece) -> Result<(), Refused> {
        self.may_queue(state)?;
        let [_, to_x, to_y] = piece.to;
        let [from, x, y] = self.route.end_nm();
        let beside = (to_x, to_y) != (x, y) || piece.shape != Shape::Line;
        if beside && self.config.structure != Structure::Path {
            return Err(Refused::Alone);
        }
        let (up, down) = self.route.extent(piece).map_err(Refused::Path)?;
        // A head that rests a count outside its travel may go back into it.
        let (top, bottom) = self.reach();
        let reach = (top.min(Nanometres(from)), bottom.max(Nanometres(from)));
        self.within(reach, Nanometres(up))?;
        self.within(reach, Nanometres(down))?;
        self.route.append(piece).map_err(Refused::Path)
    }

    pub(super) fn queue(&mut self, state: State, to: Fixed) -> Result<(), Refused> {
        self.may_queue(state)?;
        let (min, max) = self.reach();
        let outside = to < self.config.axis.counts(min) || to > self.config.axis.counts(max);
        if self.status.homed && outside {
            let target = Nanometres(to.round().saturating_mul(self.config.axis.nm_per_count));
            return Err(Refused::OutOfTravel { target, min, max });
        }
        match self.config.orbit {
            Some(orbit) if to > self.route.end() => self.orbit_to(orbit, to),
            _ => self.route.push_line(to).map_err(Refused::Path),
        }
    }

    /// Gives the permit to write flash, or says why not.
    ///
    /// # Errors
    /// Unless the head is disabled, and while a permit is out.
    pub fn permit_write(&mut self) -> Result<WritePermit, Refused> {
        if self.status.state != State::Disabled {
            return Err(Refused::State(self.status.state));
        }
        self.refuse_while_storing()?;
        self.write_permitted = true;
        Ok(WritePermit::new())
    }

    /// Takes the permit back.
    pub fn end_write(&mut self, _: WritePermit) {
        self.write_permitted = false;
    }

    fn refuse_while_storing(&self) -> Result<(), Refused> {
        if self.write_permitted { Err(Refused::Storing) } else { Ok(()) }
    }

    /// Whether the axis may be positioned.
    pub(super) fn may_position(&self, state: State) -> Result<(), Refused> {
        match state {
            State::Ready | State::HoldingPosition | State::Done | State::Positioning => Ok(()),
            state => Err(Refused::State(state)),
        }
    }

    /// Moves to a position on a profile, from whatever positioning is under way.
    fn position(&mut self, state: State, to: Nanometres, limits: &MotionLimits, touch: bool) -> Result<(), Refused> {
        let guided = self.guide.is_some();
        // With pulses on a contact is a short.
        if !guided || touch {
            self.may_position(state)?;
        }
        self.within_travel(to)?;
        if touch && !self.config.contact.sensed {
            return Err(Refused::NoSense);
        }
        let task = Task::Go(self.config.axis.counts(to), self.ramp(limits));
        if let Some(guide) = &mut self.guide {
            guide.lead(task);
            return Ok(());
        }
        self.take_up(State::Positioning, task);
        self.touching = if touch { Touching::Asked } else { Touching::No };
        Ok(())
    }

    /// Reaches a set point in so many ticks. Beyond the travel it is held at its end.
    fn follow_to(&mut self, state: State, to: Nanometres, ticks: u32) -> Result<(), Refused> {
        if self.guide.is_none() {
            self.may_position(state)?;
        }
        let (min, max) = self.travel();
        let to = if self.status.homed { to.max(min).min(max) } else { to };
        // The tick of this estimate follows it already, where a SYNC has released it.
        let due = positioning::due(self.due(), self.now.tick.wrapping_sub(1), ticks);
        let task = Task::Follow { to: self.config.axis.counts(to), due };
        match &mut self.guide {
            Some(guide) => guide.lead(task),
            None => self.take_up(State::Positioning, task),
        }
        Ok(())
    }

    /// Comes to rest on a ramp; what moves along the path stops by the acceleration of the path.
    fn brake(&mut self, state: State, deceleration: MicrometresPerSecond2) -> Result<(), Refused> {
        let deceleration = self.counts2(deceleration);
        self.stepper = None;
        if self.jump.take().is_some() {
            // Beside the path, which is over with that.
            let deceleration = CountsPerSecond2(larger(self.config.jump.limits.acceleration.0, deceleration.0));
            self.positioning = Some(Task::Brake(deceleration));
            self.enter(State::Positioning, Reason::Held);
            return Ok(());
        }
        self.break_off_search();
        let searched = self.search.take().is_some() | self.end_carrying() | self.break_off_measurement();
        if searched || state == State::Guiding && self.now.segment.velocity.0 != 0.0 {
            self.positioning = Some(Task::Brake(deceleration));
            self.enter(State::Positioning, Reason::Held);
            return Ok(());
        }
        match (&mut self.positioning, state) {
            (Some(task), State::Positioning | State::Homing) => {
                *task = Task::Brake(deceleration);
                if state == State::Homing {
                    self.status.homing = HomingState::No;
                    self.enter(State::Positioning, Reason::Held);
                }
                Ok(())
            }
            _ if state.follows() => {
                // An erosion, or the lift after it.
                if state.works() {
                    self.enter(State::HoldingPosition, Reason::Held);
                }
                Ok(())
            }
            _ => Err(Refused::State(state)),
        }
    }

    /// Looks for a reference.
    fn home(&mut self, state: State, home: &Home) -> Result<(), Refused> {
        self.may_position(state)?;
        // The bottom of a hole that is to be gone on with is no place for a home. Axis positioning ends the path.
        if state != State::Positioning && !self.route.at_end() {
            return Err(Refused::PathActive);
        }
        let axis = &self.config.axis;
        let (min, max) = axis.travel;
        if home.at < min || home.at > max {
            return Err(Refused::OutOfTravel { target: home.at, min, max });
        }
        if home.method == Method::Contact && !self.config.contact.sensed {
            return Err(Refused::NoSense);
        }
        // A stroke and a fifth.
        let stroke = axis.counts(Nanometres(max.0.saturating_sub(min.0))).round();
        let distance = stroke.saturating_add(stroke.wrapping_div(5));
        let acceleration = self.counts2(home.acceleration);
        let (fast, slow) = (self.velocity(home.fast), self.velocity(home.slow));
        let most = axis.off_limit;
        let clearance = Clearance { least: self.config.retreat.clearance, most };
        let homing = Homing::new(home.method, fast, slow, acceleration, distance, clearance, &self.seen());
        self.status.homing = HomingState::Runs;
        let task = Task::Home(homing, self.config.axis.counts(home.at));
        self.take_up(State::Homing, task);
        if home.method == Method::Contact {
            self.touching = Touching::Asked;
        }
        Ok(())
    }

    fn probe(&mut self, probes: &[Probe; PROBES]) -> Result<(), Refused> {
        if probes.iter().any(|probe| probe.source == Source::Contact) && !self.config.contact.sensed {
            return Err(Refused::NoSense);
        }
        self.probes = *probes;
        Ok(())
    }

    pub(super) fn take_up(&mut self, state: State, task: Task) {
        self.stepper = None;
        self.positioning = Some(task);
        self.touching = Touching::No;
        if self.status.state != state {
            let reason = if state == State::Homing { Reason::HomingStarted } else { Reason::Positioned };
            self.enter(state, reason);
        }
    }

    fn within_travel(&self, to: Nanometres) -> Result<(), Refused> {
        self.within(self.travel(), to)
    }

    fn within(&self, (min, max): (Nanometres, Nanometres), to: Nanometres) -> Result<(), Refused> {
        if self.status.homed && (to < min || to > max) {
            return Err(Refused::OutOfTravel { target: to, min, max });
        }
        Ok(())
    }

    fn velocity(&self, velocity: MicrometresPerSecond) -> CountsPerSecond {
        let limit = self.config.axis.gains.velocity_limit().0;
        CountsPerSecond((velocity.0 * self.config.axis.counts_per_um).abs().min(limit))
    }

    pub(super) fn counts2(&self, acceleration: MicrometresPerSecond2) -> CountsPerSecond2 {
        // A ramp of nothing would never end.
        CountsPerSecond2((acceleration.0 * self.config.axis.counts_per_um).max(1.0))
    }

    pub(super) fn ramp(&self, limits: &MotionLimits) -> Ramp {
        Ramp {
            velocity: self.velocity(limits.velocity),
            acceleration: self.counts2(limits.acceleration),
            deceleration: self.counts2(limits.deceleration),
        }
    }
}
