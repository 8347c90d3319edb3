//! Identification: the head moves, and sums up what shows motor, mass and friction.
//!
//! It begins where the head holds, homed, and stays within a length straight above: nothing of it leads toward the work beyond the
//! place where it began. The loop stays closed but for the beginnings of motion, so that limits, supervision and fault reactions are
//! those of any positioning. Per millisecond it takes what the supervision has drawn up, in codes and counts ([`Row`]), and sums products of whole
//! numbers ([`Normal`]). Stages:
//!
//! 1. *Rise* to the middle of the length.
//! 2. *Winding*: slow strokes up and down, with a pseudo-random square wave of duty on top of that of the loop. Its steps show how the
//!    current follows: resistance and inductance. A head at rest under such a wave would look like one whose encoder is dead.
//! 3. *Sweep*: strokes fast and slow, into the same sums: the back-EMF shows the motor constant.
//! 4. *Motion*: the same strokes, and what force they took: mass, sliding friction, net weight.
//! 5. *Breakaway*: from rest a duty that grows slowly, away from the work and toward it by turns, without a loop until the head has
//!    begun to move. What it took is breakaway. A loop that creeps trembles over the edges of the encoder, and shows less.
//! 6. *Return* to where it began.
//!
//! Equations of a row of the winding, per millisecond: sum of u = R sum of i + L step of i + K moved + d turn of u + c. The term of
//! `turn` takes the ticks that lie between a duty and the conversion of its current, which a board may have other than a PC. Of one
//! of the motion, per window: sum of i = m/K change of v + F/K sign of v - W/K time + k/K place + b/K moved.

use super::supervise::Row;
use crate::motion::{Profile, Ramp, TrajectorySegment};
use crate::servo::Normal;
use crate::units::{
    CountsPerSecond, CountsPerSecond2, Fixed, PLAN_TICKS, TICK_HZ, TICK_S, TICKS_PER_MS, larger, smaller,
};

/// Limits of an identification.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Length that it needs above the head, counts.
    pub travel: i64,
    /// Duty of the square wave on the winding.
    pub duty: f32,
    /// Fastest stroke.
    pub velocity: CountsPerSecond,
    /// Largest acceleration of a stroke, which the current allows.
    pub acceleration: CountsPerSecond2,
    /// Growth of the duty that is to begin a motion, in a plan, and the most that it grows to.
    pub grows: (f32, f32),
    /// Velocity, and counts, from which on a head moves: before, its friction gives way like a spring.
    pub begun: (CountsPerSecond, i64),
}

/// What an identification does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Stage {
    /// None is under way.
    #[default]
    None,
    /// To the middle of its length.
    Rise,
    /// Steps of voltage.
    Winding,
    /// Strokes that show the motor constant.
    Sweep,
    /// Strokes that show mass and friction.
    Motion,
    /// Pushes from rest that show what begins to move the head.
    Breakaway,
    /// Back to where it began.
    Return,
}

/// What a stage has summed up.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Summed {
    /// Which: [`Stage::Sweep`], [`Stage::Motion`] or [`Stage::Breakaway`].
    pub stage: Stage,
    /// Its sums.
    pub normal: Normal,
}

/// Plans between two possible steps of the square wave: they come at every phase of a millisecond that plans begin in.
const CHIP: u32 = 3;
/// Share of the velocity of a stroke, from which on the square wave is added: not where the head turns round.
const CRUISES: f32 = 0.5;
/// Shares of velocity and acceleration of a stroke with the square wave, and of a pair of strokes without it.
const SLOW: (f32, f32) = (0.25, 1.0);
const PAIRS: [(f32, f32); 4] = [(1.0, 1.0), (0.6, 1.0), (0.3, 0.5), (0.1, 0.3)];
/// Strokes with the square wave, of a sweep, of the motion; pushes from rest.
const WINDING: u32 = 8;
const SWEEP: u32 = 12;
const MOTION: u32 = 24;
const PUSHES: u32 = 10;
/// Pushes one way, and of them those that count: in the middle of all. A head may still have moved when one began.
const ONE_WAY: usize = PUSHES as usize / 2;
const MIDDLE: usize = 3;
/// Plans before a push, and those of them in which the loop brakes the head. Then it rests by its friction: a loop that trembles about
/// a count, and whose encoder falls silent, would drive the head off within 50 ms.
const RESTS: u32 = TICK_HZ / PLAN_TICKS / 4;
const BRAKES: u32 = RESTS / 8;
const HOLDS: f32 = 1.0 / 128.0;
/// Plans for which a push gives that mean duty alone.
const SETTLES: u32 = TICK_HZ / PLAN_TICKS / 10;
/// Friction at rest is at most so many times that of sliding (assumed; 2 is a bad guide), and a current of so much more is none of
/// noise and rounding: 4 codes. What has not begun to move with that has a dead encoder, or is jammed; it presses with no more.
const STICKS: f32 = 2.5;
const UNSURE: f32 = 4.0 * TICKS_PER_MS as f32;
/// Toward the work it is given no more than so many times the friction of the push away from it just before, which has shown that the
/// encoder is well: a head that moves unseen gains way with the third power of what is given beyond its friction. One that does not move with
/// that is pushed away again before it is given so much more.
const ALIKE: f32 = 1.3;
const MORE: f32 = 1.5;
/// Pushes toward the work that may end so.
const FAILS: u32 = 3;
/// Milliseconds of a window of the motion.
const WINDOW: u32 = 16;
/// Slowest velocity of a window, of the fastest stroke: below, friction is not that of sliding.
const SLIDES: f32 = 0.06;
/// Bits by which a voltage, duty times a code of the bus, is made smaller, so that its square has room.
pub(super) const VOLTAGE_BITS: u32 = 8;

/// Milliseconds that are summed up together.
#[derive(Clone, Copy, Debug, Default)]
struct Window {
    ms: u32,
    current: i64,
    moved: i64,
    /// Place of its beginning, counts from where the identification began.
    place: i64,
    /// Twice the counts in a millisecond about its beginning.
    entry: i64,
    /// It has moved forth, and back.
    forth: bool,
    back: bool,
}

/// An identification under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Identify {
    stage: Stage,
    /// Where it began, and the middle of its length.
    begun: Fixed,
    middle: Fixed,
    half: i64,
    plans: u32,
    strokes: u32,
    random: u16,
    /// Tick of the newest row.
    tick: u32,
    normal: Normal,
    /// The stage that they are of, once it is over.
    over: Option<Stage>,
    window: Window,
    /// Counts of the millisecond before.
    last: Option<i64>,
    /// Counts of all rows.
    place: i64,
    /// Where it rests before a push; the mean duty that holds it there, and the count where the push began.
    rests: Fixed,
    /// Sums of the duties of the strokes, those toward the work and those away from it, and their plans.
    duties: [(f32, u32); 2],
    /// Mean current there, a sum of a millisecond.
    current: f32,
    /// Most above that in the push under way.
    peak: f32,
    pushed: Option<i64>,
    /// Sums of the currents of the strokes, those toward the work and those away from it, and their rows.
    friction: [(i64, u32); 2],
    /// Current of the newest push away from the work when the head gave way; `None` in such a push before that.
    gave: Option<i32>,
    /// Pushes toward the work that have not moved the head.
    failed: u32,
    /// Currents, sums of a millisecond, with which it began to move toward the work, and away from it; and how many there are.
    currents: [[i32; ONE_WAY]; 2],
    moves: [usize; 2],
}

/// What the head is to do until the next plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Demand {
    /// Follow a set point with a duty on top of its loop.
    Follow(TrajectorySegment, f32),
    /// Give a duty.
    Duty(f32),
    /// A force that moves the head has not moved its counts.
    Stuck,
    /// Rest: it is over.
    End,
}

/// What becomes of a push.
enum Push {
    Grows(f32),
    Fails,
    Over,
    InVain,
}

/// What a plan is made of.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// What is followed until then.
    pub from: TrajectorySegment,
    /// Position, counts, velocity and duty.
    pub position: i64,
    pub velocity: CountsPerSecond,
    pub duty: f32,
    /// The duty is at its limit.
    pub saturated: bool,
    /// Set point less position, counts.
    pub following: f32,
    /// Ticks since the plan before, and plans that were late.
    pub ticks: u32,
    /// See [`ticks`](Seen::ticks).
    pub late: u32,
}

impl Identify {
    /// From where the set point rests.
    pub fn new(config: &Config, begun: Fixed, row: &Row) -> Identify {
        let half = config.travel.wrapping_div(2);
        Identify {
            stage: Stage::Rise,
            begun,
            middle: begun.minus(Fixed::whole(half)),
            half,
            plans: 0,
            strokes: 0,
            random: 1,
            tick: row.tick,
            normal: Normal::NONE,
            over: None,
            window: Window::default(),
            last: None,
            place: 0,
            rests: begun,
            duties: [(0.0, 0); 2],
            current: 0.0,
            peak: 0.0,
            pushed: None,
            friction: [(0, 0); 2],
            gave: None,
            failed: 0,
            currents: [[0; ONE_WAY]; 2],
            moves: [0; 2],
        }
    }

    /// What it does.
    pub fn stage(&self) -> Stage {
        self.stage
    }

    /// Goes on. What a stage that is over has summed up has to be [taken](Self::take) before the next plan.
    pub fn plan(&mut self, config: &Config, seen: &Seen, row: &Row) -> Demand {
        self.look(config, row);
        if self.stage == Stage::Motion && seen.velocity.0 != 0.0 {
            let [down, up] = &mut self.duties;
            let (sum, plans) = if seen.velocity.0 > 0.0 { down } else { up };
            (*sum, *plans) = (*sum + seen.duty, plans.saturating_add(1));
        }
        self.plans = self.plans.saturating_add(1);
        let before = self.stage;
        let demand = if before == Stage::Breakaway { self.push(config, seen, row) } else { self.stroke(config, seen) };
        let sums = matches!(before, Stage::Sweep | Stage::Motion | Stage::Breakaway);
        self.over = (sums && self.stage != before).then_some(before);
        demand
    }

    /// What a stage that is over has summed up, once.
    pub fn take(&mut self) -> Option<Summed> {
        let stage = self.over.take()?;
        Some(Summed { stage, normal: core::mem::replace(&mut self.normal, Normal::NONE) })
    }

    fn stroke(&mut self, config: &Config, seen: &Seen) -> Demand {
        let (target, ramp) = self.leg(config);
        let (segment, there) = toward(seen, target, &ramp);
        let mut duty = 0.0;
        if self.stage == Stage::Winding && segment.velocity.0.abs() > CRUISES * ramp.velocity.0 {
            duty = self.square(config, seen.position);
        }
        match self.stage {
            _ if !there => {}
            Stage::Rise => self.enter(Stage::Winding),
            Stage::Winding if self.strokes > WINDING => self.enter(Stage::Sweep),
            Stage::Sweep if self.strokes > SWEEP => self.enter(Stage::Motion),
            Stage::Motion if self.strokes > MOTION => {
                self.rests = segment.from;
                self.enter(Stage::Breakaway);
            }
            Stage::Return => return Demand::End,
            _ => self.strokes = self.strokes.saturating_add(1),
        }
        Demand::Follow(segment, duty)
    }

    /// From rest a duty that grows until the head moves.
    fn push(&mut self, config: &Config, seen: &Seen, row: &Row) -> Demand {
        if let Some(from) = self.pushed {
            match self.pushing(config, seen, row, from) {
                Push::Grows(duty) => return Demand::Duty(duty),
                Push::InVain => return Demand::Stuck,
                Push::Fails if self.failed >= FAILS => return Demand::Stuck,
                Push::Fails => self.failed = self.failed.saturating_add(1),
                Push::Over => {}
            }
            (self.pushed, self.plans) = (None, 0);
            self.strokes = self.strokes.saturating_add(1);
            self.rests = Fixed::whole(seen.position);
            // Whatever was followed before.
            return Demand::Follow(TrajectorySegment { from: self.rests, ..TrajectorySegment::default() }, 0.0);
        }
        if self.strokes >= PUSHES.wrapping_add(2 * self.failed) {
            self.settle();
            self.enter(Stage::Return);
        }
        self.current += (row.current as f32 - self.current) * HOLDS;
        if self.stage == Stage::Breakaway && self.plans > BRAKES {
            let (_, counts) = config.begun;
            if seen.position.saturating_sub(self.rests.round()).saturating_abs() <= counts {
                if self.plans > RESTS {
                    if self.strokes.is_multiple_of(2) {
                        self.gave = None;
                    }
                    (self.pushed, self.plans, self.peak) = (Some(seen.position), 0, 0.0);
                }
                return Demand::Duty(self.rest_duty());
            }
            // Friction does not hold it there.
            (self.plans, self.rests) = (0, Fixed::whole(seen.position));
        }
        let (segment, _) = toward(seen, self.rests, &self.leg(config).1);
        Demand::Follow(segment, 0.0)
    }

    /// In the middle between what the strokes took one way and the other: the duty at which friction holds a head.
    fn rest_duty(&self) -> f32 {
        let [down, up] = self.duties.map(|(sum, plans)| sum / plans.max(1) as f32);
        0.5 * (down + up)
    }

    /// A push that began at a count: first the duty that held the head, until a loop that trembled is forgotten. It is over once the
    /// head moves.
    fn pushing(&mut self, config: &Config, seen: &Seen, row: &Row, from: i64) -> Push {
        // The first one leads away from the work.
        let way = if self.strokes.is_multiple_of(2) { -1 } else { 1 };
        let moved = seen.position.saturating_sub(from);
        if moved.saturating_abs() > self.half.wrapping_div(4) {
            return Push::Over;
        }
        let plans = self.plans.saturating_sub(SETTLES);
        if plans == 0 {
            return Push::Grows(self.rest_duty());
        }
        let ((velocity, counts), (grows, most)) = (config.begun, config.grows);
        let push = grows * plans as f32;
        let gives = moved.wrapping_mul(way) >= counts;
        if gives && way < 0 {
            self.gave = self.gave.or(Some(row.current));
        }
        let begun = gives && seen.velocity.0 * way as f32 >= velocity.0;
        if !begun {
            let more = (row.current as f32 - self.current) * way as f32;
            self.peak = larger(self.peak, more);
            // What generates a voltage moves.
            let moves = self.peak - more > 2.0 * UNSURE;
            let (slides, weight) = self.slides();
            if push >= most || moves || more > STICKS * slides + UNSURE {
                return Push::InVain;
            }
            let fails = way > 0 && row.current as f32 - weight > self.alike(weight) + UNSURE;
            return if fails { Push::Fails } else { Push::Grows(self.rest_duty() + push * way as f32) };
        }
        let to = if way > 0 { 0 } else { 1 };
        if let (Some(currents), Some(moves)) = (self.currents.get_mut(to), self.moves.get_mut(to))
            && let Some(current) = currents.get_mut(*moves)
        {
            *current = row.current;
            *moves = moves.wrapping_add(1);
        }
        Push::Over
    }

    /// Currents that friction and net weight have taken in the strokes, sums of a millisecond; what a film has taken is in the first.
    fn slides(&self) -> (f32, f32) {
        let [down, up] = self.friction.map(|(sum, rows)| sum as f32 / rows.max(1) as f32);
        (0.5 * (down - up), 0.5 * (down + up))
    }

    /// What friction may take toward the work, of a current, by the newest push away from it.
    fn alike(&self, weight: f32) -> f32 {
        let again = (0..self.failed).fold(ALIKE, |share, _| share * MORE);
        again * (weight - self.gave.unwrap_or(0) as f32)
    }

    /// Takes the pushes in the middle of all, if none has been in vain.
    fn settle(&mut self) {
        for ((currents, moves), way) in self.currents.iter_mut().zip(self.moves).zip([1, -1]) {
            if moves == ONE_WAY {
                currents.sort_unstable();
                for current in currents.iter().skip((ONE_WAY - MIDDLE) / 2).take(MIDDLE) {
                    self.normal.take((*current).into(), &[0, way, 1, 0, 0]);
                }
            }
        }
    }

    fn enter(&mut self, stage: Stage) {
        self.stage = stage;
        (self.plans, self.strokes) = (0, 0);
        self.begin_window();
    }

    fn begin_window(&mut self) {
        (self.window, self.last) = (Window::default(), None);
    }

    /// Where to, and how fast.
    fn leg(&self, config: &Config) -> (Fixed, Ramp) {
        let down = self.strokes.is_multiple_of(2);
        let to = |half: i64| self.middle.plus(Fixed::whole(if down { half } else { half.saturating_neg() }));
        let gentle = Fixed::whole(self.half).to_f32();
        // So much that it takes half of a stroke to get to the velocity.
        let least = config.velocity.0 * config.velocity.0 / (1.6 * gentle);
        let acceleration = smaller(least, config.acceleration.0);
        let ramp = |velocity: f32, share: f32| Ramp {
            velocity: CountsPerSecond(config.velocity.0 * velocity),
            acceleration: CountsPerSecond2(acceleration * share),
            deceleration: CountsPerSecond2(acceleration * share),
        };
        match self.stage {
            Stage::Sweep | Stage::Motion => {
                let pair = (self.strokes / 2) as usize % PAIRS.len();
                let (velocity, share) = PAIRS.get(pair).copied().unwrap_or((1.0, 1.0));
                (to(self.half.saturating_mul(4).wrapping_div(5)), ramp(velocity, share))
            }
            Stage::Winding => (to(self.half.saturating_mul(4).wrapping_div(5)), ramp(SLOW.0, SLOW.1)),
            Stage::Return => (self.begun, ramp(0.6, 1.0)),
            _ => (self.middle, ramp(0.6, 1.0)),
        }
    }

    /// Duty of the square wave: the sign of a shift register of 9 bits (x^9 + x^5 + 1), and nothing outside of the length.
    fn square(&mut self, config: &Config, position: i64) -> f32 {
        if self.plans.is_multiple_of(CHIP) {
            let bit = (self.random >> 8 ^ self.random >> 4) & 1;
            self.random = (self.random << 1 | bit) & 0x1FF;
        }
        let away = position.saturating_sub(self.middle.round()).saturating_abs();
        match self.random & 1 {
            _ if away >= self.half => 0.0,
            1 => config.duty,
            _ => -config.duty,
        }
    }

    /// Takes the newest row of the supervision, once.
    fn look(&mut self, config: &Config, row: &Row) {
        let since = row.tick.wrapping_sub(self.tick);
        if since == 0 {
            return;
        }
        self.tick = row.tick;
        let moved = i64::from(row.moved);
        self.place = self.place.saturating_add(moved);
        if row.ticks != TICKS_PER_MS || since != TICKS_PER_MS {
            // Something is missing: what was summed up is no window.
            self.begin_window();
            return;
        }
        match self.stage {
            Stage::Winding | Stage::Sweep => self.winding(row),
            Stage::Motion => {
                let [down, up] = &mut self.friction;
                let (sum, rows) = if moved > 0 { down } else { up };
                if moved != 0 {
                    *sum = sum.saturating_add(row.current.into());
                    *rows = rows.saturating_add(1);
                }
                let least = config.velocity.0 * (SLIDES * TICK_S * (TICKS_PER_MS * WINDOW) as f32);
                self.motion(row, least as i64);
            }
            _ => {}
        }
    }

    fn winding(&mut self, row: &Row) {
        let volts = |duty: i32| i64::from(duty).wrapping_mul(row.bus.into()) >> VOLTAGE_BITS;
        let x = [row.current.into(), row.step.into(), row.moved.into(), volts(row.turn), 1];
        self.normal.take(volts(row.duty), &x);
    }

    /// Takes a row into the window, which counts if it goes one way by `least` counts and more.
    fn motion(&mut self, row: &Row, least: i64) {
        let moved = i64::from(row.moved);
        let Some(last) = self.last.replace(moved) else { return };
        // Between two milliseconds the velocity is half of what both have moved. Twice that stays whole.
        let velocity = last.wrapping_add(moved);
        if self.window.ms == WINDOW {
            let Window { current, moved: way, place, entry, forth, back, .. } = self.window;
            if !(forth && back) && way.saturating_abs() >= least.max(1) {
                let time = i64::from(WINDOW);
                let middle = place.wrapping_add(way.wrapping_div(2));
                let gain = velocity.wrapping_sub(entry);
                let x = [gain, way.signum().wrapping_mul(time), time, middle.wrapping_mul(time), way];
                self.normal.take(current, &x);
            }
            self.window.ms = 0;
        }
        if self.window.ms == 0 {
            let place = self.place.wrapping_sub(moved);
            self.window = Window { entry: velocity, place, ..Window::default() };
        }
        let window = &mut self.window;
        window.ms = window.ms.saturating_add(1);
        window.current = window.current.wrapping_add(row.current.into());
        window.moved = window.moved.wrapping_add(moved);
        window.forth |= moved > 0;
        window.back |= moved < 0;
    }
}

/// On toward a place, from what was followed; whether it is there.
pub(super) fn toward(seen: &Seen, target: Fixed, ramp: &Ramp) -> (TrajectorySegment, bool) {
    let Seen { from, ticks, .. } = *seen;
    // The profile goes on by these ticks first.
    let gone = Fixed(from.travel.0.wrapping_mul(ticks.into()));
    let mut profile = Profile::along(TrajectorySegment { from: Fixed(from.from.0.wrapping_sub(gone.0)), ..from });
    let segment = profile.toward(target, ramp, ticks);
    (segment, profile.stands() && segment.from == target)
}
