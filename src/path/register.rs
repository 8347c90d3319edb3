//! The register: where on the path the head is, what lies ahead and what can be retraced.

use super::line::Line;
use super::piece::{Grid, Packed, Piece, Place, REACH, Refused, Segment, Shape, counts, length, length_um};
use super::{AXES, Point};
use crate::units::{FRACTION_BITS, Fixed, Micrometres, MicrometresPerSecond2, PLAN_TICKS, TICK_S, smaller};
use heapless::Deque;

/// Segments that can wait ahead of the one under way.
pub const AHEAD: usize = 256;
/// Segments already passed that can be retraced.
pub const BEHIND: usize = 1024;

/// Joints crossed in one step at the most, and looked at for a corner: a bounded tick, even through a row of segments shorter
/// than a step.
const JOINTS: usize = 8;
/// Time in which an axis may change its velocity at a corner as if at the acceleration allowed: from a plan to the next, s.
const CORNER_S: f32 = PLAN_TICKS as f32 * TICK_S;

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
    /// Where places are reckoned from: whole counts.
    datum: Point,
    lead: Line,
    /// Its end.
    first: Place,
    /// Slot under way, and what is there.
    current: usize,
    now: Segment,
    /// Path coordinate at its start.
    start: Fixed,
    s: Fixed,
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
        s: Fixed(0),
        oldest: Fixed(0),
        newest: Fixed(0),
        furthest: Fixed(0),
        retreat: Fixed(0),
        marks: false,
        mark: Fixed(0),
        marked: false,
        passed: Fixed(0),
        beside: false,
    };

    /// Sets the nm per count of each axis, 50 at least: for a path that is begun anew from now on.
    pub fn scale(&mut self, nm_per_count: [i64; AXES]) {
        self.nm_per_count = nm_per_count;
    }

    fn grid(&self) -> Grid {
        Grid(self.nm_per_count)
    }

    /// Forgets everything and begins where the axes are, so that enabling makes no jump. `escape` is where a retreat
    /// past the beginning leads, in a straight line (`s` below zero), for [`REACH`] at the most; at the escape point itself
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
        self.current = 0;
        self.now = Segment::Line(self.lead);
        self.oldest = Fixed(0).minus(length);
        self.start = self.oldest;
        (self.s, self.newest, self.furthest) = (Fixed(0), Fixed(0), Fixed(0));
        (self.mark, self.marked, self.passed, self.beside) = (Fixed(0), false, Fixed(0), false);
    }

    /// Appends a straight line to a point in counts.
    pub fn push_line(&mut self, to: Point) -> Result<(), Refused> {
        let mut nm = [0; AXES];
        for (nm, (to, nm_per_count)) in nm.iter_mut().zip(to.iter().zip(&self.nm_per_count)) {
            let whole = (to.0 >> FRACTION_BITS).saturating_mul(*nm_per_count);
            let part = (to.0 & ((1 << FRACTION_BITS) - 1)).saturating_mul(*nm_per_count);
            *nm = whole.saturating_add(part.saturating_add(1 << (FRACTION_BITS - 1)) >> FRACTION_BITS);
        }
        self.append(&Piece { shape: Shape::Line, to: nm, centre: [0; 2], mark: false, stop: false })
    }

    /// Appends a piece.
    ///
    /// # Errors
    /// See [`Refused`].
    pub fn append(&mut self, piece: &Piece) -> Result<(), Refused> {
        if self.waiting() >= AHEAD {
            return Err(Refused::QueueFull);
        }
        let mut packed = self.packed(piece)?;
        let grid = self.grid();
        let (place, end) = self.last();
        let ([_, x, y], [_, to_x, to_y]) = (place, packed.to);
        let next = packed.unpack(place, end, &self.datum, &grid);
        let before = match self.segments.len() {
            0 => Segment::Line(self.lead),
            slots => self.unpacked(slots).unwrap_or(Segment::Line(self.lead)),
        };
        if before.length().0 > 0 {
            packed.join(self.unit(before.direction(before.length())), self.unit(next.direction(Fixed(0))));
        }
        self.segments.push_back(packed).map_err(|_| Refused::QueueFull)?;
        self.beside |= (x, y) != (to_x, to_y) || piece.shape != Shape::Line;
        if self.current == 0 && self.lead.length().0 == 0 && self.segments.len() == 1 {
            // Only what the register holds can be gone back along.
            (self.current, self.now) = (1, next);
            self.come_past(&packed);
        }
        self.newest = self.newest.plus(packed.length());
        Ok(())
    }

    /// How far up and down a piece leads the first axis, nm.
    ///
    /// # Errors
    /// As if it were appended.
    pub fn extent(&self, piece: &Piece) -> Result<(i64, i64), Refused> {
        let packed = self.packed(piece)?;
        let (place, _) = self.last();
        let (least, most) = packed.extent(place);
        let [datum, ..] = self.datum_nm();
        Ok((datum.saturating_add(least.into()), datum.saturating_add(most.into())))
    }

    fn packed(&self, piece: &Piece) -> Result<Packed, Refused> {
        let mut to: Place = [0; AXES];
        for (axis, (place, (nm, datum))) in to.iter_mut().zip(piece.to.iter().zip(self.datum_nm())).enumerate() {
            let from_datum = nm.saturating_sub(datum);
            if from_datum.saturating_abs() > REACH {
                return Err(Refused::TooFar { axis: axis as u8 });
            }
            *place = from_datum as i32;
        }
        let (from, _) = self.last();
        Packed::new(from, to, piece)
    }

    fn datum_nm(&self) -> [i64; AXES] {
        let mut nm = [0; AXES];
        for (nm, (datum, nm_per_count)) in nm.iter_mut().zip(self.datum.iter().zip(&self.nm_per_count)) {
            *nm = (datum.0 >> FRACTION_BITS).saturating_mul(*nm_per_count);
        }
        nm
    }

    /// Direction in um per um.
    fn unit(&self, direction: [f32; AXES]) -> [f32; AXES] {
        let mut unit = direction;
        for (unit, nm_per_count) in unit.iter_mut().zip(&self.nm_per_count) {
            *unit *= *nm_per_count as f32 * 1e-3;
        }
        unit
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

    /// Steps along the path, positive toward the work, and says what stopped it short.
    pub fn step(&mut self, by: Fixed) -> Option<Bound> {
        let wanted = self.s.plus(by);
        let before = self.start;
        let bound = if by.0 >= 0 { self.forward(wanted) } else { self.backward(wanted) };
        if self.start != before {
            self.ready();
        }
        bound
    }

    /// A joint has been crossed.
    #[cold]
    fn ready(&mut self) {
        if let Some(now) = self.unpacked(self.current) {
            self.now = now;
        }
    }

    fn forward(&mut self, wanted: Fixed) -> Option<Bound> {
        for _ in 0..JOINTS {
            let Some(length) = self.length(self.current) else { return Some(Bound::End) };
            let end = self.start.plus(length);
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
            self.start = end;
            self.current = next;
            self.come_past(&segment);
            let lead = usize::from(self.lead.length().0 > 0);
            if self.current.wrapping_add(lead) > BEHIND.wrapping_add(1) {
                self.forget();
            }
        }
        Some(Bound::Joints)
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

    fn come_past(&mut self, segment: &Packed) {
        if segment.mark && !(self.marked && self.start < self.mark) {
            (self.mark, self.marked) = (self.start, true);
        }
    }

    /// Where a retreat ends, and what ends it there.
    fn floor(&self) -> (Fixed, Bound) {
        let distance = self.furthest.minus(self.retreat);
        let (floor, bound) =
            if distance >= self.oldest { (distance, Bound::Distance) } else { (self.oldest, Bound::Memory) };
        if self.marked && self.marks && self.mark >= floor { (self.mark, Bound::Mark) } else { (floor, bound) }
    }

    fn backward(&mut self, wanted: Fixed) -> Option<Bound> {
        let (floor, bound) = self.floor();
        // A bound set behind the head's back must not push it forward.
        let floor = floor.min(self.s);
        let (wanted, bound) = if wanted < floor { (floor, Some(bound)) } else { (wanted, None) };
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

    /// Axis setpoints at the present coordinate, counts.
    #[inline]
    pub fn setpoint(&self) -> Point {
        self.now.at(self.s.minus(self.start))
    }

    /// Axis travel for a short travel along the path from the present coordinate, counts: what a setpoint goes on by between
    /// two steps. A joint in between shows only at the next step.
    #[inline(always)]
    pub fn travel(&self, by: Fixed) -> Point {
        self.now.travel(self.s.minus(self.start), by)
    }

    /// Axis travel per path travel at the present coordinate, counts per um.
    #[inline(always)]
    pub fn direction(&self) -> [f32; AXES] {
        self.now.direction(self.s.minus(self.start))
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

    /// Whether a stop before that is reached, and not over.
    pub fn at_stop(&self) -> bool {
        let ends = |length| self.s >= self.start.plus(length) && !self.at_end();
        self.stops(self.current, self.s) && self.length(self.current).is_some_and(ends)
    }

    /// The stop that is reached is over.
    pub fn pass_stop(&mut self) {
        self.passed = self.passed.max(self.s);
    }

    /// Whether an erosion ends at the end of what is in a slot.
    fn stops(&self, slot: usize, end: Fixed) -> bool {
        end > self.passed && self.segment(slot).is_some_and(|segment| segment.stop)
    }

    /// Whether this is the farthest that was reached since the restart.
    pub fn is_at_front(&self) -> bool {
        self.s >= self.furthest
    }

    /// Length of path from a coordinate to the end.
    pub fn ahead_of(&self, s: Fixed) -> Fixed {
        self.newest.minus(s)
    }

    /// Length of path ahead. A corner counts as an end as much farther away as the speed is that it may be passed with:
    /// v^2 = a d, with the v that no axis changes by more than `acceleration` does in the time of a plan.
    pub fn ahead(&self, acceleration: MicrometresPerSecond2) -> Micrometres {
        let mut least = self.newest.minus(self.s).to_f32();
        let Some(length) = self.length(self.current) else { return Micrometres(least) };
        let mut joint = self.start.plus(length);
        let mut slot = self.current.wrapping_add(1);
        for looked in 0..JOINTS {
            let left = joint.minus(self.s).to_f32();
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
        let mut joint = self.start;
        let mut slot = self.current;
        for looked in 0..JOINTS {
            let left = self.s.minus(joint).to_f32();
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

    /// Length that a retreat can still cover.
    pub fn left_behind(&self) -> Micrometres {
        Micrometres(self.s.minus(self.floor().0).to_f32())
    }

    /// Whether the path leads another axis than the first, since it began: then that one's place tells nothing of the coordinate.
    pub fn leads_beside(&self) -> bool {
        self.beside
    }

    /// Sets how far a retreat may go behind the furthest point; marks bound it as well.
    pub fn set_retreat(&mut self, retreat: Fixed) {
        (self.retreat, self.marks) = (retreat, true);
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

    /// Lets a retreat go back as far as there is path.
    pub fn free_retreat(&mut self) {
        (self.retreat, self.marks) = (Fixed(i64::MAX), false);
    }
}

/// What a corner adds to the length before it, um. Beyond the last joint that is looked at nothing is known.
fn passing(corner: f32, acceleration: MicrometresPerSecond2, looked: usize) -> f32 {
    if looked.wrapping_add(1) == JOINTS {
        0.0
    } else if corner > 0.0 {
        acceleration.0 * (CORNER_S / corner) * (CORNER_S / corner)
    } else {
        f32::INFINITY
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    type Small = Register<1281>;

    /// 1 and 2 counts per um, and um.
    const GRID: [i64; AXES] = [1000, 500, 1000];

    fn um(x: i64) -> Fixed {
        Fixed::whole(x)
    }

    fn small() -> Small {
        let mut path = Small::EMPTY;
        path.scale(GRID);
        path.restart([Fixed(0); AXES], [Fixed(0); AXES]);
        path.set_retreat(um(100_000));
        path
    }

    fn at([x, y]: [i64; 2]) -> Point {
        [um(x), um(y), um(0)]
    }

    fn path(points: &[[i64; 2]]) -> Small {
        let mut path = small();
        for point in points {
            path.push_line(at(*point)).unwrap();
        }
        path
    }

    #[test]
    fn enabling_makes_no_jump() {
        let mut path = path(&[[10, 0]]);
        path.step(um(3));
        path.restart(at([-7, 5]), at([-7, -95]));
        assert_eq!(path.setpoint(), at([-7, 5]));
        assert_eq!(path.s(), um(0));
        assert_eq!(path.step(um(-20)), None);
        assert_eq!(path.setpoint(), at([-7, -35]));
        assert_eq!(path.step(um(-31)), Some(Bound::Memory));
        assert_eq!(path.setpoint(), at([-7, -95]));
    }

    #[test]
    fn at_the_escape_point_there_is_nothing_to_retrace() {
        let mut path = path(&[]);
        path.restart(at([1, 1]), at([1, 1]));
        assert!(path.at_end());
        assert_eq!(path.step(um(-1)), Some(Bound::Memory));
        assert_eq!(path.step(um(1)), Some(Bound::End));
        assert_eq!(path.setpoint(), at([1, 1]));
    }

    #[test]
    fn a_retreat_says_what_bounds_it() {
        let mut path = path(&[[50, 0], [50, 50]]);
        assert_eq!(path.step(um(60)), None);
        path.set_retreat(um(40));
        assert_eq!(path.step(um(-39)), None);
        assert_eq!(path.step(um(-2)), Some(Bound::Distance));
        assert_eq!(path.s(), um(20));
        path.set_retreat(um(30));
        assert_eq!(path.step(um(-1)), Some(Bound::Distance));
        assert_eq!(path.s(), um(20), "a bound set too late holds, it does not push");
        path.set_retreat(um(1000));
        assert_eq!(path.step(um(-30)), Some(Bound::Memory));
        assert_eq!(path.s(), um(0));
    }

    #[test]
    fn the_end_is_reported_and_more_path_goes_on_from_there() {
        let mut path = path(&[[10, 0]]);
        assert_eq!(path.step(um(11)), Some(Bound::End));
        assert!(path.at_end());
        path.push_line(at([10, 8])).unwrap();
        assert!(!path.at_end());
        assert_eq!(path.step(um(1)), None);
        assert_eq!(path.setpoint(), at([10, 2]));
    }

    #[test]
    fn the_queue_refuses_the_257th_waiting_segment_and_the_history_keeps_1024() {
        let mut path = path(&[]);
        let mut x = 0;
        let mut refused = 0;
        for _ in 0..5000 {
            match path.push_line(at([x + 1, 0])) {
                Ok(()) => x += 1,
                Err(Refused::QueueFull) => {
                    assert_eq!(path.waiting(), AHEAD);
                    refused += 1;
                    path.step(um(1));
                }
                Err(other) => panic!("{other:?}"),
            }
        }
        assert!(refused > 2000);
        let top = path.s();
        while path.step(um(-1)).is_none() {}
        assert_eq!(top.minus(path.s()), um(BEHIND as i64 + 1));
        assert_eq!(path.push_line(at([x, 0])), Err(Refused::QueueFull), "retracing does not make room");
    }

    #[test]
    fn a_step_across_many_short_segments_is_bounded_and_loses_nothing() {
        let mut path = path(&[]);
        for x in 1..=20 {
            path.push_line(at([x, 0])).unwrap();
        }
        assert_eq!(path.step(um(20)), Some(Bound::Joints));
        let reached = path.s();
        assert!(reached >= um(7) && reached < um(20));
        while path.step(um(-20)) == Some(Bound::Joints) {}
        assert_eq!(path.s(), um(0));
    }

    #[test]
    fn a_retrace_returns_to_the_same_counts_after_a_million_reversals() {
        let mut path = path(&[[300, 70], [310, -500], [-40, -500], [-41, 0]]);
        let mut seed = 1u64;
        for _ in 0..1_000_000 {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            path.step(Fixed(((seed >> 40) as i64 - (1 << 23)) * 64));
        }
        path.set_retreat(um(1_000_000));
        while path.step(um(-50)) != Some(Bound::Memory) {}
        assert_eq!(path.setpoint(), at([0, 0]));
        while path.step(um(50)) != Some(Bound::End) {}
        assert_eq!(path.setpoint(), at([-41, 0]));
    }

    proptest! {
        /// The setpoint depends on the coordinate alone, not on how it was reached.
        #[test]
        fn the_setpoint_is_a_pure_function_of_the_coordinate(
            points in prop::collection::vec([-500i64..500, -500i64..500], 1..12),
            steps in prop::collection::vec(-(1i64 << 31)..(1i64 << 31), 1..200),
        ) {
            let mut wandering = small();
            let mut straight = small();
            for point in &points {
                prop_assert_eq!(wandering.push_line(at(*point)), straight.push_line(at(*point)));
            }
            for by in steps {
                wandering.step(Fixed(by));
            }
            while straight.s() < wandering.s() {
                straight.step(wandering.s().minus(straight.s()));
            }
            prop_assert_eq!(wandering.s(), straight.s());
            prop_assert_eq!(wandering.setpoint(), straight.setpoint());
        }
    }
}
