//! Homing: looks for a place that the axis can find again (IEC 61800-7-201, homing methods).
//!
//! The negative limit is the upper one, the positive limit the lower one; they are where the head turns round here, not
//! faults. *Fast* is the velocity toward a switch, *slow* the one toward the edge of a switch, an index mark or the work.
//!
//! An axis that meets what it does not look for has found nothing, and goes back from there: that it moves shows that its encoder
//! lives.

use super::{Profile, Ramp, TrajectorySegment};
use crate::encoder::Mark;
use crate::units::{CountsPerSecond, CountsPerSecond2, Fixed};

/// What is looked for. The number is the one in 6098h.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Method {
    /// Where electrode and work touch. The manufacturer's range.
    Contact = -1,
    /// First index mark below the upper limit switch.
    UpperLimitAndMark = 1,
    /// First index mark above the lower limit switch.
    LowerLimitAndMark = 2,
    /// Edge of the upper limit switch.
    UpperLimit = 17,
    /// Edge of the lower limit switch.
    LowerLimit = 18,
    /// Next index mark upward.
    MarkAbove = 33,
    /// Next index mark downward.
    MarkBelow = 34,
    /// Where the axis is; 37 means the same.
    Here = 35,
}

impl Method {
    /// The method of a number.
    pub fn from_number(number: i8) -> Option<Method> {
        Some(match number {
            -1 => Method::Contact,
            1 => Method::UpperLimitAndMark,
            2 => Method::LowerLimitAndMark,
            17 => Method::UpperLimit,
            18 => Method::LowerLimit,
            33 => Method::MarkAbove,
            34 => Method::MarkBelow,
            35 | 37 => Method::Here,
            _ => return None,
        })
    }
}

/// What a plan sees of the axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Seen {
    /// Position, counts.
    pub position: i64,
    /// The upper limit switch is open.
    pub upper: bool,
    /// The lower limit switch is open.
    pub lower: bool,
    /// Newest index mark.
    pub mark: Mark,
    /// Position of that mark, counts.
    pub marked: i64,
    /// Electrode and work have touched, and nothing has pressed on since.
    pub touches: bool,
    /// The axis does not follow: something is in its way.
    pub blocked: bool,
}

/// Why a reference was not found. The number is the one in 2000h:9.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Missed {
    /// There is no such place within the distance.
    NotThere = 1,
    /// Its position would put the axis outside its travel.
    OutOfTravel = 2,
    /// The axis came up against something: a stop without a switch.
    Blocked = 3,
    /// Electrode and work have touched.
    Touched = 4,
}

/// How far an axis goes back from what it has met, counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clearance {
    /// From the work that was looked for; at least, from anything else.
    pub least: i64,
    /// At most, from anything else: never beyond where it has begun otherwise.
    pub most: i64,
}

/// The next step of a homing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outcome {
    /// It moves.
    Moves(TrajectorySegment),
    /// The axis stands; the place that was looked for is at this position.
    Found(i64),
    /// The axis stands, and has no reference.
    Missed(Missed),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Step {
    /// To the switch.
    ToSwitch,
    /// Off the switch again, to its edge.
    OffSwitch,
    /// To the next mark; marks crossed so far.
    ToMark(u32),
    /// To the work.
    ToWork,
    /// Back to a position from what was in the way.
    Back(i64, Result<i64, Missed>),
    /// Comes to rest.
    Rest(Result<i64, Missed>),
}

/// Homing under way.
#[derive(Clone, Copy, Debug)]
pub struct Homing {
    method: Method,
    fast: CountsPerSecond,
    slow: CountsPerSecond,
    acceleration: CountsPerSecond2,
    /// Length after which there is nothing to be found, counts.
    distance: i64,
    clearance: Clearance,
    step: Step,
    start: i64,
    /// Where it began.
    began: i64,
}

impl Homing {
    /// Begins where the axis is.
    pub fn new(
        method: Method,
        fast: CountsPerSecond,
        slow: CountsPerSecond,
        acceleration: CountsPerSecond2,
        distance: i64,
        clearance: Clearance,
        seen: &Seen,
    ) -> Homing {
        let step = match method {
            Method::Contact => Step::ToWork,
            Method::Here => Step::Rest(Ok(seen.position)),
            Method::MarkAbove | Method::MarkBelow => Step::ToMark(seen.mark.crossings),
            _ => Step::ToSwitch,
        };
        let start = seen.position;
        Homing { method, fast, slow, acceleration, distance, clearance, step, start, began: start }
    }

    /// Whether it still looks for its place.
    pub fn looks(&self) -> bool {
        !matches!(self.step, Step::Back(..) | Step::Rest(_))
    }

    /// Plans on; `ticks` have passed since the plan before.
    pub fn plan(&mut self, profile: &mut Profile, seen: &Seen, ticks: u32) -> Outcome {
        self.look(seen);
        let gone = seen.position.saturating_sub(self.start).saturating_abs();
        if gone > self.distance && self.looks() {
            self.step = Step::Rest(Err(Missed::NotThere));
        }
        let velocity = if self.step == Step::ToSwitch { self.fast } else { self.slow };
        let ramp = Ramp { velocity, acceleration: self.acceleration, deceleration: self.acceleration };
        match self.step {
            Step::Back(to, found) => {
                let to = Fixed::whole(to);
                let segment = profile.toward(to, &ramp, ticks);
                if profile.stands() && segment.from == to { ended(found) } else { Outcome::Moves(segment) }
            }
            Step::Rest(found) => {
                let segment = profile.stop(self.acceleration, ticks);
                if profile.stands() { ended(found) } else { Outcome::Moves(segment) }
            }
            _ => {
                let whole = if self.is_toward_work() { Fixed::MAX_WHOLE } else { -Fixed::MAX_WHOLE };
                Outcome::Moves(profile.toward(Fixed::whole(whole), &ramp, ticks))
            }
        }
    }

    /// Which way it looks: away from the upper switch, or toward the lower one.
    fn is_toward_work(&self) -> bool {
        let up = matches!(self.method, Method::UpperLimitAndMark | Method::UpperLimit);
        match (self.step, self.method) {
            (Step::ToSwitch, _) => !up,
            (_, Method::MarkAbove) => false,
            (_, Method::MarkBelow | Method::Contact) => true,
            _ => up,
        }
    }

    /// Something is in the way.
    fn meet(&mut self, seen: &Seen) {
        let Clearance { least, most } = self.clearance;
        let here = seen.position;
        let far = here.saturating_sub(self.began).saturating_abs().min(most).max(least);
        let back = |by: i64| here.saturating_add(if self.is_toward_work() { by.saturating_neg() } else { by });
        self.step = match self.method {
            Method::Contact if seen.touches => Step::Back(back(least), Ok(here)),
            _ => Step::Back(back(far), Err(if seen.touches { Missed::Touched } else { Missed::Blocked })),
        };
    }

    fn look(&mut self, seen: &Seen) {
        if self.looks() && (seen.touches || seen.blocked) {
            self.meet(seen);
            return;
        }
        let open = match self.method {
            Method::UpperLimitAndMark | Method::UpperLimit => seen.upper,
            _ => seen.lower,
        };
        self.step = match self.step {
            Step::ToSwitch if open => {
                self.start = seen.position;
                Step::OffSwitch
            }
            Step::OffSwitch if !open => match self.method {
                Method::UpperLimit | Method::LowerLimit => Step::Rest(Ok(seen.position)),
                _ => Step::ToMark(seen.mark.crossings),
            },
            Step::ToMark(before) if seen.mark.crossings != before => Step::Rest(Ok(seen.marked)),
            step => step,
        };
    }
}

fn ended(found: Result<i64, Missed>) -> Outcome {
    match found {
        Ok(position) => Outcome::Found(position),
        Err(missed) => Outcome::Missed(missed),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::PLAN_TICKS;

    /// An axis that follows its set point exactly, with switches at both ends and marks every 10 000 counts.
    struct Axis {
        position: i64,
        crossings: u32,
        marked: i64,
    }

    const MARKS: i64 = 10_000;
    const CLEARANCE: Clearance = Clearance { least: 10, most: 500 };

    impl Axis {
        fn seen(&self) -> Seen {
            Seen {
                position: self.position,
                upper: self.position < 100,
                lower: self.position > 49_900,
                mark: Mark { crossings: self.crossings, ..Mark::default() },
                marked: self.marked,
                touches: false,
                blocked: false,
            }
        }

        fn go(&mut self, to: i64) {
            let (low, high) = (self.position.min(to), self.position.max(to));
            let next = if to > self.position { (low / MARKS + 1) * MARKS } else { high.div_euclid(MARKS) * MARKS };
            if low < next && next <= high {
                (self.crossings, self.marked) = (self.crossings + 1, next);
            }
            self.position = to;
        }
    }

    fn home(method: i8, from: i64, distance: i64) -> Outcome {
        let mut axis = Axis { position: from, crossings: 3, marked: 77 };
        let mut homing = Homing::new(
            Method::from_number(method).unwrap(),
            CountsPerSecond(20_000.0),
            CountsPerSecond(2_000.0),
            CountsPerSecond2(1e6),
            distance,
            CLEARANCE,
            &axis.seen(),
        );
        let mut profile = Profile::at(Fixed::whole(from));
        for _ in 0..1_000_000 {
            match homing.plan(&mut profile, &axis.seen(), PLAN_TICKS) {
                Outcome::Moves(segment) => axis.go(segment.from.round()),
                end => return end,
            }
        }
        panic!("never ends: {homing:?}");
    }

    #[test]
    fn each_method_finds_its_place_from_anywhere() {
        for from in [50, 5_000, 24_321, 49_950] {
            let near = |outcome: Outcome, place: i64| {
                assert!(matches!(outcome, Outcome::Found(at) if (at - place).abs() <= 1), "{outcome:?}, not {place}");
            };
            near(home(1, from, 60_000), MARKS);
            near(home(2, from, 60_000), 4 * MARKS);
            near(home(17, from, 60_000), 100);
            near(home(18, from, 60_000), 49_900);
            near(home(35, from, 60_000), from);
            near(home(37, from, 60_000), from);
        }
        assert_eq!(home(33, 24_321, 60_000), Outcome::Found(2 * MARKS));
        assert_eq!(home(34, 24_321, 60_000), Outcome::Found(3 * MARKS));
    }

    #[test]
    fn what_is_not_within_the_distance_is_missed() {
        assert_eq!(home(17, 24_321, 24_000), Outcome::Missed(Missed::NotThere));
        assert!(matches!(home(17, 24_321, 24_300), Outcome::Found(_)));
        assert_eq!(home(34, 24_321, 5_000), Outcome::Missed(Missed::NotThere));
        assert_eq!(home(-1, 24_321, 5_000), Outcome::Missed(Missed::NotThere));
    }

    /// What is in the way at `at`: the outcome, and where the axis rests.
    fn meet(method: i8, from: i64, at: i64, touches: bool) -> (Outcome, i64) {
        let mut axis = Axis { position: from, crossings: 3, marked: 77 };
        let method = Method::from_number(method).unwrap();
        let (fast, slow) = (CountsPerSecond(20_000.0), CountsPerSecond(2_000.0));
        let mut homing = Homing::new(method, fast, slow, CountsPerSecond2(1e6), 60_000, CLEARANCE, &axis.seen());
        let mut profile = Profile::at(Fixed::whole(from));
        for _ in 0..1_000_000 {
            let met = if at > from { axis.position >= at } else { axis.position <= at };
            let seen = Seen { touches: met && touches, blocked: met && !touches, ..axis.seen() };
            if met && homing.looks() {
                // Whoever looks begins anew where the axis is.
                profile = Profile::at(Fixed::whole(axis.position));
            }
            match homing.plan(&mut profile, &seen, PLAN_TICKS) {
                Outcome::Moves(segment) => axis.go(segment.from.round()),
                end => return (end, axis.position),
            }
        }
        panic!("never ends: {homing:?}");
    }

    #[test]
    fn the_work_is_found_where_it_is_looked_for_and_is_in_the_way_of_everything_else() {
        let near = |(outcome, rest): (Outcome, i64), back: i64, found: bool| {
            match outcome {
                Outcome::Found(at) => assert!(found && (at - 30_000).abs() <= 6, "{outcome:?}"),
                _ => assert!(!found && outcome == Outcome::Missed(Missed::Touched), "{outcome:?}"),
            }
            assert!((30_000 - back - rest).abs() <= 6, "at rest at {rest}");
        };
        near(meet(-1, 24_321, 30_000, true), 10, true);
        near(meet(34, 29_700, 30_000, true), 300, false);
        near(meet(18, 24_321, 30_000, true), 500, false);
    }

    #[test]
    fn whoever_is_blocked_goes_back_no_farther_than_where_it_began() {
        let blocked = Outcome::Missed(Missed::Blocked);
        for (method, from, at, rest) in
            [(17, 24_321, 20_000, 20_500), (17, 20_100, 20_000, 20_100), (-1, 24_321, 24_325, 24_315)]
        {
            let (outcome, position) = meet(method, from, at, false);
            assert!(outcome == blocked && (position - rest).abs() <= 6, "{method}: {outcome:?} at {position}");
        }
    }

    #[test]
    fn other_numbers_are_no_methods() {
        assert_eq!((i8::MIN..=i8::MAX).filter(|n| Method::from_number(*n).is_some()).count(), 9);
    }
}
