//! What a path is made of: pieces as a host gives them, and packed as the register keeps them.

use super::arc::{Arc, Round, distance};
use super::grid::{Grid, Place, REACH, counts, length, length_um};
use super::line::{Line, SLOPE_BITS, product};
use super::shape::{Plane, Shape};
use super::{AXES, Point};
use crate::units::Fixed;
use core::fmt;

/// Smallest and largest radius, nm.
pub const RADII: (i64, i64) = (10_000, 1 << 29);
/// By how much start and end of an arc may differ in their distance from its centre, nm: as much as coordinates in whole um
/// bring about.
pub const INCONSISTENCY: i64 = 2_000;

/// Jumps of direction that are as good as none: rounding of coordinates.
const SMOOTH: f32 = 0.002;
/// Parts of a corner: a jump of 2, back along the same line, takes 254.
const CORNER: f32 = 127.0;

/// A piece of path, from where the one before ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Piece {
    /// What it looks like.
    pub shape: Shape,
    /// Where it ends: down, X, Y, nm.
    pub to: [i64; AXES],
    /// Centre of an arc less its start, along first and second axis of the plane, nm.
    pub centre: [i32; 2],
    /// A working retreat does not go back behind its beginning.
    pub mark: bool,
    /// An erosion ends at its end, and the next one continues from there.
    pub stop: bool,
}

/// Why a piece was refused. Nothing was changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Refused {
    /// [`super::AHEAD`] segments wait already.
    QueueFull,
    /// From the end of the path to the end of the path.
    NoLength,
    /// An end farther than [`REACH`] from where the path begins.
    TooFar {
        /// Along this axis: 0 down, 1 X, 2 Y.
        axis: u8,
    },
    /// A radius outside [`RADII`].
    Radius {
        /// The radius, nm.
        nm: u32,
    },
    /// Start and end of an arc are not as far from the centre.
    Inconsistent {
        /// Distance of the start, nm.
        start: u32,
        /// Distance of the end, nm.
        end: u32,
    },
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (least, most) = RADII;
        match self {
            Refused::QueueFull => f.write_str("the path queue is full"),
            Refused::NoLength => f.write_str("the piece of path has no length"),
            Refused::TooFar { axis } => {
                write!(f, "axis {axis} would be led farther than {REACH} nm from where the path begins")
            }
            Refused::Radius { nm } => write!(f, "a radius of {nm} nm is outside {least} to {most} nm"),
            Refused::Inconsistent { start, end } => {
                write!(
                    f,
                    "start and end are {start} and {end} nm from the centre, which may differ by {INCONSISTENCY} nm"
                )
            }
        }
    }
}

impl core::error::Error for Refused {}

/// A segment as the register keeps it: 28 bytes. It begins where the one before ends.
#[derive(Clone, Copy, Debug)]
pub(super) struct Packed {
    pub to: Place,
    /// As [`length`] gives it.
    length: u32,
    centre: [i32; 2],
    shape: Shape,
    pub mark: bool,
    pub stop: bool,
    /// Jump of direction at its beginning, in parts of [`CORNER`].
    corner: u8,
}

/// A segment, ready to be followed.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
// A line is 0 in memory: an empty register then is, and needs no image of 36 kB in flash.
#[repr(u8)]
pub enum Segment {
    /// Straight.
    Line(Line),
    /// Circular.
    Arc(Arc),
}

impl Packed {
    /// Packs a piece that begins at a place; `to` is its end from where the path begins.
    pub fn new(from: Place, to: Place, piece: &Piece) -> Result<Packed, Refused> {
        let mut travel = [0u32; AXES];
        for (travel, (from, to)) in travel.iter_mut().zip(from.iter().zip(&to)) {
            *travel = to.abs_diff(*from);
        }
        let length = match piece.shape.arc() {
            None => length(travel.map(u64::from)),
            Some((plane, _)) => {
                let round = Packed::round(from, to, piece.centre, piece.shape).ok_or(Refused::NoLength)?;
                let (least, most) = RADII;
                if !(least..=most).contains(&i64::from(round.radius)) {
                    return Err(Refused::Radius { nm: round.radius });
                }
                let [fu, fv, _] = plane.pick(from);
                let [tu, tv, _] = plane.pick(to);
                let [cu, cv] = piece.centre;
                let off = |t: i32, f: i32, c: i32| t.saturating_sub(f).saturating_sub(c);
                let end = distance([off(tu, fu, cu), off(tv, fv, cv)]);
                if i64::from(end.abs_diff(round.radius)) > INCONSISTENCY {
                    return Err(Refused::Inconsistent { start: round.radius, end });
                }
                let [_, _, along] = plane.pick(travel);
                // What the ends differ by is gone as well: the way of the centre is not steeper than a line is.
                length([round.length(), along.into(), end.abs_diff(round.radius).into()])
            }
        };
        if length == 0 {
            return Err(Refused::NoLength);
        }
        let Piece { shape, centre, mark, stop, .. } = *piece;
        Ok(Packed { to, length, centre, shape, mark, stop, corner: 0 })
    }

    /// Length, um.
    pub fn length(&self) -> Fixed {
        length_um(self.length)
    }

    /// Makes it ready; `start` is where it begins, in counts, `datum` where the path does.
    pub fn unpack(&self, from: Place, start: Point, datum: &Point, grid: &Grid) -> Segment {
        let end = counts(self.to, datum, grid);
        match Packed::round(from, self.to, self.centre, self.shape) {
            None => Segment::Line(Line::new(start, end, self.length())),
            Some(round) => Segment::Arc(Arc::new(start, end, &round, self.length(), grid)),
        }
    }

    fn round(from: Place, to: Place, centre: [i32; 2], shape: Shape) -> Option<Round> {
        let (plane, turn) = shape.arc()?;
        let [fu, fv, _] = plane.pick(from);
        let [tu, tv, _] = plane.pick(to);
        Some(Round::new([fu, fv], [tu, tv], centre, plane, turn))
    }

    /// How far down and up it leads at the most, nm from where the path begins.
    pub fn extent(&self, from: Place) -> (i32, i32) {
        let [start, ..] = from;
        let [end, ..] = self.to;
        let (mut least, mut most) = (start.min(end), start.max(end));
        if let Some(round) = Packed::round(from, self.to, self.centre, self.shape) {
            let radius = round.radius as i32;
            let [cu, cv] = self.centre;
            let (centre, top) = match round.plane {
                Plane::Xy => return (least, most),
                Plane::Zx => (start.saturating_add(cu), 0u32),
                Plane::Yz => (start.saturating_add(cv), 1 << 30),
            };
            if round.passes(top) {
                most = most.max(centre.saturating_add(radius));
            }
            if round.passes(top.wrapping_add(1 << 31)) {
                least = least.min(centre.saturating_sub(radius));
            }
        }
        (least, most)
    }

    /// Remembers how much the direction jumps at its beginning, from that of the one before; both of length 1.
    pub fn join(&mut self, before: [f32; AXES], after: [f32; AXES]) {
        let jump = jump(before, after);
        self.corner = if jump < SMOOTH { 0 } else { libm::ceilf(jump * CORNER) as u8 };
    }

    /// Jump of direction at its beginning: 0 for none, 2 for back along the same line. Never less than it is.
    pub fn corner(&self) -> f32 {
        f32::from(self.corner) * (1.0 / CORNER)
    }
}

/// How much a direction jumps: 2 for back along the same line; both of length 1.
pub(super) fn jump(before: [f32; AXES], after: [f32; AXES]) -> f32 {
    let mut square = 0.0;
    for (before, after) in before.iter().zip(&after) {
        square += (after - before) * (after - before);
    }
    libm::sqrtf(square)
}

impl Segment {
    /// What is at a distance from the start. Outside 0..=length it is what is at the nearer end.
    pub(super) fn here(&self, distance: Fixed) -> Here {
        match self {
            Segment::Line(line) => line.here(distance),
            Segment::Arc(arc) => arc.here(distance),
        }
    }

    /// Length, um.
    pub fn length(&self) -> Fixed {
        match self {
            Segment::Line(line) => line.length(),
            Segment::Arc(arc) => arc.length(),
        }
    }
}

/// What is at a place: worked out once, when the head gets there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Here {
    /// Set points of all axes, counts.
    pub at: Point,
    /// Counts per um of path, [`SLOPE_BITS`] binary places.
    pub slope: [i32; AXES],
}

impl Here {
    /// Axis travel for a short travel along the path, counts.
    #[inline(always)]
    pub fn travel(&self, by: Fixed) -> Point {
        self.slope.map(|slope| product::<SLOPE_BITS>(by, slope))
    }

    /// Axis travel per path travel, counts per um.
    #[inline(always)]
    pub fn direction(&self) -> [f32; AXES] {
        self.slope.map(|slope| slope as f32 * (1.0 / (1u32 << SLOPE_BITS) as f32))
    }
}
