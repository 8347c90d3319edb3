//! The scope of the servo tick: up to eight signals, one sample every 50 us or slower, recorded into a ring.
//!
//! - A *bank* is a ring of samples with a header that says what is in it. It lies in memory that start-up does not touch, so that a
//!   complete record is still there after a reset; the header's sum tells it from noise.
//! - The *record* of a host is that of [`Recorder`] in the large bank. It waits for a [`Trigger`] and keeps a share of the ring from before.
//! - A *snapshot* is what the head has done around a fault, recorded by itself every second millisecond ([`Snapshots`]). Two banks take turns: the
//!   last snapshot stays until the next fault, through a reset as well.
//!
//! The servo task alone writes; the protocol reads a bank only once its task has announced that it is complete.

mod bank;
mod recorder;
mod signal;
mod snapshot;

pub use bank::{Bank, HEADER, Memory, STREAM_HEADER};
pub use recorder::{Phase, Recorder, Setup, Trigger};
pub use signal::{Scales, Signal, View};
pub use snapshot::{Kept, SNAPSHOT_SIGNALS, Snapshots};

#[cfg(not(target_os = "none"))]
pub use signal::SIGNAL_TEXTS;

/// Signals of a record.
pub const SIGNALS: usize = 8;
/// Words of a record: 16 KiB.
pub const RECORD: usize = 4096;
/// Words of a snapshot: 128 samples of eight signals.
pub const SNAPSHOT: usize = 1024;
