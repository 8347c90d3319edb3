//! Index marks: where each was seen, and whether the distance between two is what the scale promises.
//!
//! Terms: the index line is high over a stretch of the scale, the *mark*. Its *position* is the lowest count at which the
//! line is high, that is the edge of the mark which faces away from the work, whichever way it is crossed. So a mark has
//! the same position from both sides, and its width does not matter as long as it is one count or more (a quarter of an
//! encoder line: what a gated index output gives).
//! If an index edge lies so close to an edge of A or B that the interrupt may see either first, the position is that count
//! or the one below it: allow for this count in the tolerance.
//!
//! [L] sections 2 and 3: a reference mark every 10 mm at 1 um per transition, hence the default distance of 10 000 counts.

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
/// A change of the index line alone does not say which edge of the mark it was: the axis may have turned since the last
/// count. What says it is the level at the end of the present count where the axis came in. Coming in low while moving
/// toward the work, or high while moving away, the edge inside this count is the low one, however often it is crossed.
#[derive(Clone, Debug)]
pub(super) struct MarkLatch {
    high: bool,
    entry: Option<Entry>,
    mark: Mark,
}

/// How the axis came into the present count.
#[derive(Clone, Copy, Debug)]
struct Entry {
    toward_work: bool,
    high: bool,
}

impl MarkLatch {
    pub(super) fn new(high: bool) -> Self {
        MarkLatch { high, entry: None, mark: Mark::default() }
    }

    /// The index line may have changed, the count has not.
    pub(super) fn level(&mut self, high: bool, count: u32) {
        if high != self.high {
            self.high = high;
            if self.entry.is_some_and(|entry| entry.toward_work != entry.high) {
                self.cross(count);
            }
        }
    }

    /// The count has changed, and the index line may have changed with it.
    pub(super) fn step(&mut self, high: bool, before: u32, after: u32, toward_work: bool) {
        self.entry = Some(Entry { toward_work, high });
        if high != self.high {
            self.high = high;
            if high == toward_work {
                self.cross(if high { after } else { before });
            }
        }
    }

    /// The count is no longer known to follow the scale: what happened to the index line meanwhile says nothing.
    pub(super) fn lose(&mut self, high: bool) {
        self.high = high;
        self.entry = None;
    }

    fn cross(&mut self, count: u32) {
        self.mark = Mark { count, toward_work: self.high, crossings: self.mark.crossings.wrapping_add(1) };
    }

    pub(super) fn mark(&self) -> Mark {
        self.mark
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
    /// 10 000 counts [L]; one count for an index edge that falls together with an edge of A or B. One illegal transition
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
    last: Mark,
    wrong: u32,
}

impl MarkCheck {
    /// Takes the first mark that comes as it is.
    pub fn new(spacing: MarkSpacing) -> Self {
        MarkCheck { spacing, last: Mark::default(), wrong: 0 }
    }

    /// Takes the newest mark, new or not, at least once per crossing of a further mark. `Err` says, once per new mark, that
    /// its distance is wrong; the next distance is measured from this mark.
    pub fn update(&mut self, mark: Mark) -> Result<(), WrongDistance> {
        let last = core::mem::replace(&mut self.last, mark);
        let crossings = mark.crossings.wrapping_sub(last.crossings);
        if crossings == 0 || last.crossings == 0 {
            return Ok(());
        }
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
