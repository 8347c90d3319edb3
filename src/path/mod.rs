//! The path: a register that shifts both ways.
//!
//! *Path coordinate* `s` is the length travelled along the queued segments, positive toward the work. It goes forward on
//! feed and backward on retreat; axis setpoints are pure functions of `s`. Ratios between axes are therefore exact by
//! construction, and a retrace returns to the same counts, always. (The per-axis shift registers of \[R\] section 6.7.1 run
//! asynchronously and drift in ratio; one coordinate for all axes cannot.)
//!
//! *Segment*: one piece of path, a file of its own. Another kind is another file and one line in its list (`segment.rs`).

mod line;
mod register;
mod segment;

pub use line::Line;
pub use register::{AHEAD, BEHIND, Bound, Refused, Register};
pub use segment::Segment;

/// Axes that one head drives.
pub const AXES: usize = 1;
