//! Index marks: where each was seen, and whether the distance between two is what the scale promises.
//!
//! Terms: the index line is high over a stretch of the scale, the *mark*. Its *position* is the lowest count at which the
//! line is seen high, whichever way the axis goes: both sides and any width give the same position. A mark is *crossed*
//! where its position and the count below meet, and latched when the axis has left the second of the two. The interrupt
//! must see the edges of the index line as well as those of A and B.
//!
//! A gated index output switches together with A or B. If the interrupt can see either edge first, the position may also be
//! the count below: allow for this count in the tolerance.
//!
//! \[L\] sections 2 and 3: a reference mark every 10 mm at 1 um per transition, hence the default distance of 10 000 counts.

use core::fmt;

/// A latched index mark.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Mark {
    /// Raw count at the mark, wrapping; [`super::Position::at`] turns it into a position.
    pub count: u32,
    /// Crossed toward the work.
    pub toward_work: bool,
    /// Marks crossed since the start, either way, wrapping. While it is 0 there is no mark.
    pub crossings: u32,
}

/// Finds the low edge of each mark in the levels the decoder sees.
///
/// A change of the index line alone does not say which edge of the mark it was, because the axis may have turned since the
/// last count. So the line is noted for a whole *stay* at a count, and two stays in a row say where the low edge is: not
/// seen high, then seen high one count nearer to the work, or the same backward.
#[derive(Clone, Debug)]
pub(super) struct MarkLatch {
    /// [`HIGH`], [`HIGH_BEFORE`], [`UNKNOWN_BEFORE`].
    line: u32,
}

/// The line has been high during this stay.
const HIGH: u32 = 1;
/// The line was high during the stay before, one count away.
const HIGH_BEFORE: u32 = 2;
/// There was no stay before that says anything.
const UNKNOWN_BEFORE: u32 = 4;

impl MarkLatch {
    /// Before the first stay; `high` is the index line, 0 or 1.
    pub(super) fn new(high: u32) -> Self {
        MarkLatch { line: UNKNOWN_BEFORE | high }
    }

    /// The latch whose [`MarkLatch::line`] was `line`.
    pub(super) fn of(line: u32) -> Self {
        MarkLatch { line }
    }

    /// What it knows; 0 away from marks, where a step need not ask it while the line is low.
    pub(super) fn line(&self) -> u32 {
        self.line
    }

    /// The stay continues.
    pub(super) fn stay(&mut self, high: u32) {
        self.line |= high;
    }

    /// The stay at `count`, which began by a step toward the work or away, ends with a step after which the line is `high`.
    /// `Some` is the position of a mark that has been crossed, in the direction in which this stay began.
    pub(super) fn leave(&mut self, count: u32, toward_work: bool, high: u32) -> Option<u32> {
        let stays = self.line;
        self.line = (stays & HIGH) << 1 | high;
        match (stays, toward_work) {
            (HIGH, true) => Some(count),
            (HIGH_BEFORE, false) => Some(count.wrapping_add(1)),
            _ => None,
        }
    }
}

/// What the scale promises.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct MarkSpacing {
    /// Distance between neighbouring marks, counts.
    pub counts: u32,
    /// Allowed deviation of one distance, counts.
    pub tolerance: u32,
}

impl Default for MarkSpacing {
    /// 10 000 counts \[L\]; one count for an index edge that falls together with an edge of A or B. One illegal transition
    /// is two counts and shows.
    fn default() -> Self {
        MarkSpacing { counts: 10_000, tolerance: 1 }
    }
}

/// The distance between two marks is not what it should be: counts were lost or made up, or a mark was missed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct WrongDistance {
    /// Distance it should be, counts, positive toward the work; 0 for the same mark crossed back.
    pub expected: i32,
    /// Distance it is.
    pub measured: i32,
}

impl fmt::Display for WrongDistance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "index marks {} counts apart instead of {}", self.measured, self.expected)
    }
}

impl core::error::Error for WrongDistance {}

/// Checks each mark against the one before.
#[derive(Clone, Debug)]
pub struct MarkCheck {
    spacing: MarkSpacing,
    /// Crossings at the last look.
    crossings: u32,
    /// Newest mark since this began.
    last: Option<Mark>,
    wrong: u32,
}

impl MarkCheck {
    /// Begins after so many crossings, of which nothing is believed any more; takes the next mark that comes as it is.
    pub fn new(spacing: MarkSpacing, crossings: u32) -> Self {
        MarkCheck { spacing, crossings, last: None, wrong: 0 }
    }

    /// Takes the newest mark, new or not, at least once per crossing of a further mark. `Err` says, once per new mark, that
    /// its distance is wrong; the next distance is measured from this mark.
    pub fn update(&mut self, mark: Mark) -> Result<(), WrongDistance> {
        let crossings = mark.crossings.wrapping_sub(self.crossings);
        if crossings == 0 {
            return Ok(());
        }
        self.crossings = mark.crossings;
        let Some(last) = self.last.replace(mark) else { return Ok(()) };
        // Of several crossings since the last look only the newest is known. They are of one mark, trembled over, so they
        // alternate: whether the first of them left `last` behind or came back to it follows from their number.
        let first_toward_work = mark.toward_work == (crossings % 2 == 1);
        let counts = i32::try_from(self.spacing.counts).unwrap_or(i32::MAX);
        let expected = match (first_toward_work == last.toward_work, first_toward_work) {
            (false, _) => 0,
            (true, true) => counts,
            (true, false) => -counts,
        };
        let measured = mark.count.wrapping_sub(last.count) as i32;
        if measured.abs_diff(expected) <= self.spacing.tolerance {
            return Ok(());
        }
        self.wrong = self.wrong.wrapping_add(1);
        Err(WrongDistance { expected, measured })
    }

    /// Wrong distances since the start, wrapping.
    pub fn wrong(&self) -> u32 {
        self.wrong
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Marks as a decoder would latch them, each `crossings` after the one before.
    struct Marks(Mark);

    impl Marks {
        fn next(&mut self, count: i32, toward_work: bool, crossings: u32) -> Mark {
            self.0 = Mark { count: count as u32, toward_work, crossings: self.0.crossings.wrapping_add(crossings) };
            self.0
        }
    }

    fn started(count: i32, toward_work: bool) -> (MarkCheck, Marks) {
        let (mut check, mut marks) = (MarkCheck::new(MarkSpacing::default(), 0), Marks(Mark::default()));
        assert_eq!(check.update(marks.0), Ok(()));
        assert_eq!(check.update(marks.next(count, toward_work, 1)), Ok(()));
        (check, marks)
    }

    #[test]
    fn marks_at_their_distance_are_right_both_ways_and_when_the_axis_turns_between_them() {
        let (mut check, mut marks) = started(-4000, true);
        for (count, toward_work) in
            [(6000, true), (16_000, true), (16_000, false), (6000, false), (-4000, false), (-4000, true)]
        {
            let mark = marks.next(count, toward_work, 1);
            assert_eq!(check.update(mark), Ok(()));
            assert_eq!(check.update(mark), Ok(()), "the same mark seen again is no new mark");
        }
        assert_eq!(check.wrong(), 0);
    }

    #[test]
    fn a_distance_is_right_up_to_the_tolerance_and_wrong_beyond_it() {
        for (toward_work, expected) in [(true, 10_000), (false, -10_000)] {
            for deviation in -3..=3 {
                let (mut check, mut marks) = started(0, toward_work);
                let measured = expected + deviation;
                let result = check.update(marks.next(measured, toward_work, 1));
                if deviation.abs() <= 1 {
                    assert_eq!((result, check.wrong()), (Ok(()), 0));
                } else {
                    assert_eq!((result, check.wrong()), (Err(WrongDistance { expected, measured }), 1));
                }
            }
        }
    }

    #[test]
    fn coming_back_over_the_same_mark_the_distance_is_zero() {
        let (mut check, mut marks) = started(500, true);
        assert_eq!(check.update(marks.next(499, false, 1)), Ok(()));
        assert_eq!(
            check.update(marks.next(504, true, 1)),
            Err(WrongDistance { expected: 0, measured: 5 }),
            "counts made up while turning"
        );
    }

    #[test]
    fn trembling_over_a_mark_between_two_looks_is_understood_from_the_number_of_crossings() {
        // Last look: mark at 0, left toward the work. Any number of crossings of the mark at 10 000 later:
        for crossings in 1..8 {
            let (mut check, mut marks) = started(0, true);
            assert_eq!(check.update(marks.next(10_000, crossings % 2 == 1, crossings)), Ok(()));
        }
        // ... or of the same mark.
        for crossings in 1..8 {
            let (mut check, mut marks) = started(0, true);
            assert_eq!(check.update(marks.next(0, crossings % 2 == 0, crossings)), Ok(()));
        }
    }

    #[test]
    fn after_a_wrong_distance_the_next_is_measured_from_the_new_mark() {
        let (mut check, mut marks) = started(0, true);
        assert!(check.update(marks.next(9_996, true, 1)).is_err());
        assert_eq!(check.update(marks.next(19_996, true, 1)), Ok(()));
        assert_eq!(check.wrong(), 1);
    }

    #[test]
    fn nothing_is_measured_from_a_mark_that_was_crossed_before() {
        let (_, mut marks) = started(0, true);
        let mut check = MarkCheck::new(MarkSpacing::default(), marks.0.crossings);
        assert_eq!(check.update(marks.0), Ok(()));
        assert_eq!(check.update(marks.next(4, false, 1)), Ok(()), "counts were lost before this began");
        assert!(check.update(marks.next(0, true, 1)).is_err());
    }

    #[test]
    fn a_missed_mark_is_a_wrong_distance() {
        let (mut check, mut marks) = started(0, true);
        let wrong = WrongDistance { expected: 10_000, measured: 20_000 };
        assert_eq!(check.update(marks.next(20_000, true, 1)), Err(wrong));
    }

    #[test]
    fn marks_on_both_sides_of_the_wrap_of_the_count_are_at_their_distance() {
        let (mut check, mut marks) = started(i32::MAX - 10, true);
        assert_eq!(check.update(marks.next((i32::MAX - 10).wrapping_add(10_000), true, 1)), Ok(()));
    }
}
