//! How a fault's reaction moves the head, tick by tick.

use super::config::{Config, Lift};
use super::{Fault, Reaction};
use crate::motion::Leg;
use crate::servo::Window;
use crate::units::{Fixed, MicrometresPerSecond, TICK_S, Volts};

/// What the head is to do in a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Motion {
    /// Bridge open.
    Coast,
    /// Along the path at a velocity, with the duty inside a window.
    Path(MicrometresPerSecond, Window),
    /// Beside the path.
    Axis(Leg),
    /// Velocity loop alone.
    Velocity(MicrometresPerSecond),
    /// Open loop, or a loop closed elsewhere.
    Duty(f32),
}

/// What a reaction has to know.
#[derive(Clone, Copy, Debug)]
pub(super) struct Situation {
    /// Path coordinate, um.
    pub path: Fixed,
    /// Path coordinate of the safe height.
    pub safe: Fixed,
    /// Setpoint less position, counts.
    pub following: f32,
    /// Upper limit switch open.
    pub upper_limit: bool,
    /// The winding is hot.
    pub current_reduced: bool,
    /// Bus voltage.
    pub bus: Volts,
}

/// A reaction under way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reacting {
    pub fault: Fault,
    reaction: Reaction,
    ticks: u32,
    path: Fixed,
    following: f32,
    lifted: bool,
}

/// Time in which a force-limited retract has to shrink the following error.
const SHRINK: u32 = (20e-3 / TICK_S) as u32;

impl Reacting {
    pub fn new(fault: Fault, situation: &Situation) -> Reacting {
        Reacting {
            fault,
            reaction: fault.reaction(),
            ticks: 0,
            path: situation.path,
            following: situation.following,
            lifted: false,
        }
    }

    /// Whether `fault` is urgent enough to take over.
    pub fn yields_to(&self, fault: Fault) -> bool {
        fault.reaction() > self.reaction
    }

    /// Motion for this tick.
    pub fn tick(&mut self, config: &Config, now: &Situation) -> Motion {
        self.ticks = self.ticks.saturating_add(1);
        let full = Window::symmetric(config.axis.duty_limit);
        let up = MicrometresPerSecond(-config.retreat.velocity.0);
        let hold = Motion::Path(MicrometresPerSecond(0.0), full);
        match self.reaction {
            Reaction::Retrace if now.path > now.safe => Motion::Path(up, full),
            Reaction::RetractOffLimit if now.path > self.path.minus(config.retreat.off_limit) => Motion::Path(up, full),
            Reaction::Retrace | Reaction::RetractOffLimit | Reaction::HoldBelow | Reaction::Hold => hold,
            Reaction::ForceLimitedRetract => {
                if self.ticks == SHRINK && now.following.abs() >= self.following.abs() {
                    self.reaction = Reaction::OpenLoopLift;
                    self.ticks = 0;
                }
                let holding = config.axis.gains.holding();
                let limited = Window {
                    low: (holding - config.lift.limited).min(0.0),
                    high: (holding + config.lift.limited).max(0.0),
                };
                let clear = now.path <= now.safe;
                Motion::Path(if clear { MicrometresPerSecond(0.0) } else { up }, full.and(limited))
            }
            Reaction::OpenLoopLift => Motion::Duty(self.lift(&config.lift, now, config.lift.hold)),
            Reaction::LiftOnStored | Reaction::EmergencyLift => {
                let dead = now.bus < config.lift.bus_dead;
                let duty = self.lift(&config.lift, now, 0.0);
                if self.lifted || dead { Motion::Coast } else { Motion::Duty(duty) }
            }
            Reaction::Coast => Motion::Coast,
        }
    }

    /// Lifts for a limited time, not into an open upper limit and not with a hot winding; then gives `afterwards`.
    fn lift(&mut self, lift: &Lift, now: &Situation, afterwards: f32) -> f32 {
        self.lifted |= self.ticks > lift.ticks || now.upper_limit || now.current_reduced;
        if self.lifted { afterwards } else { lift.duty }
    }
}
