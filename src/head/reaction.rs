//! How a fault's reaction moves the head, plan by plan.
//!
//! No reaction presses toward the work. One that closes the loop may push down only to brake a head that the encoder shows
//! rising. Otherwise the duty ends at the holding duty, with which nothing accelerates the head. So an encoder that dies
//! under a reaction, and then always reads the same count, cannot drive the electrode into the work: the integrator
//! winds up against that end. It may drive the head upward until the supervision, or [`Reacting::plan`] itself, contradicts it.
//!
//! A lift has no encoder, and the holding duty rests on settings: it never gives a duty toward the work. At zero duty the
//! winding is shorted by the bridge and brakes whatever moves with K^2/R times its velocity; that is all that a lift has
//! against a head that rises. The current of the shorted winding is K/R times the velocity: a head that leaps off its upper stop
//! is seen by it, and braked upward.

use super::config::Config;
use super::fault::{Fault, Reaction};
use crate::motion::TrajectorySegment;
use crate::servo::{Plant, Window};
use crate::units::{CountsPerSecond, Fixed, MicrometresPerSecond, TICK_S, Volts, larger, smaller};

/// What the head is to do until the next plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Motion {
    /// Bridge open.
    Coast,
    /// Along the path at a velocity, with the duty inside a window.
    Path(MicrometresPerSecond, Window),
    /// The same, and nothing presses toward the work.
    Upward(MicrometresPerSecond, Window),
    /// Beside the path.
    Axis(TrajectorySegment),
    /// Beside the path, with the duty that its acceleration is known to take.
    Jump(TrajectorySegment, f32),
    /// Velocity loop alone.
    Velocity(MicrometresPerSecond),
    /// Velocity loop off the path, with the duty inside a window.
    Stroke(CountsPerSecond, Window),
    /// Open loop.
    Duty(f32),
    /// The loop closed over the gap voltage itself.
    Gap(Volts),
}

/// What a reaction has to know.
#[derive(Clone, Copy, Debug)]
pub(super) struct Situation {
    /// Path coordinate, um.
    pub path: Fixed,
    /// Path coordinate of the safe height.
    pub safe: Fixed,
    /// The path leads no further back: it is at its beginning, or the upper limit switch is open.
    pub blocked: bool,
    /// Setpoint less position, counts.
    pub following: f32,
    /// Measured position, counts.
    pub position: i64,
    /// Measured velocity.
    pub velocity: CountsPerSecond,
    /// The same, if the encoder does not count any more.
    pub driven: CountsPerSecond,
    /// The same by the motor current, if the winding is shorted.
    pub generated: CountsPerSecond,
    /// What the back-EMF has shown lately beyond the counts.
    pub unseen: CountsPerSecond,
    /// Duty of the tick before, and whether it was at a limit.
    pub duty: f32,
    pub saturated: bool,
    /// The head stands where it can rise no further: at its upper limit switch, or at the upper end of its travel.
    pub top: bool,
    /// It is known where that is.
    pub homed: bool,
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
    fault: Fault,
    reaction: Reaction,
    ticks: u32,
    path: Fixed,
    /// Smallest following error of a force-limited retract so far, and ticks since then.
    following: f32,
    grown: u32,
    /// Velocity that a lift has still to brake, counts/s, positive toward the work; `None` before it has begun.
    brakes: Option<f32>,
    /// Ticks for which it has left the braking to the bridge.
    shorted: u32,
    /// It rose when the winding was looked at last; it may have leapt off its stop, and falls.
    rises: bool,
    leaps: bool,
    lifted: bool,
    /// A lift was seen to lift.
    risen: bool,
    /// Position in the beginning, or, while holding, lately; ticks for which it has been the same then, and whether the head has
    /// once come to rest.
    position: i64,
    still: u32,
    rests: bool,
    /// Ticks for which it has been holding, and whether the head has once stood meanwhile.
    held: u32,
    stood: bool,
}

/// Time in which a force-limited retract has to shrink the following error.
const SHRINK: u32 = ticks(20e-3);
/// Standstill after which a head rests, and for which it may withstand the limited force.
const REST: u32 = ticks(100e-3);
/// Standstill after which a head stands that no more than its friction holds.
const STANDS: u32 = ticks(10e-3);
/// Time after which a head that holds stands, even if it trembles over an edge of the encoder.
const TREMBLES: u32 = ticks(1.0);
/// Times its friction that move any head, if it is a little more than was learnt.
const FRICTIONS: f32 = 1.33;
/// Times L/R in which the current of a shorted winding has become that of its back-EMF alone, from any before it.
const DECAYS: f32 = 6.0;
/// Velocity upward that a lift does not wait for the bridge to brake, mm/s.
const RISES: f32 = 20.0;
/// Way upward, um, by which a lift is seen to go the right way: more than a head coasts whose motor is wired the wrong way.
const LIFTED: f32 = 100.0;
/// Time for which the supervision may still speak of what it saw before this reaction.
const STALE: u32 = ticks(5e-3);

/// Ticks after which the current of a shorted winding shows its back-EMF: a look of the supervision, 1 ms, and what was before has decayed.
fn shows(plant: &Plant) -> u32 {
    ticks(1e-3 + DECAYS * plant.inductance_h / plant.resistance_ohm)
}

const fn ticks(seconds: f32) -> u32 {
    (seconds / TICK_S) as u32
}

impl Reacting {
    pub fn new(fault: Fault, reaction: Reaction, situation: &Situation) -> Reacting {
        Reacting {
            fault,
            reaction,
            ticks: 0,
            path: situation.path,
            following: situation.following.abs(),
            grown: 0,
            brakes: None,
            shorted: 0,
            rises: false,
            leaps: false,
            lifted: false,
            risen: false,
            position: situation.position,
            still: 0,
            rests: false,
            held: 0,
            stood: false,
        }
    }

    /// What it is about.
    pub fn fault(&self) -> Fault {
        self.fault
    }

    /// What is done about it.
    pub fn reaction(&self) -> Reaction {
        self.reaction
    }

    /// Whether it still moves the head: nothing but its end brakes that, so it may not be broken off. A bridge that is open
    /// already brakes nothing.
    pub fn moves(&self) -> bool {
        match self.reaction {
            Reaction::Coast => false,
            Reaction::OpenLoopLift | Reaction::LiftOnStored | Reaction::EmergencyLift => !self.lifted,
            _ => !self.stood,
        }
    }

    /// The reaction that another fault escalates this one to, if it is urgent enough.
    pub fn escalates(&self, fault: Fault) -> Option<Reaction> {
        let lifts = matches!(self.reaction, Reaction::OpenLoopLift | Reaction::LiftOnStored | Reaction::EmergencyLift);
        match fault {
            // The lift itself goes the wrong way, unless that was seen before it, or the head has been lifted and bounces off its stop.
            Fault::PolarityWrong if lifts && (self.ticks <= STALE || self.risen) => None,
            _ if fault.reaction() > self.reaction => Some(fault.reaction()),
            _ => None,
        }
    }

    /// Motion until the next plan, `ticks` after the one before; or what shows in how the head answers to this reaction, and
    /// the reaction to that.
    pub fn plan(&mut self, config: &Config, now: &Situation, ticks: u32) -> Result<Motion, (Fault, Reaction)> {
        self.ticks = self.ticks.saturating_add(ticks);
        let up = MicrometresPerSecond(-config.retreat.velocity.0);
        let full = upward(config, config.axis.duty_limit);
        let above = |height: Fixed| now.blocked || now.path <= height;
        Ok(match self.reaction {
            Reaction::Retrace if !above(now.safe) => Motion::Upward(up, full),
            Reaction::RetractOffLimit if !above(self.path.minus(config.retreat.off_limit)) => Motion::Upward(up, full),
            Reaction::Retrace | Reaction::RetractOffLimit | Reaction::HoldBelow | Reaction::Hold => {
                self.hold(config, now, full, ticks)?
            }
            Reaction::ForceLimitedRetract => {
                if self.grows(config, now, ticks) {
                    return Err((self.fault, Reaction::OpenLoopLift));
                }
                let limited = upward(config, config.lift.limited);
                if above(now.safe) { self.hold(config, now, limited, ticks)? } else { Motion::Upward(up, limited) }
            }
            Reaction::OpenLoopLift => Motion::Duty(self.lift(config, now, config.lift.hold, ticks)),
            Reaction::LiftOnStored | Reaction::EmergencyLift => {
                let dead = now.bus < config.lift.bus_dead;
                if self.unmoved(config, now) {
                    return Err((Fault::EncoderLost, Reaction::Coast));
                }
                let duty = self.lift(config, now, 0.0, ticks);
                if self.lifted || dead { Motion::Coast } else { Motion::Duty(duty) }
            }
            Reaction::Coast => Motion::Coast,
        })
    }

    /// Whether the head stands. One that the loop pushes may move under a dead encoder: it has to withstand that as long as it
    /// would take to be contradicted.
    fn stands(&self, config: &Config, now: &Situation) -> bool {
        let pushed = (now.duty - config.axis.gains.holding()).abs() > config.supervise.breakaway.friction;
        let withstood = self.rests && self.still > REST;
        !pushed && self.still > STANDS || withstood || self.held > TREMBLES
    }

    /// Holds: with full force until the head rests, then with limited force and with no more than the continuous
    /// current. A head that withstands that force without moving by a count has a dead encoder, unless it is
    /// at its upper end.
    fn hold(
        &mut self,
        config: &Config,
        now: &Situation,
        window: Window,
        ticks: u32,
    ) -> Result<Motion, (Fault, Reaction)> {
        self.held = self.held.saturating_add(ticks);
        self.still = if now.position == self.position { self.still.saturating_add(ticks) } else { 0 };
        self.position = now.position;
        self.stood |= self.stands(config, now);
        let rest = MicrometresPerSecond(0.0);
        if !self.rests {
            self.rests = self.still > REST;
            self.still = if self.rests { 0 } else { self.still };
            return Ok(Motion::Upward(rest, window));
        }
        let continuous = config.axis.plant.current_window(config.axis.current.continuous, now.velocity);
        let window = upward(config, config.lift.limited).and(continuous);
        let pushed = now.saturated && now.duty < config.axis.gains.holding() && !now.top;
        if pushed && self.still > REST {
            Err((Fault::EncoderLost, Reaction::OpenLoopLift))
        } else {
            Ok(Motion::Upward(rest, window))
        }
    }

    /// The following error has been too large, and has not become smaller, for too long.
    fn grows(&mut self, config: &Config, now: &Situation, ticks: u32) -> bool {
        let following = now.following.abs();
        self.grown = self.grown.saturating_add(ticks);
        if following < self.following {
            self.following = following;
            self.grown = 0;
        }
        following > config.supervise.following && self.grown >= SHRINK
    }

    /// A whole lift is over, which no sound head would have withstood without a count: not even with what is left of the bus.
    fn unmoved(&self, config: &Config, now: &Situation) -> bool {
        let axis = &config.axis;
        let whole = !self.lifted && self.ticks > config.lift.ticks;
        let needed = axis.gains.holding() - FRICTIONS * config.supervise.breakaway.friction;
        let enough = config.lift.duty * now.bus.0 < needed * axis.plant.bus.0;
        whole && enough && now.homed && !now.top && now.position == self.position
    }

    /// Lifts for a limited time, not into an open upper limit and not with a hot winding; then gives `afterwards`. What moves is
    /// braked first: weight and friction would stop what falls after a millimetre, in the work. What rises is braked by the
    /// bridge alone, for no duty may drive toward the work; if it leaps off its stop meanwhile, the winding shows that.
    fn lift(&mut self, config: &Config, now: &Situation, afterwards: f32, ticks: u32) -> f32 {
        let (lift, axis) = (&config.lift, &config.axis);
        let lifted = self.position.saturating_sub(now.position) as f32;
        self.risen |= lifted > LIFTED * axis.counts_per_um;
        self.lifted |= self.ticks > lift.ticks || now.upper_limit || now.current_reduced;
        if self.lifted {
            return afterwards;
        }
        // One that its loop drove up for long, unseen, shows by its back-EMF that it rises.
        let begun = if now.driven.0 > 0.0 { now.driven.0 } else { smaller(now.driven.0, now.unseen.0) };
        let fast = RISES * 1e3 * axis.counts_per_um;
        if self.brakes.is_none() && self.fault == Fault::EncoderLost && begun <= 0.0 && now.duty < lift.duty {
            // Its loop drove it up harder than a lift does, nobody knows for how long: the winding is asked first.
            (self.brakes, self.leaps) = (Some(0.0), true);
        }
        let shown = self.shorted > shows(&axis.plant);
        if self.leaps && self.brakes == Some(0.0) && !shown {
            self.shorted = self.shorted.saturating_add(ticks);
            return 0.0;
        }
        let velocity = if shown { now.generated.0 } else { self.brakes.unwrap_or(begun) };
        if velocity < -fast {
            self.shorted = self.shorted.saturating_add(ticks);
            (self.brakes, self.rises) = (Some(velocity), true);
            return 0.0;
        }
        if shown {
            // The current that showed the end of a rise may have been on its way from one direction to the other: once that is braked,
            // the winding is looked at again.
            self.leaps = self.rises || velocity > fast;
            (self.shorted, self.rises) = (0, false);
        }
        let time = ticks.max(1) as f32 * TICK_S;
        let most = axis.plant.current_window(axis.current.peak, CountsPerSecond(0.0)).high;
        let resting = smaller(axis.gains.holding(), 0.0);
        let falls = larger(velocity, 0.0);
        let whole = resting - axis.plant.accelerating(falls / time);
        let braking = larger(whole, -smaller(most, axis.duty_limit));
        let gone = (resting - braking) * time / axis.plant.accelerating(1.0);
        self.brakes = Some(if braking == whole { 0.0 } else { falls - gone });
        smaller(lift.duty, braking)
    }
}

/// Duties from `force` above the holding duty on. The follower ends them at the holding duty, but for the braking of a rise.
pub(super) fn upward(config: &Config, force: f32) -> Window {
    let (holding, limit) = (config.axis.gains.holding(), config.axis.duty_limit);
    Window { low: smaller(larger(holding - force, -limit), smaller(holding, limit)), high: limit }
}
