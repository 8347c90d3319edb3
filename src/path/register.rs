//! The register: where on the path the head is, what lies ahead and what can be retraced.

use super::{Line, Segment};
use crate::units::{Fixed, Micrometres};
use heapless::Deque;

/// Segments that can wait ahead of the one under way.
pub const AHEAD: usize = 256;
/// Segments already passed that can be retraced.
pub const BEHIND: usize = 1024;

/// Joints crossed in one step at the most: a bounded tick, even through a row of segments shorter than a step.
const JOINTS_PER_STEP: usize = 8;

/// What stopped a step short.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Bound {
    /// Forward: the end of the last segment.
    End,
    /// Backward: nothing older is remembered.
    Memory,
    /// Backward: the set retreat distance.
    Distance,
    /// Either way: more joints in one step than a tick may take; the rest follows in the next.
    Joints,
}

/// Why a segment was refused. Nothing was changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Refused {
    /// [`AHEAD`] segments wait already.
    QueueFull,
    /// From the end of the path to the end of the path.
    NoLength,
}

/// Path with history, `N` segments in all.
#[derive(Debug)]
pub struct Register<const A: usize, const N: usize> {
    segments: Deque<Segment<A>, N>,
    counts_per_um: [f32; A],
    /// Where the path begins while there is no segment.
    origin: [Fixed; A],
    /// Index of the segment under way.
    current: usize,
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
}

impl<const A: usize, const N: usize> Register<A, N> {
    /// A path that begins at the origin, with no room for a retreat and no scale: [`Register::scale`] gives it one. Every bit
    /// is 0, so that it can be written in place.
    pub const EMPTY: Self = Register {
        segments: Deque::new(),
        counts_per_um: [0.0; A],
        origin: [Fixed(0); A],
        current: 0,
        start: Fixed(0),
        s: Fixed(0),
        oldest: Fixed(0),
        newest: Fixed(0),
        furthest: Fixed(0),
        retreat: Fixed(0),
    };

    /// Sets the counts per um of each axis, for lines that are appended from now on.
    pub fn scale(&mut self, counts_per_um: [f32; A]) {
        self.counts_per_um = counts_per_um;
    }

    /// Forgets everything and begins where the axes are, so that enabling makes no jump. `escape` is where a retreat
    /// past the beginning leads, in a straight line (`s` below zero); at the escape point itself there is none.
    pub fn restart(&mut self, here: [Fixed; A], escape: [Fixed; A]) {
        self.segments.clear();
        self.origin = here;
        self.current = 0;
        self.start = Fixed(0);
        self.s = Fixed(0);
        self.oldest = Fixed(0);
        self.newest = Fixed(0);
        self.furthest = Fixed(0);
        let Some(line) = Line::new(escape, here, self.counts_per_um) else { return };
        // Only what the register holds can be gone back along.
        if self.segments.push_back(line.into()).is_ok() {
            self.oldest = Fixed(0).minus(line.length());
            self.start = self.oldest;
        }
    }

    /// Appends a straight line to a point in counts.
    pub fn push_line(&mut self, to: [Fixed; A]) -> Result<(), Refused> {
        if self.waiting() >= AHEAD {
            return Err(Refused::QueueFull);
        }
        let line = Line::new(self.end(), to, self.counts_per_um).ok_or(Refused::NoLength)?;
        self.segments.push_back(line.into()).map_err(|_| Refused::QueueFull)?;
        self.newest = self.newest.plus(line.length());
        Ok(())
    }

    /// Steps along the path, positive toward the work, and says what stopped it short.
    pub fn step(&mut self, by: Fixed) -> Option<Bound> {
        let wanted = self.s.plus(by);
        if by.0 >= 0 { self.forward(wanted) } else { self.backward(wanted) }
    }

    fn forward(&mut self, wanted: Fixed) -> Option<Bound> {
        for _ in 0..JOINTS_PER_STEP {
            let Some(segment) = self.segments.get(self.current) else { return Some(Bound::End) };
            let end = self.start.plus(segment.length());
            if wanted <= end {
                self.arrive(wanted);
                return None;
            }
            self.arrive(end);
            if self.current.wrapping_add(1) >= self.segments.len() {
                return Some(Bound::End);
            }
            self.start = end;
            self.current = self.current.wrapping_add(1);
            if self.current > BEHIND
                && let Some(forgotten) = self.segments.pop_front()
            {
                self.oldest = self.oldest.plus(forgotten.length());
                self.current = self.current.wrapping_sub(1);
            }
        }
        Some(Bound::Joints)
    }

    /// Where a retreat ends, and what ends it there.
    fn floor(&self) -> (Fixed, Bound) {
        let distance = self.furthest.minus(self.retreat);
        if distance >= self.oldest { (distance, Bound::Distance) } else { (self.oldest, Bound::Memory) }
    }

    fn backward(&mut self, wanted: Fixed) -> Option<Bound> {
        let (floor, bound) = self.floor();
        // A bound set behind the head's back must not push it forward.
        let floor = floor.min(self.s);
        let (wanted, bound) = if wanted < floor { (floor, Some(bound)) } else { (wanted, None) };
        for _ in 0..JOINTS_PER_STEP {
            if wanted >= self.start {
                self.arrive(wanted);
                return bound;
            }
            self.arrive(self.start);
            let previous = self.current.checked_sub(1).and_then(|index| Some((index, self.segments.get(index)?)));
            let Some((index, segment)) = previous else { return bound };
            self.start = self.start.minus(segment.length());
            self.current = index;
        }
        Some(Bound::Joints)
    }

    fn arrive(&mut self, s: Fixed) {
        self.s = s;
        self.furthest = self.furthest.max(s);
    }

    /// Axis setpoints at the present coordinate, counts.
    pub fn setpoint(&self) -> [Fixed; A] {
        self.segments.get(self.current).map_or(self.origin, |segment| segment.at(self.s.minus(self.start)))
    }

    /// Axis travel for a short travel along the path from the present coordinate, counts: what a setpoint goes on by between
    /// two steps. A joint in between shows only at the next step.
    pub fn travel(&self, by: Fixed) -> [Fixed; A] {
        let from = self.s.minus(self.start);
        self.segments.get(self.current).map_or([Fixed(0); A], |segment| segment.travel(from, by))
    }

    /// Axis travel per path travel at the present coordinate, counts per um.
    pub fn direction(&self) -> [f32; A] {
        self.segments.get(self.current).map_or([0.0; A], |segment| segment.direction(self.s.minus(self.start)))
    }

    /// Path coordinate, um.
    pub fn s(&self) -> Fixed {
        self.s
    }

    /// End of the last segment, counts.
    pub fn end(&self) -> [Fixed; A] {
        self.segments.back().map_or(self.origin, |segment| segment.end())
    }

    /// Segments waiting behind the one under way.
    pub fn waiting(&self) -> usize {
        self.segments.len().saturating_sub(self.current.saturating_add(1))
    }

    /// Whether the end of the last segment is reached.
    pub fn at_end(&self) -> bool {
        self.s >= self.newest
    }

    /// Length of path ahead.
    pub fn ahead(&self) -> Micrometres {
        Micrometres(self.newest.minus(self.s).to_f32())
    }

    /// Length that a retreat can still cover.
    pub fn behind(&self) -> Micrometres {
        Micrometres(self.s.minus(self.floor().0).to_f32())
    }

    /// Sets how far a retreat may go behind the furthest point.
    pub fn set_retreat(&mut self, retreat: Fixed) {
        self.retreat = retreat;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    type Small = Register<2, 1281>;

    fn um(x: i64) -> Fixed {
        Fixed::whole(x)
    }

    fn small() -> Small {
        let mut path = Small::EMPTY;
        path.scale([1.0, 2.0]);
        path.set_retreat(um(100_000));
        path
    }

    fn path(points: &[[i64; 2]]) -> Small {
        let mut path = small();
        for point in points {
            path.push_line(point.map(um)).unwrap();
        }
        path
    }

    #[test]
    fn enabling_makes_no_jump() {
        let mut path = path(&[[10, 0]]);
        path.step(um(3));
        path.restart([um(-7), um(5)], [um(-7), um(-95)]);
        assert_eq!(path.setpoint(), [um(-7), um(5)]);
        assert_eq!(path.s(), um(0));
        assert_eq!(path.step(um(-20)), None);
        assert_eq!(path.setpoint(), [um(-7), um(-35)]);
        assert_eq!(path.step(um(-31)), Some(Bound::Memory));
        assert_eq!(path.setpoint(), [um(-7), um(-95)]);
    }

    #[test]
    fn at_the_escape_point_there_is_nothing_to_retrace() {
        let mut path = path(&[]);
        path.restart([um(1), um(1)], [um(1), um(1)]);
        assert!(path.at_end());
        assert_eq!(path.step(um(-1)), Some(Bound::Memory));
        assert_eq!(path.step(um(1)), Some(Bound::End));
        assert_eq!(path.setpoint(), [um(1), um(1)]);
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
        path.push_line([um(10), um(8)]).unwrap();
        assert!(!path.at_end());
        assert_eq!(path.step(um(1)), None);
        assert_eq!(path.setpoint(), [um(10), um(2)]);
    }

    #[test]
    fn the_queue_refuses_the_257th_waiting_segment_and_the_history_keeps_1024() {
        let mut path = path(&[]);
        let mut x = 0;
        let mut refused = 0;
        for _ in 0..5000 {
            match path.push_line([um(x + 1), um(0)]) {
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
        assert_eq!(path.push_line([um(x), um(0)]), Err(Refused::QueueFull), "retracing does not make room");
    }

    #[test]
    fn a_step_across_many_short_segments_is_bounded_and_loses_nothing() {
        let mut path = path(&[]);
        for x in 1..=20 {
            path.push_line([um(x), um(0)]).unwrap();
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
        assert_eq!(path.setpoint(), [um(0), um(0)]);
        while path.step(um(50)) != Some(Bound::End) {}
        assert_eq!(path.setpoint(), [um(-41), um(0)]);
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
                prop_assert_eq!(wandering.push_line(point.map(um)), straight.push_line(point.map(um)));
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
