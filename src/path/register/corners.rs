//! Lengths to where the head must be slow: the end of the path, the end of a retreat, the corners before them.

use super::{JOINTS, Register};
use crate::units::{Fixed, Micrometres, MicrometresPerSecond2, PLAN_TICKS, TICK_S, smaller};

/// Time in which an axis may change its velocity at a corner as if at the acceleration allowed: from a plan to the next, s.
const CORNER_S: f32 = PLAN_TICKS as f32 * TICK_S;

impl<const N: usize> Register<N> {
    /// Length of path from a coordinate to the end.
    pub fn ahead_of(&self, s: Fixed) -> Fixed {
        self.newest.minus(s)
    }

    /// Length of path ahead. A corner counts as an end as much farther away as the speed is that it may be passed with:
    /// v^2 = a d, with the v that no axis changes by more than `acceleration` does in the time of a plan.
    pub fn ahead(&self, acceleration: MicrometresPerSecond2) -> Micrometres {
        if self.is_off() {
            return self.ahead_off(acceleration);
        }
        let mut least = self.newest.from(self.s);
        let mut joint = self.end;
        let mut slot = self.current.wrapping_add(1);
        for looked in 0..JOINTS {
            let left = joint.from(self.s);
            if left >= least {
                break;
            }
            if self.stops(slot.wrapping_sub(1), joint) {
                return Micrometres(left);
            }
            let Some(segment) = self.segment(slot) else { break };
            least = smaller(least, left + passing(segment.corner(), acceleration, looked));
            joint = joint.plus(segment.length());
            slot = slot.wrapping_add(1);
        }
        Micrometres(least)
    }

    /// Length that a retreat can still cover; corners as in [`Register::ahead`].
    pub fn behind(&self, acceleration: MicrometresPerSecond2) -> Micrometres {
        let mut least = self.left_behind().0;
        if self.is_off() {
            return Micrometres(least);
        }
        let mut joint = self.start;
        let mut slot = self.current;
        for looked in 0..JOINTS {
            let left = self.s.from(joint);
            if left >= least {
                break;
            }
            let Some(segment) = self.segment(slot) else { break };
            least = smaller(least, left + passing(segment.corner(), acceleration, looked));
            slot = slot.wrapping_sub(1);
            let Some(length) = self.length(slot) else { break };
            joint = joint.minus(length);
        }
        Micrometres(least)
    }
}

/// What a corner adds to the length before it, um. Beyond the last joint that is looked at nothing is known.
pub(super) fn passing(corner: f32, acceleration: MicrometresPerSecond2, looked: usize) -> f32 {
    if looked.wrapping_add(1) == JOINTS {
        0.0
    } else if corner > 0.0 {
        acceleration.0 * (CORNER_S / corner) * (CORNER_S / corner)
    } else {
        f32::INFINITY
    }
}
