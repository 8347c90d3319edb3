//! The register: where on the path the head is, what lies ahead and what can be retraced.

mod append;
mod corners;
mod escape;
mod retreat;
mod step;
#[cfg(test)]
mod tests;

use self::escape::Off;
use super::grid::{Grid, Place, counts, length, length_um};
use super::line::Line;
use super::piece::{Here, Packed, Segment};
use super::{AXES, Point};
use crate::units::{FRACTION_BITS, Fixed};
use heapless::Deque;

/// Segments that can wait ahead of the one under way.
pub const AHEAD: usize = 256;
/// Segments already passed that can be retraced.
pub const BEHIND: usize = 1024;

/// Joints crossed in one step at the most, and looked at for a corner: a bounded tick, even through a row of segments shorter
/// than a step.
const JOINTS: usize = 8;

/// What stopped a step short.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Bound {
    /// Forward: the end of the last segment.
    End,
    /// Forward: the end of one at which an erosion ends.
    Stop,
    /// Backward: nothing older is remembered.
    Memory,
    /// Backward: the set retreat distance.
    Distance,
    /// Backward: a mark.
    Mark,
    /// Either way: more joints in one step than a tick may take; the rest follows in the next.
    Joints,
}

/// Path with history, `N` segments in all.
///
/// *Slots* are numbered from the oldest: the *lead*, which is the way that a retreat past the beginning takes, then the segments.
/// When the lead is forgotten it is the point at which the oldest segment begins.
#[derive(Debug)]
pub struct Register<const N: usize> {
    segments: Deque<Packed, N>,
    nm_per_count: [i64; AXES],
    /// Origin of places: whole counts.
    datum: Point,
    lead: Line,
    /// Its end.
    first: Place,
    /// Slot under way, and what is there.
    current: usize,
    now: Segment,
    /// Path coordinates at its start and at its end.
    start: Fixed,
    end: Fixed,
    s: Fixed,
    here: Here,
    /// Path coordinates of the oldest remembered and the newest queued point.
    oldest: Fixed,
    newest: Fixed,
    /// Largest coordinate reached since the restart.
    furthest: Fixed,
    /// How far behind it a retreat may go.
    retreat: Fixed,
    /// Marks bound a retreat, and where the newest is that has been come past.
    marks: bool,
    mark: Fixed,
    marked: bool,
    /// Stops up to here are over.
    passed: Fixed,
    /// A piece leads another axis than the first.
    beside: bool,
    off: Off,
}

impl<const N: usize> Register<N> {
    /// A path that begins at the origin, with no room for a retreat and no scale: [`Register::scale`] gives it one. Every bit
    /// is 0, so that it can be written in place.
    pub const EMPTY: Self = Register {
        segments: Deque::new(),
        nm_per_count: [0; AXES],
        datum: [Fixed(0); AXES],
        lead: Line::point([Fixed(0); AXES]),
        first: [0; AXES],
        current: 0,
        now: Segment::Line(Line::point([Fixed(0); AXES])),
        start: Fixed(0),
        end: Fixed(0),
        s: Fixed(0),
        here: Here { at: [Fixed(0); AXES], slope: [0; AXES] },
        oldest: Fixed(0),
        newest: Fixed(0),
        furthest: Fixed(0),
        retreat: Fixed(0),
        marks: false,
        mark: Fixed(0),
        marked: false,
        passed: Fixed(0),
        beside: false,
        off: Off::NONE,
    };

    /// Sets the nm per count of each axis, 50 at least: for a path that is begun anew from now on.
    pub fn scale(&mut self, nm_per_count: [i64; AXES]) {
        self.nm_per_count = nm_per_count;
    }

    fn grid(&self) -> Grid {
        Grid(self.nm_per_count)
    }

    /// Forgets everything and begins where the axes are, so that enabling makes no jump. `escape` is where a retreat
    /// past the beginning leads, in a straight line (`s` below zero), for [`REACH`](super::REACH) at the most; at the escape point itself
    /// there is none.
    pub fn restart(&mut self, here: Point, escape: Point) {
        self.segments.clear();
        self.datum = here.map(|here| Fixed(here.round() << FRACTION_BITS));
        let part = |from: &Point, to: &Point| {
            let mut nm = [0; AXES];
            for (((nm, from), to), nm_per_count) in nm.iter_mut().zip(from).zip(to).zip(&self.nm_per_count) {
                *nm = Grid::nm(to.minus(*from), *nm_per_count) as i32;
            }
            nm
        };
        self.first = part(&self.datum, &here);
        let back = part(&here, &escape);
        let from = counts(back, &here, &self.grid());
        let length = length_um(length(back.map(|nm| nm.unsigned_abs().into())));
        self.lead = if length.0 > 0 { Line::new(from, here, length) } else { Line::point(here) };
        (self.current, self.off) = (0, Off::NONE);
        self.oldest = Fixed(0).minus(length);
        (self.s, self.newest, self.furthest) = (Fixed(0), Fixed(0), Fixed(0));
        self.enter(Segment::Line(self.lead), self.oldest);
        (self.mark, self.marked, self.passed, self.beside) = (Fixed(0), false, Fixed(0), false);
    }

    fn datum_nm(&self) -> [i64; AXES] {
        let mut nm = [0; AXES];
        for (nm, (datum, nm_per_count)) in nm.iter_mut().zip(self.datum.iter().zip(&self.nm_per_count)) {
            *nm = (datum.0 >> FRACTION_BITS).saturating_mul(*nm_per_count);
        }
        nm
    }

    /// End of the last segment.
    fn last(&self) -> (Place, Point) {
        match self.segments.back() {
            Some(segment) => (segment.to, counts(segment.to, &self.datum, &self.grid())),
            None => (self.first, self.lead.end()),
        }
    }

    fn segment(&self, slot: usize) -> Option<&Packed> {
        self.segments.get(slot.checked_sub(1)?)
    }

    /// Length of what is in a slot.
    fn length(&self, slot: usize) -> Option<Fixed> {
        match slot {
            0 => Some(self.lead.length()),
            slot => self.segment(slot).map(Packed::length),
        }
    }

    fn unpacked(&self, slot: usize) -> Option<Segment> {
        let Some(segment) = self.segment(slot) else {
            return (slot == 0).then_some(Segment::Line(self.lead));
        };
        let grid = self.grid();
        let (place, start) = match self.segment(slot.wrapping_sub(1)) {
            Some(before) => (before.to, counts(before.to, &self.datum, &grid)),
            None => (self.first, self.lead.end()),
        };
        Some(segment.unpack(place, start, &self.datum, &grid))
    }

    /// What begins at a coordinate is under way.
    fn enter(&mut self, now: Segment, start: Fixed) {
        (self.now, self.start, self.end) = (now, start, start.plus(now.length()));
        self.look();
    }

    /// The coordinate has changed.
    fn look(&mut self) {
        self.here = self.now.here(self.s.minus(self.start));
    }

    /// Axis setpoints at the present coordinate, counts.
    #[inline]
    pub fn setpoint(&self) -> Point {
        self.here.at
    }

    /// Axis travel for a short travel along the path from the present coordinate, counts: what a set point moves by between
    /// two steps. A joint in between shows only at the next step.
    #[inline(always)]
    pub fn travel(&self, by: Fixed) -> Point {
        self.here.travel(by)
    }

    /// Axis travel per path travel at the present coordinate, counts per um.
    #[inline(always)]
    pub fn direction(&self) -> [f32; AXES] {
        self.here.direction()
    }

    /// Path coordinate, um.
    pub fn s(&self) -> Fixed {
        self.s
    }

    /// End of the last segment, counts.
    pub fn end(&self) -> Point {
        let (_, end) = self.last();
        end
    }

    /// End of the last segment, nm.
    pub fn end_nm(&self) -> [i64; AXES] {
        let (place, _) = self.last();
        let mut end = self.datum_nm();
        for (end, place) in end.iter_mut().zip(place) {
            *end = end.saturating_add(place.into());
        }
        end
    }

    /// Segments waiting behind the one under way.
    pub fn waiting(&self) -> usize {
        self.segments.len().saturating_sub(self.current)
    }

    /// Whether the end of the last segment is reached.
    pub fn at_end(&self) -> bool {
        self.s >= self.newest
    }

    /// Whether this is the farthest that was reached since the restart.
    pub fn is_at_front(&self) -> bool {
        self.s >= self.furthest
    }

    /// Whether the path leads another axis than the first, since it began: then the position of the first says nothing of the coordinate.
    pub fn leads_beside(&self) -> bool {
        self.beside
    }
}
