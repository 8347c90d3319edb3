//! Commissioning: encoder direction, motor polarity, gap polarity and stroke, before any loop is closed.
//!
//! It starts with the head at rest at its upper stop (where counterbalance or spring hold it) and no workpiece below. The
//! stop is what makes the signs certain: from there the head can only move toward the work, so
//!
//! 1. a slowly growing positive duty moves the head: the motor is right; it does not, but a negative one does: the motor is
//!    reversed; neither does: nothing is connected, or the duty limit is too low;
//! 2. the count grew: the encoder is right; it fell: the encoder is reversed;
//! 3. driven back, the head stops where it began: it was at the stop;
//! 4. with pulses on, the open gap shows its voltage with the right sign;
//! 5. the whole stroke is driven at a slow velocity, down to the lower stop and back, and measured.
//!
//! Every duty stays under commissioning's own limit, and every step has a time limit.

use crate::gap::{GapReading, Quality};
use crate::servo::{Plant, Window};
use crate::units::{CountsPerSecond, Newtons, TICK_S, Volts, larger};
use core::fmt;

/// Limits of commissioning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Largest duty, either way.
    pub duty: f32,
    /// Counts that prove a motion.
    pub motion: i64,
    /// Stroke expected, counts.
    pub stroke: i64,
    /// Counts by which the measured stroke may differ.
    pub stroke_tolerance: i64,
    /// Velocity of the stroke measurement.
    pub velocity: CountsPerSecond,
    /// Lowest open-circuit voltage.
    pub open_min: Volts,
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
    /// The stroke is not what the settings say; the measured one in counts.
    Stroke(i64),
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
            Finding::Stroke(counts) => write!(f, "the stroke measures {counts} counts, not what axis.stroke_um says"),
        }
    }
}

/// What was measured when nothing was wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Report {
    /// Duty at which the head began to move: friction and net weight.
    pub breakaway: f32,
    /// Open-circuit voltage.
    pub open: Volts,
    /// Stroke, counts.
    pub stroke: i64,
}

impl Report {
    /// Dry friction: what the push to break away was more than the net weight.
    pub fn friction(&self, plant: &Plant) -> Newtons {
        let pushed = self.breakaway / plant.duty(Newtons(1.0));
        Newtons(larger(pushed + plant.net_weight().0, 0.0))
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Step {
    Rest,
    PushDown,
    PushUp,
    Return,
    Gap,
    StrokeDown,
    StrokeUp,
}

/// What commissioning wants until the next plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wish {
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
    report: Report,
}

/// Time to rest and to read the gap.
const SETTLE: u32 = ticks(0.3);
/// Time in which a push grows to the limit.
const RAMP: u32 = ticks(2.0);
/// Share of the motion that is looked for, behind which the head has begun to move.
const BEGUN: i64 = 10;
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
            report: Report { breakaway: 0.0, open: Volts(0.0), stroke: 0 },
        }
    }

    /// Goes on, `ticks` after the plan before: what to do, and the result once there is one.
    pub fn plan(
        &mut self,
        config: &Config,
        count: i64,
        gap: &GapReading,
        ticks: u32,
    ) -> (Wish, Option<Result<Report, Finding>>) {
        self.ticks = self.ticks.saturating_add(ticks);
        self.still = if count.abs_diff(self.last) <= 1 { self.still.saturating_add(ticks) } else { 0 };
        if self.still == 0 {
            self.last = count;
        }
        let moved = count.saturating_sub(self.start);
        let window = Window::symmetric(config.duty);
        let wish = match self.step {
            Step::PushDown => Wish::Duty(config.duty * self.ramp()),
            Step::PushUp => Wish::Duty(-config.duty * self.ramp()),
            Step::Return => Wish::Duty(-config.duty),
            Step::StrokeDown => Wish::Stroke(config.velocity, window),
            Step::StrokeUp => Wish::Stroke(CountsPerSecond(-config.velocity.0), window),
            Step::Gap => Wish::Pulses,
            Step::Rest => Wish::Duty(0.0),
        };
        let duty = if let Wish::Duty(duty) = wish { duty } else { 0.0 };
        (wish, self.judge(config, moved, duty, gap))
    }

    /// Whether it runs a velocity loop: the strokes do.
    pub fn closes_loop(&self) -> bool {
        matches!(self.step, Step::StrokeDown | Step::StrokeUp)
    }

    fn ramp(&self) -> f32 {
        (self.ticks as f32 * (1.0 / RAMP as f32)).min(1.0)
    }

    fn judge(&mut self, config: &Config, moved: i64, duty: f32, gap: &GapReading) -> Option<Result<Report, Finding>> {
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
            Step::PushDown if moved.abs() <= config.motion / BEGUN => self.report.breakaway = duty,
            Step::PushUp if moved.abs() > config.motion => return Some(Err(Finding::MotorReversed)),
            Step::PushUp if self.ticks > RAMP + SETTLE => return Some(Err(Finding::NoMotion)),
            Step::Return if moved < -config.motion => return Some(Err(Finding::NotAtUpperStop)),
            Step::Return if stopped => self.enter(Step::Gap),
            Step::Gap if self.ticks > SETTLE => {
                self.report.open = gap.filtered;
                match gap.quality {
                    Quality::Valid if gap.filtered >= config.open_min => self.enter(Step::StrokeDown),
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
                return Some(if fits { Ok(self.report) } else { Err(Finding::Stroke(self.report.stroke)) });
            }
            _ => {}
        }
        None
    }

    fn enter(&mut self, step: Step) {
        self.step = step;
        self.ticks = 0;
        self.still = 0;
    }
}
