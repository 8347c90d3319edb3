//! The escape: a straight line off the path, which a retreat from a short takes instead of the way that it came.
//!
//! It is a part of the path coordinate: it ends where the path was left, and begins its own length before that. So set points
//! are functions of the coordinate there as well: the way back is the way out, and the path goes on at the same place.

use super::{Register, corners};
use crate::path::grid::{counts, length, length_um};
use crate::path::line::Line;
use crate::path::piece::{Segment, jump};
use crate::path::{AXES, Point};
use crate::units::{Fixed, Micrometres, MicrometresPerSecond2, smaller};

/// An escape under way; all 0 where there is none.
#[derive(Clone, Copy, Debug)]
pub(super) struct Off {
    length: Fixed,
    /// Path coordinate where the path was left.
    joint: Fixed,
    /// That at which the segment under way begins.
    resumes: Fixed,
    /// Jump of direction there.
    corner: f32,
}

impl Off {
    pub const NONE: Off = Off { length: Fixed(0), joint: Fixed(0), resumes: Fixed(0), corner: 0.0 };
}

impl<const N: usize> Register<N> {
    /// Leaves the path where it is, for a line to a point so many nm away. On such a line already, or without a length, nothing
    /// changes.
    pub fn escape(&mut self, by: [i32; AXES]) {
        let length = length_um(length(by.map(|nm| nm.unsigned_abs().into())));
        if self.is_off() || length.0 <= 0 {
            return;
        }
        let here: Point = self.setpoint();
        let line = Line::new(counts(by, &here, &self.grid()), here, length);
        let (out, on) = (line.here(length).direction(), self.direction());
        let corner = jump(self.unit(out), self.unit(on));
        self.off = Off { length, joint: self.s, resumes: self.start, corner };
        let [_, x, y] = by;
        self.beside |= (x, y) != (0, 0);
        self.enter(Segment::Line(line), self.s.minus(length));
    }

    /// The coordinate is on an escape.
    pub fn is_off(&self) -> bool {
        self.off.length.0 > 0
    }

    /// How far off the path an escape is, um; `None` on the path.
    pub fn off(&self) -> Option<Fixed> {
        self.is_off().then(|| self.off.joint.minus(self.s))
    }

    /// Back on the path, where it was left.
    pub(super) fn come_back(&mut self) {
        let Off { joint, resumes, .. } = self.off;
        (self.s, self.start, self.off) = (joint, resumes, Off::NONE);
        self.ready();
    }

    /// Length ahead on an escape, the corner at its end as in [`Register::ahead`].
    pub(super) fn ahead_off(&self, acceleration: MicrometresPerSecond2) -> Micrometres {
        let left = self.off.joint.minus(self.s).to_f32() + corners::passing(self.off.corner, acceleration, 0);
        Micrometres(smaller(left, self.newest.minus(self.s).to_f32()))
    }
}
