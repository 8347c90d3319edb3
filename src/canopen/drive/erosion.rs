//! An erosion as a host sees it: its counters, and what ends it (2006h).

use super::{Drive, clamp32, codes};
use crate::canopen::objects::Item;
use crate::head::{self, Change, Reason};
use crate::units::{FRACTION_BITS, Fixed};

/// A retreat from a short of more than this is a long one: [G], long-distance retreats.
const LONG_RETREAT: Fixed = Fixed(5 << FRACTION_BITS);

impl Drive {
    /// A change of the head's state.
    pub fn changed(&mut self, change: Change) {
        self.reason = codes::reason(change.reason);
        self.watch_identification(&change);
        self.watch_tuning(&change);
        match change.reason {
            Reason::Short => {
                let count = self.value(Item::Shorts).wrapping_add(1);
                self.set(Item::Shorts, count);
            }
            Reason::Jumped | Reason::JumpedLow => {
                let count = self.value(Item::Jumps).wrapping_add(1);
                self.set(Item::Jumps, count);
            }
            Reason::PathEnd => self.stopped_by = 1,
            Reason::BrokenThrough => self.stopped_by = 4,
            Reason::SparkedOut => self.stopped_by = 5,
            Reason::SparkOutTime => self.stopped_by = 6,
            Reason::PathStop => self.stopped_by = 7,
            Reason::Touched | Reason::NotTouched | Reason::Lifted => self.set_points.clear_target(),
            Reason::Homed => {
                self.datum.forget();
                self.resume.homed();
            }
            _ => {}
        }
        let depth = matches!(change.reason, Reason::PathEnd) && change.from != head::State::Seeking;
        let ended = depth || matches!(change.reason, Reason::SparkedOut | Reason::SparkOutTime);
        if ended && !self.technology.has_more() || matches!(change.reason, Reason::BrokenThrough) {
            self.resume.ended();
        }
    }

    pub(super) fn watch_erosion(&mut self) {
        let (state, path) = (self.status.state, self.status.path);
        match (state == head::State::Retreating, self.retreating, self.retreat) {
            (true, false, _) => self.retreat = Some(path),
            (true, true, Some(from)) if from.minus(path) > LONG_RETREAT => {
                let count = self.value(Item::LongRetreats).wrapping_add(1);
                self.set(Item::LongRetreats, count);
                self.retreat = None;
            }
            _ => {}
        }
        self.retreating = state == head::State::Retreating;
        let eroding = state.works() || self.technology.is_busy();
        if eroding && !self.eroding {
            self.set(Item::ErodingTime, 0);
            self.set(Item::Deepest, i32::MIN);
            (self.stopped_by, self.retreats_before) = (0, self.value(Item::LongRetreats) as u32);
        }
        self.eroding = eroding;
        if !eroding {
            return;
        }
        let time = self.value(Item::ErodingTime).wrapping_add(1);
        self.set(Item::ErodingTime, time);
        self.set(Item::Deepest, self.value(Item::Deepest).max(clamp32(self.status.position)));
        let retreats = (self.value(Item::LongRetreats) as u32).wrapping_sub(self.retreats_before);
        let (longest, most) = (self.value(Item::StopTime) as u32, self.value(Item::StopRetreats) as u32);
        let ends = if longest > 0 && time as u32 >= longest {
            2
        } else if most > 0 && retreats > most {
            3
        } else {
            0
        };
        if ends > 0 && self.stopped_by == 0 {
            self.stopped_by = ends;
            self.hold();
        }
    }
}
