//! Limits of positions, and what the numbers of a host are in um.

use crate::canopen::drive::Drive;
use crate::canopen::objects::Item;
use crate::head::MotionLimits;
use crate::units::{MicrometresPerSecond, MicrometresPerSecond2, Nanometres};

impl Drive {
    /// Software limits and travel, which count from the home, as positions of a host, counts.
    #[inline(never)]
    pub(super) fn limits(&self) -> (i32, i32) {
        let (min, max) = (self.value(Item::LimitMin).into(), self.value(Item::LimitMax).into());
        let (min, max) = if self.status.homed {
            let axis = &self.active.head.axis;
            let counts = |nm: Nanometres| nm.0.checked_div(axis.nm_per_count).unwrap_or(0);
            let carried = self.status.carried;
            let (top, bottom) = (counts(axis.travel.0), counts(axis.travel.1));
            // A path that a coarse axis carries the head along ends below the travel.
            let carries = self.erodes() && self.active.head.inch.step > 0;
            let bottom = if carries { i64::MAX } else { bottom.saturating_add(carried) };
            (top.saturating_add(carried).max(min), bottom.min(max))
        } else {
            (min, max)
        };
        (self.host_position(min), self.host_position(max))
    }

    pub(super) fn within_limits(&mut self, target: i32) -> i32 {
        let inside = self.clamped(target);
        self.set_points.limited = inside != target;
        inside
    }

    pub(super) fn clamped(&self, target: i32) -> i32 {
        let (min, max) = self.limits();
        target.max(min).min(max)
    }

    /// A length.
    pub(in super::super) fn nanometres(&self, counts: i32) -> Nanometres {
        Nanometres(i64::from(counts).saturating_mul(self.active.head.axis.nm_per_count))
    }

    fn um_per_count(&self) -> f32 {
        self.active.head.axis.nm_per_count as f32 * 1e-3
    }

    pub(super) fn velocity(&self, counts: i32) -> MicrometresPerSecond {
        MicrometresPerSecond(counts as f32 * self.um_per_count())
    }

    /// An acceleration, or a deceleration, of an object, within 60C5h and 60C6h.
    pub(in super::super) fn acceleration(&self, item: Item) -> MicrometresPerSecond2 {
        let most = match item {
            Item::ProfileAcceleration | Item::HomingAcceleration => self.value(Item::MaxAcceleration),
            Item::ProfileDeceleration => self.value(Item::MaxDeceleration),
            _ => i32::MAX,
        };
        MicrometresPerSecond2(self.value(item).min(most) as f32 * self.um_per_count())
    }

    pub(super) fn motion_limits(&self, velocity: i32) -> MotionLimits {
        MotionLimits {
            velocity: self.velocity(velocity),
            acceleration: self.acceleration(Item::ProfileAcceleration),
            deceleration: self.acceleration(Item::ProfileDeceleration),
        }
    }
}
