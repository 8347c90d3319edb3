//! Estimate: what every servo tick knows of the axis, and gives to the planner.
//!
//! Position and velocity from the encoder, and sums of what the drive draws. Nothing here decides.

use super::Fault;
use super::probe::{Latched, PROBES};
use super::tick::SetPoint;
use crate::encoder::{Mark, Position, Velocity};
use crate::gap::GapReading;
use crate::motion::TrajectorySegment;
use crate::servo::DriveMeans;
use crate::units::{ADC_FULL_SCALE, Amps, CLOCK_HZ, CountsPerSecond, Fixed, MicrometresPerSecond, TICK_S, Volts, rare};
use edm_hal_shim::bridge::Drive;
use edm_hal_shim::encoder::RawCount;
use edm_hal_shim::safety::{DriveCodes, SafetyInputs};

/// Code of no current.
const MID_SCALE: i32 = ADC_FULL_SCALE.div_ceil(2) as i32;

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
    /// The path coordinate at which that retreat has left the path, if it is an escape.
    pub left: Option<Fixed>,
    /// The strongest fault that is new.
    pub reported: Option<Fault>,
    /// One that casts doubt on the encoder, whose reaction may be weaker.
    pub doubt: Option<Fault>,
    /// A set point that a SYNC has released.
    pub set_point: Option<SetPoint>,
    /// Plans that were late, since the start.
    pub late: u32,
}

/// What has been drawn since the start. All of it wraps: differences over less than 25 s are right.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Sums {
    /// Ticks.
    pub ticks: u32,
    /// Current codes above mid-scale.
    pub current: i32,
    /// Their squares. Twelve bits: those of a tick stay within 22, of a millisecond within 27.
    pub squares: u32,
    /// Duties as given to the bridge.
    pub duty: i32,
    /// Newest current code above mid-scale.
    pub newest: i32,
}

impl Sums {
    /// The current code, if it has been the same in every tick since `before`: then the mean of the squares is the square of the mean.
    pub fn only_code_since(&self, before: &Sums) -> Option<i32> {
        let ticks = self.ticks.wrapping_sub(before.ticks).cast_signed();
        let same = self.newest.wrapping_mul(ticks) == self.current.wrapping_sub(before.current);
        let squares = self.squares.wrapping_sub(before.squares).cast_signed();
        (same && self.newest.wrapping_mul(self.newest).wrapping_mul(ticks) == squares).then_some(self.newest)
    }

    /// What was drawn since `before`; `amps` to a code, positive toward the work, as the duty is where `sign` is 1.
    pub fn since(&self, before: &Sums, amps: f32, sign: f32, bus: Volts, moved: i32) -> (DriveMeans, f32) {
        let ticks = self.ticks.wrapping_sub(before.ticks).max(1) as f32;
        let (share, time) = (1.0 / ticks, ticks * TICK_S);
        let squares = self.squares.wrapping_sub(before.squares) as f32;
        let drawn = DriveMeans {
            over: crate::units::Seconds(time),
            duty: self.duty.wrapping_sub(before.duty) as f32 * share * (sign / f32::from(Drive::FULL)),
            mean: Amps(self.current.wrapping_sub(before.current) as f32 * share * amps),
            end: Amps(self.newest as f32 * amps),
            bus,
            encoder: CountsPerSecond(moved as f32 / time),
        };
        (drawn, squares * share * (amps * amps))
    }
}

/// Position, velocity, and what the drive draws.
#[derive(Debug)]
pub struct Estimator {
    /// Count of the newest reading, as it came.
    seen: u32,
    /// The encoder counts down toward the work.
    reversed: bool,
    started: bool,
    position: Position,
    velocity: Velocity,
    /// Newest velocity.
    now: CountsPerSecond,
    sums: Sums,
}

impl Estimator {
    /// Of an encoder that has not been read.
    pub fn new(reversed: bool) -> Estimator {
        let none = RawCount::default();
        let (position, velocity) = (Position::new(none), Velocity::new(none, CLOCK_HZ));
        let now = CountsPerSecond(0.0);
        Estimator { seen: 0, reversed, started: false, position, velocity, now, sums: Sums::default() }
    }

    /// The encoder is wired like this.
    pub fn wire(&mut self, reversed: bool) {
        if reversed != self.reversed {
            *self = Estimator { sums: self.sums, ..Estimator::new(reversed) };
        }
    }

    /// One tick.
    #[inline]
    pub fn tick(&mut self, raw: &RawCount, drive: DriveCodes) {
        // In most ticks of an eroding head there is nothing new.
        if raw.count != self.seen || !self.velocity.holds(raw) {
            rare();
            if raw.count == self.seen && self.velocity.is_newest(raw.last_edge) && self.started {
                // Position and edges stay as they are: an edge is missing, and the velocity falls.
                self.now = self.velocity.wait(raw.now);
            } else {
                self.take(raw);
            }
        }
        let current = i32::from(drive.motor_current).wrapping_sub(MID_SCALE);
        self.sums.ticks = self.sums.ticks.wrapping_add(1);
        self.sums.newest = current;
        self.sums.current = self.sums.current.wrapping_add(current);
        self.sums.squares = self.sums.squares.wrapping_add(current.wrapping_mul(current).cast_unsigned());
    }

    /// A new count or edge, or the first reading.
    #[inline(never)]
    fn take(&mut self, raw: &RawCount) {
        self.seen = raw.count;
        let wired = as_wired(self.reversed, *raw);
        if !self.started {
            self.start(wired);
        }
        self.position.update(wired);
        self.now = self.velocity.tick(wired);
    }

    #[cold]
    #[inline(never)]
    fn start(&mut self, wired: RawCount) {
        self.started = true;
        self.position = Position::new(wired);
        self.velocity = Velocity::new(wired, CLOCK_HZ);
    }

    /// The bridge was given this duty.
    #[inline]
    pub fn applied(&mut self, duty: i32) {
        self.sums.duty = self.sums.duty.wrapping_add(duty);
    }

    /// Position, counts.
    #[inline]
    pub fn position(&self) -> i64 {
        self.position.counts()
    }

    /// The same as a coordinate.
    #[inline]
    pub fn at(&self) -> Fixed {
        self.position.fixed()
    }

    /// Velocity.
    #[inline]
    pub fn velocity(&self) -> CountsPerSecond {
        self.now
    }

    /// Position at another raw count, as it came: where an index mark is.
    pub fn position_at(&self, count: u32) -> i64 {
        self.position.at(if self.reversed { count.wrapping_neg() } else { count })
    }

    /// The axis is given other coordinates: `by` is added to all of them.
    pub fn shift(&mut self, by: i64) {
        self.position.set_position(self.position.counts().saturating_add(by));
    }

    /// What has been drawn.
    pub fn sums(&self) -> &Sums {
        &self.sums
    }
}

/// A count that grows toward the work, whichever way the encoder is wired.
#[inline]
pub(super) fn as_wired(reversed: bool, raw: RawCount) -> RawCount {
    let count = if reversed { raw.count.wrapping_neg() } else { raw.count };
    RawCount { count, toward_work: raw.toward_work ^ reversed, ..raw }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a tick leaves out changes nothing: edges that come, stay away for long, and come back, either way round.
    #[test]
    fn position_and_velocity_are_those_of_every_reading_taken() {
        for reversed in [false, true] {
            let mut raw = RawCount { count: 7, last_edge: 100, toward_work: true, now: 200 };
            let mut estimator = Estimator::new(reversed);
            let wired = as_wired(reversed, raw);
            let (mut position, mut velocity) = (Position::new(wired), Velocity::new(wired, CLOCK_HZ));
            let mut falls = 0;
            for tick in 0u32..200_000 {
                // Edges every tick, then ever more rarely, then none for longer than a standstill takes.
                let pause = 1 + tick % 50_000 / 40;
                if tick > 0 && tick % 50_000 < 5_000 && tick % pause == 0 {
                    raw.toward_work = tick % 7 != 0;
                    raw.count = raw.count.wrapping_add(if raw.toward_work { 1 } else { u32::MAX });
                    raw.last_edge = raw.now.wrapping_sub(50);
                }
                estimator.tick(&raw, DriveCodes::default());
                let wired = as_wired(reversed, raw);
                let before = velocity.tick(wired).0;
                position.update(wired);
                assert_eq!(estimator.velocity().0.to_bits(), before.to_bits(), "tick {tick}");
                assert_eq!(
                    (estimator.position(), estimator.at()),
                    (position.counts(), position.fixed()),
                    "tick {tick}"
                );
                falls += u32::from(before != 0.0 && tick % 50_000 > 5_000);
                raw.now = raw.now.wrapping_add(CLOCK_HZ / crate::units::TICK_HZ);
            }
            assert!(falls > 1000, "the velocity has fallen in {falls} ticks alone");
        }
    }
}
