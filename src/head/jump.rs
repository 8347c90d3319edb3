//! A jump: straight up out of the work, and back to the *float point*, so that fresh dielectric comes where the debris was.
//!
//! Pulses are off while the head is away. It leaves the path, by its own axis alone: what drives X and Y need not
//! follow at its speed, and no corner slows it. Meanwhile the path coordinate goes back by the float distance, along the path;
//! the way down ends at the set point of that coordinate, and the rest is gone under gap control. So the electrode arrives at
//! speed only where it has been, and comes on to the same counts as before.

use super::rhythm;
use crate::motion::{JerkLimits, PART, SCurve, TrajectorySegment};
use crate::units::{CountsPerSecond, Fixed, PLAN_TICKS, TICK_HZ};

/// How to jump.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Servo ticks of erosion between two jumps; 0: on demand only.
    pub every: u32,
    /// Height, counts; of an adaptive jump the least.
    pub height: u32,
    /// When interval and height adapt themselves.
    pub adaptive: rhythm::Config,
    /// Limits of the motion.
    pub limits: JerkLimits,
    /// Length of path before the last good place from which the gap leads, um.
    pub float: u32,
}

/// A jump under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Jump {
    /// Up, then down; none before the head rests.
    stroke: Option<SCurve>,
    /// Time of that, parts of a tick, and how much of it goes by in a tick.
    time: u32,
    pace: u32,
    returns: bool,
    velocity: f32,
    height: Fixed,
    /// Path coordinate of the float point.
    pub float: Fixed,
    /// The head is to hold there.
    pub holds: bool,
}

impl Jump {
    /// So high, counts, and to a float point.
    pub fn new(height: Fixed, float: Fixed) -> Jump {
        Jump { stroke: None, time: 0, pace: PART, returns: false, velocity: 0.0, height, float, holds: false }
    }

    /// Whether it has left the path.
    pub fn is_away(&self) -> bool {
        self.stroke.is_some()
    }

    /// How far the set point is ahead, of a following error.
    pub fn ahead(&self, following: f32) -> f32 {
        if self.returns { following } else { -following }
    }

    /// Goes on by so many ticks, from the set point `from`, to `float` on the way down, which is that of the float point, with a
    /// share `pace` of its velocity. Gives what to follow until the next plan and its acceleration, counts/s^2; `None` when it
    /// is there.
    pub fn plan(
        &mut self,
        config: &Config,
        [from, float]: [Fixed; 2],
        pace: f32,
        ticks: u32,
    ) -> Option<(TrajectorySegment, f32)> {
        self.time = self.time.saturating_add(ticks.saturating_mul(self.pace));
        let stroke = match self.stroke {
            Some(stroke) if self.time < stroke.ticks().saturating_mul(PART) => stroke,
            Some(_) if self.returns => return None,
            before => {
                self.time = 0;
                self.returns = before.is_some();
                let (from, to) = before.map_or((from, from.minus(self.height)), |up| (up.to(), float));
                *self.stroke.insert(SCurve::new(from, to, &config.limits))
            }
        };
        self.pace = (pace * PART as f32) as u32;
        let next = self.time.saturating_add(PLAN_TICKS.saturating_mul(self.pace));
        let travel = stroke.at_part(next).minus(from);
        let travel = Fixed(travel.0.wrapping_div(PLAN_TICKS.into()));
        let velocity = travel.to_f32() * TICK_HZ as f32;
        let acceleration = (velocity - self.velocity) * (TICK_HZ / PLAN_TICKS) as f32;
        self.velocity = velocity;
        Some((TrajectorySegment { from, travel, velocity: CountsPerSecond(velocity) }, acceleration))
    }
}
