//! The inch-worm (\[R\] section 8): a hole deeper than the stroke, bored by a head that a coarse axis carries.
//!
//! Near the lower end of its travel the head switches the pulses off, goes up by a step and a clearance, and asks the host to
//! move the coarse axis toward the work by that step. When the host says that it has, or when the head has touched the bottom of
//! the hole before and after the move and so knows how far it went, the counts of the head are shifted by that distance: positions
//! stay those of the hole, and the travel moves down with the head. The erosion goes on at the same count.

use super::state::Reason;
use super::touch::Touching;
use crate::units::{Fixed, Nanometres};

/// How a move of the coarse axis is seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SeenBy {
    /// The host says how far it has moved.
    Word,
    /// The head touches the bottom of the hole before and after it; the host only says that it has ended.
    Touch,
}

/// How the head is carried.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Counts that the coarse axis is asked to move by; 0: it is not asked.
    pub step: i64,
    /// Counts above the lower end of the travel from which on it is asked.
    pub reserve: i64,
    /// Counts by which the head goes up beyond the step: so far the coarse axis may go too far.
    pub clearance: i64,
    /// Largest difference, counts, between what was asked and what was said or touched.
    pub tolerance: i64,
    /// Servo ticks after which the host is late.
    pub patience: u32,
    /// How a move is seen.
    pub seen: SeenBy,
}

/// What the host says of a coarse axis.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Carry {
    /// It has carried the head to this distance from where it was at the home, positive toward the work.
    To(Nanometres),
    /// It has moved as it was asked.
    AsAsked,
    /// It has not moved and will not.
    Refused,
}

/// How it stands to the coarse axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Inch {
    /// Nothing is asked.
    #[default]
    No,
    /// The head touches the bottom, or goes up.
    Prepares,
    /// The host is asked to move.
    Asks,
    /// The head looks for the bottom, or goes back to it.
    Returns,
    /// The host has not answered in time: it is no longer asked. The head waits above the bottom.
    Late,
    /// What the host said, or the bottom, is farther from what was asked than allowed. The head waits above the bottom.
    Contradicts,
}

impl Inch {
    /// All of them, in the order of their numbers.
    pub const ALL: [Inch; 6] = [Inch::No, Inch::Prepares, Inch::Asks, Inch::Returns, Inch::Late, Inch::Contradicts];
}

/// What a carried head does next.
#[derive(Clone, Copy, Debug)]
pub(super) enum Phase {
    /// Looks for the bottom before the move.
    Finds(Touching),
    /// Goes up to this position.
    Rises(i64),
    /// Asks, for so many ticks already.
    Asks(u32),
    /// Waits for an answer without asking.
    Waits,
    /// Looks for the bottom after the move.
    Checks(Touching),
    /// The bottom was not where it should be: goes up to this position again.
    Backs(i64),
    /// Goes back to the float point.
    Returns,
}

/// A move of the coarse axis under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Inching {
    pub phase: Phase,
    /// The bottom, where it was touched before the move, counts and fractions.
    pub bottom: Option<Fixed>,
    /// Where the set point was at the newest slow touch: it says more than a count, and trails as much each time.
    pub felt: Option<Fixed>,
    /// Where the head waits, counts.
    pub waits_at: i64,
    /// Path coordinate of the float point.
    pub float: Fixed,
    /// It sought, and had not found the work yet.
    pub seeks: bool,
    /// The erosion does not go on, and why.
    pub ends: Option<Reason>,
}
