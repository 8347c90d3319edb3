//! Follow: every servo tick goes on along the trajectory in force, and answers at once to what is urgent.
//!
//! The [`Follower`] runs at the servo tick and the [`Planner`](super::Planner) below it, so neither waits for the other:
//!
//! ```text
//! tick       T                 T+1               T+2 = T + LEAD            T+5 = T + PLAN_TICKS
//! follow     hands over an     follows           the plan of T comes       hands over the next estimate
//!            estimate                            into force
//! plan                 plans: some 20 us
//! ```
//!
//! A plan that is not there when its tick has come is *late*: the trajectory goes on in a straight line, and when that lasts
//! the head coasts. Something urgent (a short, a safety input, a fault told, a set point released by SYNC) is acted on in its
//! own tick, by what the plan in force has made ready for it; the plan under way, which does not know of it, is discarded by
//! its
//! *generation*, and an estimate is handed over in the same tick.
//!
//! Between two plans the set point goes on in a straight line, at the velocity of the plan and in the direction of the
//! segment under way. The next plan sets it back on the path, from which it can have departed only at a joint.

use super::estimate::{Estimator, Sums};
use super::probe::{Here, Latched, PROBES, Probes, Sight, Wanted};
use super::{Fault, Reaction, State, positioning};
use crate::encoder::Mark;
use crate::gap::{GapReading, Quality};
use crate::kept::{Kept, parts};
use crate::motion::TrajectorySegment;
use crate::servo::{AxisLoop, Gains, Output, Pid, PidGains, Window};
use crate::units::{
    CountsPerSecond, Fixed, MicrometresPerSecond, Nanometres, PLAN_TICKS, TICK_HZ, TICK_S, TICKS_PER_MS, Volts, rare,
    smaller, within, within_either,
};
use edm_hal_shim::bridge::Drive;
use edm_hal_shim::encoder::RawCount;
use edm_hal_shim::safety::{DriveCodes, SafetyInputs};

/// Ticks from an estimate to the plan that is made of it coming into force.
pub const LEAD: u32 = 2;
/// Late plans in a row that are a fault: 1 ms.
const LATE: u32 = TICKS_PER_MS / PLAN_TICKS;

/// A head that the encoder shows rising faster than this may be braked, counts/s. Below, an edge is a millisecond old: a dead
/// encoder shows its last velocity no longer.
const RISING: f32 = -1000.0;

/// What is followed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Follow {
    /// Nothing: the bridge is open.
    #[default]
    Nothing,
    /// The set point.
    Setpoint,
    /// A velocity.
    Velocity,
    /// A duty.
    Duty,
    /// The gap voltage, without a loop in between.
    Gap,
}

/// What the ticks carry out until another one comes into force.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Trajectory {
    /// What is followed.
    pub follow: Follow,
    /// Duties allowed.
    pub window: Window,
    /// Nothing presses toward the work: only a rise is braked.
    pub upward: bool,
    /// Velocity of the set point, or the one to keep.
    pub velocity: CountsPerSecond,
    /// Duty to give; that of a loop has it on top.
    pub duty: f32,
    /// Gap voltage to keep.
    pub gap: Volts,
    /// Velocity along the path.
    pub along: MicrometresPerSecond,
    /// Travel along the path in a tick, um.
    pub advance: Fixed,
    /// Travel of the axis in a tick, counts.
    pub travel: Fixed,
}

impl Trajectory {
    /// The bridge is open.
    pub const COAST: Trajectory = Trajectory {
        follow: Follow::Nothing,
        window: Window { low: 0.0, high: 0.0 },
        upward: false,
        velocity: CountsPerSecond(0.0),
        duty: 0.0,
        gap: Volts(0.0),
        along: MicrometresPerSecond(0.0),
        advance: Fixed(0),
        travel: Fixed(0),
    };

    /// A duty inside a window.
    pub fn duty(duty: f32, window: Window) -> Trajectory {
        Trajectory { follow: Follow::Duty, window, duty: window.clamp(duty), ..Trajectory::COAST }
    }

    /// A velocity, with duties inside a window.
    pub fn velocity(velocity: CountsPerSecond, window: Window) -> Trajectory {
        Trajectory { follow: Follow::Velocity, window, velocity, ..Trajectory::COAST }
    }

    /// A gap voltage, with duties inside a window.
    pub fn gap(gap: Volts, window: Window) -> Trajectory {
        Trajectory { follow: Follow::Gap, window, gap, ..Trajectory::COAST }
    }

    /// A set point that moves on by itself, beside no path.
    pub fn axis(segment: &TrajectorySegment, window: Window) -> Trajectory {
        let TrajectorySegment { travel, velocity, .. } = *segment;
        Trajectory { follow: Follow::Setpoint, window, velocity, travel, ..Trajectory::COAST }
    }
}

/// Which safety inputs are a hazard in a state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Concerns {
    /// Any at all: not while disabled.
    pub any: bool,
    /// A single limit switch: not where switches are what is looked for.
    pub limits: bool,
    /// The upper one: a head that was enabled there may leave it.
    pub upper: bool,
    /// The dielectric: with pulses.
    pub dielectric: bool,
}

impl Concerns {
    /// The most urgent fault that safety inputs show.
    pub fn hazard(&self, safety: &SafetyInputs) -> Option<Fault> {
        let upper = safety.upper_limit && self.upper;
        match safety {
            _ if !self.any => None,
            SafetyInputs { supply_low: true, .. } => Some(Fault::SupplyLow),
            SafetyInputs { bridge_fault: true, .. } => Some(Fault::BridgeFault),
            SafetyInputs { emergency_stop: true, .. } => Some(Fault::EmergencyStop),
            SafetyInputs { lower_limit: true, .. } if upper => Some(Fault::BothLimits),
            _ if upper && self.limits => Some(Fault::UpperLimit),
            SafetyInputs { lower_limit: true, .. } if self.limits => Some(Fault::LowerLimit),
            SafetyInputs { dielectric: true, .. } if self.dielectric => Some(Fault::DielectricNotOk),
            _ => None,
        }
    }
}

/// What a contact with the work means, in a motion toward it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Touch {
    /// Nothing: pulses are on, or nobody moves.
    #[default]
    Ignored,
    /// A fault.
    Fault,
    /// The end of the motion.
    End,
}

/// What the planner decides, and has made ready for what is urgent.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Plan {
    /// Of the estimate that it was made of.
    pub generation: u32,
    /// What to follow.
    pub trajectory: Trajectory,
    /// Path coordinate and set point when it comes into force.
    pub path: Fixed,
    /// See [`path`](Plan::path).
    pub setpoint: Fixed,
    /// Position less the count since the start: a home.
    pub offset: i64,
    /// How often the path has begun anew: coordinates of another one mean nothing.
    pub paths: u32,
    /// How often the loop's integrator had to be cleared.
    pub resets: u32,
    /// How often the encoder was to be believed anew.
    pub trusts: u32,
    /// State that it belongs to.
    pub state: State,
    /// The loop is closed over the encoder.
    pub closed: bool,
    /// Pulses are allowed.
    pub pulses: bool,
    /// A reference is looked for: positions of index marks are wanted, and whatever is in the way is no fault.
    pub homes: bool,
    /// The head is known to be below the upper end of its travel: no stop is in its way.
    pub free: bool,
    /// Nothing tells that the work is near: see [`Measured::open`].
    pub open: bool,
    /// What the touch probes wait for.
    pub probes: Wanted,
    /// A set point that a SYNC releases may be followed, toward the work at this velocity at most.
    pub set_points: bool,
    /// See [`set_points`](Plan::set_points).
    pub toward: CountsPerSecond,
    /// By how much it may change the velocity at the most, and the tick after which the set point before it is reached.
    pub slew: CountsPerSecond,
    /// See [`slew`](Plan::slew).
    pub due: u32,
    /// What a contact means.
    pub touch: Touch,
    /// Hazards.
    pub concerns: Concerns,
    /// Reaction under way.
    pub reaction: Option<Reaction>,
    /// No loop may be closed in a reaction.
    pub doubted: bool,
    /// For a short, where the state cares.
    pub retreat: Option<Trajectory>,
    /// For a fault whose reaction closes the loop: the way to rest; and the duties of one with limited force.
    pub stop: Trajectory,
    /// See [`stop`](Plan::stop).
    pub limited: Window,
    /// For a fault whose reaction lifts.
    pub lift: Trajectory,
}

impl Plan {
    /// Of a head that is disabled.
    pub const DISABLED: Plan = Plan {
        generation: 0,
        trajectory: Trajectory::COAST,
        path: Fixed(0),
        setpoint: Fixed(0),
        offset: 0,
        paths: 0,
        resets: 0,
        trusts: 0,
        state: State::Disabled,
        closed: false,
        pulses: false,
        homes: false,
        free: false,
        open: false,
        probes: Wanted::OFF,
        set_points: false,
        toward: CountsPerSecond(0.0),
        slew: CountsPerSecond(0.0),
        due: 0,
        touch: Touch::Ignored,
        concerns: Concerns { any: false, limits: false, upper: false, dielectric: false },
        reaction: None,
        doubted: false,
        retreat: None,
        stop: Trajectory::COAST,
        limited: Window { low: 0.0, high: 0.0 },
        lift: Trajectory::COAST,
    };

    /// What is done at once about a fault, and its reaction; `None` where the one under way is as strong.
    fn answer(&self, fault: Fault) -> Option<(Reaction, Trajectory)> {
        // A reaction that runs says itself what escalates it: the planner judges the same.
        let lifts = self.doubted && self.reaction.is_none();
        let least = if lifts { Reaction::OpenLoopLift } else { Reaction::Retrace };
        let reaction = fault.reaction().max(least);
        if self.reaction.is_some_and(|under_way| under_way >= reaction) {
            return None;
        }
        let trajectory = match reaction {
            Reaction::Coast => Trajectory::COAST,
            Reaction::OpenLoopLift | Reaction::LiftOnStored | Reaction::EmergencyLift => self.lift,
            Reaction::ForceLimitedRetract => Trajectory { window: self.limited, ..self.stop },
            _ => self.stop,
        };
        Some((reaction, trajectory))
    }
}

impl Default for Plan {
    fn default() -> Plan {
        Plan::DISABLED
    }
}

/// A set point that a SYNC releases.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SetPoint {
    /// Where.
    pub to: Nanometres,
    /// The same in counts.
    pub counts: Fixed,
    /// Servo ticks in which it is to be reached.
    pub ticks: u32,
}

/// What a servo tick sees.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TickInput {
    /// The count that the loops use.
    pub encoder: RawCount,
    /// Ticks of uninterrupted short, of the newest gap reading.
    pub short_ticks: u32,
    /// With pulses off: electrode and work touch.
    pub touches: bool,
    /// Filtered gap voltage, if there is a valid one; where [`Follower::wants_gap`] says so.
    pub gap: Option<Volts>,
    /// For the touch probes, where [`Follower::probes`] says so.
    pub sight: Sight,
    /// Motor current and bus voltage.
    pub drive: DriveCodes,
    /// Safety inputs, if any of them is unsafe.
    pub safety: Option<SafetyInputs>,
    /// The reflex has begun a retreat since the tick before.
    pub reflex: bool,
    /// A fault that another task has found.
    pub told: Option<Fault>,
    /// A SYNC has released it.
    pub set_point: Option<SetPoint>,
    /// Somebody wants something of the planner.
    pub asked: bool,
}

/// What the tick wants of the world until the next one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TickOutput {
    /// To the H-bridge.
    pub drive: Drive,
    /// To the generator: pulses allowed.
    pub pulses: bool,
    /// The planner is to be given an estimate.
    pub hands_over: bool,
    /// A plan has come into force, or was late.
    pub begins: bool,
}

/// What the planner sees.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Estimate {
    /// Counts estimates; a plan has that of its own.
    pub generation: u32,
    /// Servo tick, wrapping.
    pub tick: u32,
    /// Path coordinate and set point.
    pub path: Fixed,
    /// See [`path`](Estimate::path).
    pub setpoint: Fixed,
    /// The same when the plan comes into force.
    pub path_then: Fixed,
    /// See [`path_then`](Estimate::path_then).
    pub segment: TrajectorySegment,
    /// Velocity along the path.
    pub along: MicrometresPerSecond,
    /// Position, and the offset that it is given with.
    pub position: i64,
    /// See [`position`](Estimate::position).
    pub offset: i64,
    /// Which path the coordinate is of.
    pub paths: u32,
    /// Velocity.
    pub velocity: CountsPerSecond,
    /// Set point less position, counts.
    pub following: f32,
    /// Duty of the tick, positive toward the work.
    pub duty: f32,
    /// It is at its limit.
    pub saturated: bool,
    /// Newest gap reading.
    pub gap: GapReading,
    /// Newest index mark, where it is wanted, and where the axis stood there.
    pub mark: Mark,
    /// See [`mark`](Estimate::mark).
    pub marked: i64,
    /// What the touch probes have kept.
    pub probes: [Latched; PROBES],
    /// Safety inputs.
    pub safety: SafetyInputs,
    /// A short has been answered by the retreat that was made ready, or a contact that is the end of a motion by rest.
    pub short: bool,
    /// The strongest fault that is new.
    pub told: Option<Fault>,
    /// One that casts doubt on the encoder, whose reaction may be weaker.
    pub doubt: Option<Fault>,
    /// A set point that a SYNC has released.
    pub set_point: Option<SetPoint>,
    /// Plans that were late, since the start.
    pub late: u32,
}

/// What the supervision judges once a millisecond.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Measured {
    /// Servo tick, wrapping.
    pub tick: u32,
    /// State of the plan in force.
    pub state: State,
    /// The loop is closed over the encoder.
    pub closed: bool,
    /// The set point stands.
    pub rests: bool,
    /// The head is known to be below the upper end of its travel.
    pub free: bool,
    /// The gap is open, or the work far below: nothing but its friction holds the head, unless it has met a film on its way.
    pub open: bool,
    /// A reference is looked for: a head that is stopped has found what is in its way.
    pub homes: bool,
    /// Pulses are allowed, for work.
    pub pulses: bool,
    /// Times that the encoder was to be believed anew.
    pub trusts: u32,
    /// Set point less position, counts.
    pub following: f32,
    /// Velocity.
    pub velocity: CountsPerSecond,
    /// Duty, positive toward the work.
    pub duty: f32,
    /// It is at its limit.
    pub saturated: bool,
    /// Quality of the gap reading, and the newest code of its converter.
    pub quality: Quality,
    /// See [`quality`](Measured::quality).
    pub code: u16,
    /// Pulses are permitted, for work or for commissioning.
    pub permitted: bool,
    /// The gap voltage has shown nothing but short for a millisecond.
    pub short: bool,
    /// What was drawn.
    pub sums: Sums,
    /// Bus voltage, a code.
    pub bus: u16,
}

/// What the follower runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FollowConfig {
    /// Gains of the cascade.
    pub gains: Gains,
    /// Gains of the loop without a cascade, duty per volt.
    pub single: PidGains,
    /// The encoder counts down toward the work.
    pub encoder_reversed: bool,
    /// A positive duty moves away from the work.
    pub motor_reversed: bool,
    /// Ticks of uninterrupted short before the retreat begins.
    pub trigger: u32,
}

parts!(it: FollowConfig { gains, single, encoder_reversed, motor_reversed, trigger } by
    [it.gains],
    [it.single],
    [it.encoder_reversed, it.motor_reversed, it.trigger],
);

/// The part of a head that runs in every servo tick.
#[derive(Debug)]
pub struct Follower {
    config: FollowConfig,
    kept: Kept<FollowConfig>,
    /// [`Drive::FULL`], negative for a reversed motor.
    full: f32,
    estimator: Estimator,
    axis: AxisLoop,
    single: Pid,
    following: f32,
    duty: f32,
    saturated: bool,
    tick: u32,
    /// In force: what is followed, path coordinate and set point are those of the newest tick.
    plan: Plan,
    /// Of the newest estimate; the tick in which its plan comes into force, if it is awaited; the next estimate's.
    generation: u32,
    due: Option<u32>,
    next: u32,
    /// Plans that were late: since the start, and in a row.
    late: u32,
    in_a_row: u32,
    /// Somebody wants something of the planner, which is at work.
    asked: bool,
    /// That, or an unsafe input in the tick before.
    attentive: bool,
    /// For the estimate of this tick.
    short: bool,
    told: Option<Fault>,
    doubt: Option<Fault>,
    set_point: Option<SetPoint>,
    /// The same in the estimate before: what a late planner has not read is said again.
    said: (bool, [Option<Fault>; 2], Option<SetPoint>),
    /// Safety inputs of the tick before.
    safety: SafetyInputs,
    probes: Probes,
}

impl Follower {
    /// A disabled head.
    #[inline(always)]
    pub fn new(config: FollowConfig) -> Follower {
        Follower {
            config,
            kept: Kept::NEW,
            full: full(&config),
            estimator: Estimator::new(config.encoder_reversed),
            axis: AxisLoop::default(),
            single: Pid::default(),
            following: 0.0,
            duty: 0.0,
            saturated: false,
            tick: 0,
            plan: Plan::DISABLED,
            generation: 0,
            due: None,
            next: 1,
            late: 0,
            in_a_row: 0,
            asked: false,
            attentive: false,
            short: false,
            told: None,
            doubt: None,
            set_point: None,
            said: (false, [None; 2], None),
            safety: SafetyInputs::default(),
            probes: Probes::default(),
        }
    }

    /// Runs another configuration. The loop keeps its integrator, which is a duty: no bump.
    pub fn configure(&mut self, config: &FollowConfig) {
        self.estimator.wire(config.encoder_reversed);
        self.full = full(config);
        self.config = *config;
        self.kept = Kept::NEW;
    }

    /// Looks at a part of the configuration: false once it has changed by itself.
    #[inline]
    pub fn is_intact(&mut self) -> bool {
        self.kept.agrees(&self.config)
    }

    /// Whether the next tick wants the gap voltage.
    #[inline]
    pub fn wants_gap(&self) -> bool {
        self.plan.trajectory.follow == Follow::Gap
    }

    /// Whether the next tick wants to know of the sources of the touch probes.
    #[inline]
    pub fn probes(&self) -> bool {
        self.plan.probes.on
    }

    /// Number of the newest tick, wrapping.
    pub fn number(&self) -> u32 {
        self.tick
    }

    /// Whether the next tick is neither to hand over nor to begin, unless something urgent comes.
    pub fn is_next_plain(&self) -> bool {
        let tick = self.tick.wrapping_add(1);
        self.next != tick && self.due != Some(tick)
    }

    /// Measured position, counts.
    pub fn position(&self) -> i64 {
        self.estimator.position()
    }

    /// What is in force.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// What is followed.
    pub fn trajectory(&self) -> &Trajectory {
        &self.plan.trajectory
    }

    /// One servo tick. `planned` gives the plan of an estimate, if it is there.
    #[inline]
    pub fn tick<'a>(&mut self, input: &TickInput, planned: impl FnOnce(u32) -> Option<&'a Plan>) -> TickOutput {
        self.tick = self.tick.wrapping_add(1);
        let mut begins = false;
        if self.due.is_some_and(|due| due == self.tick) {
            self.due = None;
            begins = true;
            match planned(self.generation) {
                Some(plan) => {
                    self.begin(plan);
                    if self.plan.trajectory.follow != Follow::Setpoint {
                        self.following = 0.0;
                    }
                }
                None => self.miss(),
            }
        }
        self.estimator.tick(&input.encoder, input.drive);
        if self.plan.probes.on {
            self.probe(input);
        }
        let mut hands_over = self.tick == self.next;
        // One test for a tick in which there is nothing.
        let shorted = input.reflex | (input.short_ticks >= self.config.trigger);
        if shorted | input.touches | input.asked | input.safety.is_some() | self.attentive {
            hands_over |= self.is_urgent(input, shorted);
        }
        let drive = self.follow(input.gap);
        if hands_over {
            self.generation = self.generation.wrapping_add(1);
            self.due = Some(self.tick.wrapping_add(LEAD));
            self.next = self.tick.wrapping_add(PLAN_TICKS);
        }
        TickOutput { drive, pulses: self.plan.pulses, hands_over, begins }
    }

    /// A plan comes into force.
    #[inline(never)]
    fn begin(&mut self, plan: &Plan) {
        if plan.resets != self.plan.resets {
            self.axis.reset();
            self.single.reset();
        }
        if plan.offset != self.plan.offset {
            let by = plan.offset.wrapping_sub(self.plan.offset);
            self.estimator.shift(by);
            self.probes.shift(by);
        }
        if plan.probes.on | self.plan.probes.on {
            self.probes.want(&plan.probes);
        }
        self.plan = *plan;
        self.in_a_row = 0;
    }

    /// The touch probes look.
    #[cold]
    #[inline(never)]
    fn probe(&mut self, input: &TickInput) {
        let here = Here {
            tick: self.tick,
            position: self.estimator.position(),
            marked: self.estimator.position_at(input.sight.mark.count),
            pulses: self.plan.pulses,
            touches: input.touches,
        };
        self.probes.tick(&self.plan.probes, &input.sight, &here);
    }

    /// The plan of this tick is not there.
    #[cold]
    fn miss(&mut self) {
        self.late = self.late.wrapping_add(1);
        self.in_a_row = self.in_a_row.saturating_add(1);
        if self.in_a_row >= LATE {
            self.fault(Fault::PlanLate);
            self.tell_of(Fault::PlanLate);
        }
    }

    /// Whether there is more than a short, or a contact, that the state does not care for, and it is urgent.
    #[cold]
    fn is_urgent(&mut self, input: &TickInput, shorted: bool) -> bool {
        let touches = input.touches && self.plan.touch != Touch::Ignored;
        let concerns = (shorted && self.plan.retreat.is_some()) | touches;
        (concerns | input.asked | input.safety.is_some() | self.attentive) && self.urgent(input, shorted)
    }

    /// Whether what has come cannot wait for the next estimate.
    fn urgent(&mut self, input: &TickInput, shorted: bool) -> bool {
        let mut urgent = false;
        if let Some(fault) = input.told {
            self.fault(fault);
            self.tell_of(fault);
            urgent = true;
        }
        let safety = input.safety.unwrap_or_default();
        if safety != self.safety {
            self.safety = safety;
            urgent = true;
        }
        if let Some(fault) = self.plan.concerns.hazard(&safety) {
            urgent |= self.fault(fault);
        }
        if shorted && let Some(retreat) = self.plan.retreat.take() {
            self.plan.trajectory = retreat;
            self.plan.set_points = false;
            self.short = true;
            urgent = true;
        }
        if input.touches && self.plan.trajectory.velocity.0 > 0.0 {
            urgent |= self.touch();
        }
        if let Some(point) = input.set_point {
            if self.plan.set_points {
                self.follow_to(point);
            }
            self.set_point = Some(point);
            urgent = true;
        }
        // Whoever asks is not that urgent: a plan under way is not discarded for it.
        self.asked |= input.asked;
        let asks = self.asked && self.due.is_none();
        self.asked &= !(asks | urgent);
        self.attentive = self.asked | input.safety.is_some();
        urgent | asks
    }

    /// Acts on a fault; whether that is more than what is done already.
    fn fault(&mut self, fault: Fault) -> bool {
        let Some((reaction, trajectory)) = self.plan.answer(fault) else { return false };
        self.plan.reaction = Some(reaction);
        self.plan.pulses = false;
        self.plan.retreat = None;
        self.plan.set_points = false;
        self.plan.closed &= trajectory.follow == Follow::Setpoint;
        self.plan.trajectory = trajectory;
        self.axis.reset();
        true
    }

    /// The next estimate tells of a fault, or of a stronger one; and of one that casts doubt on the encoder, which a stronger one
    /// must not hide.
    fn tell_of(&mut self, fault: Fault) {
        if fault.doubts_encoder() && self.doubt != Some(Fault::EncoderLost) {
            self.doubt = Some(fault);
        }
        if self.told.is_none_or(|told| told.reaction() < fault.reaction()) {
            self.told = Some(fault);
        }
    }

    /// Electrode and work touch: nothing presses on from this tick on.
    fn touch(&mut self) -> bool {
        match core::mem::take(&mut self.plan.touch) {
            Touch::Ignored => return false,
            Touch::Fault => {
                self.fault(Fault::Contact);
                self.tell_of(Fault::Contact);
            }
            Touch::End => {
                self.plan.trajectory = self.plan.stop;
                self.plan.set_points = false;
                self.short = true;
                self.axis.reset();
            }
        }
        (self.plan.trajectory.velocity, self.plan.trajectory.travel) = (CountsPerSecond(0.0), Fixed(0));
        true
    }

    /// The set point of a SYNC, from this tick on.
    fn follow_to(&mut self, point: SetPoint) {
        // This tick goes on along it already.
        let before = self.tick.wrapping_sub(1);
        let due = positioning::due(self.plan.due, before, point.ticks);
        let left = positioning::until(due, before).max(PLAN_TICKS);
        let distance = point.counts.minus(self.plan.setpoint).to_f32();
        let limit = self.config.gains.velocity_limit().0;
        let velocity = within_either(distance / left as f32 * TICK_HZ as f32, limit);
        let (now, slew) = (self.plan.trajectory.velocity.0, self.plan.slew.0);
        let velocity = smaller(within(velocity, now - slew, now + slew), self.plan.toward.0);
        self.plan.trajectory.velocity = CountsPerSecond(velocity);
        self.plan.trajectory.travel = Fixed::short(velocity * TICK_S);
        (self.plan.trajectory.advance, self.plan.trajectory.along) = (Fixed(0), MicrometresPerSecond(0.0));
    }

    /// Carries the trajectory out for one tick.
    #[inline]
    fn follow(&mut self, gap: Option<Volts>) -> Drive {
        let (plan, gains) = (&mut self.plan, &self.config.gains);
        let trajectory = &plan.trajectory;
        let velocity = self.estimator.velocity();
        let duty = if trajectory.follow == Follow::Setpoint {
            plan.path = plan.path.near(trajectory.advance);
            plan.setpoint = plan.setpoint.near(trajectory.travel);
            self.following = plan.setpoint.from(self.estimator.at());
            let mut window = trajectory.window;
            if trajectory.upward {
                rare();
                if velocity.0 >= RISING {
                    window.high = smaller(window.high, gains.holding());
                }
            }
            self.axis.follow(gains, self.following, trajectory.velocity, trajectory.duty, velocity, window)
        } else {
            rare();
            match trajectory.follow {
                Follow::Nothing | Follow::Setpoint => {
                    (self.duty, self.saturated) = (0.0, false);
                    self.axis.reset();
                    return Drive::Coast;
                }
                Follow::Velocity => self.axis.run(gains, trajectory.velocity, velocity, trajectory.window),
                Follow::Duty => Output::new(trajectory.duty, trajectory.window),
                Follow::Gap => {
                    // What is not valid is no reason to move.
                    let error = gap.map_or(0.0, |gap| gap.0 - trajectory.gap.0);
                    self.single.update(&self.config.single, error, gains.holding(), trajectory.window)
                }
            }
        };
        self.duty = duty.value;
        self.saturated = duty.limited;
        // A duty is a share: it fits.
        let code = (duty.value * self.full) as i32;
        self.estimator.gave(code);
        Drive::Duty(code as i16)
    }

    /// The estimate before was not read, and is overwritten by that of this tick.
    #[cold]
    pub fn unread(&mut self) {
        let (short, faults, set_point) = self.said;
        self.short |= short;
        faults.into_iter().flatten().for_each(|fault| self.tell_of(fault));
        self.set_point = self.set_point.or(set_point);
    }

    /// Writes the estimate of this tick, which has wanted to hand one over; `quality` is that of the reading now.
    #[inline(never)]
    pub fn estimate(&mut self, to: &mut Estimate, reading: &GapReading, quality: Quality, newest: &Mark) {
        // One field after the other: a whole estimate would be put together beside it, and copied.
        let Estimate {
            generation,
            tick,
            path,
            setpoint,
            path_then,
            segment,
            along,
            position,
            offset,
            paths,
            velocity,
            following,
            duty,
            saturated,
            gap,
            mark,
            marked,
            probes,
            safety,
            short,
            told,
            doubt,
            set_point,
            late,
        } = to;
        *generation = self.generation;
        *tick = self.tick;
        *path = self.plan.path;
        *setpoint = self.plan.setpoint;
        // The tick that brings the plan goes on along the trajectory already.
        let later = |fixed: Fixed| Fixed(fixed.0.wrapping_mul((LEAD - 1).into()));
        *path_then = self.plan.path.near(later(self.plan.trajectory.advance));
        segment.from = self.plan.setpoint.near(later(self.plan.trajectory.travel));
        segment.travel = self.plan.trajectory.travel;
        let follows = self.plan.trajectory.follow == Follow::Setpoint;
        segment.velocity = if follows { self.plan.trajectory.velocity } else { CountsPerSecond(0.0) };
        *along = self.plan.trajectory.along;
        *position = self.estimator.position();
        *offset = self.plan.offset;
        *paths = self.plan.paths;
        *velocity = self.estimator.velocity();
        *following = self.following;
        *duty = self.duty;
        *saturated = self.saturated;
        *gap = GapReading { quality, ..*reading };
        *mark = *newest;
        *marked = if self.plan.homes { self.estimator.position_at(newest.count) } else { 0 };
        *probes = *self.probes.latched();
        *safety = self.safety;
        *short = core::mem::take(&mut self.short);
        *told = self.told.take();
        *doubt = self.doubt.take();
        // Not taken: it would be put together beside both, and copied.
        *set_point = self.set_point;
        self.set_point = None;
        self.said = (*short, [*told, *doubt], *set_point);
        *late = self.late;
    }

    /// Writes what the supervision judges.
    #[inline(never)]
    pub fn measured(&self, to: &mut Measured, input: &TickInput, reading: &GapReading, quality: Quality) {
        *to = Measured {
            tick: self.tick,
            state: self.plan.state,
            closed: self.plan.closed,
            rests: self.plan.trajectory.follow == Follow::Setpoint && self.plan.trajectory.travel == Fixed(0),
            free: self.plan.free,
            open: self.plan.open,
            homes: self.plan.homes,
            pulses: self.plan.pulses && self.plan.state.pulses(),
            trusts: self.plan.trusts,
            following: self.following,
            velocity: self.estimator.velocity(),
            duty: self.duty,
            saturated: self.saturated,
            quality,
            code: reading.code,
            permitted: self.plan.pulses,
            short: input.short_ticks >= TICKS_PER_MS,
            sums: *self.estimator.sums(),
            bus: input.drive.bus_voltage,
        };
    }

    /// What is measured and followed, for a report of every tick.
    pub fn tell(&self, status: &mut super::Status) {
        status.tick = self.tick;
        status.position = self.estimator.position();
        status.velocity = self.estimator.velocity();
        status.setpoint = self.plan.setpoint;
        status.following = self.following;
        status.path = self.plan.path;
        status.duty = self.duty;
        status.saturated = self.saturated;
    }
}

fn full(config: &FollowConfig) -> f32 {
    let full = f32::from(Drive::FULL);
    if config.motor_reversed { -full } else { full }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kept::Parts;
    use crate::settings::Settings;

    /// Ticks until an estimate is handed over, with `input` in the first; gives what it tells of short, fault and set point. Nobody
    /// has read the one before where it is `unread`.
    fn handed(follower: &mut Follower, unread: bool, input: TickInput) -> (bool, Option<Fault>, Option<SetPoint>) {
        let mut estimate = Estimate::default();
        let (mut input, quiet) = (input, TickInput::default());
        while !follower.tick(&input, |_| None).hands_over {
            input = quiet;
        }
        if unread {
            follower.unread();
        }
        follower.estimate(&mut estimate, &GapReading::default(), Quality::Valid, &Mark::default());
        (estimate.short, estimate.told, estimate.set_point)
    }

    #[test]
    fn what_an_estimate_tells_is_told_again_until_somebody_has_read_it() {
        let told = |fault| TickInput { told: Some(fault), asked: true, ..TickInput::default() };
        let config = Settings::default().build().unwrap().head.follow();
        let mut follower = Follower::new(config);
        let point = |ticks| Some(SetPoint { ticks, ..SetPoint::default() });
        follower.plan.retreat = Some(Trajectory::COAST);
        let short = TickInput { set_point: point(20), reflex: true, ..TickInput::default() };
        assert_eq!(handed(&mut follower, false, TickInput { asked: true, ..short }), (true, None, point(20)));
        assert_eq!(handed(&mut follower, true, told(Fault::OverCurrent)), (true, Some(Fault::OverCurrent), point(20)));
        // The stronger fault, the newer set point.
        assert!(Fault::HostSilent.reaction() < Fault::OverCurrent.reaction());
        let newer = TickInput { set_point: point(40), ..told(Fault::HostSilent) };
        assert_eq!(handed(&mut follower, true, newer), (true, Some(Fault::OverCurrent), point(40)));
        // Read.
        assert_eq!(handed(&mut follower, false, TickInput::default()), (false, None, None));
    }

    #[test]
    fn of_two_faults_in_a_tick_the_stronger_is_told() {
        let mut follower = Follower::new(Settings::default().build().unwrap().head.follow());
        (0..LATE).for_each(|_| follower.miss());
        assert!(Fault::HostSilent.reaction() < Fault::PlanLate.reaction());
        let weaker = TickInput { told: Some(Fault::HostSilent), ..TickInput::default() };
        assert_eq!(handed(&mut follower, false, weaker).1, Some(Fault::PlanLate));
    }

    #[test]
    fn a_doubt_in_the_encoder_is_told_beside_a_stronger_fault_until_somebody_has_read_it() {
        for fault in [Fault::EncoderLost, Fault::PolarityWrong, Fault::FollowingError] {
            let mut follower = Follower::new(Settings::default().build().unwrap().head.follow());
            let told = TickInput { told: Some(fault), asked: true, ..TickInput::default() };
            assert_eq!(handed(&mut follower, false, told).1, Some(fault));
            let mut estimate = Estimate::default();
            for _ in 0..5 {
                (0..LATE).for_each(|_| follower.miss());
                follower.unread();
                follower.estimate(&mut estimate, &GapReading::default(), Quality::Valid, &Mark::default());
            }
            assert_eq!((estimate.told.map(Fault::reaction), estimate.doubt), (Some(Reaction::Coast), Some(fault)));
        }
    }

    #[test]
    fn a_configuration_that_changes_by_itself_is_seen_and_one_that_is_given_is_not() {
        let config = Settings::default().build().unwrap().head.follow();
        let other = FollowConfig { trigger: config.trigger + 7, ..config };
        let mut follower = Follower::new(config);
        let looks = |follower: &mut Follower| (0..=FollowConfig::PARTS).filter(|_| !follower.is_intact()).count();
        assert_eq!(looks(&mut follower), 0);
        follower.configure(&other);
        assert_eq!(looks(&mut follower), 0);
        follower.config.trigger ^= 1 << 30;
        assert!(looks(&mut follower) > 0);
        follower.configure(&config);
        assert_eq!(looks(&mut follower), 0);
        follower.config.motor_reversed ^= true;
        assert!(looks(&mut follower) > 0);
    }
}
