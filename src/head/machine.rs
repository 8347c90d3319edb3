//! The servo tick.

use super::commissioning::Commissioning;
use super::config::{Config, Setpoint, Structure};
use super::measure::{Sums, Tracking};
use super::positioning::Positioning;
use super::proof::{Goal, Outcome, Proof};
use super::reaction::{Motion, Reacting, Situation};
use super::schedule::{self, Schedule};
use super::trajectory::Trajectory;
use super::{
    Change, ChangeLog, Fault, Finding, Reaction, Reason, Refused, Report, State, Status, TickInput, TickOutput,
};
use crate::encoder::Mark;
use crate::feed::{FeedLaw, Law, Limiter};
use crate::gap::{OpenCircuit, Quality};
use crate::path::Path;
use crate::servo::{AxisLoop, CurrentGuard, Pid, Window};
use crate::units::{Fixed, MicrometresPerSecond, Volts};
use core::ops::DerefMut;
use edm_hal_shim::bridge::Drive;
use edm_hal_shim::safety::SafetyInputs;

/// One head: path, loops, states. `P` owns the path, wherever there is room for it: a `Box<Path>`, or a `&'static mut Path`.
#[derive(Debug)]
pub struct Head<P> {
    pub(super) config: Config,
    pub(super) status: Status,
    pub(super) changes: ChangeLog,
    /// `None` until the first tick has read the encoder.
    pub(super) tracking: Option<Tracking>,
    pub(super) path: P,
    pub(super) law: Law,
    pub(super) limiter: Limiter,
    pub(super) axis: AxisLoop,
    pub(super) single: Pid,
    pub(super) guard: CurrentGuard,
    schedule: Schedule,
    pub(super) trajectory: Trajectory,
    /// [`Drive::FULL`], negative for a reversed motor.
    pub(super) full: f32,
    pub(super) sums: Sums,
    /// Where the axis is, as a coordinate.
    pub(super) at: Fixed,
    /// Plan in the next tick, whatever its slot.
    pub(super) urgent: bool,
    /// Ticks from the plan before to this one.
    pub(super) planned: u32,
    pub(super) positioning: Option<Positioning>,
    /// Newest index mark.
    pub(super) mark: Mark,
    pub(super) reacting: Option<Reacting>,
    /// The fault that has cast doubt on the encoder, until it has proved itself.
    pub(super) doubt: Option<Fault>,
    pub(super) proof: Option<Proof>,
    /// Times that a proof has pushed the head downward in vain.
    pub(super) descents: u32,
    pub(super) commissioning: Option<Commissioning>,
    pub(super) checked: Option<Result<Report, Finding>>,
    /// Tick in which the present state was entered.
    entered: u32,
    /// State that a retreat returns to, and the count where it began.
    pub(super) retreat: (State, i64),
    pub(super) open: OpenCircuit,
    /// Path coordinate where the work was found.
    pub(super) work: Option<Fixed>,
    /// The upper limit was open when the loop was closed: the head may leave it downward.
    pub(super) upper_limit_excused: bool,
    pub(super) safety: SafetyInputs,
    /// The reflex has begun a retreat.
    reflex: bool,
    /// A [`super::WritePermit`] is out.
    pub(super) write_permitted: bool,
}

impl<P: DerefMut<Target = Path>> Head<P> {
    /// A disabled head on an empty path.
    pub fn new(config: Config, mut path: P) -> Head<P> {
        path.scale([config.axis.counts_per_um]);
        path.set_retreat(config.retreat.limit);
        Head {
            status: Status::default(),
            changes: ChangeLog::default(),
            tracking: None,
            path,
            law: config.law,
            limiter: Limiter::default(),
            axis: AxisLoop::default(),
            single: Pid::default(),
            guard: CurrentGuard::default(),
            schedule: Schedule::new(),
            trajectory: Trajectory::new(0),
            full: full(&config),
            sums: Sums::default(),
            at: Fixed(0),
            urgent: true,
            planned: 1,
            positioning: None,
            mark: Mark::default(),
            reacting: None,
            doubt: None,
            proof: None,
            descents: 0,
            commissioning: None,
            checked: None,
            entered: 0,
            retreat: (State::Eroding, 0),
            open: OpenCircuit::new(config.seek.settle),
            work: None,
            upper_limit_excused: false,
            safety: SafetyInputs::default(),
            reflex: false,
            write_permitted: false,
            config,
        }
    }

    /// What is known after the last tick.
    pub fn status(&self) -> &Status {
        &self.status
    }

    /// What the ticks run.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Limits that the supervision judges by.
    pub fn supervision(&self) -> super::SupervisionLimits {
        self.config.supervise
    }

    /// Oldest change of state not read yet.
    pub fn next_change(&mut self) -> Option<Change> {
        self.changes.pop()
    }

    /// Changes of state that were never read, because they came faster.
    pub fn lost_changes(&self) -> u32 {
        self.changes.lost()
    }

    /// Result of the last commissioning.
    pub fn commissioning_result(&self) -> Option<Result<Report, Finding>> {
        self.checked
    }

    /// Swaps the configuration between two ticks. While a loop is closed the axis as wired must stay the same, and the
    /// loops keep their integrators: no bump.
    pub fn configure(&mut self, config: Config) -> Result<(), Refused> {
        // Gains and the duty limit may change under way: the loops' integrals are duties.
        if self.status.state != State::Disabled && !self.config.axis.is_wired_as(&config.axis) {
            return Err(Refused::State(self.status.state));
        }
        if config.law != self.config.law {
            self.law = config.law;
        }
        self.path.set_retreat(config.retreat.limit);
        self.full = full(&config);
        self.config = config;
        self.urgent = true;
        Ok(())
    }

    /// A fault found elsewhere: supervision, reflex, a classifier. Pulses go off with this call's return. While another one's
    /// reaction runs, only one that escalates it is taken.
    pub fn raise(&mut self, fault: Fault) {
        let reaction = match &self.reacting {
            Some(reacting) => reacting.escalates(fault),
            // Over an encoder in doubt no loop is closed.
            None if self.doubt.is_some() => Some(fault.reaction().max(Reaction::OpenLoopLift)),
            None => Some(fault.reaction()),
        };
        if let Some(reaction) = reaction {
            self.react_with(fault, reaction);
        }
    }

    /// Takes up a reaction to a fault, whatever was done before.
    fn react_with(&mut self, fault: Fault, reaction: Reaction) {
        self.end_positioning();
        self.reacting = Some(Reacting::new(fault, reaction, &self.situation()));
        self.commissioning = None;
        self.proof = None;
        self.status.fault = Some(fault);
        self.status.first = self.status.first.or(Some(fault));
        if fault.doubts_encoder() {
            // What the head moves without its counts is counted by nobody, or wrongly.
            let blind = fault == Fault::EncoderLost || reaction >= Reaction::OpenLoopLift;
            let lost = blind || self.doubt == Some(Fault::EncoderLost);
            self.doubt = Some(if lost { Fault::EncoderLost } else { fault });
            self.status.homed &= !lost;
        }
        self.axis.reset();
        // A reaction may retrace further than a working retreat.
        self.path.set_retreat(Fixed(i64::MAX));
        self.enter(State::Fault, Reason::Fault(fault));
    }

    pub(super) fn enter(&mut self, state: State, reason: Reason) {
        self.changes.push(Change { tick: self.status.tick, from: self.status.state, to: state, reason });
        self.status.state = state;
        self.entered = self.status.tick;
        if !matches!(state, State::Positioning | State::Homing) {
            self.end_positioning();
        }
        if state == State::Disabled {
            // Broken off, or at their end.
            (self.commissioning, self.proof) = (None, None);
        }
        self.urgent = true;
        self.status.feed = MicrometresPerSecond(match state {
            State::Seeking => self.config.seek.velocity.0,
            State::Retreating => -self.config.retreat.velocity.0,
            _ => 0.0,
        });
        if state != State::Fault {
            self.path.set_retreat(self.config.retreat.limit);
        }
    }

    /// One servo tick.
    #[inline]
    pub fn tick(&mut self, input: &TickInput) -> TickOutput {
        self.status.tick = self.status.tick.wrapping_add(1);
        let busy = self.schedule.begin();
        self.measure(input);
        let shorted = input.gap.short_ticks >= self.config.retreat.trigger;
        let more = busy || self.urgent || input.reflex || shorted || input.safety.is_some();
        if more {
            self.do_more(busy, input);
        }
        TickOutput { drive: self.follow(), pulses: self.trajectory.pulses(), more }
    }

    /// What most ticks do not do.
    #[cold]
    fn do_more(&mut self, busy: bool, input: &TickInput) {
        // Whoever is not busy is here for something urgent.
        let mut plan = !busy || input.reflex || input.safety.is_some();
        plan |= input.gap.short_ticks >= self.config.retreat.trigger;
        if busy {
            let slot = self.schedule.take();
            if slot == schedule::LOOK {
                self.look_at_drive(input);
                self.look_at_encoder(input);
            }
            plan |= schedule::plans(slot);
        }
        if plan || self.urgent {
            self.plan(input);
        }
    }

    /// Whether the next tick may plan by itself: it then wants the newest gap reading. Other ticks look at its short ticks
    /// alone; a plan out of its turn takes the reading as it was at most four ticks before.
    #[inline]
    pub fn wants_gap(&self) -> bool {
        self.urgent || self.schedule.is_due()
    }

    /// Whether the next tick compares the two counters: it then wants a fresh reading of the watch, of illegal transitions and
    /// of index marks. Other ticks do not look at them.
    #[inline]
    pub fn looks_at_encoder(&self) -> bool {
        self.schedule.next() == schedule::LOOK
    }

    /// Whether the tick before was the one of its millisecond that looked at drive and encoder: supervision and host want
    /// the status.
    pub fn has_looked(&self) -> bool {
        self.schedule.has_looked()
    }

    /// States that count ticks, and loops that have the gap voltage as their only setpoint.
    pub(super) fn plans_every_tick(&self) -> bool {
        match self.status.state {
            State::Commissioning | State::Fault | State::Proving => true,
            State::Seeking => self.open.volts().is_none(),
            State::Eroding => self.config.structure != Structure::Path,
            _ => false,
        }
    }

    /// Takes in what a plan looks at.
    pub(super) fn take_in(&mut self, input: &TickInput) {
        self.status.gap = input.gap;
        self.status.gap_setpoint = match self.config.setpoint {
            Setpoint::Volts(volts) => volts,
            Setpoint::ShareOfOpen(share) => Volts(self.status.open_circuit.0 * share),
        };
        self.safety = input.safety.unwrap_or_default();
        self.status.safety = self.safety;
        self.mark = input.encoder.mark;
        self.reflex = input.reflex;
    }

    /// The most urgent fault that the safety inputs show, as far as the present state cares.
    pub(super) fn unsafe_input(&self) -> Option<Fault> {
        let state = self.status.state;
        let checking = matches!(state, State::Commissioning | State::Homing);
        // The proof may push the head up to its switch, and then begins there.
        let excused = self.upper_limit_excused || state == State::Proving;
        let safety = SafetyInputs {
            upper_limit: self.safety.upper_limit && !excused,
            dielectric: self.safety.dielectric && state.pulses(),
            ..self.safety
        };
        // The check drives from stop to stop, and homing looks for the switches: one open limit is where they turn round.
        match hazard(&safety) {
            _ if state == State::Disabled => None,
            Some(Fault::UpperLimit | Fault::LowerLimit) if checking => None,
            hazard => hazard,
        }
    }

    pub(super) fn situation(&self) -> Situation {
        let safe = self.work.unwrap_or(Fixed(0)).minus(self.config.retreat.safe);
        let axis = &self.config.axis;
        let (top, _) = axis.travel;
        let margin = (self.config.retreat.off_limit.to_f32() * axis.counts_per_um) as i64;
        let at_top = self.status.homed && self.status.position <= self.fixed(top).round().saturating_add(margin);
        Situation {
            path: self.path.s(),
            safe,
            following: self.status.following,
            position: self.status.position,
            velocity: self.status.velocity,
            duty: self.status.duty,
            saturated: self.status.saturated,
            top: at_top || self.safety.upper_limit,
            upper_limit: self.safety.upper_limit,
            current_reduced: self.guard.reduced(),
            bus: self.status.bus,
        }
    }

    /// State transitions, then the motion of the state and whether it needs pulses.
    pub(super) fn decide(&mut self) -> (Motion, bool) {
        self.upper_limit_excused &= self.safety.upper_limit;
        let full = Window::symmetric(self.config.axis.duty_limit);
        let along = |velocity| Motion::Path(MicrometresPerSecond(velocity), full);
        match self.status.state {
            State::Seeking => self.seek(),
            State::Eroding => self.watch_short(State::Eroding),
            State::Guiding => self.watch_short(State::Guiding),
            State::Retreating => self.end_retreat(),
            _ => {}
        }
        let state = self.status.state;
        let motion = match state {
            State::Disabled => Motion::Coast,
            // Whatever was raised: nothing moves while the processor may stall.
            State::Fault if self.write_permitted => Motion::Coast,
            State::Commissioning => return self.run_commissioning(),
            State::Proving => self.run_proof(),
            State::Ready | State::Done | State::HoldingPosition => along(0.0),
            State::Positioning | State::Homing => self.plan_positioning(),
            State::Seeking if self.open.volts().is_none() => along(0.0),
            State::Seeking => along(self.config.seek.velocity.0),
            State::Eroding => self.erode(),
            State::Guiding => self.guide(),
            State::Retreating => along(-self.config.retreat.velocity.0),
            State::Fault => self.react(),
        };
        // The state of now: a path that ended in this tick has ended its pulses too.
        (motion, self.status.state.pulses())
    }

    /// The motion of the reaction under way; that of a second fault in the tick in which it shows.
    fn react(&mut self) -> Motion {
        let situation = self.situation();
        let motion = |head: &mut Self| head.reacting.as_mut().map(|reacting| reacting.tick(&head.config, &situation));
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
        match proof.tick(&self.config, self.status.position, self.safety.upper_limit) {
            Outcome::Push(duty) => Motion::Duty(duty),
            Outcome::Hold => {
                if !self.status.closed {
                    self.axis.reset();
                    self.restart_path();
                }
                Motion::Path(MicrometresPerSecond(0.0), self.full_window())
            }
            Outcome::Proved(goal) => {
                self.doubt = None;
                self.proof = None;
                self.descents = 0;
                match goal {
                    Goal::Ready => self.close_loop(),
                    Goal::Commissioning => self.begin_commissioning(),
                }
                Motion::Path(MicrometresPerSecond(0.0), self.full_window())
            }
            // The lift is a push of the same sign: where that goes the wrong way there is none.
            Outcome::Failed(Fault::PolarityWrong) => {
                self.react_with(Fault::PolarityWrong, Reaction::Coast);
                Motion::Coast
            }
            Outcome::Failed(fault) => {
                let descended = proof.is_descending() && !self.safety.upper_limit;
                self.descents = self.descents.saturating_add(descended.into());
                self.raise(fault);
                self.react()
            }
        }
    }

    fn run_commissioning(&mut self) -> (Motion, bool) {
        let Some(check) = &mut self.commissioning else { return (Motion::Coast, false) };
        let status = &self.status;
        let (wish, result) = check.tick(
            &self.config.commissioning,
            &self.config.axis.gains,
            status.position,
            status.velocity,
            &status.gap,
        );
        if let Some(result) = result {
            self.config.commissioned = result.is_ok();
            self.checked = Some(result);
            self.commissioning = None;
            self.enter(State::Disabled, Reason::CommissioningEnded);
            return (Motion::Coast, false);
        }
        (Motion::Duty(wish.duty), wish.pulses)
    }

    fn seek(&mut self) {
        self.watch_short(State::Seeking);
        if self.status.state != State::Seeking {
            return;
        }
        let gap = self.status.gap;
        let Some(open) = self.open.volts() else {
            self.open.observe(&gap, true);
            return;
        };
        self.status.open_circuit = open;
        if open < self.config.seek.open_min {
            self.raise(Fault::GapSignalInvalid);
            return;
        }
        let valid = gap.quality == Quality::Valid;
        if valid && gap.filtered.0 < open.0 * self.config.seek.threshold {
            self.work = self.work.or(Some(self.path.s()));
            self.law = self.config.law;
            self.single.reset();
            self.enter(State::Eroding, Reason::WorkFound);
        } else if self.path.at_end() && self.arrived() {
            self.enter(State::Done, Reason::PathEnd);
        }
    }

    /// The axis is on the count that the path asks for.
    fn arrived(&self) -> bool {
        let [setpoint] = self.path.setpoint();
        self.status.position == setpoint.round()
    }

    /// The fast path to a retreat: the reflex has begun one, or the unfiltered gap was shorted for a set time.
    fn watch_short(&mut self, from: State) {
        if self.reflex || self.status.gap.short_ticks >= self.config.retreat.trigger {
            self.retreat = (from, self.status.position);
            self.enter(State::Retreating, Reason::Short);
        }
    }

    fn end_retreat(&mut self) {
        let (back_to, began) = self.retreat;
        let gone = began.saturating_sub(self.status.position);
        let shorted = self.status.gap.short_ticks > 0;
        let clear = gone >= self.config.retreat.clearance || self.path.behind().0 <= 0.0;
        if !shorted && clear {
            self.law = self.config.law;
            self.enter(back_to, Reason::GapRecovered);
        } else if shorted
            && (self.status.tick.wrapping_sub(self.entered) > self.config.retreat.persistent
                || self.path.behind().0 <= 0.0)
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
        let config = &self.config;
        let full = Window::symmetric(config.axis.duty_limit);
        if self.path.at_end() && self.arrived() {
            self.enter(State::Done, Reason::PathEnd);
            return Motion::Path(MicrometresPerSecond(0.0), full);
        }
        let error = self.gap_error();
        let config = &self.config;
        match config.structure {
            Structure::SingleLoop => {
                let window = full.and(self.current_window());
                Motion::Duty(self.single.update(&config.single, error.0, config.axis.gains.holding(), window).value)
            }
            structure => {
                let wanted = config.limits.clamp(self.law.velocity(error, self.planned));
                self.status.feed = wanted;
                if structure == Structure::Path { Motion::Path(wanted, full) } else { Motion::Velocity(wanted) }
            }
        }
    }

    /// Holds the end of the path, or returns to it from a retreat, and tells the feed that the gap asks for.
    fn guide(&mut self) -> Motion {
        let error = self.gap_error();
        self.status.feed = self.config.limits.clamp(self.law.velocity(error, self.planned));
        Motion::Path(self.config.retreat.velocity, self.full_window())
    }

    pub(super) fn full_window(&self) -> Window {
        Window::symmetric(self.config.axis.duty_limit)
    }

    pub(super) fn current_window(&self) -> Window {
        let limit = self.guard.limit(&self.config.axis.current);
        self.config.axis.plant.current_window(limit, self.status.velocity)
    }
}

fn full(config: &Config) -> f32 {
    let full = f32::from(Drive::FULL);
    if config.axis.motor_reversed { -full } else { full }
}

/// The most urgent fault that safety inputs show.
pub(super) fn hazard(safety: &SafetyInputs) -> Option<Fault> {
    match safety {
        SafetyInputs { bridge_fault: true, .. } => Some(Fault::BridgeFault),
        SafetyInputs { emergency_stop: true, .. } => Some(Fault::EmergencyStop),
        SafetyInputs { upper_limit: true, lower_limit: true, .. } => Some(Fault::BothLimits),
        SafetyInputs { upper_limit: true, .. } => Some(Fault::UpperLimit),
        SafetyInputs { lower_limit: true, .. } => Some(Fault::LowerLimit),
        SafetyInputs { dielectric: true, .. } => Some(Fault::DielectricNotOk),
        _ => None,
    }
}
