//! Profile position: a set point by bit 4 of the controlword, one to go to and one that waits.

use crate::canopen::drive::state::{control, halts};
use crate::canopen::drive::{Drive, codes};
use crate::canopen::objects::Item;
use crate::head::{self, Command, Refused};

impl Drive {
    /// Profile position: a new set-point.
    pub(super) fn new_set_point(&mut self, word: u16) {
        if self.set_points.next.is_some() {
            return;
        }
        if self.status.state == head::State::Touching {
            self.refuses(codes::refused(Refused::State(self.status.state)));
            self.set_points.missed = true;
            return;
        }
        let given = self.value(Item::TargetPosition);
        let target = if word & control::RELATIVE != 0 {
            let from = match (self.value(Item::PositioningOption), self.set_points.target) {
                (0, Some(target)) => target,
                (1, _) => self.host_position(self.status.setpoint.round()),
                _ => self.position(),
            };
            from.saturating_add(given)
        } else {
            given
        };
        // Rows lead to one depth; a host that goes on gives it again.
        if self.technology.is_busy() && !self.technology.leads_to(target) {
            self.refuses(codes::refused(Refused::PathActive));
            return;
        }
        (self.set_points.acknowledged, self.set_points.missed) = (true, false);
        if self.technology.is_busy() {
            return;
        }
        if self.set_points.moving && word & control::IMMEDIATELY == 0 && !self.erodes() {
            self.set_points.next = Some(target);
        } else if !halts(word) {
            self.go(target);
        } else {
            self.set_points.target = Some(target);
        }
    }

    /// Goes to a target.
    pub(super) fn go(&mut self, target: i32) {
        let target = self.within_limits(target);
        self.set_points.target = Some(target);
        self.set_points.within = 0;
        let sent = if self.erodes() {
            self.erode_to(target)
        } else {
            let limits = self.motion_limits(self.value(Item::ProfileVelocity));
            let to = self.place(target);
            // With pulses on a contact is a short.
            let touches = self.value(Item::Touch) == 1 && !self.guides();
            self.command(if touches { Command::Touch(to, limits) } else { Command::Position(to, limits) })
        };
        self.set_points.moving = sent;
    }
}
