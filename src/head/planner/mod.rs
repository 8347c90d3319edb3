//! Plan: states, fault reactions, feed law, limits, the path ahead.
//!
//! The [`Planner`] runs below the servo tick, some 4000 times a second, on the [`Estimate`] of one tick, and makes the [`Plan`]
//! that comes into force [`LEAD`](super::LEAD) ticks later. It sees nothing else of the world but what the supervision has
//! looked at ([`Monitored`]). Commands come in between [`begin`](Planner::begin) and [`plan`](Planner::plan).

mod commands;
mod motion;
mod states;
mod touching;

use super::commissioning::{Commissioning, Finding, Report};
use super::config::Config;
use super::ends::Ends;
use super::estimate::Estimate;
use super::fault::{Fault, Reaction};
use super::follow::{FollowConfig, LEAD};
use super::guide::{Guidance, Guide};
use super::jump::Jump;
use super::plan::{Hazards, Plan, Touch};
use super::positioning::{HomingState, Task, When};
use super::probe::{PROBES, Probe, Source, Wanted};
use super::proof::Proof;
use super::reaction::{Reacting, Situation, upward};
use super::route::{Bounds, Route};
use super::silence::Silence;
use super::state::{Change, ChangeLog, Reason, State};
use super::supervise::{Config as SupervisionConfig, Monitored};
use super::touch;
use super::trajectory::{Follow, Trajectory};
use super::{Refused, Status};
use crate::feed::Law;
use crate::gap::OpenCircuit;
use crate::gap::Quality;
use crate::kept::Kept;
use crate::motion::TrajectorySegment;
use crate::path::Path;
use crate::servo::{Presliding, Window};
use crate::units::{CountsPerSecond, Fixed, MicrometresPerSecond, PLAN_TICKS, TICK_S, Volts};
use core::ops::DerefMut;
use edm_hal_shim::self_test::SelfTest;

/// Counts by which a set point at rest may be beyond where the axis has been: the loop trembles over an edge.
const TREMBLE: i64 = 1;
/// Share of the open-circuit voltage from which on a gap is open: discharges are rare.
const OPEN: f32 = 0.8;
/// Height above the lowest place so far from which a head on its way up has shown its film, um.
const AWAY_UM: f32 = 20.0;

/// How a positioning that is to touch the work stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Touching {
    /// It is not to.
    No,
    /// It is to, and has not yet.
    Asked,
    /// It has, and goes back until it is clear.
    Done,
}

/// The part of a head that decides. `P` owns the path: a `Box<Path>`, or a `&'static mut Path`.
#[derive(Debug)]
pub struct Planner<P> {
    config: Config,
    kept: Kept<Config>,
    status: Status,
    changes: ChangeLog,
    route: Route<P>,
    now: Estimate,
    judged: Monitored,
    silence: Silence,
    /// Ticks since the estimate before.
    ticks: u32,
    /// Position less the count since the start.
    offset: i64,
    resets: u32,
    trusts: u32,
    law: Law,
    open: OpenCircuit,
    /// State that a retreat returns to, and the count where it began.
    retreat: (State, i64),
    positioning: Option<Task>,
    /// While guiding, and in a retreat from there.
    guide: Option<Guide>,
    jump: Option<Jump>,
    presliding: Presliding,
    /// The search for a surface under way.
    search: Option<touch::Touching>,
    /// What of the erosion's end has come, and the path coordinate of the lift after it.
    ends: Ends,
    lifts_to: Fixed,
    /// The work has been found, and the gap is still wider than the one to keep.
    meets: bool,
    /// Ticks of erosion since the last jump.
    eroded: u32,
    /// Jumps for arcs since there were fewer.
    arc_jumps: u8,
    /// Ticks for which a set point has waited for the axis.
    waited: u32,
    /// Path coordinate of the last good place.
    good: Fixed,
    /// Whether it is to touch the work.
    touching: Touching,
    probes: [Probe; PROBES],
    /// Furthest place toward the work that the axis has been at since the loop was closed, counts.
    cleared: i64,
    reacting: Option<Reacting>,
    /// The fault that has cast doubt on the encoder, until it has proved itself.
    doubt: Option<Fault>,
    proof: Option<Proof>,
    /// Times that a proof has pushed the head downward in vain.
    descents: u32,
    commissioning: Option<Commissioning>,
    commissioned: Option<Result<Report, Finding>>,
    /// Tick in which the present state was entered.
    entered: u32,
    /// The upper limit was open when the loop was closed: the head may leave it downward.
    upper_limit_excused: bool,
    /// A [`super::WritePermit`] is out.
    write_permitted: bool,
    /// The board has failed its self-test.
    self_test_failed: bool,
}

impl<P: DerefMut<Target = Path>> Planner<P> {
    /// A disabled head on an empty path. On a board that has failed its self-test it has a fault from its first plan on, which
    /// nothing but another start resets.
    #[inline(always)]
    pub fn new(config: Config, path: P, self_test: SelfTest) -> Planner<P> {
        Planner {
            status: Status::default(),
            changes: ChangeLog::default(),
            route: Route::new(path, config.axis.nm_per_count, config.retreat.limit),
            now: Estimate::default(),
            judged: Monitored::default(),
            silence: Silence::default(),
            ticks: 1,
            offset: 0,
            resets: 0,
            trusts: 0,
            law: config.law,
            open: OpenCircuit::new(config.seek.settle),
            retreat: (State::Eroding, 0),
            positioning: None,
            guide: None,
            jump: None,
            presliding: Presliding::default(),
            search: None,
            ends: Ends::default(),
            lifts_to: Fixed(0),
            meets: false,
            eroded: 0,
            arc_jumps: 0,
            waited: 0,
            good: Fixed(0),
            touching: Touching::No,
            probes: [Probe::default(); PROBES],
            cleared: 0,
            reacting: None,
            doubt: None,
            proof: None,
            descents: 0,
            commissioning: None,
            commissioned: None,
            entered: 0,
            upper_limit_excused: false,
            write_permitted: false,
            self_test_failed: self_test.failed(),
            kept: Kept::NEW,
            config,
        }
    }

    /// What is known after the newest plan.
    pub fn status(&self) -> &Status {
        &self.status
    }

    /// What is run.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// What the follower has to run for it.
    pub fn follow_config(&self) -> FollowConfig {
        self.config.follow()
    }

    /// What the supervision has to judge by.
    pub fn supervision(&self) -> SupervisionConfig {
        self.config.supervision()
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
        self.commissioned
    }

    /// Swaps the configuration between two plans. While a loop is closed the axis as wired must stay the same.
    ///
    /// # Errors
    /// While a loop may be closed, and the axis is wired otherwise; another structure while other axes go along the path.
    pub fn configure(&mut self, config: Config) -> Result<(), Refused> {
        if self.status.state != State::Disabled && !self.config.axis.is_wired_as(&config.axis) {
            return Err(Refused::State(self.status.state));
        }
        if config.structure != self.config.structure && self.route.leads_beside() {
            return Err(Refused::Alone);
        }
        if config.law != self.config.law {
            self.law = config.law;
        }
        if !matches!(self.status.state, State::Fault | State::Lifting) {
            self.route.set_retreat(config.retreat.limit);
        }
        let rescaled = config.axis.nm_per_count != self.config.axis.nm_per_count;
        self.adopt(config);
        if rescaled {
            self.route.scale(self.config.axis.nm_per_count);
            self.restart_path();
        }
        Ok(())
    }

    /// What is run from here on, and what it is compared with.
    fn adopt(&mut self, config: Config) {
        self.config = config;
        self.kept = Kept::NEW;
    }

    /// Looks at a part of the configuration: false once it has changed by itself.
    pub fn is_intact(&mut self) -> bool {
        self.kept.agrees(&self.config)
    }

    /// Takes in the estimate of a tick, and what it tells of.
    pub fn begin(&mut self, now: &Estimate, judged: &Monitored) {
        self.ticks = now.tick.wrapping_sub(self.now.tick).clamp(1, super::TICKS_MOST);
        self.now = *now;
        self.judged = *judged;
        self.route.reconcile(now);
        self.take_in();
        let count = now.position.wrapping_sub(now.offset);
        let missing = self.silence.look(&self.config, count, now.duty, now.segment.velocity, self.ticks);
        // Where a head may meet its stop, standing still says nothing.
        let stops = match self.status.state {
            State::Commissioning => true,
            State::Fault => !self.is_free(),
            _ => self.looks_for_home(),
        };
        if missing && self.status.closed && !stops {
            self.raise(Fault::EncoderLost);
        }
        if self.self_test_failed && self.status.state == State::Disabled {
            self.raise(Fault::SelfTestFailed);
        }
        if let Some(fault) = now.doubt {
            self.raise(fault);
        }
        if let Some(fault) = now.reported
            && now.doubt != now.reported
        {
            self.raise(fault);
        }
        if let Some(fault) = self.hazards().hazard(&self.now.safety) {
            self.raise(fault);
        }
        if self.presses() {
            self.raise(Fault::Contact);
        }
    }

    /// Decides, and writes the plan.
    pub fn plan(&mut self, plan: &mut Plan) {
        let (motion, allowed) = self.decide();
        let mut followed = self.trajectory(motion);
        self.compensate(&mut followed);
        self.status.reacting = self.reacting.as_ref().is_some_and(Reacting::moves);
        let retreats = matches!(self.status.state, State::Seeking | State::Eroding | State::Guiding);
        // One field after the other: a whole plan would be put together beside it, and copied.
        let Plan {
            generation,
            trajectory,
            path,
            setpoint,
            offset,
            paths,
            resets,
            trusts,
            state,
            closed,
            pulses,
            homes,
            free,
            open,
            probes,
            set_points,
            toward,
            slew,
            due,
            touch,
            hazards,
            reaction,
            doubted,
            retreat,
            stop,
            limited,
            lift,
        } = plan;
        *generation = self.now.generation;
        *trajectory = followed;
        *path = self.route.s();
        *setpoint = self.status.setpoint;
        *offset = self.offset;
        *paths = self.route.begun();
        *resets = self.resets;
        *trusts = self.trusts;
        *state = self.status.state;
        *closed = self.status.closed;
        *pulses = allowed;
        *homes = self.looks_for_home();
        *free = self.is_free();
        *open = self.is_open();
        *probes = self.wanted();
        *set_points = self.follows_set_points();
        *toward = self.toward(*setpoint);
        *slew = self.slew();
        *due = self.due();
        *touch = self.touch();
        *hazards = self.hazards();
        *reaction = self.reacting.as_ref().map(Reacting::reaction);
        *doubted = self.doubt.is_some();
        *retreat = if retreats { Some(self.ready_retreat()) } else { None };
        *stop = self.ready_stop(&followed);
        *limited = self.ready_window(self.config.lift.limited);
        *lift = self.ready_lift();
        self.status.path = self.route.s();
        self.status.waiting = self.route.waiting();
        self.status.beside = self.route.beside();
        self.status.paths = self.route.begun();
        self.status.retreat_ended = self.route.ended();
        self.status.guidance = self.guide.as_ref().map_or(Guidance::No, Guide::guidance);
    }

    /// What the estimate says, for whom it concerns.
    fn take_in(&mut self) {
        let (now, judged, status) = (&self.now, &self.judged, &mut self.status);
        let offset = self.offset.wrapping_sub(now.offset);
        status.tick = now.tick;
        status.position = now.position.wrapping_add(offset);
        status.setpoint = now.setpoint.plus(Fixed::whole(offset));
        status.following = now.following;
        status.velocity = now.velocity;
        status.duty = now.duty;
        status.saturated = now.saturated;
        status.gap = now.gap;
        status.safety = now.safety;
        status.late_plans = now.late;
        status.probes = now.probes;
        for edge in status.probes.iter_mut().flat_map(|latched| &mut latched.edges) {
            edge.position = edge.position.wrapping_add(offset);
        }
        status.current = judged.current;
        status.bus = judged.bus;
        status.back_emf = judged.back_emf;
        status.illegal_transitions = judged.illegal;
        status.current_reduced = judged.reduced;
        status.gap_setpoint = self.config.setpoint.volts(status.open_circuit);
        if status.closed && status.state.follows() && !status.gap.touches {
            self.cleared = self.cleared.max(status.position);
        }
    }

    /// What is followed when the plan comes into force, if nothing is decided.
    fn segment(&self) -> TrajectorySegment {
        if self.route.begun() != self.now.paths {
            return TrajectorySegment { from: self.route.setpoint(), ..TrajectorySegment::default() };
        }
        let offset = Fixed::whole(self.offset.wrapping_sub(self.now.offset));
        TrajectorySegment { from: self.now.segment.from.plus(offset), ..self.now.segment }
    }

    /// A fault found elsewhere: supervision, protocol. While another one's reaction runs, only one that escalates it is taken.
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
        self.reset_loop();
        // A reaction may retrace further than a working retreat.
        self.route.free_retreat();
        self.enter(State::Fault, Reason::Fault(fault));
    }

    fn reset_loop(&mut self) {
        self.resets = self.resets.wrapping_add(1);
    }

    fn enter(&mut self, state: State, reason: Reason) {
        self.changes.push(Change { tick: self.status.tick, from: self.status.state, to: state, reason });
        if !matches!(state, State::Positioning | State::Homing | State::Jumping | State::Touching) {
            self.end_positioning();
        }
        if !matches!(state, State::Guiding | State::Retreating) {
            self.guide = None;
        }
        self.status.state = state;
        self.entered = self.status.tick;
        if state == State::Disabled {
            // Broken off, or at their end.
            (self.commissioning, self.proof) = (None, None);
        }
        self.status.feed = MicrometresPerSecond(match state {
            State::Seeking => self.config.seek.velocity.0,
            State::Retreating | State::Lifting => -self.config.retreat.velocity.0,
            _ => 0.0,
        });
        match state {
            // Out of the work, whatever bounds a working retreat.
            State::Lifting => self.route.free_retreat(),
            State::Fault => {}
            _ => self.route.set_retreat(self.config.retreat.limit),
        }
    }

    /// Ends axis positioning: the path begins where the set point is.
    fn end_positioning(&mut self) {
        (self.touching, self.status.approaching) = (Touching::No, false);
        self.break_off_search();
        let beside = self.positioning.take().is_some() | self.jump.take().is_some() | self.search.take().is_some();
        if beside || self.status.state == State::Guiding {
            if self.status.homing == HomingState::Runs {
                self.status.homing = HomingState::No;
            }
            let here = self.segment().from;
            self.restart_path_at(here);
        }
    }

    /// The path begins where the axis is; a retreat past the beginning leads straight up.
    fn restart_path(&mut self) {
        self.restart_path_at(Fixed::whole(self.status.position));
    }

    /// The path begins at a set point.
    fn restart_path_at(&mut self, here: Fixed) {
        let axis = &self.config.axis;
        let escape = Fixed::whole((axis.escape.0 * axis.counts_per_um) as i64);
        let top = if self.status.homed { axis.counts(axis.travel.0) } else { here.minus(escape) };
        self.route.restart(here, top);
        self.good = Fixed(0);
        self.status.setpoint = here;
    }

    /// The head is known to be below the upper end of its travel: no stop is in its way.
    fn is_free(&self) -> bool {
        self.status.homed && !self.at_top()
    }

    /// The gap of a head that feeds or positions is open; one that goes back has left the work.
    fn is_open(&self) -> bool {
        let Status { state, gap, open_circuit, .. } = &self.status;
        match state {
            State::Seeking | State::Eroding => gap.quality == Quality::Valid && gap.filtered.0 >= OPEN * open_circuit.0,
            State::Positioning => !gap.touches,
            State::Retreating | State::Lifting | State::Fault => {
                let above = self.cleared.saturating_sub(self.status.position);
                above as f32 > AWAY_UM * self.config.axis.counts_per_um
            }
            _ => false,
        }
    }

    /// The head stands at the upper end of its travel, perhaps against its stop.
    fn at_top(&self) -> bool {
        // The travel begins at 0.
        self.status.homed && self.status.position <= self.config.axis.off_limit
    }

    fn situation(&self) -> Situation {
        Situation {
            path: self.route.s(),
            safe: self.route.work().minus(self.config.retreat.safe),
            blocked: self.route.at_beginning() || self.now.safety.upper_limit,
            following: self.status.following,
            position: self.status.position,
            velocity: self.status.velocity,
            driven: self.silence.driven(),
            unseen: self.judged.back_emf.difference(),
            generated: self.config.axis.plant.generating(self.judged.current),
            duty: self.status.duty,
            saturated: self.status.saturated,
            top: self.at_top() || self.now.safety.upper_limit,
            homed: self.status.homed,
            upper_limit: self.now.safety.upper_limit,
            current_reduced: self.status.current_reduced,
            bus: self.status.bus,
        }
    }

    /// What a contact means now.
    fn touch(&self) -> Touch {
        match self.status.state {
            State::Positioning | State::Homing if self.touching == Touching::Asked => Touch::End,
            State::Homing if self.looks_for_home() => Touch::End,
            State::Positioning | State::Homing | State::Jumping => Touch::Fault,
            State::Touching if self.search.as_ref().is_some_and(touch::Touching::approaches) => Touch::End,
            _ => Touch::Ignored,
        }
    }

    /// Electrode and work touch short of a set point that goes on toward the work, or has come to rest there: the loop would
    /// press the head on where it has never been, whether or not the set point moves. Nobody is held off the work elsewhere.
    fn presses(&self) -> bool {
        let positions = matches!(self.status.state, State::Ready | State::Positioning | State::Homing);
        let ahead = self.status.setpoint.round().saturating_sub(self.cleared);
        let touches = self.status.gap.touches && self.touching == Touching::No && !self.looks_for_home();
        touches && positions && ahead > TREMBLE && self.now.segment.velocity.0 >= 0.0
    }

    /// Largest velocity toward the work with pulses off: as much as comes down to the approach by the acceleration of the path
    /// where the axis has not been yet.
    pub(super) fn toward(&self, from: Fixed) -> CountsPerSecond {
        let Config { contact, acceleration, axis, .. } = &self.config;
        let clear = Fixed::whole(self.cleared).minus(from).to_f32();
        if self.touching != Touching::No || clear <= 0.0 {
            return contact.approach;
        }
        let slowing = 2.0 * acceleration.0 * axis.counts_per_um * clear;
        CountsPerSecond(libm::sqrtf(contact.approach.0 * contact.approach.0 + slowing))
    }

    /// What the touch probes wait for.
    fn wanted(&self) -> Wanted {
        let on = self.probes.iter().any(|probe| probe.source != Source::Off);
        let discharge = Volts(self.status.open_circuit.0 * self.config.seek.threshold);
        Wanted { on, probes: self.probes, discharge }
    }

    /// Whether a reference is looked for, and not yet gone back from.
    pub(super) fn looks_for_home(&self) -> bool {
        matches!(&self.positioning, Some(Task::Home(homing, _)) if homing.looks())
    }

    /// Whether the supervision has found something in the way of a reference that is looked for.
    pub(super) fn is_blocked(&self) -> bool {
        let since = self.judged.tick.wrapping_sub(self.entered).cast_signed() > 0;
        self.judged.blocked && since && self.looks_for_home()
    }

    /// Whether the set point of the loop is the path's.
    fn follows_path(&self) -> bool {
        let beside = self.positioning.is_some() || self.jump.is_some() || self.search.is_some();
        !beside && self.status.state != State::Guiding
    }

    /// Whether a set point that a SYNC releases is followed at once: not where the head leads.
    fn follows_set_points(&self) -> bool {
        match &self.guide {
            Some(guide) => self.status.state == State::Guiding && guide.is_together(),
            None => self.may_position(self.status.state).is_ok(),
        }
    }

    /// Largest change of velocity of a guided head from a plan to the next.
    fn slew(&self) -> CountsPerSecond {
        let Config { acceleration, axis, .. } = &self.config;
        let guided = acceleration.0 * axis.counts_per_um * (PLAN_TICKS as f32 * TICK_S);
        CountsPerSecond(if self.guide.is_some() { guided } else { f32::INFINITY })
    }

    /// Tick after which the set point under way is reached, or was.
    fn due(&self) -> u32 {
        match self.guide.as_ref().map(|guide| &guide.task).or(self.positioning.as_ref()) {
            Some(Task::Follow { due, .. }) => *due,
            _ => self.now.tick,
        }
    }

    /// When the plan comes into force.
    fn when(&self) -> When {
        When { now: self.now.tick.wrapping_add(LEAD.wrapping_sub(1)), ticks: self.ticks }
    }

    /// Which safety inputs are a hazard in the present state.
    fn hazards(&self) -> Hazards {
        let state = self.status.state;
        Hazards {
            any: state != State::Disabled,
            // Commissioning drives from stop to stop, homing looks for the switches, and to a search for the work the lower one is
            // the end of the travel: one open limit is where they turn.
            limits: !matches!(state, State::Commissioning | State::Homing | State::Touching),
            // The proof may push the head up to its switch, and then begins there.
            upper: !self.upper_limit_excused && state != State::Proving,
            dielectric: state.pulses(),
        }
    }

    fn bounds(&self) -> Bounds {
        Bounds { acceleration: self.config.acceleration, upper_limit: self.now.safety.upper_limit, ticks: self.ticks }
    }

    fn ready_retreat(&self) -> Trajectory {
        if self.status.state == State::Guiding {
            // Beside the path, and straight up.
            let up = if self.now.safety.upper_limit { 0.0 } else { -self.slew().0 };
            let travel = Fixed::short(up * TICK_S);
            let segment = TrajectorySegment { velocity: CountsPerSecond(up), travel, ..TrajectorySegment::default() };
            return Trajectory::axis(&segment, self.full_window().and(self.current_window()));
        }
        let up = MicrometresPerSecond(-self.config.retreat.velocity.0);
        self.route.ready(up, &self.bounds(), self.full_window().and(self.current_window()))
    }

    /// For two ticks: what is open stays open, what is positioned goes on, what follows the path slows down.
    fn ready_stop(&self, trajectory: &Trajectory) -> Trajectory {
        let window = self.ready_window(self.config.axis.duty_limit);
        match trajectory.follow {
            Follow::Setpoint if self.follows_path() => {
                let stop = self.route.ready(MicrometresPerSecond(0.0), &self.bounds(), window);
                Trajectory { upward: true, ..stop }
            }
            Follow::Setpoint => Trajectory { window, upward: true, ..*trajectory },
            _ => Trajectory::COAST,
        }
    }

    /// Duties of a fault's reaction with so much force.
    fn ready_window(&self, force: f32) -> Window {
        upward(&self.config, force).and(self.current_window())
    }

    fn ready_lift(&self) -> Trajectory {
        let barred = self.status.current_reduced || self.now.safety.upper_limit;
        if barred || self.status.state == State::Disabled {
            Trajectory::COAST
        } else {
            Trajectory::duty(self.config.lift.duty, self.full_window())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kept::Parts;
    use crate::settings::Settings;

    #[test]
    fn a_configuration_that_changes_by_itself_is_seen_and_one_that_is_given_is_not() {
        let config = Settings::default().build().unwrap().head;
        let mut planner = Planner::new(config, Box::new(Path::EMPTY), SelfTest::PASSED);
        let looks = |planner: &mut Planner<_>| (0..=Config::PARTS).filter(|_| !planner.is_intact()).count();
        assert_eq!(looks(&mut planner), 0);
        let other = Config { commissioned: !config.commissioned, ..config };
        planner.configure(other).unwrap();
        assert_eq!(looks(&mut planner), 0);
        planner.config.supervise.following = -config.supervise.following;
        assert!(looks(&mut planner) > 0);
        planner.configure(config).unwrap();
        assert_eq!(looks(&mut planner), 0);
    }
}
