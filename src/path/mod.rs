//! The path: a register that shifts both ways.
//!
//! *Path coordinate* `s` is the length travelled along the queued segments, positive toward the work. It goes forward on
//! feed and backward on retreat; axis setpoints are pure functions of `s`. Ratios between axes are therefore exact by
//! construction, and a retrace returns to the same counts, always. (The per-axis shift registers of \[R\] section 6.7.1 run
//! asynchronously and drift in ratio; one coordinate for all axes cannot.)
//!
//! *Piece*: what a host queues, a line or an arc in one of three planes. *Segment*: the same in the register, packed; the one
//! under way is unpacked when a joint is crossed, so that a tick only multiplies. Everything is in whole numbers.
//!
//! The first axis is the head's own, down; X and Y are set points for other drives.

mod angle;
mod arc;
mod grid;
mod line;
mod piece;
mod register;
mod shape;

pub use arc::Arc;
pub use grid::REACH;
pub use line::Line;
pub use piece::{INCONSISTENCY, Piece, RADII, Refused, Segment};
pub use register::{AHEAD, BEHIND, Bound, Register};
pub use shape::{Plane, Shape, Turn};

use crate::units::Fixed;

/// Axes of a path: down, X and Y.
pub const AXES: usize = 3;
/// nm per count of the other axes: their set points are in um.
pub const BESIDE_NM: i64 = 1000;
/// Set points of all axes, counts.
pub type Point = [Fixed; AXES];
/// The path of a head, with everything that it can retrace: 36 kB.
pub type Path = Register<{ AHEAD + BEHIND + 1 }>;
