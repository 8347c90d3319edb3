//! What a host may ask, and why it may be refused. A refused command changes nothing.

use super::commissioning::Commissioning;
use super::machine::{Head, hazard};
use super::positioning::{Home, MotionLimits};
use super::proof::{Goal, Proof};
use super::trajectory::Trajectory;
use super::{Fault, Reason, State};
use crate::gap::OpenCircuit;
use crate::path::{self, Path};
use crate::units::{Fixed, MicrometresPerSecond2, Nanometres};
use core::fmt;
use core::ops::DerefMut;
use edm_hal_shim::safety::SafetyInputs;

/// A request from host, keyboard or test.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Command {
    /// Close the loop where the head is. After a lost encoder, a wrong polarity or a following error the encoder has to prove
    /// itself first, by a small move.
    Enable,
    /// Open the loop; the mechanics hold.
    Disable,
    /// Declare the present position.
    SetHome(Nanometres),
    /// Queue a straight move to a position.
    MoveTo(Nanometres),
    /// Queue a straight move by a distance, from the end of the queue.
    MoveBy(Nanometres),
    /// Forget the queue; the path begins anew where the axis is.
    ClearPath,
    /// Move to a position on a profile, pulses off. A new target may be given on the way.
    Position(Nanometres, MotionLimits),
    /// Reach a host's next set point in so many servo ticks, pulses off.
    Follow(Nanometres, u32),
    /// Look for a reference. Not while pulses are on, nor with a path to go.
    Home(Home),
    /// Come to rest with this deceleration, pulses off, and hold.
    Brake(MicrometresPerSecond2),
    /// Pulses on; seek the work and erode along the queue.
    Start,
    /// Pulses on; hold the position and tell the feed that the gap asks for: a host keeps the path. A short is retreated
    /// from here, and returned from.
    Guide,
    /// Pulses off; hold the position.
    Hold,
    /// Commission: check encoder, motor, gap and stroke.
    Commission,
    /// Acknowledge a fault whose cause is gone. A head that was lifted without its encoder has no home any more; what casts
    /// doubt on the encoder is not gone before it has proved itself.
    ResetFault,
}

/// Why a command was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Refused {
    /// Not in this state.
    State(State),
    /// Commissioning has not passed since the settings it depends on were changed.
    NotCommissioned,
    /// An absolute move needs a home.
    NotHomed,
    /// The target lies outside the travel.
    OutOfTravel {
        /// Target asked for.
        target: Nanometres,
        /// Upper end of the travel.
        min: Nanometres,
        /// Lower end of the travel.
        max: Nanometres,
    },
    /// The move has no length.
    NoLength,
    /// No room in the queue; try again when a segment is done.
    QueueFull,
    /// Nothing queued.
    NoPath,
    /// The cause of this fault is still there.
    StillFaulty(Fault),
    /// Settings are being stored.
    Storing,
    /// A fault has cast doubt on the encoder: it has to prove itself first, which it does when the head is enabled.
    Doubted(Fault),
    /// A path is under way or queued: where it has got to is no reference.
    PathActive,
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Refused::State(state) => write!(f, "not possible while {}", state.name()),
            Refused::NotCommissioned => f.write_str("commissioning (commission) has not passed yet"),
            Refused::NotHomed => f.write_str("an absolute move needs a homed axis"),
            Refused::OutOfTravel { target, min, max } => {
                write!(f, "target {} um is outside the travel of {} to {} um", target.um().0, min.um().0, max.um().0)
            }
            Refused::NoLength => f.write_str("the move has no length"),
            Refused::QueueFull => f.write_str("the path queue is full"),
            Refused::NoPath => f.write_str("no move is queued"),
            Refused::StillFaulty(fault) => write!(f, "the cause is still there: {}", fault.name()),
            Refused::Storing => f.write_str("settings are being stored"),
            Refused::PathActive => f.write_str("a path is under way or queued: clear it first"),
            Refused::Doubted(fault) => write!(f, "after {} the head has to be enabled first", fault.name()),
        }
    }
}

impl core::error::Error for Refused {}

impl<P: DerefMut<Target = Path>> Head<P> {
    /// Carries out a command, or refuses it and changes nothing.
    pub fn command(&mut self, command: Command) -> Result<(), Refused> {
        let state = self.status.state;
        match command {
            Command::Enable => self.enable(state),
            Command::Disable => {
                if state == State::Fault {
                    return Err(Refused::State(state));
                }
                self.enter(State::Disabled, Reason::Disabled);
                Ok(())
            }
            Command::SetHome(at) => self.set_home(state, at),
            Command::MoveTo(_) if !self.status.homed => Err(Refused::NotHomed),
            Command::MoveTo(to) => self.queue(state, self.fixed(to)),
            Command::MoveBy(by) => {
                let [end] = self.path.end();
                self.queue(state, end.plus(self.fixed(by)))
            }
            Command::ClearPath => {
                if !matches!(state, State::Ready | State::HoldingPosition | State::Done) {
                    return Err(Refused::State(state));
                }
                let [here] = self.path.setpoint();
                self.restart_path_at(here);
                Ok(())
            }
            Command::Position(to, limits) => self.position(state, to, &limits),
            Command::Follow(to, ticks) => self.follow_to(state, to, ticks),
            Command::Home(home) => self.home(state, &home),
            Command::Brake(deceleration) => self.brake(state, deceleration),
            Command::Start => {
                if !matches!(state, State::Ready | State::HoldingPosition | State::Done) {
                    return Err(Refused::State(state));
                }
                if self.path.at_end() {
                    return Err(Refused::NoPath);
                }
                self.refuse_hazard(true)?;
                self.enter(State::Seeking, Reason::Started);
                Ok(())
            }
            Command::Guide => {
                if !matches!(state, State::Ready | State::HoldingPosition | State::Done) {
                    return Err(Refused::State(state));
                }
                self.refuse_hazard(true)?;
                let [here] = self.path.setpoint();
                self.restart_path_at(here);
                self.law = self.config.law;
                self.enter(State::Guiding, Reason::Started);
                Ok(())
            }
            Command::Hold => {
                if !state.follows() {
                    return Err(Refused::State(state));
                }
                if self.positioning.is_some() {
                    return self.brake(state, self.config.acceleration);
                }
                self.enter(State::HoldingPosition, Reason::Held);
                Ok(())
            }
            Command::Commission => {
                if state != State::Disabled {
                    return Err(Refused::State(state));
                }
                self.refuse_while_storing()?;
                self.refuse_hazard(true)?;
                if self.doubt.is_some() {
                    self.begin_proof(Goal::Commissioning);
                } else {
                    self.begin_commissioning();
                }
                Ok(())
            }
            Command::ResetFault => {
                if state != State::Fault {
                    return Err(Refused::State(state));
                }
                self.refuse_hazard(true)?;
                if self.doubt == Some(Fault::EncoderLost) {
                    // The counters have parted; they are taken to agree from here on.
                    self.tracking = None;
                }
                self.reacting = None;
                self.status.fault = None;
                self.status.first = None;
                self.enter(State::Disabled, Reason::FaultReset);
                Ok(())
            }
        }
    }

    fn enable(&mut self, state: State) -> Result<(), Refused> {
        if state != State::Disabled {
            return Err(Refused::State(state));
        }
        if !self.config.commissioned {
            return Err(Refused::NotCommissioned);
        }
        self.refuse_while_storing()?;
        self.refuse_hazard(false)?;
        if self.doubt.is_some() {
            self.begin_proof(Goal::Ready);
        } else {
            self.axis.reset();
            self.restart_path();
            self.close_loop();
        }
        Ok(())
    }

    /// The loop is closed where the path begins.
    pub(super) fn close_loop(&mut self) {
        self.upper_limit_excused = self.safety.upper_limit;
        self.open = OpenCircuit::new(self.config.seek.settle);
        self.enter(State::Ready, Reason::Enabled);
    }

    pub(super) fn begin_commissioning(&mut self) {
        self.checked = None;
        self.commissioning = Some(Commissioning::new(self.status.position));
        self.enter(State::Commissioning, Reason::CommissioningStarted);
    }

    fn begin_proof(&mut self, goal: Goal) {
        self.proof = Some(Proof::new(&self.config, self.status.position, goal, self.descents));
        self.enter(State::Proving, Reason::ProofStarted);
    }

    /// A head may leave its upper limit downward, so that one alone is no reason to refuse; the dielectric matters only
    /// where pulses follow.
    fn refuse_hazard(&self, pulses: bool) -> Result<(), Refused> {
        let only_upper = self.safety.upper_limit && !self.safety.lower_limit;
        let safety = SafetyInputs {
            upper_limit: self.safety.upper_limit && !only_upper,
            dielectric: self.safety.dielectric && pulses,
            ..self.safety
        };
        let sagging = self.status.bus < self.config.supervise.bus_min;
        match hazard(&safety) {
            Some(fault) => Err(Refused::StillFaulty(fault)),
            None if sagging => Err(Refused::StillFaulty(Fault::BusSag)),
            None => Ok(()),
        }
    }

    /// The path begins where the axis is; a retreat past the beginning leads straight up.
    pub(super) fn restart_path(&mut self) {
        self.restart_path_at(Fixed::whole(self.status.position));
    }

    /// The path begins at a set point.
    pub(super) fn restart_path_at(&mut self, here: Fixed) {
        let escape = Fixed::whole((self.config.axis.escape.0 * self.config.axis.counts_per_um) as i64);
        let top = if self.status.homed { self.fixed(self.config.axis.travel.0) } else { here.minus(escape) };
        self.path.restart([here], [top.min(here)]);
        self.work = None;
        self.limiter.stop();
        self.trajectory = Trajectory::new(self.status.tick);
        self.status.setpoint = here;
        self.urgent = true;
    }

    fn set_home(&mut self, state: State, at: Nanometres) -> Result<(), Refused> {
        if !matches!(state, State::Disabled | State::Ready) {
            return Err(Refused::State(state));
        }
        if let Some(fault) = self.doubt {
            return Err(Refused::Doubted(fault));
        }
        let (min, max) = self.config.axis.travel;
        if at < min || at > max {
            return Err(Refused::OutOfTravel { target: at, min, max });
        }
        let counts = self.fixed(at).round();
        let Some(tracking) = &mut self.tracking else { return Err(Refused::State(state)) };
        tracking.position.set_position(counts);
        self.status.position = counts;
        self.at = tracking.position.fixed();
        self.status.homed = true;
        self.restart_path();
        Ok(())
    }

    fn queue(&mut self, state: State, to: Fixed) -> Result<(), Refused> {
        if !state.follows() || matches!(state, State::Positioning | State::Homing) {
            return Err(Refused::State(state));
        }
        let (min, max) = self.config.axis.travel;
        let outside = to < self.fixed(min) || to > self.fixed(max);
        if self.status.homed && outside {
            let target = Nanometres(to.round().saturating_mul(self.config.axis.nm_per_count));
            return Err(Refused::OutOfTravel { target, min, max });
        }
        self.path.push_line([to]).map_err(|refused| match refused {
            path::Refused::QueueFull => Refused::QueueFull,
            path::Refused::NoLength => Refused::NoLength,
        })
    }

    /// A length in counts, fractions included.
    pub(super) fn fixed(&self, length: Nanometres) -> Fixed {
        let limit = Fixed::MAX_WHOLE;
        let scaled = Fixed::whole(length.0.clamp(-limit, limit));
        Fixed(scaled.0.checked_div(self.config.axis.nm_per_count).unwrap_or(0))
    }
}
