//! The servo tick.

use super::check::Check;
use super::config::{Axis, Config, Setpoint, Structure};
use super::reaction::{Motion, Reacting, Situation};
use super::{Change, ChangeLog, Fault, Finding, Reason, Refused, Report, State, Status, TickInput, TickOutput};
use crate::encoder::{MarkCheck, Plausibility, Position, Velocity};
use crate::feed::{FeedLaw, Law, Limiter};
use crate::gap::{OpenCircuit, Quality};
use crate::path::Path;
use crate::servo::{AxisLoop, CurrentGuard, Pid, Window};
use crate::units::{ADC_FULL_SCALE, Amps, CountsPerSecond, Fixed, MicrometresPerSecond, Volts, larger};
use core::ops::DerefMut;
use edm_hal_shim::bridge::Drive;
use edm_hal_shim::encoder::RawCount;
use edm_hal_shim::safety::SafetyInputs;

/// What follows the encoder.
#[derive(Debug)]
pub(super) struct Tracking {
    pub(super) position: Position,
    velocity: Velocity,
    plausibility: Plausibility,
    marks: MarkCheck,
}

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
    pub(super) reacting: Option<Reacting>,
    pub(super) check: Option<Check>,
    pub(super) checked: Option<Result<Report, Finding>>,
    /// Ticks in the present state.
    pub(super) in_state: u32,
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
    /// A [`super::Leave`] is out.
    pub(super) on_leave: bool,
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
            reacting: None,
            check: None,
            checked: None,
            in_state: 0,
            retreat: (State::Eroding, 0),
            open: OpenCircuit::new(config.seek.settle),
            work: None,
            upper_limit_excused: false,
            safety: SafetyInputs::default(),
            reflex: false,
            on_leave: false,
            config,
        }
    }

    /// What is known after the last tick.
    pub fn status(&self) -> &Status {
        &self.status
    }

    /// Limits that the supervision judges by.
    pub fn supervision(&self) -> super::SupervisionLimits {
        self.config.supervise
    }

    /// Oldest change of state not read yet.
    pub fn next_change(&mut self) -> Option<Change> {
        self.changes.pop()
    }

    /// Result of the last guided check.
    pub fn check_result(&self) -> Option<Result<Report, Finding>> {
        self.checked
    }

    /// Swaps the configuration between two ticks. While a loop is closed the axis as wired must stay the same, and the
    /// loops keep their integrators: no bump.
    pub fn configure(&mut self, config: Config) -> Result<(), Refused> {
        if self.status.state != State::Disabled && config.axis != self.config.axis {
            return Err(Refused::State(self.status.state));
        }
        if config.law != self.config.law {
            self.law = config.law;
        }
        self.path.set_retreat(config.retreat.limit);
        self.config = config;
        Ok(())
    }

    /// A fault found elsewhere: supervision, reflex, a classifier. Pulses go off with this call's return.
    pub fn raise(&mut self, fault: Fault) {
        if let Some(reacting) = &self.reacting
            && !reacting.yields_to(fault)
        {
            return;
        }
        self.reacting = Some(Reacting::new(fault, &self.situation()));
        self.check = None;
        self.status.fault = Some(fault);
        // What was counted since cannot be trusted, nor the place where zero was.
        self.status.homed &= fault != Fault::EncoderLost;
        self.axis.reset();
        // A reaction may retrace further than a working retreat.
        self.path.set_retreat(Fixed(i64::MAX));
        self.enter(State::Fault, Reason::Fault(fault));
    }

    pub(super) fn enter(&mut self, state: State, reason: Reason) {
        self.changes.push(Change { tick: self.status.tick, from: self.status.state, to: state, reason });
        self.status.state = state;
        self.in_state = 0;
        if state != State::Fault {
            self.path.set_retreat(self.config.retreat.limit);
        }
    }

    /// One servo tick.
    pub fn tick(&mut self, input: &TickInput) -> TickOutput {
        self.status.tick = self.status.tick.wrapping_add(1);
        self.in_state = self.in_state.saturating_add(1);
        let believed = self.measure(input);
        if !believed && self.status.state.follows() {
            self.raise(Fault::EncoderLost);
        }
        if let Some(fault) = self.unsafe_input() {
            self.raise(fault);
        }
        let (motion, pulses) = self.decide();
        let drive = self.carry_out(motion);
        TickOutput { drive, pulses }
    }

    /// Takes the inputs in; gives whether the encoder can be believed.
    fn measure(&mut self, input: &TickInput) -> bool {
        let axis = &self.config.axis;
        let (raw, mark) = (as_wired(axis, input.encoder.raw), input.encoder.mark);
        let tracking = self.tracking.get_or_insert_with(|| Tracking {
            position: Position::new(raw),
            velocity: Velocity::new(raw, axis.clock_hz),
            plausibility: Plausibility::new(axis.plausibility, input.encoder.illegal),
            marks: MarkCheck::new(axis.marks),
        });
        self.status.position = tracking.position.update(raw);
        self.status.velocity = tracking.velocity.tick(raw);
        let watch = input.watch.map(|watch| as_wired(axis, watch));
        let counters = tracking.plausibility.tick(raw, watch, input.encoder.illegal);
        let scale = tracking.marks.update(mark);
        self.status.illegal_transitions = input.encoder.illegal;
        self.status.gap = input.gap;
        self.status.gap_setpoint = match self.config.setpoint {
            Setpoint::Volts(volts) => volts,
            Setpoint::ShareOfOpen(share) => Volts(self.status.open_circuit.0 * share),
        };
        self.safety = input.safety;
        self.status.safety = input.safety;
        self.reflex = input.reflex;

        let mid_scale = f32::from(ADC_FULL_SCALE.div_ceil(2));
        let current = (f32::from(input.drive.motor_current) - mid_scale) * axis.amps_per_code.0;
        self.status.current = Amps(if axis.motor_reversed { -current } else { current });
        self.status.bus = Volts(f32::from(input.drive.bus_voltage) * axis.bus_per_code.0);
        let Status { duty, bus, current, velocity, .. } = self.status;
        self.status.back_emf.update(&axis.plant, duty, bus, current, velocity);
        counters.is_ok() && scale.is_ok()
    }

    /// The most urgent fault that the safety inputs show, as far as the present state cares.
    fn unsafe_input(&self) -> Option<Fault> {
        let state = self.status.state;
        let checking = state == State::Commissioning;
        let safety = SafetyInputs {
            upper_limit: self.safety.upper_limit && !self.upper_limit_excused,
            dielectric: self.safety.dielectric && state.pulses(),
            ..self.safety
        };
        // The check drives from stop to stop: one open limit is where it turns round.
        match hazard(&safety) {
            _ if state == State::Disabled => None,
            Some(Fault::UpperLimit | Fault::LowerLimit) if checking => None,
            hazard => hazard,
        }
    }

    pub(super) fn situation(&self) -> Situation {
        let safe = self.work.unwrap_or(Fixed(0)).minus(self.config.retreat.safe);
        Situation {
            path: self.path.s(),
            safe,
            following: self.status.following,
            upper_limit: self.safety.upper_limit,
            current_reduced: self.guard.reduced(),
            bus: self.status.bus,
        }
    }

    /// State transitions, then the motion of the state and whether it needs pulses.
    fn decide(&mut self) -> (Motion, bool) {
        self.upper_limit_excused &= self.safety.upper_limit;
        let full = Window::symmetric(self.config.axis.duty_limit);
        let along = |velocity| Motion::Path(MicrometresPerSecond(velocity), full);
        match self.status.state {
            State::Seeking => self.seek(),
            State::Eroding => self.watch_short(State::Eroding),
            State::Retreating => self.end_retreat(),
            _ => {}
        }
        let state = self.status.state;
        let motion = match state {
            State::Disabled => Motion::Coast,
            // Whatever was raised: nothing moves while the processor may stall.
            State::Fault if self.on_leave => Motion::Coast,
            State::Commissioning => return self.run_check(),
            State::Ready | State::Done | State::HoldingPosition => along(0.0),
            State::Seeking if self.open.volts().is_none() => along(0.0),
            State::Seeking => along(self.config.seek.velocity.0),
            State::Eroding => self.erode(),
            State::Retreating => along(-self.config.retreat.velocity.0),
            State::Fault => {
                let situation = self.situation();
                match &mut self.reacting {
                    Some(reacting) => reacting.tick(&self.config, &situation),
                    None => Motion::Coast,
                }
            }
        };
        // The state of now: a path that ended in this tick has ended its pulses too.
        (motion, self.status.state.pulses())
    }

    fn run_check(&mut self) -> (Motion, bool) {
        let Some(check) = &mut self.check else { return (Motion::Coast, false) };
        let status = &self.status;
        let (wish, result) =
            check.tick(&self.config.check, &self.config.axis.gains, status.position, status.velocity, &status.gap);
        if let Some(result) = result {
            self.config.commissioned = result.is_ok();
            self.checked = Some(result);
            self.check = None;
            self.enter(State::Disabled, Reason::CheckEnded);
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
        } else if shorted && (self.in_state > self.config.retreat.persistent || self.path.behind().0 <= 0.0) {
            self.raise(Fault::PersistentShort);
        }
    }

    fn erode(&mut self) -> Motion {
        let config = &self.config;
        let full = Window::symmetric(config.axis.duty_limit);
        if self.path.at_end() && self.arrived() {
            self.enter(State::Done, Reason::PathEnd);
            return Motion::Path(MicrometresPerSecond(0.0), full);
        }
        // A reading that is not valid is no reason to move; supervision decides how long that may last.
        let error = match self.status.gap.quality {
            Quality::Valid => Volts(self.status.gap.filtered.0 - self.status.gap_setpoint.0),
            _ => Volts(0.0),
        };
        match config.structure {
            Structure::SingleLoop => {
                let window = full.and(self.current_window());
                Motion::Duty(self.single.update(&config.single, error.0, config.axis.gains.holding(), window))
            }
            structure => {
                let wanted = config.limits.clamp(self.law.velocity(error));
                if structure == Structure::Path { Motion::Path(wanted, full) } else { Motion::Velocity(wanted) }
            }
        }
    }

    fn current_window(&self) -> Window {
        let limit = self.guard.limit(&self.config.axis.current);
        self.config.axis.plant.current_window(limit, self.status.velocity)
    }

    fn carry_out(&mut self, motion: Motion) -> Drive {
        self.guard.update(&self.config.axis.current, self.status.current);
        self.status.current_reduced = self.guard.reduced();
        let axis = self.config.axis;
        let allowed = Window::symmetric(axis.duty_limit).and(self.current_window());
        let (duty, window) = match motion {
            Motion::Coast => {
                self.limiter.stop();
                self.axis.reset();
                self.status.duty = 0.0;
                self.status.saturated = false;
                self.follow_axis();
                return Drive::Coast;
            }
            Motion::Path(wanted, window) => {
                let window = window.and(allowed);
                let velocity = self.limited(wanted);
                self.path.step(velocity.per_tick());
                let [setpoint] = self.path.setpoint();
                let [direction] = self.path.direction();
                self.status.setpoint = setpoint;
                self.status.following = setpoint.minus(Fixed::whole(self.status.position)).to_f32();
                let feed = CountsPerSecond(velocity.0 * direction);
                (self.axis.follow(&axis.gains, self.status.following, feed, self.status.velocity, window), window)
            }
            Motion::Velocity(wanted) => {
                self.follow_axis();
                let [direction] = self.path.direction();
                let wanted = CountsPerSecond(self.limited(wanted).0 * direction);
                (self.axis.run(&axis.gains, wanted, self.status.velocity, allowed), allowed)
            }
            Motion::Duty(duty) => {
                self.limiter.stop();
                self.follow_axis();
                (duty, allowed)
            }
        };
        self.status.duty = window.clamp(duty);
        self.status.saturated = self.status.duty <= window.low || self.status.duty >= window.high;
        self.status.path = self.path.s();
        let signed = if axis.motor_reversed { -self.status.duty } else { self.status.duty };
        Drive::Duty((signed * f32::from(Drive::FULL)) as i16)
    }

    /// Path velocity inside acceleration and stopping distance; an open upper limit is never run into.
    fn limited(&mut self, wanted: MicrometresPerSecond) -> MicrometresPerSecond {
        let wanted = if self.safety.upper_limit { MicrometresPerSecond(larger(wanted.0, 0.0)) } else { wanted };
        self.limiter.limit(wanted, self.config.acceleration, self.path.ahead(), self.path.behind())
    }

    /// Without a position loop the path coordinate follows the axis, so that closing the loop makes no jump.
    fn follow_axis(&mut self) {
        let [setpoint] = self.path.setpoint();
        let [direction] = self.path.direction();
        let off = Fixed::whole(self.status.position).minus(setpoint).to_f32();
        if direction != 0.0 {
            self.path.step(Fixed::short(off / direction));
        }
        let [setpoint] = self.path.setpoint();
        self.status.setpoint = setpoint;
        self.status.following = 0.0;
        self.status.path = self.path.s();
    }
}

/// A count that grows toward the work, whichever way the encoder is wired.
fn as_wired(axis: &Axis, raw: RawCount) -> RawCount {
    if axis.encoder_reversed {
        RawCount { count: raw.count.wrapping_neg(), toward_work: !raw.toward_work, ..raw }
    } else {
        raw
    }
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
