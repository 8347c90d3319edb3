//! Tuning: the head moves, and measures the frequency response of its own loop.
//!
//! It begins where the head holds, homed, and stays within a length straight above, as an identification does: nothing of it leads
//! toward the work beyond the place where it began. The loop stays closed all the time. Under it goes a slow stroke up and down, so that
//! friction is that of sliding and the edges of the encoder come at every phase; on top of the duty of the loop goes a sine, only where
//! the set point keeps its velocity. Sums over whole periods with that sine and its cosine give
//! what the loop answers with (C, duty less the sine) and how the head moves (X, position less set point). With U = E + C, E the sine:
//!
//! - L = -C / U, the loop opened at the duty. It has everything in it: gains as they run, estimate of the velocity, winding, delays.
//! - G = j w X / U, what a duty makes of the velocity, by position.
//!
//! A sample of the sine is held for a plan, 5 ticks. It comes into force 2 ticks after its estimate, so that of the estimate at the end
//! its middle is a tick past: E = a D exp(j w T), D = sin(5 w T / 2) / (5 sin(w T / 2)), T the tick. What a held sample has above half of
//! the rate of plans comes back as an error, where the head still moves with it: simulated, 2 % of L at 1 kHz.
//!
//! The sine is as large as lets the head swing by a fifth of its velocity, or by [`Config::swing`]: with more, friction would turn round.

use super::follow::LEAD;
use super::identify::{Demand, Seen, toward};
use crate::motion::Ramp;
use crate::units::{CountsPerSecond, CountsPerSecond2, Fixed, PLAN_TICKS, TICK_HZ, TICK_S, larger, smaller, within};
use core::f32::consts::TAU;

/// Points of a response at the most.
pub const POINTS: usize = 32;
/// Words of a point.
pub const WORDS: usize = 8;

/// Limits of a tuning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Length that it needs above the head, counts.
    pub travel: i64,
    /// Largest sine, duty.
    pub duty: f32,
    /// Largest swing about the set point, counts.
    pub swing: f32,
    /// Velocity of the strokes.
    pub velocity: CountsPerSecond,
    /// Their acceleration.
    pub acceleration: CountsPerSecond2,
    /// Lowest frequency, Hz; from each to the next one this ratio; how many.
    pub lowest: f32,
    /// See [`lowest`](Config::lowest).
    pub ratio: f32,
    /// See [`lowest`](Config::lowest).
    pub points: u32,
    /// mm to a count.
    pub mm: f32,
}

/// What a tuning does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Step {
    /// None is under way.
    #[default]
    None,
    /// To the middle of its length.
    Rise,
    /// One frequency after the other.
    Measure,
    /// Back to where it began.
    Return,
}

/// The response at a frequency. Deviations are those of the mean over its windows, absolute, of both parts together.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Point {
    /// Frequency, Hz.
    pub hz: f32,
    /// Amplitude of the sine, duty.
    pub duty: f32,
    /// The loop opened at the duty, -C / U: real and imaginary part, deviation.
    pub open: [f32; 3],
    /// Velocity of the head to a duty of 1, mm/s: the same.
    pub plant: [f32; 3],
}

impl Point {
    /// As a host reads it.
    pub fn words(&self) -> [f32; WORDS] {
        let [open_re, open_im, open_off] = self.open;
        let [plant_re, plant_im, plant_off] = self.plant;
        [self.hz, self.duty, open_re, open_im, open_off, plant_re, plant_im, plant_off]
    }
}

/// Plans a second.
const PLAN_HZ: f32 = (TICK_HZ / PLAN_TICKS) as f32;
/// Windows of a point, and the shortest, s.
const WINDOWS: u32 = 8;
const WINDOW_S: f32 = 0.06;
/// Time, and periods, for which the sine is on before a window: what turning round has left dies away.
const SETTLE_S: f32 = 0.03;
const SETTLE_PERIODS: f32 = 0.5;
/// Share of the length in which strokes go, and of that what the windows may take.
const STROKE: f32 = 0.8;
const USED: f32 = 0.95;
/// Share of its velocity by which a stroke is slower than the one before, and by which it may differ from it.
const VARIES: f32 = 0.013;
const STEADY: f32 = 0.001;
/// Velocity by which the head swings, of that of the stroke: wanted; accepted from and to, times that; at which the sine is halved.
const SWINGS: f32 = 0.2;
const ACCEPTED: (f32, f32) = (0.5, 1.5);
const TOO_FAST: f32 = 0.7;
/// Share of the largest sine that the first one has, and by how much one may grow at once.
const FIRST: f32 = 0.125;
const GROWS: f32 = 4.0;
/// Strokes after which a frequency is given up.
const STROKES: u32 = 80;

/// Real and imaginary part.
type Complex = (f32, f32);

fn square(z: Complex) -> f32 {
    z.0 * z.0 + z.1 * z.1
}

fn plus(a: Complex, b: Complex) -> Complex {
    (a.0 + b.0, a.1 + b.1)
}

fn times(a: Complex, b: Complex) -> Complex {
    (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
}

/// a / b; zero where b is.
fn over(a: Complex, b: Complex) -> Complex {
    let by = square(b);
    let share = if by > 0.0 { 1.0 / by } else { 0.0 };
    let product = times(a, (b.0, -b.1));
    (product.0 * share, product.1 * share)
}

/// exp(j angle) up to 2 rad, to 1e-6: by its series at a sixteenth of it, squared four times. The functions of a library take 8 KiB, most of
/// them for angles that do not come here.
fn turned(angle: f32) -> Complex {
    let x = angle * (1.0 / 16.0);
    let square = x * x;
    let cos = 1.0 - square * (0.5 - square * (1.0 / 24.0 - square * (1.0 / 720.0)));
    let sin = x * (1.0 - square * (1.0 / 6.0 - square * (1.0 / 120.0)));
    (0..4).fold((cos, sin), |turn, _| times(turn, turn))
}

#[inline(never)]
fn root(square: f32) -> f32 {
    libm::sqrtf(square)
}

/// Means over windows.
#[derive(Clone, Copy, Debug, Default)]
struct Mean {
    sum: Complex,
    squares: f32,
}

impl Mean {
    fn take(&mut self, z: Complex) {
        self.sum = plus(self.sum, z);
        self.squares += square(z);
    }

    /// Mean of so many and its deviation.
    fn of(&self, windows: u32) -> (Complex, f32) {
        let share = 1.0 / windows.max(1) as f32;
        let mean = (self.sum.0 * share, self.sum.1 * share);
        let variance = larger(self.squares * share - square(mean), 0.0);
        (mean, root(variance / larger(windows as f32 - 1.0, 1.0)))
    }
}

/// A tuning under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tune {
    step: Step,
    /// Where it began, and the middle of its length.
    begun: Fixed,
    middle: Fixed,
    half: i64,
    /// Frequency, and how many there were before.
    hz: f32,
    point: u32,
    /// Its windows: plans, and those before the first; velocity of the strokes.
    plans: u32,
    settle: u32,
    velocity: f32,
    /// Strokes of this frequency; direction of the next one.
    strokes: u32,
    down: bool,
    /// Amplitude of the sine; cosine and sine of now, and of the step to the next plan.
    amplitude: f32,
    phase: Complex,
    turn: Complex,
    /// What the plan before has given of it, with cosine and sine.
    given: Option<(f32, Complex)>,
    /// Plans since the sine began, and in the window.
    settled: u32,
    count: u32,
    /// Sums of the window with sine and cosine.
    answer: Complex,
    swing: Complex,
    /// Over windows, and how many.
    answers: Mean,
    swings: Mean,
    windows: u32,
    /// Plans that were late.
    late: u32,
    over: Option<Point>,
}

impl Tune {
    /// From where the set point rests.
    #[inline(never)]
    pub fn new(config: &Config, begun: Fixed, late: u32) -> Tune {
        let half = config.travel.wrapping_div(2);
        let mut tune = Tune {
            step: Step::Rise,
            begun,
            middle: begun.minus(Fixed::whole(half)),
            half,
            hz: config.lowest,
            point: 0,
            plans: 1,
            settle: 0,
            velocity: 0.0,
            strokes: 0,
            down: false,
            amplitude: FIRST * config.duty,
            phase: (1.0, 0.0),
            turn: (1.0, 0.0),
            given: None,
            settled: 0,
            count: 0,
            answer: (0.0, 0.0),
            swing: (0.0, 0.0),
            answers: Mean::default(),
            swings: Mean::default(),
            windows: 0,
            late,
            over: None,
        };
        tune.begin(config);
        tune
    }

    /// What it does.
    pub fn step(&self) -> Step {
        self.step
    }

    /// A point that has been measured in the newest plan, once.
    pub fn take(&mut self) -> Option<Point> {
        self.over.take()
    }

    /// The loop is another one: the frequency under way begins anew.
    pub fn restart(&mut self) {
        (self.answers, self.swings, self.windows) = (Mean::default(), Mean::default(), 0);
        self.rest();
    }

    /// Goes on.
    #[inline(never)]
    pub fn plan(&mut self, config: &Config, seen: &Seen) -> Demand {
        if let Some((given, phase)) = self.given.take() {
            self.look(config, seen, given, phase);
        }
        self.late = seen.late;
        let (target, velocity) = match self.step {
            Step::Measure => {
                let way = Fixed::whole((self.half as f32 * STROKE) as i64);
                // Another velocity for each stroke: with the same in all, the edges of the encoder would come at the same few phases.
                let velocity = self.velocity * (1.0 - VARIES * (self.strokes % WINDOWS) as f32);
                (if self.down { self.middle.plus(way) } else { self.middle.minus(way) }, velocity)
            }
            Step::Return => (self.begun, config.velocity.0),
            _ => (self.middle, config.velocity.0),
        };
        let Config { acceleration, .. } = *config;
        let ramp = Ramp { velocity: CountsPerSecond(velocity), acceleration, deceleration: acceleration };
        let (segment, there) = toward(seen, target, &ramp);
        let cruises = self.step == Step::Measure && (segment.velocity.0.abs() - velocity).abs() < STEADY * velocity;
        let away = seen.position.saturating_sub(self.middle.round()).saturating_abs();
        let duty = if cruises && away < self.half { self.sine() } else { 0.0 };
        if !cruises {
            self.rest();
        }
        if there {
            match self.step {
                Step::Return => return Demand::End,
                Step::Measure => {
                    self.strokes = self.strokes.saturating_add(1);
                    self.down = !self.down;
                    if self.strokes > STROKES {
                        // What would be measured next would take as long.
                        self.step = Step::Return;
                    }
                }
                _ => self.step = Step::Measure,
            }
        }
        Demand::Follow(segment, duty)
    }

    /// The next sample of the sine.
    fn sine(&mut self) -> f32 {
        let duty = self.amplitude * self.phase.1;
        self.given = Some((duty, self.phase));
        self.phase = times(self.phase, self.turn);
        duty
    }

    /// No sine: the next one begins at zero.
    fn rest(&mut self) {
        (self.given, self.phase, self.settled) = (None, (1.0, 0.0), 0);
        self.drop_window();
    }

    fn drop_window(&mut self) {
        (self.count, self.answer, self.swing) = (0, (0.0, 0.0), (0.0, 0.0));
    }

    /// What has come of a sample.
    fn look(&mut self, config: &Config, seen: &Seen, given: f32, (cos, sin): Complex) {
        // Not where the head still catches up with a stroke that has begun.
        let follows = self.settled.saturating_mul(2) > self.settle;
        let fast = follows && (seen.velocity.0 - seen.from.velocity.0).abs() > TOO_FAST * self.velocity;
        if fast {
            // Whatever was measured with a larger one counts no more.
            self.amplitude *= 0.5;
            (self.answers, self.swings, self.windows) = (Mean::default(), Mean::default(), 0);
        }
        if fast || seen.saturated || seen.ticks != PLAN_TICKS || seen.late != self.late {
            self.settled = 0;
            self.drop_window();
            return;
        }
        self.settled = self.settled.saturating_add(1);
        if self.settled <= self.settle {
            return;
        }
        let (answer, swing) = (seen.duty - given, -seen.following);
        self.answer = plus(self.answer, (answer * sin, answer * cos));
        self.swing = plus(self.swing, (swing * sin, swing * cos));
        self.count = self.count.saturating_add(1);
        if self.count >= self.plans {
            self.window(config);
            self.drop_window();
        }
    }

    /// A window is complete.
    #[inline(never)]
    fn window(&mut self, config: &Config) {
        let share = 2.0 / self.plans.max(1) as f32;
        let mean = |sum: Complex| (sum.0 * share, sum.1 * share);
        let (answer, swing) = (mean(self.answer), mean(self.swing));
        if self.windows == 0 {
            let angular = TAU * self.hz;
            let swings = angular * root(square(swing));
            let wanted = smaller(SWINGS * self.velocity, angular * config.swing);
            let most = self.amplitude >= config.duty;
            let little = swings < ACCEPTED.0 * wanted && !most;
            if little || swings > ACCEPTED.1 * wanted {
                let by = smaller(wanted / larger(swings, 1.0), GROWS);
                self.amplitude = within(self.amplitude * by, 0.0, config.duty);
                self.settled = 0;
                return;
            }
        }
        self.answers.take(answer);
        self.swings.take(swing);
        self.windows = self.windows.saturating_add(1);
        if self.windows >= WINDOWS {
            self.over = Some(self.point(config));
            self.hz *= config.ratio;
            self.point = self.point.saturating_add(1);
            self.begin(config);
            if self.point >= config.points {
                self.step = Step::Return;
            }
        }
    }

    /// What the windows of a frequency show.
    #[inline(never)]
    fn point(&self, config: &Config) -> Point {
        let angular = TAU * self.hz;
        let half = 0.5 * angular * TICK_S;
        let ticks = PLAN_TICKS as f32;
        let held = self.amplitude * turned(ticks * half).1 / (ticks * turned(half).1);
        // A sample is in force from LEAD ticks after one estimate to as many after the next: its middle is so long before that.
        let before = (0.5 * (ticks + 1.0) - LEAD as f32) * 2.0 * half;
        let turn = turned(before);
        let sine = (held * turn.0, held * turn.1);
        let ((answer, answer_off), (swing, swing_off)) = (self.answers.of(self.windows), self.swings.of(self.windows));
        let whole = plus(sine, answer);
        let share = 1.0 / larger(root(square(whole)), f32::MIN_POSITIVE);
        let open = over(answer, whole);
        let moves = over(times((0.0, angular * config.mm), swing), whole);
        let off = answer_off * share;
        let moved = root(square(moves));
        Point {
            hz: self.hz,
            duty: self.amplitude,
            open: [-open.0, -open.1, off * share * held.abs()],
            plant: [moves.0, moves.1, angular * config.mm * swing_off * share + moved * off],
        }
    }

    /// A frequency begins: whole periods in whole plans, so that what does not belong to it adds up to nothing.
    #[inline(never)]
    fn begin(&mut self, config: &Config) {
        let hz = larger(self.hz, 0.1);
        let periods = larger(libm::ceilf(hz * WINDOW_S), 1.0);
        self.plans = ((periods * PLAN_HZ / hz + 0.5) as u32).max(4);
        self.hz = periods * PLAN_HZ / self.plans as f32;
        let angle = TAU * periods / self.plans as f32;
        self.turn = turned(angle);
        self.settle = (larger(SETTLE_S, SETTLE_PERIODS / hz) * PLAN_HZ) as u32;
        let ramps = config.velocity.0 * config.velocity.0 / config.acceleration.0;
        let way = larger(2.0 * STROKE * self.half as f32 - ramps, 0.0) * USED;
        let time = self.plans.saturating_add(self.settle) as f32 / PLAN_HZ;
        self.velocity = smaller(config.velocity.0, larger(way / time, 1.0));
        self.strokes = 0;
        self.restart();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_is_that_of_the_angle() {
        for step in -200..=200 {
            let angle = step as f32 * 0.01;
            let (cos, sin) = turned(angle);
            assert!((cos - angle.cos()).abs() < 2e-6 && (sin - angle.sin()).abs() < 2e-6, "{angle}: {cos} {sin}");
        }
    }
}
