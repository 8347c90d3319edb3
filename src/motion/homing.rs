//! Homing: looks for a place that the axis can find again (IEC 61800-7-201, homing methods).
//!
//! The negative limit is the upper one, the positive limit the lower one; they are where the head turns round here, not
//! faults. *Fast* is the velocity toward a switch, *slow* the one toward the edge of a switch or an index mark.

use super::{Profile, Ramp, TrajectorySegment};
use crate::encoder::Mark;
use crate::units::{CountsPerSecond, CountsPerSecond2, Fixed};

/// What is looked for. The number is the one in 6098h.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Method {
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
}

/// How homing goes on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outcome {
    /// It moves.
    Moves(TrajectorySegment),
    /// The axis stands; the place that was looked for is at this position.
    Found(i64),
    /// The axis stands; there is no such place within the distance.
    Missed,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Step {
    /// To the switch.
    ToSwitch,
    /// Off the switch again, to its edge.
    OffSwitch,
    /// To the next mark; marks crossed so far.
    ToMark(u32),
    /// Comes to rest.
    Rest(Option<i64>),
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
    step: Step,
    start: i64,
}

impl Homing {
    /// Begins where the axis is.
    pub fn new(
        method: Method,
        fast: CountsPerSecond,
        slow: CountsPerSecond,
        acceleration: CountsPerSecond2,
        distance: i64,
        seen: &Seen,
    ) -> Homing {
        let step = match method {
            Method::Here => Step::Rest(Some(seen.position)),
            Method::MarkAbove | Method::MarkBelow => Step::ToMark(seen.mark.crossings),
            _ => Step::ToSwitch,
        };
        Homing { method, fast, slow, acceleration, distance, step, start: seen.position }
    }

    /// Plans on; `ticks` have passed since the plan before.
    pub fn plan(&mut self, profile: &mut Profile, seen: &Seen, ticks: u32) -> Outcome {
        self.look(seen);
        let gone = seen.position.saturating_sub(self.start).saturating_abs();
        if gone > self.distance && !matches!(self.step, Step::Rest(_)) {
            self.step = Step::Rest(None);
        }
        // Toward the work: away from the upper switch, or toward the lower one.
        let up = matches!(self.method, Method::UpperLimitAndMark | Method::UpperLimit);
        let (toward_work, velocity) = match self.step {
            Step::ToSwitch => (!up, self.fast),
            Step::OffSwitch => (up, self.slow),
            Step::ToMark(_) => match self.method {
                Method::MarkAbove => (false, self.slow),
                Method::MarkBelow => (true, self.slow),
                _ => (up, self.slow),
            },
            Step::Rest(found) => {
                let segment = profile.stop(self.acceleration, ticks);
                return match (profile.stands(), found) {
                    (false, _) => Outcome::Moves(segment),
                    (true, Some(position)) => Outcome::Found(position),
                    (true, None) => Outcome::Missed,
                };
            }
        };
        let ramp = Ramp { velocity, acceleration: self.acceleration, deceleration: self.acceleration };
        let far = Fixed::whole(if toward_work { Fixed::MAX_WHOLE } else { -Fixed::MAX_WHOLE });
        Outcome::Moves(profile.toward(far, &ramp, ticks))
    }

    fn look(&mut self, seen: &Seen) {
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
                Method::UpperLimit | Method::LowerLimit => Step::Rest(Some(seen.position)),
                _ => Step::ToMark(seen.mark.crossings),
            },
            Step::ToMark(before) if seen.mark.crossings != before => Step::Rest(Some(seen.marked)),
            step => step,
        };
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

    impl Axis {
        fn seen(&self) -> Seen {
            Seen {
                position: self.position,
                upper: self.position < 100,
                lower: self.position > 49_900,
                mark: Mark { crossings: self.crossings, ..Mark::default() },
                marked: self.marked,
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
        assert_eq!(home(17, 24_321, 24_000), Outcome::Missed);
        assert!(matches!(home(17, 24_321, 24_300), Outcome::Found(_)));
        assert_eq!(home(34, 24_321, 5_000), Outcome::Missed);
    }

    #[test]
    fn other_numbers_are_no_methods() {
        assert_eq!((i8::MIN..=i8::MAX).filter(|n| Method::from_number(*n).is_some()).count(), 8);
    }
}
