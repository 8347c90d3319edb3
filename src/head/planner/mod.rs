//! Plan: states, fault reactions, feed law, limits, the path ahead.
//!
//! The [`Planner`] runs below the servo tick, 4000 times a second, 2000 in slow erosion, on the [`Estimate`] of one tick, and makes the [`Plan`]
//! that comes into force [`LEAD`](super::LEAD) ticks later. In addition it sees only the values of the supervision
//! ([`Monitored`]), a thousand times a second. Commands come in between [`begin`](Planner::begin) and [`plan`](Planner::plan).

mod commands;
mod conditions;
mod eroding;
mod faults;
mod guiding;
mod identifying;
mod inching;
mod jumping;
mod motion;
mod orbiting;
mod positions;
mod ready;
mod states;
mod stepping;
mod touching;
mod transitions;

pub use identifying::Evidence;

use super::commissioning::{Commissioning, Finding, Report};
use super::config::Config;
use super::ends::Ends;
use super::estimate::Estimate;
use super::fault::Fault;
use super::follow::FollowConfig;
use super::guide::{Guidance, Guide};
use super::identify::{Identify, Stage};
use super::inch::Inching;
use super::jump::Jump;
use super::orbit::Orbit;
use super::plan::Plan;
use super::positioning::Task;
use super::probe::{PROBES, Probe};
use super::proof::Proof;
use super::reaction::Reacting;
use super::restraint::{Look, Restraint};
use super::rhythm::Rhythm;
use super::route::Route;
use super::silence::Silence;
use super::state::{Change, ChangeLog, State};
use super::steps::{Recorder, Stepper};
use super::supervise::{Config as SupervisionConfig, Monitored, Row};
use super::touch;
use super::transfer::Transfer;
use super::tune::{Step as TuneStep, Tune};
use super::{Refused, Status};
use crate::encoder::Mark;
use crate::feed::{After, Generator, Leading};
use crate::gap::OpenCircuit;
use crate::kept::Kept;
use crate::motion::TrajectorySegment;
use crate::path::{AXES, Path};
use crate::servo::Presliding;
use crate::units::{CountsPerSecond, Fixed, Micrometres, MicrometresPerSecond, Volts};
use core::ops::DerefMut;
use edm_hal_shim::safety::SafetyInputs;
use edm_hal_shim::self_test::SelfTest;

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

/// What of the newest estimate is asked for after [`Planner::begin`], and is not in the status.
#[derive(Clone, Copy, Debug, Default)]
struct Now {
    generation: u32,
    tick: u32,
    segment: TrajectorySegment,
    along: MicrometresPerSecond,
    offset: i64,
    paths: u32,
    mark: Mark,
    marked: i64,
    safety: SafetyInputs,
    short: bool,
}

/// The same of what the supervision says.
#[derive(Clone, Copy, Debug, Default)]
struct Watched {
    tick: u32,
    arcs: Option<bool>,
    blocked: bool,
    row: Row,
}

/// The part of a head that decides. `P` owns the path: a `Box<Path>`, or a `&'static mut Path`.
#[derive(Debug)]
pub struct Planner<P> {
    config: Config,
    kept: Kept<Config>,
    status: Status,
    changes: ChangeLog,
    route: Route<P>,
    now: Now,
    watched: Watched,
    silence: Silence,
    restraint: Restraint,
    /// The calculated head bounds the duty of this plan.
    restrained: bool,
    /// Ticks since the estimate before.
    ticks: u32,
    /// Position less the count since the start.
    offset: i64,
    resets: u32,
    trusts: u32,
    law: Leading,
    /// What the law wants of the generator.
    generator: Generator,
    /// Where the law has looked last: along the path, um; beside it, counts of the axis.
    looked: Fixed,
    /// After a change of the controlled variable: the gap error. After one of the law: the path velocity.
    transfer: Transfer,
    changeover: Transfer,
    /// Servo ticks of erosion in which the controlled variable, or what the law looks at, was not known.
    unknown: u32,
    open: OpenCircuit,
    /// What readings are regauged by.
    regauged: f32,
    /// State that a retreat returns to, and the count where it began.
    retreat: (State, i64),
    positioning: Option<Task>,
    /// Follows steps of a host, as a positioning.
    stepper: Option<Stepper>,
    /// Makes a path of them.
    recorder: Option<Recorder>,
    /// Ticks since the newest of them.
    unstepped: u32,
    /// While guiding, and in a retreat from there.
    guide: Option<Guide>,
    jump: Option<Jump>,
    inch: Option<Inching>,
    /// What of the touched moves of the coarse axis is no whole count.
    carried_rest: Fixed,
    presliding: Presliding,
    /// Duty of a host on top of that of the loops, while set points of a stream are followed.
    push: f32,
    /// The search for a surface under way.
    search: Option<touch::Touching>,
    /// What of the erosion's end has come, and the path coordinate of the lift after it.
    ends: Ends,
    lifts_to: Fixed,
    /// The orbit under way, and the path that it is of.
    orbit: Option<(Orbit, u32)>,
    /// Where an escape from here leads, nm.
    escape: [i32; AXES],
    /// The work has been found, and the gap is still wider than the one to keep.
    meets: bool,
    /// Ticks of erosion since the last jump.
    eroded: u32,
    rhythm: Rhythm,
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
    /// The identification under way.
    identify: Option<Identify>,
    /// The tuning under way.
    tune: Option<Tune>,
    commissioning: Option<Commissioning>,
    commissioned: Option<Result<Report, Finding>>,
    /// Tick in which the present state was entered.
    entered: u32,
    /// Last tick in which the retreat under way still had a way to go.
    cornered: u32,
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
            now: Now::default(),
            watched: Watched::default(),
            silence: Silence::default(),
            restraint: Restraint::default(),
            restrained: false,
            ticks: 1,
            offset: 0,
            resets: 0,
            trusts: 0,
            law: Leading::new(&config.law),
            generator: Generator::FREE,
            looked: Fixed(0),
            transfer: Transfer::NONE,
            changeover: Transfer::NONE,
            unknown: 0,
            open: OpenCircuit::new(config.seek.settle),
            regauged: 0.0,
            retreat: (State::Eroding, 0),
            positioning: None,
            stepper: None,
            recorder: None,
            unstepped: 0,
            guide: None,
            jump: None,
            inch: None,
            carried_rest: Fixed(0),
            presliding: Presliding::default(),
            push: 0.0,
            search: None,
            ends: Ends::default(),
            lifts_to: Fixed(0),
            orbit: None,
            escape: [0; AXES],
            meets: false,
            eroded: 0,
            rhythm: Rhythm::default(),
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
            identify: None,
            tune: None,
            commissioning: None,
            commissioned: None,
            entered: 0,
            cornered: 0,
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

    /// What the feed law wants of the generator since the newest plan.
    pub fn generator(&self) -> &Generator {
        &self.generator
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
            self.law.retune(&config.law);
            self.changeover.begin();
        }
        if core::mem::discriminant(&config.controlled) != core::mem::discriminant(&self.config.controlled) {
            self.transfer.begin();
        }
        if !matches!(self.status.state, State::Fault | State::Lifting) {
            self.route.set_retreat(config.retreat.limit);
        }
        let restructured = config.structure != self.config.structure;
        let rescaled = config.axis.nm_per_count != self.config.axis.nm_per_count;
        if let Some(tune) = &mut self.tune
            && self.config.axis.gains != config.axis.gains
        {
            tune.restart();
        }
        self.adopt(config);
        if restructured {
            self.looked = self.place();
        }
        if rescaled {
            self.route.scale(self.config.axis.nm_per_count);
            self.restart_path();
        }
        Ok(())
    }

    /// The feed law leads from here on.
    fn lead(&mut self, after: fn(Micrometres) -> After) {
        let behind = Micrometres(self.good.minus(self.route.s()).to_f32());
        self.law.resume(&self.config.law, after(behind));
        self.changeover = Transfer::NONE;
        self.looked = self.place();
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

    /// What the supervision says, once a millisecond, before [`begin`](Planner::begin).
    pub fn watch(&mut self, monitored: &Monitored) {
        let Monitored { tick, current, bus, back_emf, reduced, illegal, arcs, senses, blocked, row } = monitored;
        self.watched = Watched { tick: *tick, arcs: *arcs, blocked: *blocked, row: *row };
        let status = &mut self.status;
        status.current = *current;
        status.bus = *bus;
        status.back_emf = *back_emf;
        status.illegal_transitions = *illegal;
        status.current_reduced = *reduced;
        status.senses = *senses;
    }

    /// Takes in the estimate of a tick, and what it reports.
    pub fn begin(&mut self, now: &Estimate) {
        self.ticks = now.tick.wrapping_sub(self.now.tick).clamp(1, super::TICKS_MOST);
        self.now = Now {
            generation: now.generation,
            tick: now.tick,
            segment: now.segment,
            along: now.along,
            offset: now.offset,
            paths: now.paths,
            mark: now.mark,
            marked: now.marked,
            safety: now.safety,
            short: now.short,
        };
        if let Some(at) = now.left
            && now.paths == self.route.begun()
        {
            self.route.escape(at, self.escape);
        }
        self.unstepped = self.unstepped.saturating_add(self.ticks);
        self.route.reconcile(now);
        self.take_in(now);
        let count = now.position.wrapping_sub(now.offset);
        let missing = self.silence.look(&self.config, count, now.duty, now.segment.velocity, self.ticks);
        let config = (&self.config.restraint, &self.config.axis.gains);
        self.restrained = self.is_restrained();
        if self.restrained {
            let (velocity, wanted) = (now.velocity, now.segment.velocity.0);
            let rests = wanted == 0.0 && self.status.state != State::Eroding;
            self.restraint.look(config, &Look { count, velocity, wanted, rests, duty: now.duty, ticks: self.ticks });
        } else {
            self.restraint = Restraint::at(count);
        }
        let missing = missing || self.restrained && self.restraint.is_lost(self.config.supervise.breakaway.film);
        if missing && self.status.closed && !self.may_stop() {
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
        if self.presses() || self.is_run_into() {
            self.raise(Fault::Contact);
        }
    }

    /// A head that may meet its stop, whose standing still says nothing.
    fn may_stop(&self) -> bool {
        match self.status.state {
            State::Commissioning => true,
            State::Fault => !self.is_free(),
            _ => self.looks_for_home(),
        }
    }

    /// Decides, and writes the plan.
    pub fn plan(&mut self, plan: &mut Plan) {
        if self.orbit.is_some() {
            self.orbit_on();
        }
        self.record_steps();
        let (motion, allowed) = self.decide();
        let current = self.current_window();
        let mut followed = self.trajectory(motion, current);
        let next = self.plan_ticks(&followed);
        self.compensate(&mut followed, next);
        self.status.reacting = self.reacting.as_ref().is_some_and(Reacting::moves);
        let retreats = matches!(self.status.state, State::Seeking | State::Eroding | State::Guiding);
        // One field after the other: a whole plan would be put together beside it, and copied.
        let Plan {
            generation,
            ticks,
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
            fault,
            doubted,
            retreat,
            escapes,
            stop,
            limited,
            lift,
        } = plan;
        *generation = self.now.generation;
        *ticks = next;
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
        *toward = if *set_points { self.toward(*setpoint) } else { CountsPerSecond(0.0) };
        *slew = self.slew();
        *due = self.due();
        *touch = self.touch();
        *hazards = self.hazards();
        *reaction = self.reacting.as_ref().map(Reacting::reaction);
        *fault = self.status.fault;
        *doubted = self.doubt.is_some();
        *escapes = retreats && self.ready_to_escape();
        *retreat = if retreats { Some(self.ready_retreat(current)) } else { None };
        *stop = self.ready_stop(&followed, current);
        *limited = self.ready_window(self.config.lift.limited, current);
        *lift = self.ready_lift();
        self.status.path = self.route.s();
        // An orbit is one segment of its host.
        self.status.waiting = if self.orbit.is_some() { 0 } else { self.route.waiting() };
        self.status.beside = self.route.beside();
        self.status.paths = self.route.begun();
        self.status.retreat_ended = self.route.ended();
        self.status.guidance = self.guide.as_ref().map_or(Guidance::No, Guide::guidance);
        self.status.stage = self.identify.as_ref().map_or(Stage::None, Identify::stage);
        self.status.tunes = self.tune.as_ref().map_or(TuneStep::None, Tune::step);
    }

    /// What the estimate says, for whom it concerns.
    fn take_in(&mut self, now: &Estimate) {
        let status = &mut self.status;
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
        if status.gap.regauged != self.regauged {
            let ratio = (1.0 + status.gap.regauged) / (1.0 + self.regauged);
            self.regauged = status.gap.regauged;
            status.open_circuit = Volts(status.open_circuit.0 * ratio);
            self.open.scale(ratio);
        }
        status.gap_setpoint = self.config.setpoint.volts(status.open_circuit);
        if status.closed && status.state.follows() && !status.gap.touches {
            self.cleared = self.cleared.max(status.position);
        }
    }

    /// What is followed when the plan comes into force, if nothing is decided.
    #[inline(never)]
    fn segment(&self) -> TrajectorySegment {
        if self.route.begun() != self.now.paths {
            return TrajectorySegment { from: self.route.setpoint(), ..TrajectorySegment::default() };
        }
        let offset = Fixed::whole(self.offset.wrapping_sub(self.now.offset));
        TrajectorySegment { from: self.now.segment.from.plus(offset), ..self.now.segment }
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
