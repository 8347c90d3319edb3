//! Faults: how one is raised, what its reaction has to know, and the contact that is one.

use super::{Planner, Touching};
use crate::head::fault::{Fault, Reaction};
use crate::head::reaction::{Motion, Reacting, Situation};
use crate::head::state::{Reason, State};
use crate::path::Path;
use core::ops::DerefMut;

/// Counts by which a set point at rest may be beyond where the axis has been: the loop trembles over an edge.
const TREMBLE: i64 = 1;

impl<P: DerefMut<Target = Path>> Planner<P> {
    /// A fault found elsewhere: supervision, protocol. While another one's reaction runs, only one that escalates it is taken.
    #[inline(never)]
    pub fn raise(&mut self, fault: Fault) {
        let reaction = match &self.reacting {
            Some(reacting) => reacting.escalates(fault),
            // Over an encoder in doubt no loop is closed.
            None if self.doubt.is_some() => Some(fault.reaction().max(Reaction::OpenLoopLift)),
            None => Some(fault.reaction()),
        };
        if let Some(reaction) = reaction {
            self.react_with(fault, reaction);
        }
    }

    /// Takes up a reaction to a fault, whatever was done before.
    #[inline(never)]
    pub(super) fn react_with(&mut self, fault: Fault, reaction: Reaction) {
        self.end_positioning();
        self.reacting = Some(Reacting::new(fault, reaction, &self.situation()));
        self.commissioning = None;
        self.proof = None;
        self.status.fault = Some(fault);
        self.status.first = self.status.first.or(Some(fault));
        if fault.doubts_encoder() {
            // What the head moves without its counts is counted by nobody, or wrongly.
            let blind = fault == Fault::EncoderLost || reaction >= Reaction::OpenLoopLift;
            let lost = blind || self.doubt == Some(Fault::EncoderLost);
            self.doubt = Some(if lost { Fault::EncoderLost } else { fault });
            self.status.homed &= !lost;
        }
        self.reset_loop();
        // A reaction may retrace further than a working retreat.
        self.route.free_retreat();
        self.enter(State::Fault, Reason::Fault(fault));
    }

    /// The motion of the reaction under way; that of a second fault in the plan in which it shows.
    pub(super) fn react(&mut self) -> Motion {
        let (situation, ticks) = (self.situation(), self.ticks);
        let motion = |planner: &mut Self| {
            planner.reacting.as_mut().map(|reacting| reacting.plan(&planner.config, &situation, ticks))
        };
        match motion(self) {
            None => Motion::Coast,
            Some(Ok(motion)) => motion,
            Some(Err((fault, reaction))) => {
                self.react_with(fault, reaction);
                motion(self).and_then(Result::ok).unwrap_or(Motion::Coast)
            }
        }
    }

    pub(super) fn situation(&self) -> Situation {
        Situation {
            path: self.route.s(),
            safe: self.route.work().minus(self.config.retreat.safe),
            blocked: self.route.at_beginning() || self.now.safety.upper_limit || self.is_spent(),
            following: self.status.following,
            position: self.status.position,
            velocity: self.status.velocity,
            driven: self.silence.driven(),
            unseen: self.status.back_emf.difference(),
            generated: self.config.axis.plant.generating(self.status.current),
            duty: self.status.duty,
            saturated: self.status.saturated,
            top: self.at_top() || self.now.safety.upper_limit,
            homed: self.status.homed,
            upper_limit: self.now.safety.upper_limit,
            current_reduced: self.status.current_reduced,
            bus: self.status.bus,
        }
    }

    /// Electrode and work touch short of a set point that moves toward the work, or rests there: the loop would
    /// press the head on where it has never been, whether or not the set point moves. Nobody is held off the work elsewhere.
    pub(super) fn presses(&self) -> bool {
        let positions = matches!(self.status.state, State::Ready | State::Positioning | State::Homing);
        let ahead = self.status.setpoint.round().saturating_sub(self.cleared);
        let touches = self.status.gap.touches && self.touching == Touching::No && !self.looks_for_home();
        touches && positions && ahead > TREMBLE && self.now.segment.velocity.0 >= 0.0
    }
}
