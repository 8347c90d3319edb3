//! Supervision at 1 kHz: what no single tick can judge.
//!
//! It *looks* first: at what the drive has drawn (current, bus voltage, heat of the winding, back-EMF) and at whether the
//! encoder can be believed (its two counters, illegal transitions, the distance of index marks). Then it judges. Whatever
//! closes a loop over the encoder is judged alike, in every state: work, axis positioning, the strokes of commissioning, and
//! the reaction to another fault.

use super::estimate::{Sums, as_wired};
use super::fault::Fault;
use super::state::State;
use crate::encoder::{MarkCheck, MarkSpacing, Plausibility, PlausibilityLimits, Snapshot};
use crate::gap::pulses::{self, Pulses, Shares};
use crate::gap::senses::{self, Senses, Sensing};
use crate::gap::{PulseFault, PulseSeen, PulseWatch, Quality, Sight};
use crate::kept::parts;
use crate::servo::{BackEmf, CurrentGuard, CurrentLimits, Gains, Plant};
use crate::units::{
    ADC_FULL_SCALE, Amps, CountsPerSecond, Micrometres, Newtons, TICKS_PER_MS, Volts, larger, smaller, within,
};
use core::f32::consts::PI;
use edm_hal_shim::bridge::Drive;
use edm_hal_shim::encoder::RawCount;
use edm_hal_shim::reflex::PulseCounts;

/// Limits of the supervision. Times are in ms, which is its period.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Largest following error, counts.
    pub following: f32,
    /// For so long.
    pub following_ms: u32,
    /// What begins to move the head against its friction: an encoder that stands still all the same is not believed.
    pub breakaway: Breakaway,
    /// Velocity against a saturated duty that means a wrong polarity.
    pub runaway: CountsPerSecond,
    /// Largest difference between encoder velocity and the one of the back-EMF.
    pub velocity: CountsPerSecond,
    /// Share of the winding's resistive drop by which the back-EMF may be wrong.
    pub resistance: f32,
    /// For so long.
    pub encoder_ms: u32,
    /// The gap voltage is averaged by the gate: pulses without its edges are no pulses.
    pub gated: bool,
    /// Bad gap reading for so long while pulses are allowed.
    pub gap_ms: u32,
    /// Silence of the host; 0 means that no host is expected.
    pub host_ms: u32,
    /// Bus voltage to work with.
    pub bus_min: Volts,
    /// Motor current that no loop should let happen.
    pub current_max: Amps,
    /// For so long.
    pub current_ms: u32,
    /// When arcs are persistent.
    pub arcs: pulses::Config,
    /// What hazard, distance and spark frequency are estimated by.
    pub senses: senses::Config,
    /// Thresholds of the reflex, by which its silence in a short is judged.
    pub sight: Sight,
}

/// What no friction withstands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Breakaway {
    /// Following error, counts, while the duty is beyond the friction in its direction: an integrator may still push the
    /// other way.
    pub following: f32,
    /// Following error, counts, in which a healthy head may rest.
    pub tremble: f32,
    /// Duty of the friction.
    pub friction: f32,
    /// Duty, either way from the one that holds the net weight and from the one that was needed lately, under any following
    /// error that is more than a tremble.
    pub push: f32,
    /// Duty that holds the net weight.
    pub holding: f32,
    /// Counts/ms by which a duty beyond the friction makes the head faster in a millisecond.
    pub acceleration: f32,
    /// Duty times ms beyond the friction, under which the film in the gap lets the head go less than can be seen.
    pub film: f32,
}

impl Breakaway {
    /// A following error moves the head when the proportional parts of the loops alone overcome its friction.
    const FOLLOWING: f32 = 1.33;
    /// Duty of the proportional parts under which a head without friction may rest: the loop trembles over an edge or two.
    const TREMBLE: f32 = 0.015;
    /// Counts of that, in a stiff loop and in a soft one.
    const TREMBLE_COUNTS: (f32, f32) = (3.0, 6.0);
    /// Healthy heads were seen to stand under 1.7 times their friction, and under 4 % of duty with hardly any.
    const PUSH: f32 = 1.8;
    /// See [`PUSH`](Breakaway::PUSH).
    const PUSH_LEAST: f32 = 0.05;
    /// Share of the newest duty in what was needed lately, once a millisecond: half a second, in which another electrode's
    /// weight is no longer a push. Healthy heads were seen to stand as long, but under small following errors, which are no
    /// push.
    const LATELY: f32 = 1.0 / 512.0;
    /// Counts that a head must have gone before it is said to stand.
    const WAY: f32 = 8.0;
    /// Duty by which that of a head at rest may change beyond what turns its friction round: of the quantised velocity, and of
    /// a friction that is a little more than was learnt.
    const REST: f32 = 0.01;
    /// Times its friction that begins to move any head, where it is a little more than was learnt.
    const BEGINS: f32 = 1.33;
    /// Duty in addition to that of weight and friction that may hold a head in an open gap: of a cable, of weight that was not learnt.
    const UNKNOWN: f32 = 0.005;
    /// Times its friction, where it turns round.
    const REST_FRICTIONS: f32 = Self::BEGINS * 2.0;
    /// Slowest velocity, counts/s, of a head that is seen to move though it is where it was a millisecond ago: two different lines
    /// within half of it. An encoder that counts no more has shown its newest line, and one that trembles shows none.
    const TURNS: f32 = 2000.0;
    /// Counts that a film has to let it go before that can be seen: two, and half as many again.
    const SEEN: f32 = 3.0;

    /// For an axis that a force in addition to its net weight begins to move, of which the share `compensated` is in the duty already, with
    /// an electrode whose face is a disc of that radius. The margins were found by simulation (docs/decisions.md).
    pub fn of(plant: &Plant, gains: &Gains, friction: Newtons, compensated: f32, face: Micrometres) -> Breakaway {
        let duty = plant.duty(friction);
        let tremble = within(gains.error_of(Self::TREMBLE), Self::TREMBLE_COUNTS.0, Self::TREMBLE_COUNTS.1);
        Breakaway {
            following: (gains.error_of(duty) * (Self::FOLLOWING - compensated)).max(tremble),
            tremble,
            friction: duty,
            push: (duty * Self::PUSH).max(Self::PUSH_LEAST),
            holding: gains.holding(),
            acceleration: 1e-6 / plant.accelerating(1.0),
            film: plant.duty(Newtons(film(face) * Self::SEEN * 1e3 / plant.counts_per_m)),
        }
    }
}

/// Resistance of the film under a round face against its motion in a narrow gap, N s/m: 3 pi mu R^4 / 2 h^3 (Reynolds).
fn film(face: Micrometres) -> f32 {
    /// Viscosity of a dielectric oil, Pa s.
    const VISCOSITY: f32 = 0.0024;
    /// Narrowest gap that is worked with, m; what is narrower resists more.
    const GAP: f32 = 20e-6;
    let radius = face.0 * 1e-6;
    let square = radius * radius;
    1.5 * PI * VISCOSITY * square * square / (GAP * GAP * GAP)
}

/// Counts milliseconds of one condition without interruption.
#[derive(Clone, Copy, Debug, Default)]
struct Lasting(u32);

impl Lasting {
    fn longer_than(&mut self, ms: u32, condition: bool) -> bool {
        self.0 = if condition { self.0.saturating_add(1) } else { 0 };
        self.0 > ms
    }
}

/// How a head that is pushed beyond its friction would move, as long as it is not seen to.
#[derive(Clone, Copy, Debug, Default)]
struct Standing {
    /// Duty beyond the friction times ms, positive toward the work.
    impulse: f32,
    /// Counts that the mass has gone under it.
    way: f32,
}

impl Standing {
    /// A millisecond under so much duty beyond the friction, toward the work or away from it; whether the head must have been seen
    /// to move.
    fn is_too_long(&mut self, breakaway: &Breakaway, beyond: f32, moves: bool) -> bool {
        // One that is pushed back rests, and begins anew.
        if moves || beyond == 0.0 || beyond * self.impulse < 0.0 {
            *self = Standing::default();
        }
        if !moves {
            // What is pushed with now may have begun just now.
            self.way += self.impulse * breakaway.acceleration;
            self.impulse += beyond;
        }
        self.way.abs() > Breakaway::WAY && self.impulse.abs() > breakaway.film
    }
}

/// Duties under which a head at rest has stood, since its encoder last counted. What holds it may turn from the whole friction one
/// way to the whole friction the other way; more than that moves it, whatever it weighs.
#[derive(Clone, Copy, Debug, Default)]
struct Rest {
    /// Mean, least and most; `None` as long as it moves or is to move.
    duties: Option<[f32; 3]>,
    /// Milliseconds since then.
    ms: f32,
    standing: Standing,
}

impl Rest {
    /// Share of the newest duty in the mean, once a millisecond: a loop that trembles over an edge gives more and less by turns.
    const MEAN: f32 = 1.0 / 16.0;
    /// How much faster than on average a head may begin to creep.
    const SLOWS: f32 = 4.0;

    /// A millisecond at rest under this duty; whether the head must have been seen to move.
    fn is_too_far(&mut self, breakaway: &Breakaway, duty: f32, rests: bool) -> bool {
        let [mean, least, most] = self.duties.unwrap_or([duty; 3]);
        let mean = mean + (duty - mean) * Self::MEAN;
        let turned = larger(mean - least, most - mean);
        self.duties = rests.then(|| [mean, smaller(least, mean), larger(most, mean)]);
        self.ms = if rests { self.ms + 1.0 } else { 1.0 };
        // It may have come to rest in a film, which takes a force as long as it goes at all, and the more in the beginning.
        let creeps = Self::SLOWS * breakaway.film / self.ms;
        let beyond = turned - Breakaway::REST_FRICTIONS * breakaway.friction - Breakaway::REST - creeps;
        self.standing.is_too_long(breakaway, larger(beyond, 0.0), !rests)
    }
}

/// How a head would move that nothing holds but its friction: no work, no flushing, and no film beyond the one that its last
/// counts have shown. That grows as the head comes down, and not at once, whatever the settings say of the face.
#[derive(Clone, Copy, Debug, Default)]
struct Unheld {
    standing: Standing,
    /// Duty times ms that the counts since the last motion have taken, and that three of them may take.
    taken: f32,
    film: f32,
}

impl Unheld {
    /// Share of its friction that a head that moves has at the least, so that the rest is film.
    const SLIDES: f32 = 0.67;
    /// Times the film that was seen, for the narrower gap of the next counts.
    const NARROWS: f32 = 2.0;

    /// A millisecond under so much duty, at the least and at the most, in addition to what holds the weight, in which the head has
    /// gone so many counts since it last moved; whether it must have been seen to move.
    fn is_too_long(
        &mut self,
        breakaway: &Breakaway,
        (duty, most): (f32, f32),
        way: Option<u32>,
        counts: bool,
        open: bool,
    ) -> bool {
        self.taken += larger(most - Self::SLIDES * breakaway.friction, 0.0);
        if let Some(way) = way {
            self.film = self.taken * Self::NARROWS * Breakaway::SEEN / way.max(1) as f32;
            self.taken = 0.0;
        }
        let film = smaller(breakaway.film, self.film);
        let beyond = |frictions: f32| duty.abs() - frictions * breakaway.friction - Breakaway::UNKNOWN;
        let push = if open { larger(beyond(1.0), 0.0).copysign(duty) } else { 0.0 };
        let long = self.standing.is_too_long(&Breakaway { film, ..*breakaway }, push, counts);
        long && beyond(Breakaway::BEGINS) > 0.0
    }
}

/// Whether the motor current follows the duty. An open wire keeps the charge of its filter, and with it one code: a
/// resting winding may give that for some milliseconds as well, but no winding whose voltage changes.
#[derive(Clone, Copy, Debug, Default)]
struct Stuck {
    /// Current code, if it was one for a millisecond, and the current that the mean voltage of that would drive at rest, A.
    code: Option<i32>,
    driven: f32,
    /// Times that this has changed without it.
    steps: u32,
    /// How long it has been one code.
    stands: Lasting,
}

impl Stuck {
    /// Codes by which the driven current has to change from one millisecond to the next.
    const CODES: f32 = 4.0;
    /// Times that it has to.
    const STEPS: u32 = 20;

    /// A millisecond with one code, if it was that; whether the code must have changed.
    fn look(&mut self, code: Option<i32>, driven: f32, per_code: f32) -> bool {
        let stands = code.is_some() && code == self.code;
        let step = (driven - self.driven).abs() > Stuck::CODES * per_code;
        self.steps = if stands { self.steps.saturating_add(step.into()) } else { 0 };
        (self.code, self.driven) = (code, driven);
        self.stands.longer_than(Supervisor::CODE_MS, stands) | (self.steps > Stuck::STEPS)
    }
}

/// What the supervision looks at and judges by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Limits.
    pub limits: Limits,
    /// The actuator.
    pub plant: Plant,
    /// What the winding may carry.
    pub current: CurrentLimits,
    /// When the encoder is not believed.
    pub plausibility: PlausibilityLimits,
    /// What the scale's index marks promise.
    pub marks: MarkSpacing,
    /// The encoder counts down toward the work.
    pub encoder_reversed: bool,
    /// A positive duty moves away from the work.
    pub motor_reversed: bool,
    /// Motor current per converter code about mid-scale.
    pub amps_per_code: Amps,
    /// Bus voltage per converter code.
    pub bus_per_code: Volts,
}

parts!(it: Config {
    limits, plant, current, plausibility, marks, encoder_reversed, motor_reversed, amps_per_code, bus_per_code,
} by
    [it.limits],
    [it.plant, it.current],
    [it.plausibility, it.marks, it.encoder_reversed, it.motor_reversed, it.amps_per_code, it.bus_per_code],
);

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
    /// Every pulse since the start.
    pub counts: pulses::Counts,
    /// Pulses are permitted, for work or for commissioning.
    pub permitted: bool,
    /// The gap voltage has shown nothing but short for a millisecond.
    pub short: bool,
    /// What was drawn.
    pub sums: Sums,
    /// Bus voltage, a code.
    pub bus: u16,
}

/// What the hardware has counted: both counters of the encoder at one instant, and the pulses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Counters {
    /// The count that the loops use, with illegal transitions and marks.
    pub used: Snapshot,
    /// The second counter on the same lines, where both are wired.
    pub watch: Option<RawCount>,
    /// What the pulses have done.
    pub pulses: PulseCounts,
    /// Motor current and bus voltage were not converted since the look before.
    pub drive_stands: bool,
}

/// What was looked at: for the planner, hosts and reports.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Monitored {
    /// Tick of what was measured.
    pub tick: u32,
    /// Motor current, positive toward the work.
    pub current: Amps,
    /// Bus voltage.
    pub bus: Volts,
    /// Second opinion on the velocity.
    pub back_emf: BackEmf,
    /// The winding is hot: only its continuous current is allowed.
    pub reduced: bool,
    /// Illegal encoder transitions since power-up, wrapping.
    pub illegal: u32,
    /// Arcs ask for a jump; `None` before enough pulses were seen to say.
    pub arcs: Option<bool>,
    /// What the pulses say of the gap.
    pub senses: Senses,
    /// An axis that looks for a reference does not follow: something is in its way, unless its encoder is lost.
    pub blocked: bool,
    /// The newest look as whole numbers.
    pub row: Row,
}

/// What was drawn and moved from one look to the next, in codes and counts, positive toward the work: exact, for sums.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Row {
    /// Tick of the look.
    pub tick: u32,
    /// Ticks since the look before.
    pub ticks: u32,
    /// Sum of the duties given to the bridge.
    pub duty: i32,
    /// Sum of the current codes above mid-scale.
    pub current: i32,
    /// By how much the newest current code is above the newest of the look before.
    pub step: i32,
    /// The same of the duty.
    pub turn: i32,
    /// Counts moved.
    pub moved: i32,
    /// Bus voltage, a code.
    pub bus: u16,
}

/// What follows the encoder.
#[derive(Debug)]
struct Belief {
    plausibility: Plausibility,
    marks: MarkCheck,
    /// Count at the look before.
    count: u32,
    /// Count from which it has to move by more than one to have moved: an encoder of which one line is dead trembles by that.
    rest: u32,
    /// It has since the look before, by so many counts.
    moves: bool,
    way: u32,
    /// It has counted since then, be it to and fro over one edge.
    counts: bool,
    /// Times that it was to be believed anew, when this began.
    trusts: u32,
    /// Wired like this then.
    reversed: bool,
}

/// State of the supervision.
#[derive(Debug, Default)]
pub struct Supervisor {
    monitored: Monitored,
    guard: CurrentGuard,
    sums: Sums,
    /// Newest duty, as the bridge was given it.
    duty: i32,
    /// `None` until the encoder has been read.
    belief: Option<Belief>,
    following: Lasting,
    runaway: Lasting,
    encoder: Lasting,
    standing: Standing,
    rest: Rest,
    unheld: Unheld,
    /// Duty needed lately.
    needed: f32,
    gap: Lasting,
    /// Code of the gap voltage at the look before, and how long it stands.
    code: u16,
    code_stands: Lasting,
    gate: Lasting,
    host: Lasting,
    current: Lasting,
    drive: Lasting,
    stuck: Stuck,
    pulses: PulseWatch,
    classes: Pulses,
    sensing: Sensing,
}

impl Supervisor {
    /// Ticks between two calls of [`Supervisor::tick`].
    pub const PERIOD: u32 = TICKS_PER_MS;
    /// Milliseconds that motor current and bus voltage may be without a conversion: one is enough to be sure, and nothing is
    /// decided on a single look.
    const DRIVE_MS: u32 = 2;
    /// Milliseconds that gap voltage and motor current may show one code. A converter whose noise is a quarter of a code, which is
    /// less than the data sheet of any has, gives the same code twice with 91 %, and so often never.
    const CODE_MS: u32 = 400;

    /// Pulses that the high comparator has not shown, and the low one, thousands, wrapping.
    pub fn unseen(&self) -> [u32; 2] {
        self.pulses.unseen()
    }

    /// Classes of the pulses of the last 200 ms.
    pub fn shares(&self) -> &Shares {
        self.classes.shares()
    }

    /// What was looked at last.
    pub fn monitored(&self) -> &Monitored {
        &self.monitored
    }

    /// Checks everything once; `host_alive`: a life sign has come since the last call. Returns the most urgent new fault.
    pub fn tick(&mut self, config: &Config, now: &Measured, counters: &Counters, host_alive: bool) -> Option<Fault> {
        let (implausible, stuck) = self.look(config, now, counters);
        let limits = &config.limits;
        let follows = now.state.follows();
        let closed = now.closed;
        let monitored = &self.monitored;

        let bus = closed && monitored.bus.0 < limits.bus_min.0;
        let current = self.current.longer_than(limits.current_ms, monitored.current.0.abs() > limits.current_max.0);
        let unmeasured = counters.drive_stands || now.bus >= ADC_FULL_SCALE;
        let on = now.state != State::Disabled;
        let drive = self.drive.longer_than(Self::DRIVE_MS, unmeasured && on) | (stuck && on);
        let doubtful = implausible && (closed || now.state == State::Proving);
        let stands = self.stands(limits, now);
        let encoder = self.contradicts(limits, closed) | (stands && !now.homes) | doubtful;
        let against = now.saturated && now.duty * now.velocity.0 < -limits.runaway.0 * now.duty.abs();
        // An open-loop lift that goes down: the polarity is wrong as well.
        let lifts = now.state == State::Fault && !closed && now.duty < 0.0;
        let sinks = lifts && now.velocity.0 > limits.runaway.0;
        let runaway = self.runaway.longer_than(limits.following_ms, closed && against || sinks);
        let following = self.following.longer_than(limits.following_ms, closed && off(limits, now));
        let blocked = now.homes && (stands || following);
        let following = following && !now.homes;
        if blocked {
            // It goes back from there, and is judged anew.
            (self.standing, self.following) = (Standing::default(), Lasting::default());
        }
        let bad = matches!(now.quality, Quality::Missing | Quality::Saturated | Quality::Reversed | Quality::Unclear);
        // The ends of the range give one code for many voltages.
        let same = now.code == self.code && (1..ADC_FULL_SCALE).contains(&now.code);
        self.code = now.code;
        let code_stands = self.code_stands.longer_than(Self::CODE_MS, same && now.state != State::Disabled);
        let gap = self.gap.longer_than(limits.gap_ms, now.pulses && bad);
        let swapped = gap && now.quality == Quality::Reversed;
        let unclear = gap && now.quality == Quality::Unclear;
        let seen = PulseSeen {
            permitted: now.permitted,
            watched: now.state != State::Disabled,
            short: now.short,
            pulses: now.counts.total(),
            sight: limits.sight,
        };
        let pulses = self.pulses.look(counters.pulses, seen);
        let arcs = self.classes.look(&limits.arcs, &now.counts, now.pulses, now.short);
        let gateless = now.quality == Quality::NoGate || limits.gated && !self.pulses.gate_seen();
        let gate = self.gate.longer_than(limits.gap_ms, now.pulses && gateless);
        let silent = self.host.longer_than(limits.host_ms, follows && !host_alive) && limits.host_ms > 0;
        self.monitored.blocked = blocked;
        self.monitored.arcs = self.classes.jump();
        self.monitored.senses = *self.sensing.look(&limits.senses, &now.counts, now.pulses);

        [
            (drive, Fault::DriveSignalLost),
            (current, Fault::OverCurrent),
            (bus, Fault::BusSag),
            (runaway, Fault::PolarityWrong),
            (encoder, Fault::EncoderLost),
            (following, Fault::FollowingError),
            (swapped, Fault::GapReversed),
            (unclear, Fault::BurningUnclear),
            (gap || code_stands, Fault::GapSignalInvalid),
            (gate, Fault::GateMissing),
            (pulses == Some(PulseFault::Unpermitted), Fault::UnpermittedPulses),
            (pulses == Some(PulseFault::Unseen), Fault::ReflexLost),
            (arcs, Fault::PersistentArc),
            (silent, Fault::HostSilent),
        ]
        .into_iter()
        .find_map(|(happens, fault)| happens.then_some(fault))
    }

    /// Looks at drive and encoder; whether the encoder is not to be believed, and whether the motor current is stuck.
    fn look(&mut self, config: &Config, now: &Measured, counters: &Counters) -> (bool, bool) {
        let reversed = config.encoder_reversed;
        let used = as_wired(reversed, counters.used.raw);
        let illegal = counters.used.illegal;
        let begins = |belief: &Belief| belief.trusts != now.trusts || belief.reversed != reversed;
        if self.belief.as_ref().is_none_or(begins) {
            self.belief = Some(Belief {
                plausibility: Plausibility::new(config.plausibility, illegal),
                marks: MarkCheck::new(config.marks, counters.used.mark.crossings),
                count: used.count,
                rest: used.count,
                moves: true,
                way: 0,
                counts: true,
                trusts: now.trusts,
                reversed,
            });
        }
        let Some(belief) = &mut self.belief else { return (false, false) };
        let moved = used.count.wrapping_sub(belief.count).cast_signed();
        belief.count = used.count;
        belief.counts = moved != 0;
        belief.way = used.count.wrapping_sub(belief.rest).cast_signed().unsigned_abs();
        belief.moves = belief.way > 1;
        if belief.moves {
            belief.rest = used.count;
        }

        let sign = if config.motor_reversed { -1.0 } else { 1.0 };
        let bus = Volts(f32::from(now.bus) * config.bus_per_code.0);
        let (drawn, squares) = now.sums.since(&self.sums, sign * config.amps_per_code.0, sign, bus, moved);
        let driven = drawn.duty * bus.0 / config.plant.resistance_ohm;
        let stuck = self.stuck.look(now.sums.only_code_since(&self.sums), driven, config.amps_per_code.0);
        let way = if config.motor_reversed { -1 } else { 1 };
        let duty = (now.duty * f32::from(Drive::FULL)) as i32;
        let (was, sums) = (self.sums, now.sums);
        self.monitored.row = Row {
            tick: now.tick,
            ticks: sums.ticks.wrapping_sub(was.ticks),
            duty: sums.duty.wrapping_sub(was.duty).wrapping_mul(way),
            current: sums.current.wrapping_sub(was.current).wrapping_mul(way),
            step: sums.newest.wrapping_sub(was.newest).wrapping_mul(way),
            turn: duty.wrapping_sub(self.duty),
            moved,
            bus: now.bus,
        };
        self.duty = duty;
        self.sums = now.sums;
        self.guard.update(&config.current, squares, drawn.over);
        self.monitored.back_emf.update(&config.plant, &drawn);
        self.monitored.current = drawn.end;
        self.monitored.tick = now.tick;
        self.monitored.bus = bus;
        self.monitored.reduced = self.guard.reduced();
        self.monitored.illegal = illegal;

        let watch = counters.watch.map(|watch| as_wired(reversed, watch));
        let apart = belief.plausibility.look(used, watch, illegal).is_err();
        (apart | belief.marks.update(counters.used.mark).is_err(), stuck)
    }

    /// An encoder that stands still while the winding generates, or the reverse, is not believed.
    fn contradicts(&mut self, limits: &Limits, closed: bool) -> bool {
        let back_emf = &self.monitored.back_emf;
        let allowed = limits.velocity.0 + limits.resistance * back_emf.resistive().0;
        let differs = back_emf.difference().0.abs() > allowed;
        self.encoder.longer_than(limits.encoder_ms, closed && differs)
    }

    /// An encoder that stands still, or trembles, while the loop gives more than friction can hold is not believed: a head that
    /// moves without counts has reached the work, or its stop, long before its back-EMF shows. The reaction to another fault
    /// drives up, perhaps onto the stop: there it may push.
    fn stands(&mut self, limits: &Limits, now: &Measured) -> bool {
        let breakaway = &limits.breakaway;
        // One that turns round may be where it was, but its edges show it.
        let turns = now.velocity.0.abs() >= Breakaway::TURNS;
        let still = !turns && self.belief.as_ref().is_some_and(|belief| !belief.moves);
        // Commissioning drives from stop to stop.
        let loops = now.closed && now.state != State::Commissioning && (now.state != State::Fault || now.free);
        let more = now.duty - self.needed;
        self.needed = match now.state {
            _ if loops => self.needed + more * Breakaway::LATELY,
            // Without a loop for a push: what was needed before still is.
            State::Identifying => self.needed,
            _ => breakaway.holding,
        };
        let beyond = now.duty - breakaway.holding;
        let push = smaller(more.abs(), beyond.abs());
        let following = now.following.abs();
        let pushed = push > breakaway.push && following > larger(breakaway.tremble, 0.5 * breakaway.following);
        let along = |duty: f32| duty.copysign(duty * now.following) > breakaway.friction;
        let follows = following > breakaway.following && along(more) && along(beyond);
        let push = if loops { larger(push - breakaway.friction, 0.0).copysign(beyond) } else { 0.0 };
        let silent = self.belief.as_ref().is_some_and(|belief| !belief.counts);
        let far = self.rest.is_too_far(breakaway, now.duty, loops && now.rests && silent);
        let way = self.belief.as_ref().filter(|belief| belief.moves).map(|belief| belief.way);
        // What holds the weight is what the settings say, or what was needed lately.
        let least = smaller(more.abs(), beyond.abs()).copysign(beyond);
        let duties = (least, larger(more.abs(), beyond.abs()));
        let unheld = self.unheld.is_too_long(breakaway, duties, way, !silent, loops && now.open);
        far | unheld | (self.standing.is_too_long(breakaway, push, !still) && (pushed || follows))
    }
}

/// The axis is too far from its setpoint. A fault's reaction does not push a head down that has risen by itself: there only
/// one that is too far down counts.
fn off(limits: &Limits, now: &Measured) -> bool {
    let following = if now.state == State::Fault { -now.following } else { now.following.abs() };
    following > limits.following
}
