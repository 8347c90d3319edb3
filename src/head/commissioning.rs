//! Commissioning: encoder direction, motor polarity, gap polarity and stroke, before any loop is closed.
//!
//! It starts with the head at rest at its upper stop (where counterbalance or spring hold it) and no workpiece below. The
//! stop is what makes the signs certain: from there the head can only move toward the work, so
//!
//! 1. a slowly growing positive duty moves the head: the motor is right; it does not, but a negative one does: the motor is
//!    reversed; neither does: nothing is connected, or the duty limit is too low;
//! 2. the count grew: the encoder is right; it fell: the encoder is reversed;
//! 3. driven back, the head stops where it began: it was at the stop;
//! 4. two pushes of different duty from rest, over half a millimetre, show the moving mass: what one has more of force than the
//!    other, over what it has more of acceleration;
//! 5. with pulses on, the open gap shows its voltage with the right sign, and as the settings say;
//! 6. the whole stroke is driven at a slow velocity, down to the lower stop and back, and measured. Half the sum of the duties
//!    that this takes is the net weight, whatever the friction is. What it takes to begin to move, less the net weight at the upper
//!    stop (a cable or spring changes it along the stroke), is friction.
//!
//! Mass and net weight have to be what the settings say, within what the check itself is sure of. They are calculated from
//! duties with resistance and constant of the motor as set: a wrong one of these, or of the length of a count, shows as a
//! wrong mass. What the head knows of its weight and friction from then on is what was measured
//! ([`Settings::learnt`](crate::settings::Settings::learnt)).
//!
//! Every duty stays under commissioning's own limit, and every step has a time limit.

use super::follow::LEAD;
use crate::gap::{GapReading, Quality};
use crate::servo::{Plant, Window};
use crate::units::{CountsPerSecond, Newtons, PLAN_TICKS, TICK_S, Volts, larger};
use core::fmt;

/// Limits of commissioning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Largest duty, either way.
    pub duty: f32,
    /// Counts that prove a motion.
    pub motion: i64,
    /// Length of a push that shows the mass, counts, and the velocity, counts/s, at which it ends before that.
    pub push: (i64, f32),
    /// Stroke expected, counts.
    pub stroke: i64,
    /// Counts by which the measured stroke may differ.
    pub stroke_tolerance: i64,
    /// Velocity of the stroke measurement.
    pub velocity: CountsPerSecond,
    /// Lowest open-circuit voltage.
    pub open_min: Volts,
    /// Open-circuit voltage of the settings.
    pub open: Volts,
}

/// What commissioning found wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Finding {
    /// The head moved with no duty on it.
    NotAtRest,
    /// No duty up to the limit moved the head.
    NoMotion,
    /// The head moved for a negative duty only: set `motor.reversed`.
    MotorReversed,
    /// The count fell while the head moved toward the work: set `encoder.reversed`.
    EncoderReversed,
    /// Driven back, the head went past the place it started from: it was not at the upper stop.
    NotAtUpperStop,
    /// The open gap reads a voltage of the wrong sign: set `gap.reversed`.
    GapReversed,
    /// The open gap reads too little voltage, or nothing.
    NoOpenCircuit,
    /// `gap.open_v` is not the voltage that was measured: the scale of the gap voltage is wrong, or the supply another one.
    OpenCircuit(Contradiction),
    /// The stroke is not what the settings say; the measured one in counts.
    Stroke(i64),
    /// The duty limit leaves too little beyond friction to measure the mass.
    TooWeak,
    /// `axis.mass_kg` is not the mass that was measured.
    Mass(Contradiction),
    /// `axis.counterbalance_n` is not the force that was measured.
    Counterbalance(Contradiction),
}

/// What was measured where a setting says something else, in thousandths of the setting's unit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Contradiction {
    /// Measured.
    pub measured: i32,
    /// Least that the setting may be: the measured value less its uncertainty.
    pub least: i32,
    /// Most that it may be.
    pub most: i32,
}

impl fmt::Display for Contradiction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [measured, least, most] = [self.measured, self.least, self.most].map(|milli| milli as f32 * 1e-3);
        write!(f, "{measured:.3}, and may be set from {least:.3} to {most:.3}")
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Finding::NotAtRest => {
                f.write_str("the head moves with no duty on it: let it come to rest at its upper stop")
            }
            Finding::NoMotion => f.write_str("no duty up to commission.duty_limit moved the head"),
            Finding::MotorReversed => f.write_str("the motor pushes the wrong way: change motor.reversed"),
            Finding::EncoderReversed => f.write_str("the encoder counts the wrong way: change encoder.reversed"),
            Finding::NotAtUpperStop => f.write_str("the head did not start at its upper stop"),
            Finding::GapReversed => f.write_str("the gap voltage has the wrong sign: change gap.reversed"),
            Finding::NoOpenCircuit => f.write_str("the open gap reads less than gap.open_min_v"),
            Finding::OpenCircuit(found) => {
                write!(f, "gap.open_v measures {found}, unless gap.volts_per_code or gap.zero_code is wrong")
            }
            Finding::Stroke(counts) => write!(f, "the stroke measures {counts} counts, not what axis.stroke_um says"),
            Finding::TooWeak => f.write_str(
                "commission.duty_limit is hardly more than friction: raise it, or the mass cannot be measured",
            ),
            Finding::Mass(found) => write!(
                f,
                "axis.mass_kg measures {found}, unless axis.resistance_ohm, axis.force_constant_n_a or encoder.count_um is wrong"
            ),
            Finding::Counterbalance(found) => {
                write!(f, "axis.counterbalance_n measures {found}, with axis.mass_kg as set")
            }
        }
    }
}

/// A measured value with the most by which it may be wrong.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Weighed {
    /// The value.
    pub value: f32,
    /// The most by which it may be wrong.
    pub uncertainty: f32,
}

impl Weighed {
    /// What is to be said of a setting that is not this.
    fn contradicts(&self, set: f32) -> Option<Contradiction> {
        let milli = |value: f32| (value * 1e3) as i32;
        let Weighed { value, uncertainty } = *self;
        // What is no number agrees with nothing.
        let agrees = (set - value).abs() <= uncertainty;
        let [measured, least, most] = [value, larger(value - uncertainty, 0.0), value + uncertainty].map(milli);
        (!agrees).then_some(Contradiction { measured, least, most })
    }
}

/// What was measured when nothing was wrong.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Report {
    /// Moving mass, kg.
    pub mass: Weighed,
    /// Weight less counterbalance, N, positive toward the work.
    pub net_weight: Weighed,
    /// Dry friction at rest, N: what begins to move the head in addition to the net weight.
    pub friction: Weighed,
    /// Open-circuit voltage.
    pub open: Volts,
    /// Stroke, counts.
    pub stroke: i64,
}

/// A push from rest, for as long as it took.
#[derive(Clone, Copy, Debug, Default)]
struct Pushed {
    duty: f32,
    /// s, counts, and their integral, count s.
    time: f32,
    way: f32,
    swept: f32,
}

impl Pushed {
    /// Time by which the beginning of a push is known, s: the winding's L/R and two ticks are included.
    const BEGUN_S: f32 = 0.1e-3;

    /// Goes on to a place.
    fn goes_on(&mut self, time: f32, way: f32) {
        self.swept += 0.5 * (self.way + way) * (time - self.time);
        (self.time, self.way) = (time, way);
    }

    /// Twice over the square of the time: a constant acceleration, counts/s^2, has this times the way; a force that is
    /// proportional to the velocity is on average this times the integral of the way.
    fn rate(&self) -> f32 {
        let time = larger(self.time, TICK_S);
        2.0 / (time * time)
    }

    fn acceleration(&self) -> f32 {
        self.rate() * self.way
    }

    /// Duty less what the back-EMF took of it on average.
    fn force(&self, plant: &Plant) -> f32 {
        self.duty - plant.back_emf() * self.rate() * self.swept
    }

    /// How far the acceleration may be wrong, counts/s^2.
    fn doubt(&self) -> f32 {
        self.acceleration() * 2.0 * Pushed::BEGUN_S / larger(self.time, TICK_S) + self.rate()
    }
}

/// Mean of the duties that a stroke has taken.
#[derive(Clone, Copy, Debug, Default)]
struct Mean {
    sum: f32,
    plans: f32,
}

impl Mean {
    fn take(&mut self, duty: f32) {
        self.sum += duty;
        self.plans += 1.0;
    }

    fn duty(&self) -> f32 {
        self.sum / larger(self.plans, 1.0)
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Step {
    Rest,
    PushDown,
    PushUp,
    Return,
    Settle,
    Push,
    Gap,
    StrokeDown,
    StrokeUp,
}

/// What commissioning wants until the next plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Demand {
    /// Duty, positive toward the work.
    Duty(f32),
    /// Pulses, with no duty.
    Pulses,
    /// A velocity, with duties inside a window.
    Stroke(CountsPerSecond, Window),
}

/// Commissioning under way.
#[derive(Clone, Copy, Debug)]
pub struct Commissioning {
    step: Step,
    ticks: u32,
    start: i64,
    still: u32,
    last: i64,
    lowest: i64,
    /// Duty at which the head began to move.
    breakaway: f32,
    /// Pushes that show the mass, and how many are over.
    pushes: [Pushed; 2],
    pushed: usize,
    /// Duties of the stroke down and of the one up: of the second and of the third quarter from the upper stop.
    strokes: [[Mean; 2]; 2],
    report: Report,
}

/// Time to rest and to read the gap.
const SETTLE: u32 = ticks(0.3);
/// Time in which a push grows to the limit.
const RAMP: u32 = ticks(2.0);
/// Share of the motion that is looked for, behind which the head has begun to move: 10 um. What holds it gives way by some
/// micrometres before it lets go.
const BEGUN: i64 = 5;
/// Time in which a push that shows the mass has to end.
const PUSH: u32 = ticks(2.0);
/// Most of the mass that the scatter of friction may leave in doubt: the hard push is twice what begins to move the head.
const DOUBT: f32 = 0.2;
/// By how much a mass may be measured wrong, beside what the times of the pushes leave open: friction that is not the same in
/// both, and what is no friction.
const MASS: f32 = 0.1;
/// Share of the friction that is not the same in two pushes, nor in both directions (assumed).
const SCATTER: f32 = 0.1;
/// Share of the weight by which the net weight may be measured wrong (assumed).
const WEIGHT: f32 = 0.05;
/// Share of the open-circuit voltage measured by which the setting may differ: supply and divider are 15 % off at the most (assumed).
const SUPPLY: f32 = 0.25;
/// Standstill that means a stop.
const STANDSTILL: u32 = ticks(0.2);
/// Longest stroke at the set velocity, as a multiple of the expected time.
const STROKE_PATIENCE: f32 = 2.0;

const fn ticks(seconds: f32) -> u32 {
    (seconds / TICK_S) as u32
}

impl Commissioning {
    /// Begins where the head is.
    pub fn new(count: i64) -> Commissioning {
        Commissioning {
            step: Step::Rest,
            ticks: 0,
            start: count,
            still: 0,
            last: count,
            lowest: count,
            breakaway: 0.0,
            pushes: [Pushed::default(); 2],
            pushed: 0,
            strokes: Default::default(),
            report: Report::default(),
        }
    }

    /// Goes on, `ticks` after the plan before, with the count and the duty of now: what to do, and the result once there is one.
    pub fn plan(
        &mut self,
        config: &Config,
        plant: &Plant,
        (count, duty): (i64, f32),
        gap: &GapReading,
        ticks: u32,
    ) -> (Demand, Option<Result<Report, Finding>>) {
        self.ticks = self.ticks.saturating_add(ticks);
        self.still = if count.abs_diff(self.last) <= 1 { self.still.saturating_add(ticks) } else { 0 };
        if self.still == 0 {
            self.last = count;
        }
        let moved = count.saturating_sub(self.start);
        let window = Window::symmetric(config.duty);
        let wish = match self.step {
            Step::PushDown => Demand::Duty(config.duty * self.ramp()),
            Step::PushUp => Demand::Duty(-config.duty * self.ramp()),
            Step::Push => Demand::Duty(self.pushing(config)),
            Step::Return => Demand::Duty(-config.duty),
            Step::StrokeDown => Demand::Stroke(config.velocity, window),
            Step::StrokeUp => Demand::Stroke(CountsPerSecond(-config.velocity.0), window),
            Step::Gap => Demand::Pulses,
            Step::Rest | Step::Settle => Demand::Duty(0.0),
        };
        self.look(config, moved, duty);
        let wished = if let Demand::Duty(duty) = wish { duty } else { 0.0 };
        (wish, self.judge(config, plant, moved, wished, gap))
    }

    /// Whether it runs a velocity loop: the strokes do.
    pub fn closes_loop(&self) -> bool {
        matches!(self.step, Step::StrokeDown | Step::StrokeUp)
    }

    fn ramp(&self) -> f32 {
        (self.ticks as f32 * (1.0 / RAMP as f32)).min(1.0)
    }

    /// Duty of a push that shows the mass: all that is allowed, then halfway from there to what begins to move the head.
    fn pushing(&self, config: &Config) -> f32 {
        if self.pushed == 0 { config.duty } else { 0.5 * (config.duty + self.breakaway) }
    }

    /// Takes in what the middle half of a stroke takes.
    fn look(&mut self, config: &Config, moved: i64, duty: f32) {
        let quarter = config.stroke / 4;
        let [down, up] = &mut self.strokes;
        let [second, third] = match self.step {
            Step::StrokeDown => down,
            Step::StrokeUp => up,
            _ => return,
        };
        if moved > quarter && moved < config.stroke - quarter {
            let part = if moved < config.stroke / 2 { second } else { third };
            part.take(duty);
        }
    }

    fn judge(
        &mut self,
        config: &Config,
        plant: &Plant,
        moved: i64,
        duty: f32,
        gap: &GapReading,
    ) -> Option<Result<Report, Finding>> {
        let stroke_ticks = (config.stroke as f32 / config.velocity.0 * STROKE_PATIENCE / TICK_S) as u32;
        let stopped = self.still > STANDSTILL && self.ticks > STANDSTILL;
        match self.step {
            Step::Rest if moved.abs() > config.motion => return Some(Err(Finding::NotAtRest)),
            Step::Rest if self.ticks > SETTLE => self.enter(Step::PushDown),
            Step::PushDown if moved.abs() > config.motion => {
                if moved < 0 {
                    return Some(Err(Finding::EncoderReversed));
                }
                self.enter(Step::Return);
            }
            Step::PushDown if self.ticks > RAMP + SETTLE => self.enter(Step::PushUp),
            // The push grows on while the head gets under way.
            Step::PushDown if moved.abs() <= config.motion / BEGUN => self.breakaway = duty,
            Step::PushUp if moved.abs() > config.motion => return Some(Err(Finding::MotorReversed)),
            Step::PushUp if self.ticks > RAMP + SETTLE => return Some(Err(Finding::NoMotion)),
            Step::Return if moved < -config.motion => return Some(Err(Finding::NotAtUpperStop)),
            Step::Return if stopped && self.pushed < self.pushes.len() => self.enter(Step::Settle),
            Step::Return if stopped => match self.weigh(plant) {
                Ok(()) => self.enter(Step::Gap),
                Err(finding) => return Some(Err(finding)),
            },
            Step::Settle if self.ticks > SETTLE => self.enter(Step::Push),
            Step::Push if self.ticks > PUSH => return Some(Err(Finding::NoMotion)),
            Step::Push => self.push(config, plant, moved, duty),
            Step::Gap if self.ticks > SETTLE => {
                self.report.open = gap.filtered;
                let open = Weighed { value: gap.filtered.0, uncertainty: SUPPLY * gap.filtered.0 };
                match gap.quality {
                    Quality::Valid if gap.filtered >= config.open_min => match open.contradicts(config.open.0) {
                        Some(found) => return Some(Err(Finding::OpenCircuit(found))),
                        None => self.enter(Step::StrokeDown),
                    },
                    Quality::Reversed => return Some(Err(Finding::GapReversed)),
                    _ => return Some(Err(Finding::NoOpenCircuit)),
                }
            }
            Step::StrokeDown if stopped || self.ticks > stroke_ticks => {
                self.lowest = moved;
                self.enter(Step::StrokeUp);
            }
            Step::StrokeUp if stopped || self.ticks > stroke_ticks => {
                self.report.stroke = self.lowest.saturating_sub(moved);
                let error = self.report.stroke.saturating_sub(config.stroke);
                let fits = error.abs() <= config.stroke_tolerance;
                let balanced = if fits { self.balance(plant) } else { Err(Finding::Stroke(self.report.stroke)) };
                return Some(balanced.map(|()| self.report));
            }
            _ => {}
        }
        None
    }

    /// Goes on with a push that shows the mass, which ends with its way, or once it is fast.
    fn push(&mut self, config: &Config, plant: &Plant, moved: i64, duty: f32) {
        // The duty is that of the plan before, and comes into force a little later; the current follows with L/R.
        let late = (PLAN_TICKS + LEAD) as f32 * TICK_S + plant.inductance_h / plant.resistance_ohm;
        let time = self.ticks as f32 * TICK_S - late;
        let Some(push) = self.pushes.get_mut(self.pushed) else { return };
        let before = push.way;
        if time > 0.0 {
            push.goes_on(time, moved as f32);
        }
        push.duty = duty;
        let (most, fast) = config.push;
        if moved >= most || push.way - before > fast * PLAN_TICKS as f32 * TICK_S {
            self.pushed += 1;
            self.enter(Step::Return);
        }
    }

    /// The mass by two pushes: net weight and friction were the same in both.
    fn weigh(&mut self, plant: &Plant) -> Result<(), Finding> {
        let [hard, soft] = &self.pushes;
        let forced = hard.force(plant) - soft.force(plant);
        let gained = hard.acceleration() - soft.acceleration();
        let scatter = SCATTER * self.breakaway / forced;
        if !(gained > 0.0 && (0.0..DOUBT).contains(&scatter)) {
            return Err(Finding::TooWeak);
        }
        let value = plant.mass_kg * forced / plant.accelerating(gained);
        let doubt = MASS + (hard.doubt() + soft.doubt()) / gained + scatter;
        self.report.mass = Weighed { value, uncertainty: value * doubt };
        self.report.mass.contradicts(plant.mass_kg).map_or(Ok(()), |found| Err(Finding::Mass(found)))
    }

    /// Net weight and friction by the duties of both strokes, and by what began to move the head.
    fn balance(&mut self, plant: &Plant) -> Result<(), Finding> {
        let per_newton = plant.duty(Newtons(1.0));
        let [down, up] = self.strokes.map(|quarters| quarters.map(|mean| mean.duty() / per_newton));
        let [second, third] = [-0.5 * (down[0] + up[0]), -0.5 * (down[1] + up[1])];
        let value = 0.5 * (second + third);
        let uncertainty = SCATTER * 0.25 * (down[0] + down[1] - up[0] - up[1]).abs() + WEIGHT * plant.weight().0;
        self.report.net_weight = Weighed { value, uncertainty };
        // The middles of the quarters are a quarter of the stroke apart, and half of it below the upper stop on average.
        let at_upper_stop = value - 2.0 * (third - second);
        let friction = larger(self.breakaway / per_newton + at_upper_stop, 0.0);
        self.report.friction = Weighed { value: friction, uncertainty: uncertainty + SCATTER * friction };
        let counterbalance = Weighed { value: plant.weight().0 - value, uncertainty };
        counterbalance.contradicts(plant.counterbalance.0).map_or(Ok(()), |found| Err(Finding::Counterbalance(found)))
    }

    fn enter(&mut self, step: Step) {
        self.step = step;
        self.ticks = 0;
        self.still = 0;
    }
}
