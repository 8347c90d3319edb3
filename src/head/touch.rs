//! Finding the surface of the work: the electrode touches it twice, pulses off, on the contact sense.
//!
//! The first touch may be fast and says where about the surface is: the electrode presses on until it stands. Then the head goes
//! back and comes again, so slowly that the place where the contact shows is that of the surface; it is what is *found*.
//! Between the touches and before the first one the head rests until the sense supply has recovered from whatever was on the
//! gap, and the gap must read open: a lead that is broken reads as a contact wherever the head is. A head that touches from
//! the beginning goes back first.
//!
//! *Overshoot* is how far beyond the place found the axis has been. Every move is as long as the search says, so that it ends by
//! itself: nothing found is an answer, and no fault.

use crate::motion::{Profile, Ramp, TrajectorySegment};
use crate::units::{CountsPerSecond, CountsPerSecond2, Fixed, TICK_HZ};

/// Rest before the sense is believed: after pulses of 300 V it shows an open gap after 16 ms at the most (docs/wiring.md).
const SETTLE: u32 = TICK_HZ / 50;

/// How to touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Velocity of the first touch, and of every way back.
    pub first: CountsPerSecond,
    /// Velocity of the second touch.
    pub second: CountsPerSecond,
    /// Counts to go back from a touch.
    pub back: u32,
}

/// How the newest search for a surface stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Search {
    /// Never asked for.
    #[default]
    Never,
    /// Under way.
    Runs,
    /// The surface was found.
    Found,
    /// There was no contact within reach, or not a second time.
    Missed,
    /// The gap reads as a contact where the head has gone back: a short, the sense supply is off, or a lead is broken.
    NotOpen,
    /// Something else came between.
    BrokenOff,
}

/// What a plan feels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Felt {
    /// Position, counts.
    pub position: i64,
    /// Electrode and work touch, now or in the tick that this plan was called for.
    pub touches: bool,
    /// The upper limit switch is open: the head can rise no further.
    pub upper: bool,
    /// The lower limit switch is open: the travel ends here.
    pub lower: bool,
}

/// The next step of a search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Next {
    /// It moves.
    Moves(TrajectorySegment),
    /// It stands: the result, and where the surface is if it was found.
    Ends(Search, Option<i64>),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Step {
    /// At rest for so many more ticks.
    Settle(u32),
    /// Toward the work, to this position at the most.
    Approach(i64),
    /// Away from the work, to this position.
    Back(i64),
}

/// Where a search may lead, counts.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    /// Farthest position to look.
    pub end: i64,
    /// Highest to go back to.
    pub top: i64,
    /// Length to go back from an open lower limit switch.
    pub off_limit: i64,
}

/// A search under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Touching {
    config: Config,
    acceleration: CountsPerSecond2,
    bounds: Bounds,
    step: Step,
    /// It has gone back already: the gap has to be open from now on.
    backed: bool,
    first: Option<i64>,
    found: Option<i64>,
    /// It has reached the end of the travel.
    missed: bool,
    /// Farthest position since the first contact.
    farthest: i64,
}

impl Touching {
    /// Begins at rest.
    pub fn new(config: Config, acceleration: CountsPerSecond2, bounds: Bounds) -> Touching {
        Touching {
            config,
            acceleration,
            bounds,
            step: Step::Settle(SETTLE),
            backed: false,
            first: None,
            found: None,
            missed: false,
            farthest: i64::MIN,
        }
    }

    /// It goes toward the work, and a contact is what it waits for.
    pub fn approaches(&self) -> bool {
        matches!(self.step, Step::Approach(_))
    }

    /// The place found, once it is touched.
    pub fn found(&self) -> Option<i64> {
        self.found
    }

    /// Counts by which the axis was beyond the place found, so far.
    pub fn overshoot(&self) -> u32 {
        let beyond = self.found.map_or(0, |found| self.farthest.saturating_sub(found));
        beyond.clamp(0, u32::MAX.into()) as u32
    }

    /// Plans on; `ticks` have passed since the plan before.
    pub fn plan(&mut self, profile: &mut Profile, felt: &Felt, ticks: u32) -> Next {
        if self.first.is_some() {
            self.farthest = self.farthest.max(felt.position);
        }
        let (velocity, to) = match self.step {
            Step::Settle(left) => {
                let rests = profile.stands();
                let segment = profile.stop(self.acceleration, ticks);
                match (rests, left.saturating_sub(ticks), felt.touches) {
                    (false, ..) => {}
                    (true, left @ 1.., _) => self.step = Step::Settle(left),
                    (true, 0, false) => self.step = Step::Approach(self.reach()),
                    (true, 0, true) if self.backed => return Next::Ends(Search::NotOpen, None),
                    (true, 0, true) => _ = self.go_back(felt.position, self.back()),
                }
                return Next::Moves(segment);
            }
            Step::Approach(_) if felt.lower && !felt.touches => {
                self.missed = true;
                (self.config.first, self.go_back(felt.position, self.bounds.off_limit))
            }
            Step::Approach(to) if !felt.touches => {
                if profile.stands() && profile.position() == Fixed::whole(to) {
                    return Next::Ends(Search::Missed, None);
                }
                (if self.first.is_some() { self.config.second } else { self.config.first }, to)
            }
            Step::Approach(_) => {
                if self.first.is_some() {
                    self.found = Some(felt.position);
                } else {
                    (self.first, self.farthest) = (Some(felt.position), felt.position);
                }
                (self.config.first, self.go_back(felt.position, self.back()))
            }
            Step::Back(to) => {
                let there = profile.stands() && profile.position() == Fixed::whole(to);
                if there || felt.upper {
                    let segment = profile.stop(self.acceleration, ticks);
                    match (profile.stands(), self.found) {
                        (true, Some(found)) => return Next::Ends(Search::Found, Some(found)),
                        (true, None) if self.missed => return Next::Ends(Search::Missed, None),
                        (true, None) => self.step = Step::Settle(SETTLE),
                        (false, _) => {}
                    }
                    return Next::Moves(segment);
                }
                (self.config.first, to)
            }
        };
        let ramp = Ramp { velocity, acceleration: self.acceleration, deceleration: self.acceleration };
        Next::Moves(profile.toward(Fixed::whole(to), &ramp, ticks))
    }

    /// Where the touch under way ends in vain. The second one has no business far behind the first.
    fn reach(&self) -> i64 {
        let Some(first) = self.first else { return self.bounds.end };
        first.saturating_add(self.back()).min(self.bounds.end.max(first))
    }

    fn back(&self) -> i64 {
        self.config.back.into()
    }

    /// Begins to go back, and says where to.
    fn go_back(&mut self, from: i64, by: i64) -> i64 {
        let to = from.saturating_sub(by).max(self.bounds.top.min(from));
        (self.step, self.backed) = (Step::Back(to), true);
        to
    }
}
