//! Jumps.

use super::Planner;
use super::states::REST;
use crate::feed::After;
use crate::head::command::Refused;
use crate::head::fault::Fault;
use crate::head::jump::Jump;
use crate::head::reaction::Motion;
use crate::head::state::{Reason, State};
use crate::path::Path;
use crate::units::{Fixed, Nanometres};
use core::ops::DerefMut;

impl<P: DerefMut<Target = Path>> Planner<P> {
    /// So much erosion since the last jump.
    pub(super) fn jump_is_due(&mut self) -> bool {
        self.eroded = self.eroded.saturating_add(self.ticks);
        let jump = &self.config.jump;
        let due = match jump.every {
            0 => false,
            _ if jump.adaptive.share > 0.0 => self.rhythm.is_due(&jump.adaptive, &self.status.gap.pulses, self.eroded),
            every => self.eroded >= every,
        };
        // One for which there is no room at all is left out.
        self.eroded = if due { 0 } else { self.eroded };
        due
    }

    /// Begins a jump. One that is commanded is as high as it is set to be, or refused; of the others a low one, which leaves the
    /// float distance free at the top, is better than none.
    pub(super) fn begin_jump(&mut self, commanded: bool) -> Result<(), Refused> {
        if !self.status.homed {
            self.status.cramped |= !commanded;
            return Err(Refused::NotHomed);
        }
        if self.now.safety.upper_limit {
            return Err(Refused::StillFaulty(Fault::UpperLimit));
        }
        let axis = &self.config.axis;
        let (top, _) = self.travel();
        let from = self.segment().from;
        let free = from.minus(axis.counts(top));
        let adapts = !commanded && self.config.jump.adaptive.share > 0.0;
        let height = if adapts { self.rhythm.height(&self.config.jump.adaptive) } else { self.config.jump.height };
        let height = Fixed::whole(height.into());
        let margin = Fixed::whole((self.config.jump.float as f32 * axis.counts_per_um) as i64);
        let cramped = free < height;
        let led = if cramped { free.minus(margin) } else { height };
        if !commanded {
            self.status.cramped = cramped;
        }
        if cramped && (commanded || led < margin) {
            let nm = |counts: Fixed| Nanometres(counts.round().saturating_mul(axis.nm_per_count));
            return Err(Refused::NoRoom { height: nm(height), free: nm(free) });
        }
        let float = self.route.s().minus(Fixed::whole(self.config.jump.float.into()));
        self.jump = Some(Jump::new(led, float));
        self.eroded = 0;
        self.enter(State::Jumping, if cramped { Reason::JumpedLow } else { Reason::Jumped });
        Ok(())
    }

    /// Goes on with a jump.
    pub(super) fn jump_on(&mut self) -> Motion {
        let from = self.segment().from;
        let rests = self.now.segment.velocity.0 == 0.0;
        let ahead = self.jump.as_ref().map_or(0.0, |jump| jump.ahead(self.status.following));
        let Some(pace) = self.awaited(ahead) else { return self.react() };
        let Some(jump) = &mut self.jump else {
            self.enter(State::HoldingPosition, Reason::Held);
            return self.along(REST);
        };
        if !jump.is_away() && !rests {
            return self.along(REST);
        }
        self.route.go_back_to(jump.float);
        let places = [from, self.route.setpoint()];
        if let Some((segment, acceleration)) = jump.plan(&self.config.jump, places, pace, self.ticks) {
            return Motion::Jump(segment, self.config.axis.plant.accelerating(acceleration));
        }
        let holds = jump.holds;
        self.jump = None;
        if holds {
            self.enter(State::HoldingPosition, Reason::Held);
        } else {
            self.enter(State::Eroding, Reason::Returned);
            self.rhythm.begin(&self.config.jump.adaptive, &self.status.gap.pulses);
            self.lead(After::Jump);
        }
        self.along(REST)
    }
}
