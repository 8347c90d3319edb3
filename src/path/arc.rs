//! A circular segment: a circle whose centre goes along a straight line.
//!
//! Along the line goes whatever is not circular: the third axis of a helix, and the few nanometres by which start and end are
//! not as far from the centre as a host gave it. Both ends are therefore met exactly.

use super::Point;
use super::angle::{self, Angle, SINE_BITS};
use super::grid::Grid;
use super::line::{Line, SLOPE_BITS, product};
use super::piece::Here;
use super::shape::{Plane, Turn};
use crate::units::Fixed;

/// An arc, ready to be followed.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Arc {
    /// Way of the centre, and of the third axis.
    way: Line,
    plane: Plane,
    turn: Turn,
    /// Radius in counts of either axis of the plane.
    radius: [Fixed; 2],
    /// Counts per um of path around the circle, [`SLOPE_BITS`] places.
    rim: [i32; 2],
    /// Where it begins.
    phase: Angle,
    length: Fixed,
    /// Angle over a shifted distance, 2^-62 turn.
    rate: u32,
    /// Binary places that a distance loses (or gains, where negative), so that the length has 31 digits.
    drop: i8,
}

/// Centre and angles of an arc, as they follow from its ends.
#[derive(Clone, Copy, Debug)]
pub(super) struct Round {
    pub plane: Plane,
    pub turn: Turn,
    /// nm.
    pub radius: u32,
    /// Where it begins.
    pub phase: Angle,
    /// Angle of the arc, 2^-32 turn; a whole turn at the most.
    pub sweep: u64,
}

impl Round {
    /// From start to end around a centre that lies so far from the start, nm. Where both are one, it is a whole turn.
    pub fn new(from: [i32; 2], to: [i32; 2], centre: [i32; 2], plane: Plane, turn: Turn) -> Round {
        let [cu, cv] = centre;
        let [fu, fv] = from;
        let [tu, tv] = to;
        let end = [tu.wrapping_sub(fu).wrapping_sub(cu), tv.wrapping_sub(fv).wrapping_sub(cv)];
        let phase = angle::of([cu.wrapping_neg(), cv.wrapping_neg()]);
        let swept = angle::of(end).wrapping_sub(phase);
        let swept = if turn == Turn::Forward { swept } else { swept.wrapping_neg() };
        let sweep = if from == to || swept == 0 { 1 << 32 } else { u64::from(swept) };
        Round { plane, turn, radius: distance([cu, cv]), phase, sweep }
    }

    /// Length around the circle, nm.
    pub fn length(&self) -> u64 {
        // 2 pi with 20 places.
        (u64::from(self.radius).wrapping_mul(self.sweep) >> 20).wrapping_mul(6_588_397) >> 32
    }

    /// Whether it comes past an angle.
    pub fn passes(&self, angle: Angle) -> bool {
        let gone = angle.wrapping_sub(self.phase);
        let gone = if self.turn == Turn::Forward { gone } else { gone.wrapping_neg() };
        u64::from(gone) <= self.sweep
    }
}

/// Length of a vector in nm, rounded down.
pub(super) fn distance([u, v]: [i32; 2]) -> u32 {
    let square = |x: i32| u64::from(x.unsigned_abs()).wrapping_mul(u64::from(x.unsigned_abs()));
    square(u).wrapping_add(square(v)).isqrt() as u32
}

impl Arc {
    /// From start to end, both in counts, with a length in um that is more than 0.
    pub(super) fn new(from: Point, to: Point, round: &Round, length: Fixed, grid: &Grid) -> Arc {
        // A length of 31 binary digits.
        let drop = (33i8).wrapping_sub(length.0.leading_zeros() as i8);
        let scaled = shifted(length, drop);
        let rate = (round.sweep << 30).checked_div(u64::from(scaled)).unwrap_or(0).min(u32::MAX.into()) as u32;
        let [gu, gv, _] = round.plane.pick(grid.0);
        let radius = [gu, gv].map(|nm_per_count| Grid::counts(round.radius.into(), nm_per_count));
        let around = round.length();
        // Share of the path that goes around, then counts per um.
        let nm = (length.0 >> 14) as u64;
        let share = (around << 22).checked_div(nm).unwrap_or(0).wrapping_mul(1024).checked_div(1000).unwrap_or(0);
        let rim = [gu, gv].map(|nm_per_count| {
            let slope =
                share.wrapping_mul(1000 << (SLOPE_BITS - 22)).checked_div(nm_per_count.unsigned_abs()).unwrap_or(0);
            let slope = slope.min(i32::MAX as u64) as i32;
            if round.turn == Turn::Forward { slope } else { slope.wrapping_neg() }
        });
        let mut arc = Arc {
            way: Line::point(from),
            plane: round.plane,
            turn: round.turn,
            radius,
            rim,
            phase: round.phase,
            length,
            rate,
            drop,
        };
        let centre = |end: Point, circle: Point| {
            let [a, b, c] = end;
            let [x, y, z] = circle;
            [a.minus(x), b.minus(y), c.minus(z)]
        };
        let begin = centre(from, arc.circle(angle::cos_sin(arc.phase)));
        let end = centre(to, arc.circle(angle::cos_sin(arc.angle(length))));
        arc.way = Line::new(begin, end, length);
        arc
    }

    /// Length, um.
    pub fn length(&self) -> Fixed {
        self.length
    }

    /// See [`Segment::here`](super::Segment::here).
    #[inline(never)]
    pub(super) fn here(&self, distance: Fixed) -> Here {
        let turned = angle::cos_sin(self.angle(distance));
        let [cosine, sine] = turned;
        let [ru, rv] = self.rim;
        let part = |rim: i32, share: i32| (i64::from(rim).wrapping_mul(i64::from(share)) >> SINE_BITS) as i32;
        let rim = self.plane.put([part(ru, sine.wrapping_neg()), part(rv, cosine), 0]);
        let mut here = self.way.here(distance);
        for (at, around) in here.at.iter_mut().zip(self.circle(turned)) {
            *at = at.near(around);
        }
        for (slope, around) in here.slope.iter_mut().zip(rim) {
            *slope = slope.saturating_add(around);
        }
        here
    }

    #[inline]
    fn angle(&self, distance: Fixed) -> Angle {
        let along = distance.max(Fixed(0)).min(self.length);
        let gone = (u64::from(shifted(along, self.drop)).wrapping_mul(self.rate.into()) >> 30) as u32;
        if self.turn == Turn::Forward { self.phase.wrapping_add(gone) } else { self.phase.wrapping_sub(gone) }
    }

    /// Counts from the centre.
    #[inline]
    fn circle(&self, [cosine, sine]: [i32; 2]) -> Point {
        let [u, v] = self.radius;
        self.plane.put([product::<SINE_BITS>(u, cosine), product::<SINE_BITS>(v, sine), Fixed(0)])
    }
}

#[inline(always)]
fn shifted(x: Fixed, drop: i8) -> u32 {
    if drop >= 0 { (x.0 >> drop) as u32 } else { (x.0 << drop.unsigned_abs()) as u32 }
}
