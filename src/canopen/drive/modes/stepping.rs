//! Mode -1: the axis follows the steps of a host.

use super::Mode;
use crate::canopen::drive::Drive;
use crate::head::{self, Command};

impl Drive {
    /// Steps are followed from here on, within the limits of positions.
    pub(super) fn follow_steps(&mut self) {
        let (low, high) = self.limits();
        if self.command(Command::Step(self.place(low), self.place(high))) {
            self.set_points.bounds = Some((low, high));
        }
    }

    /// 2001h:1 has been written in this mode: steps become path, or are followed, once the axis rests.
    pub(super) fn record_written(&mut self) {
        if self.moves() {
            self.set_points.forget();
            self.command(Command::Hold);
            self.set_points.steps_due = true;
        }
    }

    /// Whether the head follows steps.
    pub(super) fn follows_steps(&self) -> bool {
        let told = self.mode == Mode::Steps && self.set_points.bounds.is_some();
        told && self.moves() && self.status.state == head::State::Positioning
    }

    /// Once the axis rests steps are followed, and limits that change meanwhile hold for them.
    pub(super) fn watch_steps(&mut self) {
        if !self.fresh || self.mode != Mode::Steps || !self.moves() {
            return;
        }
        let changed = self.follows_steps() && self.set_points.bounds != Some(self.limits());
        let due = !self.status.state.positions() && core::mem::take(&mut self.set_points.steps_due);
        if due && self.erodes() {
            self.command(Command::Record);
        } else if due || changed {
            self.follow_steps();
        }
    }

    /// Whether the drive may be enabled: in mode -1 only while no steps come.
    pub(in super::super) fn refuses_steps(&self) -> bool {
        self.mode == Mode::Steps && self.steps.come()
    }
}
