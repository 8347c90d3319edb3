//! What cases expect: times in us, and names of faults.
//!
//! Expected times come from what finds the fault: contacts stop within the window of 50 us in which the bench opens them and
//! the next; what the live signal finds is off when the monostable has expired, in 0.4 ms; the supervision runs once a
//! millisecond, with the times of its settings.

/// Pulses off at once, by contact or break: the window of the event and the next, us.
pub const CONTACT_US: f64 = 110.0;
/// The live signal: the monostable of 0.4 ms, and up to a millisecond until a task counts as silent.
pub const LIVE_US: f64 = 1_600.0;
/// Monitored by the supervision within a few milliseconds: its own period, limits of 10 ms.
pub const SUPERVISED_US: f64 = 15_000.0;
/// The same of a hand with 30 N against the 22 N that the motor has: 7 ms until it has the head `supervise.following_um` away.
pub const HAND_US: f64 = SUPERVISED_US + 7_000.0;
/// `supervise.gap_ms`, and what its average takes.
pub const GAP_US: f64 = 45_000.0;
/// Nine of ten samples find an arc, and 120 of 200 are too many for 50 ms: 134 + 50 ms, and chance; 314 ms where the samples
/// are in phase with the pulses, and half of them find one.
pub const ARC_US: f64 = 350_000.0;
/// A host is silent after the 400 ms of its 1016h.
pub const HOST_US: f64 = 520_000.0;
/// A stopped encoder is found when the head has to move: while it erodes that takes a while.
pub const STANDS_US: f64 = 1_000_000.0;
/// A short that a retreat does not clear: two retreats along the path.
pub const SHORT_US: f64 = 3_000_000.0;
/// Pulses continue.
pub const ON: f64 = f64::INFINITY;
/// A seek measures the open-circuit voltage before it feeds.
pub const SEEK_US: f64 = 200_000.0;

/// Reports of an encoder fault, whichever check finds it first: the lift is the same.
pub const ENCODER: &[&str] = &["encoder lost", "following error"];
/// Reports of an invalid gap signal.
pub const SIGNAL: &[&str] = &["gap signal invalid", "gate missing"];
/// The reflex is lost.
pub const REFLEX: &[&str] = &["reflex lost"];
/// The live signal is lost.
pub const LIVE: &[&str] = &["live signal lost"];
