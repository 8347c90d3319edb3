//! The list of segment kinds.

use super::Line;
use crate::units::Fixed;

macro_rules! segments {
    ($($(#[$doc:meta])* $kind:ident),+ $(,)?) => {
        /// One piece of path, of any kind.
        #[derive(Clone, Copy, Debug, PartialEq)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub enum Segment<const A: usize> {
            $($(#[$doc])* $kind($kind<A>),)+
        }

        $(impl<const A: usize> From<$kind<A>> for Segment<A> {
            fn from(kind: $kind<A>) -> Self {
                Segment::$kind(kind)
            }
        })+

        impl<const A: usize> Segment<A> {
            /// Length, um.
            pub fn length(&self) -> Fixed {
                match self { $(Segment::$kind(kind) => kind.length(),)+ }
            }
            /// End point, counts.
            pub fn end(&self) -> [Fixed; A] {
                match self { $(Segment::$kind(kind) => kind.end(),)+ }
            }
            /// Axis setpoints at a distance from the start, counts.
            pub fn at(&self, distance: Fixed) -> [Fixed; A] {
                match self { $(Segment::$kind(kind) => kind.at(distance),)+ }
            }
            /// Axis travel for a short travel `by` along the path from a distance from the start, counts.
            pub fn travel(&self, distance: Fixed, by: Fixed) -> [Fixed; A] {
                match self { $(Segment::$kind(kind) => kind.travel(distance, by),)+ }
            }
            /// Axis travel per path travel at a distance from the start, counts per um.
            pub fn direction(&self, distance: Fixed) -> [f32; A] {
                match self { $(Segment::$kind(kind) => kind.direction(distance),)+ }
            }
        }
    };
}

segments! {
    /// Straight.
    Line,
}
