//! Trajectory: what the servo ticks carry out between two plans.

use crate::motion::TrajectorySegment;
use crate::servo::Window;
use crate::units::{CountsPerSecond, Fixed, MicrometresPerSecond, Volts};

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

    /// A set point that moves by itself, without a path.
    pub fn axis(segment: &TrajectorySegment, window: Window) -> Trajectory {
        let TrajectorySegment { travel, velocity, .. } = *segment;
        Trajectory { follow: Follow::Setpoint, window, velocity, travel, ..Trajectory::COAST }
    }
}
