//! Axis positioning: to a position, along a host's set points, to a reference mark.
//!
//! A *profile* is a set point that keeps within velocity, acceleration and deceleration; its target may change while it
//! moves. A *segment* is what the loop follows from one plan to the next: the set point now, and its travel in a tick. *Homing*
//! looks for a limit switch, an index mark or the work and says where the axis stood then. All of it is in encoder counts, positive
//! toward the work, and knows neither the loop nor the path.

mod homing;
mod profile;
mod s_curve;

pub use homing::{Clearance, Homing, Method, Missed, Outcome, Seen};
pub use profile::{Profile, Ramp, TrajectorySegment};
pub use s_curve::{JerkLimits, LONGEST, PART, SCurve};
