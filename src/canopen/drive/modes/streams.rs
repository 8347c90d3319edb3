//! Set points of a stream: cyclic synchronous position, and the buffer of interpolated position.

use super::Mode;
use crate::canopen::drive::state::control;
use crate::canopen::drive::{Drive, SetPoint};
use crate::canopen::objects::{Decoded, Item};
use crate::canopen::{Abort, Node, Time};
use crate::head::Command;
use crate::units::{Nanometres, Newtons, TICK_HZ};

impl Drive {
    /// 607Ah has been written.
    pub(in super::super) fn target_written(&mut self, target: i32) -> Result<(), Abort> {
        if self.mode != Mode::CyclicPosition || !self.moves() {
            return Ok(());
        }
        let target = self.within_limits(target.saturating_add(self.value(Item::PositionOffset)));
        self.set_points.target = Some(target);
        if self.erodes() {
            return if self.erode_to(target) { Ok(()) } else { Err(Abort::DeviceState) };
        }
        self.follow_to(target);
        Ok(())
    }

    /// 2017h:1 has been written.
    pub(in super::super) fn place_written(&mut self, place: i32) {
        if self.mode == Mode::CyclicPosition && self.moves() && !self.erodes() {
            let point = self.placed(place);
            self.set_points.target = None;
            self.fresh = false;
            self.follow = Some(point);
        }
    }

    /// The set point that a place on the path of another head is for this axis, within the limits.
    fn placed(&self, place: i32) -> SetPoint {
        let (low, high) = self.limits();
        let origin = i64::from(self.value(Item::PathOrigin)).saturating_add(self.datum_nm());
        let to = origin.saturating_add(place.into());
        let to = Nanometres(to.max(self.place(low).0).min(self.place(high).0));
        SetPoint { to, ticks: self.period() }
    }

    /// 60B0h has been written: the newest set point is followed with it.
    pub(in super::super) fn offset_written(&mut self) {
        if self.mode == Mode::CyclicPosition && self.moves() && !self.erodes() {
            let target = self.value(Item::TargetPosition).saturating_add(self.value(Item::PositionOffset));
            let target = self.within_limits(target);
            self.set_points.target = Some(target);
            self.follow_to(target);
        }
    }

    /// The force that the head adds while it follows set points: 60B2h in a cyclic mode, else none.
    pub(in super::super) fn push(&mut self) {
        let cyclic = matches!(self.mode, Mode::CyclicPosition | Mode::CyclicVelocity) && self.moves();
        let share = if cyclic { self.value(Item::TorqueOffset) } else { 0 };
        let axis = &self.active.head.axis;
        let force = share as f32 * 1e-3 * axis.current.continuous.0 * axis.plant.force_constant;
        if force != core::mem::replace(&mut self.set_points.push, force) {
            self.command(Command::Push(Newtons(force)));
        }
    }

    fn follow_to(&mut self, target: i32) {
        self.fresh = false;
        self.follow = Some(self.following(target));
    }

    fn following(&self, target: i32) -> SetPoint {
        SetPoint { to: self.place(target), ticks: self.period() }
    }

    /// What the next SYNC makes of 607Ah, or of 2017h:1.
    pub(in super::super) fn set_point_at_sync(&self, node: &Node) -> Option<SetPoint> {
        const PLACE: Decoded = Decoded::Row(Item::PathPlace as u16);
        const TARGET: Decoded = Decoded::Row(Item::TargetPosition as u16);
        const OFFSET: Decoded = Decoded::Row(Item::PositionOffset as u16);
        if self.mode != Mode::CyclicPosition || !self.moves() || self.erodes() {
            return None;
        }
        let ahead = |at: Decoded| node.ahead(at.place(), self).map(i32::from_le_bytes);
        if let Some(place) = ahead(PLACE) {
            return Some(self.placed(place));
        }
        let (target, offset) = (ahead(TARGET), ahead(OFFSET));
        target.or(offset)?;
        let target = target.unwrap_or(self.value(Item::TargetPosition));
        let offset = offset.unwrap_or(self.value(Item::PositionOffset));
        Some(self.following(self.clamped(target.saturating_add(offset))))
    }

    /// 60C1h:1 has been written.
    pub(in super::super) fn data_written(&mut self, target: i32) -> Result<(), Abort> {
        if self.mode != Mode::Interpolated {
            return Ok(());
        }
        let target = self.within_limits(target);
        if self.erodes() && self.acts() {
            let sent =
                !self.set_points.begins && self.queue_space() > 0 && self.command(Command::MoveTo(self.place(target)));
            if sent && self.control & control::START != 0 {
                self.command(Command::Start);
            }
            return if sent { Ok(()) } else { Err(Abort::DeviceState) };
        }
        self.set_points.buffer.push_back(target).map_err(|_| Abort::DeviceState)
    }

    /// Forgets the buffered set points.
    pub(in super::super) fn clear_buffer(&mut self) {
        self.set_points.buffer.clear();
    }

    /// Interpolated position: the next set point, when it is due.
    pub(in super::super) fn interpolate(&mut self, now: Time) {
        let active = self.mode == Mode::Interpolated && self.moves() && self.control & control::START != 0;
        if !active || self.erodes() {
            self.set_points.due = None;
            return;
        }
        let due = *self.set_points.due.get_or_insert(now);
        if now < due {
            return;
        }
        if let Some(target) = self.set_points.buffer.pop_front() {
            let period = u64::from(self.period()).saturating_mul(1_000_000 / u64::from(TICK_HZ));
            self.set_points.due = Some(Time(due.0.saturating_add(period)));
            self.set_points.target = Some(target);
            self.follow_to(target);
        } else {
            self.set_points.due = None;
        }
    }

    /// The cycle of 60C2h, servo ticks.
    pub(super) fn period(&self) -> u32 {
        let (units, exponent) = (self.value(Item::IpPeriod) as u32, self.value(Item::IpExponent));
        let divisor = 10u32.saturating_pow(exponent.unsigned_abs());
        units.saturating_mul(TICK_HZ).checked_div(divisor).unwrap_or(0).max(1)
    }
}
