//! The planes of arcs, and the shapes of pieces.

use super::AXES;

/// The plane of an arc. The axes of a path are the head's own, down, then X and Y.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Plane {
    /// X and Y (G17): a helix goes down.
    Xy,
    /// Down and X (G18).
    Zx,
    /// Y and down (G19).
    Yz,
}

impl Plane {
    /// First and second axis of the plane, then the third.
    #[inline(always)]
    pub(super) fn pick<T>(self, [down, x, y]: [T; AXES]) -> [T; AXES] {
        match self {
            Plane::Xy => [x, y, down],
            Plane::Zx => [down, x, y],
            Plane::Yz => [y, down, x],
        }
    }

    /// The reverse of [`Plane::pick`].
    #[inline(always)]
    pub(super) fn put<T>(self, [u, v, w]: [T; AXES]) -> [T; AXES] {
        match self {
            Plane::Xy => [w, u, v],
            Plane::Zx => [u, v, w],
            Plane::Yz => [v, w, u],
        }
    }
}

/// Which way around.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Turn {
    /// From the first axis of the plane toward the second.
    Forward,
    /// From the second toward the first.
    Backward,
}

/// What a piece of path looks like, by the numbers of 200Eh:6.
///
/// An arc goes around a centre in a plane, the third axis going along evenly. Back to where it begins in the plane it is a whole
/// turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Shape {
    /// Straight.
    Line,
    /// In X-Y, from X toward Y.
    Xy,
    /// In X-Y, from Y toward X.
    XyBack,
    /// In down-X, from down toward X.
    Zx,
    /// In down-X, from X toward down.
    ZxBack,
    /// In Y-down, from Y toward down.
    Yz,
    /// In Y-down, from down toward Y.
    YzBack,
}

impl Shape {
    /// All, by their numbers.
    pub const ALL: [Shape; 7] =
        [Shape::Line, Shape::Xy, Shape::XyBack, Shape::Zx, Shape::ZxBack, Shape::Yz, Shape::YzBack];

    /// By its number.
    pub fn from_number(number: u8) -> Option<Shape> {
        Shape::ALL.get(usize::from(number)).copied()
    }

    /// An arc in a plane.
    pub fn of(plane: Plane, turn: Turn) -> Shape {
        match (plane, turn) {
            (Plane::Xy, Turn::Forward) => Shape::Xy,
            (Plane::Xy, Turn::Backward) => Shape::XyBack,
            (Plane::Zx, Turn::Forward) => Shape::Zx,
            (Plane::Zx, Turn::Backward) => Shape::ZxBack,
            (Plane::Yz, Turn::Forward) => Shape::Yz,
            (Plane::Yz, Turn::Backward) => Shape::YzBack,
        }
    }

    /// Plane and turn of an arc.
    pub fn arc(self) -> Option<(Plane, Turn)> {
        match self {
            Shape::Line => None,
            Shape::Xy => Some((Plane::Xy, Turn::Forward)),
            Shape::XyBack => Some((Plane::Xy, Turn::Backward)),
            Shape::Zx => Some((Plane::Zx, Turn::Forward)),
            Shape::ZxBack => Some((Plane::Zx, Turn::Backward)),
            Shape::Yz => Some((Plane::Yz, Turn::Forward)),
            Shape::YzBack => Some((Plane::Yz, Turn::Backward)),
        }
    }
}
