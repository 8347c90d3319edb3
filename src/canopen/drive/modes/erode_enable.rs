//! 2001h:1: whether set points become path, or are followed with pulses on.

use super::Mode;
use crate::canopen::Abort;
use crate::canopen::drive::Drive;
use crate::canopen::objects::Item;
use crate::head::{self, Command, Guidance};

impl Drive {
    /// Set points are followed with pulses on.
    pub(in super::super) fn guides(&self) -> bool {
        self.value(Item::ErodeEnable) == 2
    }

    /// Whether 2001h:1 may be written: a host may guide only where set points are followed, and not out of an erosion.
    pub(in super::super) fn may_erode(&self, enable: i64) -> Result<(), Abort> {
        if enable == 2 && self.mode == Mode::Steps {
            return Err(Abort::DeviceState);
        }
        let followed = !matches!(self.mode, Mode::None | Mode::ProfileVelocity | Mode::Homing)
            && !self.is_homing()
            && self.status.state != head::State::Touching;
        let erodes = self.erodes() && self.status.state.works();
        if enable == 2 && !self.guides() && (!self.moves() || !followed || erodes) {
            return Err(Abort::DeviceState);
        }
        Ok(())
    }

    /// 2001h:1 has been written.
    pub(in super::super) fn erode_written(&mut self, before: i32) {
        let enable = self.value(Item::ErodeEnable);
        let works = self.status.state.works();
        match enable {
            _ if self.mode == Mode::Steps && enable != before => self.record_written(),
            // Nothing to end.
            0 if before == 0 && !works => {}
            0 => {
                (self.follow, self.set_points.begins, self.set_points.then) = (None, false, None);
                if works || !self.fresh {
                    self.command(Command::Hold);
                }
            }
            1 => {
                let positions = matches!(self.status.state, head::State::Positioning | head::State::Touching);
                let positions = positions || self.follow.take().is_some();
                self.set_points.begins = self.moves() && (positions || before == 2);
                self.set_points.then = None;
                if self.set_points.begins {
                    self.command(Command::Hold);
                } else if self.moves() && !(self.mode == Mode::ProfilePosition && self.resume_rows()) {
                    self.command(Command::Start);
                }
            }
            _ if before == 2 => {}
            _ => {
                (self.set_points.begins, self.set_points.then) = (false, None);
                self.command(Command::Guide);
            }
        }
    }

    /// 2001h:1 says that a host guides the head only while it does.
    pub(in super::super) fn watch_guiding(&mut self) {
        if self.fresh && self.guides() && self.status.guidance == Guidance::No {
            self.set(Item::ErodeEnable, 0);
        }
    }

    /// Appends to the path, and goes along it.
    pub(super) fn erode_to(&mut self, target: i32) -> bool {
        if self.set_points.begins {
            self.set_points.then = Some(target);
            return true;
        }
        if self.technology.in_use() && self.mode == Mode::ProfilePosition {
            return self.begin_rows(target);
        }
        self.command(Command::MoveTo(self.place(target))) && self.command(Command::Start)
    }
}
