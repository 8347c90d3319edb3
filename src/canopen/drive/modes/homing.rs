//! Homing.

use crate::canopen::drive::state::status;
use crate::canopen::drive::{Drive, codes};
use crate::canopen::objects::Item;
use crate::head::{Command, Home, HomingState, Refused};
use crate::motion::Method;

impl Drive {
    /// Why no reference may be looked for, as far as the drive knows: set points become path, or pulses are on.
    pub(super) fn refuses_homing(&self) -> Option<Refused> {
        if self.status.state.works() {
            return Some(Refused::State(self.status.state));
        }
        (self.value(Item::ErodeEnable) != 0).then_some(Refused::PathActive)
    }

    /// Homing starts.
    pub(super) fn home(&mut self) {
        self.set_points.homing_asked = true;
        self.set_points.homing_refused = false;
        if let Some(refused) = self.refuses_homing() {
            self.refuses(codes::refused(refused));
            self.set_points.homing_refused = true;
            return;
        }
        let Some(method) = Method::from_number(self.value(Item::HomingMethod) as i8) else {
            self.set_points.homing_refused = true;
            return;
        };
        let home = Home {
            method,
            fast: self.velocity(self.value(Item::HomingFast)),
            slow: self.velocity(self.value(Item::HomingSlow)),
            acceleration: self.acceleration(Item::HomingAcceleration),
            at: self.nanometres(self.value(Item::HomeOffset).saturating_neg()),
        };
        self.resume.homes(method, self.value(Item::HomeOffset));
        // A new reference begins where the axis is at rest.
        self.command(Command::Home(home));
    }

    pub(super) fn is_homing(&self) -> bool {
        self.status.homing == HomingState::Runs
    }

    /// Why homing has failed: 2000h:9.
    pub(in super::super) fn homing_error(&self) -> u8 {
        match self.status.homing {
            _ if self.set_points.homing_refused => codes::HOMING_REFUSED,
            HomingState::Failed(missed) => missed as u8,
            HomingState::No | HomingState::Runs | HomingState::Done => 0,
        }
    }

    /// In progress 0; interrupted or not started 10; attained 10 and 12; failed 10 and 13.
    pub(super) fn homing_bits(&self, still: bool) -> u16 {
        if !self.set_points.homing_asked {
            let known = if self.status.homed { status::MODE_12 } else { 0 };
            return status::REACHED | known;
        }
        if self.set_points.homing_refused {
            return status::REACHED | status::MODE_13;
        }
        match self.status.homing {
            _ if !self.fresh => 0,
            HomingState::Runs => 0,
            HomingState::Done if still => status::REACHED | status::MODE_12,
            HomingState::Done => status::MODE_12,
            HomingState::Failed(_) if still => status::REACHED | status::MODE_13,
            HomingState::Failed(_) => status::MODE_13,
            HomingState::No => status::REACHED,
        }
    }
}
