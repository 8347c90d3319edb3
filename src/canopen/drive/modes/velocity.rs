//! Profile velocity and cyclic synchronous velocity.

use super::Mode;
use crate::canopen::Abort;
use crate::canopen::drive::{Drive, SetPoint};
use crate::canopen::objects::Item;
use crate::head::Command;
use crate::units::{Nanometres, TICK_HZ};

impl Drive {
    /// Profile velocity: toward the limit of its direction.
    pub(super) fn run(&mut self) {
        let velocity = self.value(Item::TargetVelocity);
        (self.set_points.within, self.set_points.begins) = (0, false);
        if velocity == 0 {
            self.brake(Item::ProfileDeceleration);
            return;
        }
        let (low, high) = self.limits();
        let target = if velocity > 0 { high } else { low };
        let limits = self.motion_limits(velocity.saturating_abs());
        self.command(Command::Position(self.place(target), limits));
    }

    /// Whether 60FFh may be written: it would be followed, and not while the head works.
    pub(in super::super) fn may_run(&self, changes: bool) -> Result<(), Abort> {
        let set_point = changes && self.mode == Mode::ProfileVelocity || self.mode == Mode::CyclicVelocity;
        let runs = set_point && self.moves();
        if runs && self.status.state.works() && !self.guides() { Err(Abort::DeviceState) } else { Ok(()) }
    }

    /// 60FFh has been written.
    pub(in super::super) fn velocity_written(&mut self, before: i32) {
        match self.mode {
            _ if !self.moves() => {}
            Mode::ProfileVelocity if before != self.value(Item::TargetVelocity) => self.run(),
            Mode::CyclicVelocity => self.follow_velocity(),
            _ => {}
        }
    }

    /// Cyclic synchronous velocity: a set point as far on as it leads in a period.
    fn follow_velocity(&mut self) {
        let velocity = self.value(Item::TargetVelocity).saturating_add(self.value(Item::VelocityOffset));
        let (nm_per_count, second) = (self.active.head.axis.nm_per_count, i64::from(TICK_HZ));
        let (ticks, (low, high)) = (self.period(), self.limits());
        let here = self.status.setpoint.round().saturating_mul(nm_per_count).saturating_mul(second);
        let way = i64::from(velocity).saturating_mul(nm_per_count).saturating_mul(ticks.into());
        let wanted = self.set_points.led.unwrap_or(here).saturating_add(way);
        let bound = |counts: i32| self.place(counts).0.saturating_mul(second);
        let led = wanted.max(bound(low)).min(bound(high));
        (self.set_points.limited, self.set_points.led) = (led != wanted, Some(led));
        self.fresh = false;
        self.follow = Some(SetPoint { to: Nanometres(led.wrapping_div(second)), ticks });
    }
}
