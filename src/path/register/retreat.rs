//! How far a retreat may go back, and what bounds it.

use super::{Bound, Register};
use crate::units::{Fixed, Micrometres};

impl<const N: usize> Register<N> {
    /// Where a retreat ends, and what ends it there.
    pub(super) fn floor(&self) -> (Fixed, Bound) {
        if self.is_off() {
            return (self.start, Bound::Distance);
        }
        let distance = self.furthest.minus(self.retreat);
        let (floor, bound) =
            if distance >= self.oldest { (distance, Bound::Distance) } else { (self.oldest, Bound::Memory) };
        if self.marked && self.marks && self.mark >= floor { (self.mark, Bound::Mark) } else { (floor, bound) }
    }

    /// Length that a retreat can still cover.
    pub fn left_behind(&self) -> Micrometres {
        Micrometres(self.s.from(self.floor().0))
    }

    /// Sets how far a retreat may go behind the furthest point; marks bound it as well.
    pub fn set_retreat(&mut self, retreat: Fixed) {
        (self.retreat, self.marks) = (retreat, true);
    }

    /// Lets a retreat go back as far as there is path.
    pub fn free_retreat(&mut self) {
        (self.retreat, self.marks) = (Fixed(i64::MAX), false);
    }

    /// What bounds a retreat.
    pub fn bound(&self) -> Bound {
        let (_, bound) = self.floor();
        bound
    }

    /// Whether distance and marks bound a retreat.
    pub fn is_bounded(&self) -> bool {
        self.marks
    }
}
