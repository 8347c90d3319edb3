//! A step along the path, forward and backward, and what stops it short.

use super::{BEHIND, Bound, JOINTS, Register};
use crate::path::grid::counts;
use crate::path::line::Line;
use crate::path::piece::Packed;
use crate::units::Fixed;

impl<const N: usize> Register<N> {
    /// Steps along the path, positive toward the work, and says what stopped it short.
    pub fn step(&mut self, by: Fixed) -> Option<Bound> {
        let wanted = self.s.plus(by);
        let before = (self.start, self.s);
        let bound = if by.0 < 0 {
            self.backward(wanted)
        } else if wanted < self.end {
            self.arrive(wanted);
            None
        } else {
            self.forward(wanted)
        };
        if self.start != before.0 {
            self.ready();
        } else if self.s != before.1 {
            self.look();
        }
        bound
    }

    /// A joint has been crossed.
    #[cold]
    pub(super) fn ready(&mut self) {
        if let Some(now) = self.unpacked(self.current) {
            self.enter(now, self.start);
        }
    }

    /// To the end of what is under way, or beyond it.
    #[cold]
    fn forward(&mut self, wanted: Fixed) -> Option<Bound> {
        if self.is_off() {
            self.come_back();
        }
        for _ in 0..JOINTS {
            let end = self.end;
            if wanted <= end {
                self.arrive(wanted);
                return None;
            }
            self.arrive(end);
            if self.stops(self.current, end) {
                return Some(Bound::Stop);
            }
            let next = self.current.wrapping_add(1);
            let Some(segment) = self.segment(next).copied() else { return Some(Bound::End) };
            (self.start, self.end) = (end, end.plus(segment.length()));
            self.current = next;
            self.come_past(&segment);
            let lead = usize::from(self.lead.length().0 > 0);
            if self.current.wrapping_add(lead) > BEHIND.wrapping_add(1) {
                self.forget();
            }
        }
        Some(Bound::Joints)
    }

    fn backward(&mut self, wanted: Fixed) -> Option<Bound> {
        let (floor, bound) = self.floor();
        // A bound set behind the head's back must not push it forward.
        let floor = floor.min(self.s);
        let (wanted, bound) = if wanted < floor { (floor, Some(bound)) } else { (wanted, None) };
        if wanted >= self.start {
            self.arrive(wanted);
            return bound;
        }
        self.across(wanted, bound)
    }

    /// Back across joints.
    #[cold]
    fn across(&mut self, wanted: Fixed, bound: Option<Bound>) -> Option<Bound> {
        for _ in 0..JOINTS {
            if wanted >= self.start {
                self.arrive(wanted);
                return bound;
            }
            self.arrive(self.start);
            let previous = self.current.checked_sub(1).and_then(|slot| Some((slot, self.length(slot)?)));
            let Some((slot, length)) = previous else { return bound };
            self.start = self.start.minus(length);
            self.current = slot;
        }
        Some(Bound::Joints)
    }

    fn arrive(&mut self, s: Fixed) {
        self.s = s;
        self.furthest = self.furthest.max(s);
    }

    /// The oldest is forgotten: the lead at first.
    fn forget(&mut self) {
        let length = self.lead.length();
        if length.0 > 0 {
            self.lead = Line::point(self.lead.end());
            self.oldest = self.oldest.plus(length);
        } else if let Some(forgotten) = self.segments.pop_front() {
            self.first = forgotten.to;
            self.lead = Line::point(counts(forgotten.to, &self.datum, &self.grid()));
            self.oldest = self.oldest.plus(forgotten.length());
            self.current = self.current.wrapping_sub(1);
        }
    }

    pub(super) fn come_past(&mut self, segment: &Packed) {
        if segment.mark && !(self.marked && self.start < self.mark) {
            (self.mark, self.marked) = (self.start, true);
        }
    }

    /// Whether a stop before that is reached, and not over.
    pub fn at_stop(&self) -> bool {
        self.s >= self.end && !self.at_end() && !self.is_off() && self.stops(self.current, self.s)
    }

    /// The stop that is reached is over.
    pub fn pass_stop(&mut self) {
        self.passed = self.passed.max(self.s);
    }

    /// Whether an erosion ends at the end of what is in a slot.
    pub(super) fn stops(&self, slot: usize, end: Fixed) -> bool {
        end > self.passed && self.segment(slot).is_some_and(|segment| segment.stop)
    }
}
