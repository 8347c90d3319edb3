//! What passes between tasks of different priority.
//!
//! A *crossing* is a place where data leaves one task and enters another that may interrupt it, or be interrupted by it: on
//! the chip two interrupt priorities of one Cortex-M4 core, on a PC nested calls or threads. There are three kinds and no
//! other:
//!
//! | kind | for | when the other side is slow |
//! | --- | --- | --- |
//! | [`latest`] | configuration, status: the newest value wins | older values are skipped, a write is never refused |
//! | [`ring`] | events: each one counts | what does not fit is counted as lost |
//! | [`atomic`] | one word that says everything | it is overwritten |
//!
//! Neither side waits for the other. So a crossing has no lock, no priority and no deadline of its own. Each has one
//! writer and one reader, which the borrow of `split` enforces; the exceptions among the atomics are named there.
//!
//! All of it is sound for threads too, not only for one core: `tests/model.rs` tries every order of two threads' steps
//! that the memory model of C11 allows (loom), with the atomics of this package swapped by `cfg(loom)`.
//!
//! On a PC one thread can run all tasks: with the feature `preempt` every operation calls [`preempt::point`] before and after
//! each of its steps, and a scheduler that hooks in there runs a task of higher priority as a nested call, which is what an
//! interrupt is to the one that it interrupts. Without the feature the points are empty.
//!
//! The control core forbids `unsafe`; apart from registers, this package is where it is.

#![no_std]

#[cfg(feature = "preempt")]
extern crate std;

pub mod atomic;
pub mod latest;
pub mod preempt;
pub mod ring;
mod sync;

pub use atomic::{Counter, Flag, Word};
pub use latest::{Latest, Reader, Verdict, Writer};
pub use ring::{Receiver, Ring, Sender};
